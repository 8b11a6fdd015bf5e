"""What a robot finds of itself and of the others before a run. (P-PREFLIGHT)"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.runtime.deploy.joining import Joining
from koord.runtime.deploy.preflight import Check, Finding
from koord.runtime.orders.hearing import SAID_S, Hearer

#: Nothing is judged earlier, as vehicles and other robots have to be heard first.
SETTLING_S = 2.0

#: Who was heard so long ago is not there any more: Joins are said twice a second.
_SEEN_S = 3.0

#: A tick that is later than this is no tick in time.
_LATE_S = 0.05


class Lookout(Struct, frozen=True):
    """What a robot has seen and heard since it was started."""

    since_s: float
    late_s: float  #: the greatest delay of a tick
    joining: Joining
    hearer: Hearer
    now_s: float


def fleet_checks(looked: Lookout) -> Iterator[Check]:
    """Yield what is found of the robot's clock, of the other robots, and of the e-stop."""
    yield _clock(looked)
    yield from _others(looked)
    yield _estop(looked)


def _clock(looked: Lookout) -> Check:
    if looked.since_s < SETTLING_S:
        return Check("clock", Finding.PENDING, "is watched")
    late = f"ticks are late by {1000 * looked.late_s:.0f} ms at most"
    if looked.late_s <= _LATE_S:
        return Check("clock", Finding.GOOD, late)
    return Check("clock", Finding.DOUBTFUL, late, "is this computer busy with something else?")


def _others(looked: Lookout) -> Iterator[Check]:
    party, seen = looked.joining.party, looked.joining.seen
    there = {pid for pid, one in seen.items() if looked.now_s - one.at_s <= _SEEN_S}
    missing = [pid for pid in range(party.robots) if pid != party.pid and pid not in there]
    if party.robots > 1:
        if missing and looked.joining.goes_on:
            text = f"not heard of: {_named(missing)}; there is a run to go on with"
            yield Check("others", Finding.DOUBTFUL, text)
        elif missing:
            yield Check("others", Finding.PENDING, f"not heard of: {_named(missing)}")
        else:
            yield Check("others", Finding.GOOD, "all are heard, with the same key")
    for note in looked.joining.notes:
        yield Check("others", Finding.BAD, note)
    differing = [(pid, what) for pid in sorted(there) for what in seen[pid].differs]
    for pid, what in differing:
        yield Check("program", Finding.BAD, f"robot {pid} runs something else ({what})")
    if there and not differing:
        yield Check("program", Finding.GOOD, "the same program and settings")


def _estop(looked: Lookout) -> Check:
    hearer = looked.hearer
    if hearer.heard_at_s is None:
        cure = "koord estop CONFIG --test"
        return Check("e-stop", Finding.DOUBTFUL, "nobody has tried whether it is heard", cure)
    heard = f"heard {looked.now_s - hearer.heard_at_s:.0f} s ago"
    if abs(hearer.clock_off_s) > SAID_S:
        off = f"{heard}; the clocks of the wall differ by {abs(hearer.clock_off_s):.0f} s"
        cure = "an e-stop takes a round trip more until they are set"
        return Check("e-stop", Finding.DOUBTFUL, off, cure)
    return Check("e-stop", Finding.GOOD, heard)


def _named(pids: list[int]) -> str:
    return ", ".join(map(str, pids))
