"""Checks of what a driver says of itself and of its vehicle, while that stands."""

from __future__ import annotations

import math
import time
from itertools import pairwise

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.setpoints import (
    Capabilities,
    Disarm,
    Drive,
    Land,
    Position,
    Takeoff,
    Track,
    Velocity,
)
from koord.testing.conformance.bench import Bench, Sample, drift
from koord.testing.conformance.findings import Failed, Measures, Skipped
from koord.testing.conformance.subjects import flat

#: What a pose may be off where it is known where the vehicle stands.
_START_M, _START_RAD = 0.25, 0.2

#: A driver that tells poses less often cannot be guarded.
_LEAST_HZ = 5.0

#: A stamp may be so much later than the tick: clocks are read one after the other.
_FUTURE_S = 0.002

_WISHES = (Drive, Velocity, Position, Track, Takeoff, Land)


def nobody_there(bench: Bench, found: Measures) -> None:
    """Open it before anybody is on the other side."""
    peer = bench.needs_peer()
    bench.close()
    peer.stop()
    begun_s = time.monotonic()
    limit = f"a DriverError within {bench.subject.opens_within_s:g} s"
    try:
        driver = bench.subject.driver()
        driver.open(bench.clock.now())
    except DriverError as error:
        took_s = time.monotonic() - begun_s
        found.expect(bool(error.message), f"`{error.message}` after {took_s:.1f} s", limit)
        found.expect(bool(error.hint), f"`{error.hint}`" if error.hint else "no hint", "a hint")
        found.expect(took_s <= bench.subject.opens_within_s, f"{took_s:.1f} s", limit)
    except Exception as error:
        raise Failed(f"{type(error).__name__}: {error}", limit) from error
    else:
        driver.close()
        raise Failed("it opens though nobody is there", limit)


def opens(bench: Bench, found: Measures) -> None:
    """Open it: it waits until it is known where the vehicle is."""
    took_s = bench.open()
    found.at_most(took_s, bench.subject.opens_within_s, "after", "s")
    x, y, z = bench.tick().sensed.position_m
    found.expect(all(map(math.isfinite, (x, y, z))), f"it stands at ({x:.2f}, {y:.2f}, {z:.2f})")
    bench.linked()
    found.expect(True, "it answers")


def options(bench: Bench, found: Measures) -> None:
    """Give it an option that there is not."""
    limit = "a DriverError"
    try:
        bench.subject.driver({"no_such_option": 1})
    except DriverError as error:
        found.expect(True, f"`{error.message}`", limit)
    else:
        raise Failed("`no_such_option: 1` is taken", limit)


def capabilities(bench: Bench, found: Measures) -> None:
    """Ask what it can do."""
    told: Capabilities = bench.driver.capabilities
    found.expect(
        bench.subject.vehicle in told.kinds,
        f"it drives {', '.join(told.kinds)}",
        f"{bench.subject.vehicle} among them",
    )
    unknown = [str(one) for one in told.wishes if one not in _WISHES]
    found.expect(not unknown and bool(told.wishes), _names(told), "set-points that there are")
    found.expect(0 < told.rate_hz <= 100, f"{told.rate_hz:g} Hz", "0 to 100 Hz")
    found.expect(
        0 < told.pose_age_s <= bench.subject.limits.pose_age_s,
        f"poses are {told.pose_age_s:.2f} s old",
        f"at most {bench.subject.limits.pose_age_s:g} s, after which a robot holds",
    )
    stops = told.dead_man_s is None or 0 < told.dead_man_s < math.inf
    found.expect(stops, f"dead man {told.dead_man_s}", "None, or seconds")


def _names(told: Capabilities) -> str:
    return ", ".join(one.__name__ for one in told.wishes) or "no set-points"


def pose(bench: Bench, found: Measures) -> None:
    """Compare where it says that the vehicle stands with where that is."""
    subject, sensed = bench.subject, bench.tick().sensed
    norm = math.sqrt(sum(c * c for c in sensed.attitude))
    found.expect(abs(norm - 1) < 0.01, f"|q| = {norm:.3f}", "1")
    up = _up(sensed.attitude)
    found.at_most(math.degrees(math.acos(max(-1.0, min(1.0, up)))), 20.0, "tilted by", "°")
    peer = None if bench.peer is None else bench.peer.truth()
    where = subject.at_m if peer is None else peer.position_m
    heading = subject.heading_rad if peer is None or peer.heading is None else peer.heading
    if peer is None and not subject.knows_start:
        return
    found.at_most(math.dist(flat(sensed.position_m), flat(where)), _START_M, "off by")
    found.at_most(abs(sensed.position_m[2] - where[2]), _START_M, "in height by")
    turned = abs(math.remainder(yaw_of(sensed.attitude) - heading, math.tau))
    found.at_most(math.degrees(turned), math.degrees(_START_RAD), "turned by", "°")


def _up(attitude: tuple[float, float, float, float]) -> float:
    """The share of the body's upward axis that points up."""
    _, x, y, _ = attitude
    return 1 - 2 * (x * x + y * y)


def stays(bench: Bench, found: Measures) -> None:
    """Tell it to disarm, and look whether it moves."""
    samples = bench.run(1.5, Disarm())
    found.at_most(drift(samples), 0.1, "it moved by")
    armed = samples[-1].sensed.armed
    words = "it arms itself" if bench.arms_itself else f"armed: {armed}"
    found.expect(bench.is_disarmed(samples[-1]), words, "not armed, or it arms itself")


def stamps(bench: Bench, found: Measures) -> None:
    """Look at what its poses are stamped with, for some seconds."""
    bench.run(3.0, Disarm())
    told, limits = bench.driver.capabilities, bench.subject.limits
    samples = [one for one in bench.log if not one.dead]
    back_s = max((a - b for a, b in pairwise(_stamps(samples))), default=0.0)
    found.expect(back_s <= 0, f"stamps go back by {back_s:.3f} s" if back_s > 0 else "in order")
    ages = sorted(one.now_s - one.sensed.measured_at_s for one in samples)
    found.expect(
        ages[0] >= -_FUTURE_S,
        f"{-ages[0]:.3f} s from the future" if ages[0] < -_FUTURE_S else "none from the future",
    )
    usual_s = ages[int(0.95 * (len(ages) - 1))]
    found.at_most(usual_s, max(told.pose_age_s, 0.05) + 0.02, "95 % are as old as", "s")
    found.at_most(ages[-1], limits.pose_age_s, "the oldest is", "s")
    lasted_s = samples[-1].now_s - samples[0].now_s
    rate = len(set(_stamps(samples))) / max(lasted_s, 1e-9)
    found.at_least(rate, _LEAST_HZ, "new ones", "Hz")


def _stamps(samples: list[Sample]) -> list[float]:
    return [one.sensed.measured_at_s for one in samples]


def ports(bench: Bench, found: Measures) -> None:
    """Ask for sensors of programs, and say something to an actuator that there is not."""
    try:
        readings = dict(bench.driver.ports())
        bench.driver.act("no_such_port", 1)
    except Exception as error:
        raise Failed(f"{type(error).__name__}: {error}", "never raises") from error
    named = ", ".join(map(str, readings)) or "no ports"
    found.expect(all(isinstance(one, str) for one in readings), named, "by names")


def battery(bench: Bench, found: Measures) -> None:
    """Look at its battery, if it says that it tells of one."""
    if not bench.driver.capabilities.tells_battery:
        raise Skipped("the driver tells of no battery (`tells_battery`)")
    bench.until(lambda s: s.sensed.battery is not None, Disarm(), 10.0, "it tells of its battery")
    told = bench.tick().sensed.battery
    assert told is not None
    found.expect(0 <= told <= 1.05, f"{told:.2f}", "0 to 1")
