"""Several robots of a run in one process, which take turns. (decision record 0114)"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.runtime.node import Clock
from koord.runtime.transports.shared import SharedEnd, SharedUdp

#: Instead of a time: there are no more steps.
_OVER = -1.0


class Going(Struct, eq=False):
    """A robot that goes on by steps, and when its next one is due if nothing is heard before."""

    end: SharedEnd
    steps: Iterator[float | None]  #: each says for how long there is nothing to do, if it knows
    due_at: float = 0.0


def run_together(shared: SharedUdp, robots: Iterable[Going], clock: Clock) -> None:
    """Let robots take turns until all of them have ended: who has mail, or whose step is due."""
    going = list(robots)
    while going:
        now = clock()
        is_over = False
        for one in going:
            if one.due_at > now and not one.end.has_mail:
                continue
            rests_s = next(one.steps, _OVER)
            if rests_s is _OVER:
                is_over, one.due_at = True, _OVER
            else:
                one.due_at = clock() + (one.end.wanted_s if rests_s is None else rests_s)
        if is_over:
            going = [one for one in going if one.due_at is not _OVER]
        if going:
            shared.wait(max(0.0, min([one.due_at for one in going]) - clock()))
