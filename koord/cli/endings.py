"""SIGTERM and SIGHUP end a command as Ctrl-C does: in good order, with exit codes of their own."""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType
from typing import Any

from koord.cli.exits import Exit

#: What asks a process to end, and the exit code then. Windows has no SIGHUP.
_CODES = {
    getattr(signal, name): code
    for name, code in (("SIGTERM", Exit.TERMINATED), ("SIGHUP", Exit.HUNG_UP))
    if hasattr(signal, name)
}


class Endings:
    """Inside the ``with``, who asks this process to end is heard as Ctrl-C is."""

    def __init__(self) -> None:
        self.by: int | None = None  #: the signal that ended it
        self._pid = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Endings:
        self._pid = os.getpid()
        if threading.current_thread() is threading.main_thread():
            for number in _CODES:
                # Under nohup a hang-up is to be ignored.
                if signal.getsignal(number) is signal.SIG_DFL:
                    self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def code(self, code: int) -> int:
        """The exit code of the command, which would have been this one."""
        if self.by is None or code != Exit.INTERRUPTED:
            return code
        return _CODES[self.by]

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if os.getpid() != self._pid:
            # A process that was forked from this one has nothing to bring to an end.
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        self.by = number
        interrupted = signal.getsignal(signal.SIGINT)
        if not callable(interrupted):
            raise KeyboardInterrupt
        interrupted(signal.SIGINT, frame)
