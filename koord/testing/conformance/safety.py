"""Checks of what keeps people and vehicles safe: e-stop, fence, dead man, landing."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Sequence

import msgspec

from koord.runtime.drivers.setpoints import Disarm, Hold, Land, Sensed, Setpoint
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Order, Ordered, Ticked
from koord.runtime.guardian.machine import step
from koord.runtime.guardian.modes import Mode, initial
from koord.runtime.motion.field import field
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Point, World
from koord.testing.conformance.bench import Bench, Sample, drift, stands
from koord.testing.conformance.findings import Failed, Measures, Skipped
from koord.testing.conformance.leading import Line, along
from koord.testing.conformance.moving import ahead, back, under_way
from koord.testing.conformance.peers import Truth
from koord.testing.conformance.subjects import flat

#: The fence is so far from where a vehicle stands, besides its margin.
_FENCE_M = 1.0

#: A set-point reaches the vehicle, and what came of it is seen, so much later at most.
_SEEN_S = 0.3

#: A vehicle that declares no dead-man timer stands within this all the same, or it fails.
_UNDECLARED_S = 10.0

#: The process that is killed has so long until its vehicle moves.
_MOVES_S = 60.0


class Guarded:
    """A guardian between wishes and the driver, as on a robot."""

    def __init__(self, bench: Bench, world: World) -> None:
        body = bench.subject.body
        self.setup = Setup(bench.subject.limits, field(world, flat=body.ON_GROUND), TICK_S)
        self._state = initial(bench.clock.now())
        self.why: str = ""  #: the last condition that began

    @property
    def mode(self) -> Mode:
        return self._state.mode

    def telling(self, wish: Callable[[Sensed, float], Setpoint] | None) -> Callable[..., Setpoint]:
        """What the guardian makes of a wish at each tick."""

        def told(sensed: Sensed, now_s: float) -> Setpoint:
            wished = (
                Hold() if wish is None or self.mode is not Mode.RUNNING else wish(sensed, now_s)
            )
            event = Ticked(now_s, sensed, wished, 0.0)  # type: ignore[arg-type]
            self._state, answer = step(self.setup, self._state, event)
            for note in answer.notes:
                if note.condition in self._state.conditions:
                    self.why = note.text
            assert answer.setpoint is not None
            return answer.setpoint

        return told

    def order(self, order: Order, now_s: float) -> Setpoint | None:
        """Give an order; return what the driver is told at once."""
        self._state, answer = step(self.setup, self._state, Ordered(now_s, order))
        return answer.setpoint

    def started(self, bench: Bench) -> None:
        """Bring it to running, from the ground. Raises Failed."""
        bench.run(0.2, self.telling(None))
        self.order(Order.ARM, bench.clock.now())
        bench.until(lambda s: s.sensed.armed is not False, self.telling(None), 20.0, "it is armed")
        bench.run(1.5, self.telling(None))
        self.order(Order.START, bench.clock.now())
        if self.mode is not Mode.RUNNING:
            raise Failed(f"its guardian does not let it run: {self.why}")
        if bench.subject.flies:
            risen_m = bench.subject.at_m[2] + 0.9 * bench.takeoff_m
            bench.until(
                lambda s: s.sensed.position_m[2] >= risen_m,
                self.telling(bench.rising(bench.tick().sensed)),
                40.0,
                f"it has risen to {bench.takeoff_m:g} m",
            )


def fence(bench: Bench, found: Measures) -> None:
    """Let it wish to leave its fence: it is held before, and never leaves it."""
    bench.may_move()
    bench.settle()
    here = bench.tick().sensed.position_m
    half = _FENCE_M + bench.subject.limits.margin_m
    top = here[2] + bench.takeoff_m + 1.0
    low, high = (here[0] - half, here[1] - half), (here[0] + half, here[1] + half)
    ground = bench.subject.world.ground
    guarded = Guarded(bench, World((*low, ground), (*high, top)))
    guarded.started(bench)
    begun = bench.tick(guarded.telling(None)).sensed
    line = Line(begun.position_m, ahead(bench, begun), 3 * half, bench.subject.speed_mps)
    samples: list[Sample] = []
    wish = along(bench.driver.capabilities, bench.subject.body, line, bench.clock.now())
    end_s = bench.clock.now() + 2.0 * half / line.speed_mps + 2.0
    while bench.clock.now() < end_s:
        samples.append(bench.tick(guarded.telling(wish)))
        if guarded.mode is not Mode.RUNNING:
            break
    held = guarded.mode is not Mode.RUNNING
    samples += bench.run(3.0, guarded.telling(None))
    outside = max(_outside(one.sensed.position_m, low, high) for one in samples)
    far = drift(samples)
    found.expect(outside <= 0, f"it went {far:.2f} m of {half:.2f} m", "never out of the fence")
    found.expect(held, guarded.why or "it was not held", "its guardian holds it")
    found.at_least(far, 0.2, "before it went")
    truths = [one.truth.position_m for one in samples if one.truth is not None]
    if truths:
        beyond = max(_outside(one, low, high) for one in truths)
        found.expect(beyond <= 0, f"{-beyond:.2f} m inside, by the other side", "inside")
    back(bench, samples)
    bench.settle()


def _outside(point: Point, low: tuple[float, float], high: tuple[float, float]) -> float:
    """How far a point is outside of the fence; negative if it is inside."""
    return max(low[0] - point[0], low[1] - point[1], point[0] - high[0], point[1] - high[1])


def estop(bench: Bench, found: Measures) -> None:
    """Stop it on its way by the e-stop: it stands soon, and is disarmed."""
    bench.may_move()
    bench.settle()
    guarded = Guarded(bench, bench.subject.world)
    guarded.started(bench)
    first = bench.tick(guarded.telling(None)).sensed
    line = Line(first.position_m, ahead(bench, first), 1.2, bench.subject.speed_mps)
    wish = along(bench.driver.capabilities, bench.subject.body, line, bench.clock.now())
    samples = bench.until(
        lambda s: math.dist(s.sensed.position_m, first.position_m) > 0.5,
        guarded.telling(wish),
        10 + 2 * line.lasts_s,
        "it is led half a metre",
    )
    ordered_s = bench.clock.now()
    told = guarded.order(Order.ESTOP, ordered_s)
    stops = isinstance(told, Disarm if not bench.subject.flies else Land)
    found.expect(stops, f"told {type(told).__name__} at once", "in the call of the order")
    limit_s = bench.subject.stops_within_s + _SEEN_S + (0.5 if bench.subject.flies else 0.0)
    after = bench.until(_slow, guarded.telling(None), limit_s + 5.0, "it stands after the e-stop")
    found.at_most(after[-1].now_s - ordered_s, limit_s, "it does not go on after", "s")
    end = bench.until(
        lambda s: bench.is_disarmed(s) and s.sensed.airborne is not True and stands(s),
        guarded.telling(None),
        40.0,
        "it is down and disarmed after the e-stop",
    )
    found.expect(True, f"at rest and disarmed after {end[-1].now_s - ordered_s:.1f} s")
    found.at_most(drift([samples[-1], *after, *end]), 0.8, "it got further by")
    bench.settle()


def _slow(sample: Sample) -> bool:
    """Return whether it does not go on in the plane; it may be coming down."""
    return math.hypot(*sample.sensed.velocity_mps[:2]) <= 0.1


def lands(bench: Bench, found: Measures) -> None:
    """It rises to its height, comes down where it is, and is disarmed."""
    if not bench.subject.flies:
        raise Skipped(f"a {bench.subject.vehicle} does not fly")
    bench.may_move()
    bench.settle()
    bench.ready()
    start = bench.run(2.0, bench.rising(bench.tick().sensed))[-1]
    height = start.sensed.position_m[2] - bench.subject.at_m[2]
    found.expect(
        abs(height - bench.takeoff_m) <= 0.25,
        f"it rose to {height:.2f} m",
        f"{bench.takeoff_m:g} m, within 0.25 m",
    )
    down = bench.settle()
    gone = math.dist(flat(down[0].sensed.position_m), flat(down[-1].sensed.position_m))
    found.at_most(gone, 0.4, "it came down beside where it was by")
    above = down[-1].sensed.position_m[2] - bench.subject.at_m[2]
    found.at_most(abs(above), 0.2, "on the ground, off by")
    found.expect(bench.is_disarmed(down[-1]), "disarmed")


# --- the dead man ---------------------------------------------------------------------------------


def dead_man(bench: Bench, found: Measures) -> None:
    """Kill the process that drives it: it stops by itself, within the time that is declared."""
    bench.may_move()
    bench.settle()
    declared_s = bench.driver.capabilities.dead_man_s
    says = "none declared" if declared_s is None else f"declared {declared_s:g} s"
    limit_s = (declared_s or _UNDECLARED_S) + bench.subject.stops_within_s + 1.0
    if bench.subject.is_virtual:
        _fall_silent(bench, found, limit_s, says)
    else:
        _kill(bench, found, limit_s, says)
    bench.settle()


def _fall_silent(bench: Bench, found: Measures, limit_s: float, says: str) -> None:
    """The vehicle is in this process: nothing is said to it for a while."""
    samples, last = under_way(bench)
    silent = [last]
    end_s = last.now_s + limit_s
    while bench.clock.now() < end_s:
        silent.append(bench.tick(None))
    found.expect(
        _slow(silent[-1]),
        f"told nothing for {limit_s:.1f} s ({says}), it goes at "
        f"{math.hypot(*silent[-1].sensed.velocity_mps):.2f} m/s",
        "it stands",
    )
    moving = [one.now_s for one in silent if not _slow(one)]
    found.at_most(
        max(moving, default=last.now_s) - last.now_s, limit_s, f"({says}) it stood after", "s"
    )
    found.at_most(drift(bench.run(1.0, None)), 0.12, "it drifted by")
    back(bench, samples)


def _kill(bench: Bench, found: Measures, limit_s: float, says: str) -> None:
    peer = bench.peer
    bench.close()
    told = msgspec.json.encode(bench.subject).decode()
    killed = subprocess.Popen(
        [sys.executable, "-m", "koord.testing.conformance.killed", told],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        last = _until_it_moves(killed)
    finally:
        killed.kill()
        at_s = time.monotonic()
        _, error = killed.communicate()
    if last is None:
        raise Failed(f"the process that is to be killed ended: {error.strip()[-300:]}")
    bench.clock.sleep(limit_s)
    if peer is not None and peer.truth() is not None:
        stood_s = _stood_s(peer.seen(), at_s)
        limit = f"at most {limit_s:.1f} s ({says})"
        found.expect(stood_s <= limit_s, f"by the other side it stood after {stood_s:.1f} s", limit)
    bench.open()
    samples = bench.run(1.5, None)
    slow = all(_slow(one) for one in samples)
    found.expect(slow, f"{limit_s:.1f} s after the kill ({says})", "it stands, or comes down")
    gone = math.dist(flat(last), flat(samples[0].sensed.position_m))
    most = bench.subject.speed_mps * limit_s + 0.5
    found.at_most(gone, most, "since the kill it got on by")
    if peer is not None:  # it may have locked itself, until somebody switches it off and on
        bench.close()
        peer.stop()
        bench.open()


def _until_it_moves(process: subprocess.Popen[str]) -> Point | None:
    """Read where the vehicle of a process is, until it has gone on for a while."""
    assert process.stdout is not None
    end_s = time.monotonic() + _MOVES_S
    for line in process.stdout:
        told = json.loads(line)
        if told["moved"] > 0.5:
            x, y, z = told["position"]
            return x, y, z
        if time.monotonic() > end_s:
            raise Failed("the vehicle of the process that is to be killed does not move")
    return None


def _stood_s(seen: Sequence[Truth], at_s: float) -> float:
    """How long after a time the vehicle still went on in the plane, by what the peer says."""
    after = [one for one in seen if one.heard_s >= at_s]
    last_s = at_s
    for k, one in enumerate(after):
        before = [other for other in after[:k] if one.heard_s - other.heard_s <= 0.4]
        if before and one.heard_s - before[0].heard_s > 0.2:
            gone = math.dist(flat(one.position_m), flat(before[0].position_m))
            if gone / (one.heard_s - before[0].heard_s) > 0.1:
                last_s = one.heard_s
    return last_s - at_s
