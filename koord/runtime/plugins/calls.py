"""Calls of what others have written: whatever it does, it is named, and who called goes on."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias, TypeVar

from msgspec import Struct

from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import NOWHERE

Answer = TypeVar("Answer")

#: What is to be called; None at the end.
_Asked: TypeAlias = "SimpleQueue[Callable[[], Any] | None]"

#: What came of each call.
_Answered: TypeAlias = "SimpleQueue[tuple[Any, Exception | None]]"


class PlugIn(Struct, frozen=True):
    """A plug-in as a configuration names it."""

    value: str  #: its name
    options: bytes = b"{}"  #: as JSON


class PlugInError(KoordError):
    """Raised for a plug-in that raises, blocks or answers nonsense. (P-OWN)"""

    def __init__(self, what: str, story: str, cure: str, row: int = 0) -> None:
        super().__init__((Diagnostic("K932", Severity.ERROR, NOWHERE, f"{what} {story}", cure),))
        self.what, self.story, self.cure, self.row = what, story, cure, row

    def of(self, pid: int) -> PlugInError:
        """The same, with the robot."""
        return PlugInError(f"robot {pid}: {self.what}", self.story, self.cure)

    @property
    def told(self) -> str:
        """What people should know, in a line."""
        return f"{self.what} {self.story}: {self.cure}"

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.what, self.story, self.cure, self.row)


class Guarded:
    """The calls of one plug-in, in a thread of their own, so that nobody waits for it for long.

    The thread ends with it.
    """

    def __init__(self, what: str, limit_s: float) -> None:
        self.what, self._limit_s = what, limit_s
        self._asked: _Asked | None = None
        self._answered: _Answered = SimpleQueue()
        self._since_s: float | None = None  #: since when a call goes on that nobody waits for

    def call(self, function: Callable[[], Answer]) -> Answer:
        """Call it. Raises PlugInError for what it raises, and if it takes too long."""
        if self._since_s is not None:
            self._wait_again(self._since_s)
        if self._asked is None:
            self._asked = SimpleQueue()
            queues = self._asked, self._answered
            threading.Thread(target=_serve, args=queues, name=self.what, daemon=True).start()
            weakref.finalize(self, self._asked.put, None)
        self._asked.put(function)
        try:
            answer, error = self._answered.get(timeout=self._limit_s)
        except Empty:
            self._since_s = time.monotonic() - self._limit_s
            self._wait_again(self._since_s)
            raise AssertionError from None
        if isinstance(error, PlugInError):
            raise error
        if error is not None:
            story = f"raised {type(error).__name__}: {error}"
            raise PlugInError(self.what, story, "mend it; KOORD_DEBUG=1 shows where") from error
        found: Answer = answer
        return found

    def _wait_again(self, since_s: float) -> None:
        """Look whether a call that took too long is over. Raises PlugInError if not."""
        try:
            self._answered.get_nowait()
        except Empty:
            story = f"has not answered for {time.monotonic() - since_s:.1f} s"
            cure = f"it has {self._limit_s:g} s: do what takes longer in a thread of its own"
            raise PlugInError(self.what, story, cure) from None
        self._since_s = None


def _serve(asked: _Asked, answered: _Answered) -> None:
    while (function := asked.get()) is not None:
        try:
            answered.put((function(), None))
        except Exception as error:
            answered.put((None, error))
        del function  # it may hold who is to be gone
