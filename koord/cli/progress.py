"""The live line of progress, and Ctrl-C as a request rather than a crash."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TextIO

from koord.api.progress import Cancellation
from koord.cli.terminal import cells, is_terminal, style_of, visible

#: Often enough to look alive, seldom enough to cost nothing.
TICK_S = 0.2

#: A Ctrl-C that nobody has looked at for so long insists by itself.
INSIST_S = 1.0

#: Windows has none.
_HAS_TIMER = hasattr(signal, "setitimer")

_ERASE = "\r\x1b[K"


class LiveLine:
    """A line on a terminal that overwrites itself; nothing at all in a pipe or a file.

    The time goes on ticking while a solver works, because a thread of its own writes the line, from
    the first text on::

        with LiveLine(sys.stderr) as line:
            line.show("bmc, round 3 of 20")  # -> bmc, round 3 of 20, 1.4 s
        print(results)  # the line is gone
    """

    def __init__(
        self,
        stream: TextIO | None,
        *,
        clock: Callable[[], float] = time.monotonic,
        tick_s: float = TICK_S,
    ) -> None:
        self._stream = stream if is_terminal(stream) else None
        self._clock = clock
        self._tick_s = tick_s
        self._text = ""
        self._written = False
        self._started = 0.0
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> LiveLine:
        self._started = self._clock()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        if self._thread is not None:
            self._thread.join()
        self.clear()

    def show(self, text: str) -> None:
        """Set the text of the line. Cheap: it is written with the next tick."""
        self._text = text
        if self._stream is not None and self._thread is None:
            self._thread = threading.Thread(target=self._tick, name="live line", daemon=True)
            self._thread.start()

    def clear(self) -> None:
        """Wipe the line, so that something else can be printed where it stood."""
        with self._lock:
            if self._stream is not None and self._written:
                self._write(_ERASE)
                self._written = False

    def _tick(self) -> None:
        while not self._done.wait(self._tick_s):
            with self._lock:
                if self._text and self._stream is not None:
                    self._write(_ERASE + self._line())
                    self._written = True

    def _line(self) -> str:
        elapsed = f", {self._clock() - self._started:.1f} s"
        room = style_of(self._stream).width - 1 - len(elapsed)
        text = visible(self._text)
        while cells(text) > room:
            text = text[:-1]
        return text + elapsed

    def _write(self, text: str) -> None:
        assert self._stream is not None
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):
            self._stream = None  # the terminal went away; the work goes on


class Interruption(Cancellation):
    """Cancellation by Ctrl-C: the first one asks the work to end, the second one insists.

    Inside the ``with`` the first Ctrl-C cancels the work, which looks between its steps whether
    that is so; a second one raises KeyboardInterrupt, and so does the first where the work does not
    look in time, unless it is ``patient``: of work whose end takes its time.
    """

    def __init__(self, *, patient: bool = False) -> None:
        super().__init__()
        self._insists = _HAS_TIMER and not patient
        self._previous: object = None
        self._previous_alarm: object = None

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.signal(signal.SIGINT, self._on_signal)
            if self._insists:
                self._previous_alarm = signal.signal(signal.SIGALRM, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        if self._previous is not None:
            if self._insists:
                signal.setitimer(signal.ITIMER_REAL, 0)
                signal.signal(signal.SIGALRM, self._previous_alarm)  # type: ignore[arg-type]
            signal.signal(signal.SIGINT, self._previous)  # type: ignore[arg-type]
            self._previous = None

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.cancel()
        if self._insists:
            signal.setitimer(signal.ITIMER_REAL, INSIST_S)


class TimeUpError(Exception):
    """Raised where the time limit is reached."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Within the context, raise TimeUpError at a time limit, for work that checks no deadline.

    What is half done by then is lost. Where there are no timers, it takes as long as it takes.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if seconds is None or not _HAS_TIMER or not is_main:
        yield
        return
    previous = signal.signal(signal.SIGALRM, _time_is_up)
    # A timer of zero would never ring.
    signal.setitimer(signal.ITIMER_REAL, max(1e-6, seconds))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


def _time_is_up(number: int, frame: FrameType | None) -> None:
    raise TimeUpError
