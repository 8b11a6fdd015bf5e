"""Clocks of others: when something was measured, by ours."""

from __future__ import annotations

import math

#: The clocks of others, and of simulated ones on busy machines, differ by this share at most.
_DRIFT = 0.02

#: Whose time runs backwards by more has been started again; or at all, after so long a silence.
_RESTART_S = 1.0


class RemoteClock:
    """A clock of which is known when messages left it, and when they were read here.

    What waited in a queue left earlier than it was read. The shortest way that there was counts as
    the way that messages take.
    """

    def __init__(self) -> None:
        self._offset_s: float | None = None  #: our clock when this one was at 0
        self._sent_s = 0.0
        self._now_s = -math.inf

    def hear(self, sent_s: float, now_s: float) -> None:
        """Take note of a message that left at a time of that clock and is read now.

        Time does not run backwards: whoever says an earlier one has waited since.
        """
        silent_s = max(0.0, now_s - self._now_s)
        now_s = self._now_s = max(now_s, self._now_s)
        offset_s = now_s - sent_s
        back_s = self._sent_s - sent_s
        is_another = back_s > (0.0 if silent_s > _RESTART_S else _RESTART_S)
        if self._offset_s is not None and not is_another:
            drift_s = _DRIFT * max(0.0, sent_s - self._sent_s)
            offset_s = min(offset_s, self._offset_s + drift_s)
        self._offset_s, self._sent_s = offset_s, sent_s

    def ours(self, stamp_s: float) -> float:
        """Our time of a stamp of that clock, of which something was heard."""
        assert self._offset_s is not None, "hear comes first"
        return stamp_s + self._offset_s
