"""The suite: its checks, in the order in which they are made. (P-KIT)"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress

from koord.testing.conformance import failing, moving, program, safety, telling
from koord.testing.conformance.bench import (
    Bench,
    Check,
    Clock,
    RealClock,
    StoppedError,
    VirtualClock,
)
from koord.testing.conformance.findings import (
    Failed,
    Finding,
    Measures,
    Skipped,
    Verdict,
)
from koord.testing.conformance.peers import OtherSide
from koord.testing.conformance.subjects import Subject

#: All checks. Those at the end judge what was seen in all that came before.
CHECKS = (
    Check("nobody-there", "a named error if nobody answers", telling.nobody_there),
    Check("opens", "opens in time, and says where the vehicle is", telling.opens),
    Check("options", "refuses options that there are not", telling.options),
    Check("capabilities", "says what it can do, and that makes sense", telling.capabilities),
    Check("pose", "the vehicle is where it says", telling.pose),
    Check("stays", "disarmed it stays where it is", telling.stays),
    Check("stamps", "poses come often, in order, never from the future", telling.stamps),
    Check("ports", "sensors and actuators of programs", telling.ports),
    Check("battery", "a share of 1", telling.battery),
    Check("frames", "east is x, north is y, up is z", moving.frames, moves=True),
    Check("attitude", "the quaternion says where it points", moving.attitude, moves=True),
    Check("velocity", "velocities add up to ways", moving.velocity, moves=True),
    Check("units", "metres, seconds, radians", moving.units, moves=True),
    Check("speed", "no faster than it is led", moving.speed, moves=True),
    Check("holds", "stops when told to hold, and stays", moving.holds, moves=True),
    Check("lands", "takes off to its height, lands, disarms", safety.lands, moves=True),
    Check("fence", "a wish out of the fence never leaves it", safety.fence, moves=True),
    Check("e-stop", "stands soon after the order", safety.estop, moves=True),
    Check("dead-man", "stops by itself after `kill -9`", safety.dead_man, moves=True),
    Check("stale", "frozen: poses grow old, or no link", failing.stale),
    Check("remarks", "says why it does not answer", failing.remarks),
    Check("link", "link lost and found again", failing.link),
    Check("second", "a second driver of one vehicle", failing.second),
    Check("restarts", "closes and opens again", failing.restarts),
    Check("blocks", "no call waits", failing.never_blocks),
    Check("program", "a program goes to places; its trace is judged", program.runs, moves=True),
    Check("twin", "a second process of one robot is refused", program.twin, moves=True),
)

NAMES = tuple(check.name for check in CHECKS)


def bench_of(
    subject: Subject,
    peer: OtherSide | None = None,
    clock: Clock | None = None,
    is_cancelled: Callable[[], bool] = lambda: False,
) -> Bench:
    """The bench on which a subject is tested."""
    if clock is None:
        clock = VirtualClock() if subject.is_virtual else RealClock()
    return Bench(subject, peer, clock, is_cancelled)


def conform(
    bench: Bench,
    only: Collection[str] = NAMES,
    begins: Callable[[Check], None] = lambda check: None,
) -> Iterator[Finding]:
    """Make the checks of these names, and yield what each finds; the vehicle is at rest then.

    Ends early where somebody has asked for the end.
    """
    try:
        for check in CHECKS:
            if check.name in only:
                begins(check)
                yield made(check, bench)
    except StoppedError:
        return
    finally:
        end(bench)


def made(check: Check, bench: Bench) -> Finding:
    """Make a check. Raises StoppedError."""
    measures, begun_s = Measures(), time.monotonic()
    verdict, why, cure = Verdict.PASSED, "", ""
    try:
        check.run(bench, measures)
    except Skipped as skipped:
        verdict, why, cure = Verdict.SKIPPED, skipped.why, skipped.cure
    except Failed as failed:
        verdict = Verdict.FAILED
        measures.taken.append(failed.measure)
        with suppress(Failed, Skipped):
            bench.close() if not bench.is_open else bench.settle()
    took_s = time.monotonic() - begun_s
    return Finding(check.name, verdict, tuple(measures.taken), why, cure, took_s)


def end(bench: Bench) -> None:
    """Bring the vehicle to rest, and let go of it and of the other side."""
    bench.is_ending = True
    if bench.is_open:
        with suppress(Failed, Skipped):
            bench.settle()
    with suppress(Failed):
        bench.close()
    if bench.peer is not None:
        bench.peer.stop()
