"""What a Crazyflie is asked for, one thing at a time, until it is so."""

from __future__ import annotations

import math
from enum import Enum, auto

#: A request is repeated after this, in s: if nobody answered, and if it was answered.
_UNANSWERED_S, _ANSWERED_S = 0.2, 1.0


class Request(Enum):
    """What it may be asked for."""

    ARMING = auto()  #: and disarming
    LANDING = auto()


class Requests:
    """The last request, and what was said to it."""

    def __init__(self) -> None:
        self._asked: Request | None = None
        self._asked_s = self._answered_s = -math.inf
        self._error: int | None = None

    def is_due(self, request: Request, now_s: float) -> bool:
        """Return whether it is to be asked for now, for the first time or again."""
        if self._asked is not request:
            self.forget()
        pause_s = _UNANSWERED_S if self._answered_s < self._asked_s else _ANSWERED_S
        if now_s - self._asked_s < pause_s:
            return False
        self._asked, self._asked_s = request, now_s
        return True

    def hear(self, error: int | None, now_s: float) -> None:
        """Take note of an answer; None: it was agreed to."""
        self._answered_s, self._error = now_s, error

    def refusal(self, request: Request) -> int | None:
        """With which error a request was refused last; None: it was not."""
        return self._error if self._asked is request else None

    def forget(self) -> None:
        """Take what was asked for as done, or as no longer wanted."""
        self._asked = self._error = None
        self._asked_s = self._answered_s = -math.inf
