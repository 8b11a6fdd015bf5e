"""Checks of how a vehicle moves: frames, quaternions, units, velocities and speeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from msgspec import Struct

from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.setpoints import Hold, Sensed
from koord.runtime.motion.world import Point
from koord.testing.conformance.bench import Bench, Sample, drift
from koord.testing.conformance.findings import Failed, Measures, Skipped
from koord.testing.conformance.leading import Line, along, steers, turning
from koord.testing.conformance.subjects import angle, flat, minus

#: How far legs go, m.
LEG_M = 0.8

#: How far it is led about a bend.
BEND_RAD = math.pi / 3

#: Directions may be off by this.
_OFF_DEG = 20.0

#: Who sets out tilts within this time, by so much if it shows, to where it goes but for that.
_SETS_OUT_S, _SHOWS_DEG, _LEANS_DEG = 0.8, 3.0, 45.0

#: Speeds are looked at over so long.
_OVER_S = 0.5

EAST: Point = (1.0, 0.0, 0.0)
NORTH: Point = (0.0, 1.0, 0.0)


class Leg(Struct, frozen=True):
    """A line that a vehicle was led along, and what was sensed."""

    line: Line
    samples: list[Sample]

    @property
    def words(self) -> str:
        return _named(self.line.direction)

    @property
    def moved(self) -> Point:
        """How far it got, and where to."""
        return minus(self.samples[-1].sensed.position_m, self.samples[0].sensed.position_m)


class Bend(Struct, frozen=True):
    """A bend to the left that a vehicle was led."""

    rate_radps: float
    samples: list[Sample]


class Course(Struct, frozen=True):
    """What a vehicle was led along: out and back, and a bend if it is steered."""

    legs: list[Leg]
    bend: Bend | None
    rise: list[Sample]

    @property
    def samples(self) -> list[Sample]:
        return [one for leg in self.legs for one in leg.samples]


def course(bench: Bench) -> Course:
    """Lead it along some lines, once for all checks. Raises Failed and Skipped."""
    return bench.keep("course", lambda: _led(bench))


def _led(bench: Bench) -> Course:
    begun = len(bench.log)
    here = bench.ready().sensed
    rise = bench.log[begun:]
    told, body = bench.driver.capabilities, bench.subject.body
    if steers(told, body):
        way = ahead(bench, here)
        legs = [leg(bench, way), leg(bench, way, backwards=True)]
        return Course(legs, _bent(bench), rise)
    ways = [EAST, NORTH, (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]
    return Course([leg(bench, one) for one in ways], None, rise)


def leg(bench: Bench, direction: Point, *, backwards: bool = False) -> Leg:
    """Lead it along a line from where it is; it holds at the end."""
    subject, here = bench.subject, bench.tick().sensed
    to = tuple(-c for c in direction) if backwards else direction
    line = Line(here.position_m, (to[0], to[1], 0.0), LEG_M, subject.speed_mps)
    told = bench.driver.capabilities
    telling = along(told, subject.body, line, bench.clock.now(), backwards=backwards)
    if steers(told, subject.body):
        samples = bench.run(line.lasts_s, telling)
    else:
        samples = bench.until(
            lambda s: math.dist(s.sensed.position_m, line.end_m) < 0.15,
            telling,
            4 * line.lasts_s + 3.0,
            f"it is led {LEG_M:g} m",
        )
        samples += bench.run(1.0, telling)
    return Leg(line, samples + bench.run(1.0, Hold()))


def _bent(bench: Bench) -> Bend:
    """Lead it a sixth of a circle to the left, and back."""
    subject = bench.subject
    telling = turning(subject.body, subject.speed_mps, subject.turn_m)
    rate = subject.speed_mps / subject.turn_m
    samples = bench.run(BEND_RAD / rate, telling)
    bench.run(0.5, Hold())
    bench.run(BEND_RAD / rate, turning(subject.body, -subject.speed_mps, subject.turn_m))
    bench.run(1.0, Hold())
    return Bend(rate, samples)


# --- checks ---------------------------------------------------------------------------------------


def frames(bench: Bench, found: Measures) -> None:
    """East is x, north is y, up is z: it goes where it is led, and says so."""
    led = course(bench)
    least = min(led.legs, key=lambda leg: math.hypot(*flat(leg.moved)))
    moved_m = math.hypot(*flat(least.moved))
    found.at_least(moved_m, LEG_M / 2, f"led {least.words}, it says that it moved")
    worst = max(led.legs, key=lambda leg: angle(leg.moved, leg.line.direction))
    off = angle(worst.moved, worst.line.direction)
    found.at_most(off, _OFF_DEG, f"led {worst.words}, its way is off by", "°")
    if led.bend is not None:
        moved = _tangents(led.bend.samples)
        bent = math.degrees(math.remainder(moved[-1] - moved[0], math.tau))
        found.at_least(bent, 10.0, "led to the left, its way bends to the left by", "°")
    if led.rise and bench.subject.flies:
        up = led.rise[-1].sensed.position_m[2] - led.rise[0].sensed.position_m[2]
        found.at_least(up, 0.5 * bench.takeoff_m, "risen, it is higher by")
    _agrees(led, found)


def _agrees(led: Course, found: Measures) -> None:
    """Compare with what the other side says of where the vehicle is."""
    pairs = [
        (one.sensed.position_m, one.truth.position_m)
        for one in led.samples
        if one.truth is not None
    ]
    if pairs:
        furthest = max(math.dist(a, b) for a, b in pairs)
        found.at_most(furthest, 0.3, "off what the other side says by")


def attitude(bench: Bench, found: Measures) -> None:
    """Its quaternion says where it points, and which way it tilts."""
    led = course(bench)
    norms = [math.sqrt(sum(c * c for c in one.sensed.attitude)) for one in led.samples]
    found.expect(all(abs(n - 1) < 0.01 for n in norms), f"|q| up to {max(norms):.3f}", "1")
    if led.bend is not None:
        headings = [yaw_of(one.sensed.attitude) for one in led.bend.samples]
        turned = math.degrees(sum(_steps(headings)))
        found.at_least(turned, 15.0, "led to the left, it turns counter-clockwise by", "°")
        off = [
            abs(math.degrees(math.remainder(way - yaw_of(one.sensed.attitude), math.tau)))
            for way, one in _moving(led.bend.samples)
        ]
        found.at_most(_middle(off), _OFF_DEG, "it points where it goes, but for", "°")
    _points(led, found)
    if bench.subject.flies:
        _tilts(led, found)


def _points(led: Course, found: Measures) -> None:
    """Compare with the headings that the other side tells."""
    off = [
        abs(math.degrees(math.remainder(yaw_of(one.sensed.attitude) - one.truth.heading, math.tau)))
        for one in led.samples
        if one.truth is not None and one.truth.heading is not None
    ]
    if off:
        found.at_most(_middle(off), _OFF_DEG, "its heading is off what the other side says by", "°")


def _tilts(led: Course, found: Measures) -> None:
    """An aircraft that sets out tilts to where it goes."""
    tilts = [(one, _furthest(one)) for one in led.legs]
    most = max(math.hypot(*lean) for _, lean in tilts)
    if most < math.radians(_SHOWS_DEG):
        return
    for one, (x, y) in tilts:
        seen = math.degrees(math.hypot(x, y))
        off = angle((x, y, 0.0), one.line.direction)
        found.expect(
            math.hypot(x, y) >= most / 3 and off <= _LEANS_DEG,
            f"led {one.words}, it tilts by {seen:.0f}°, off by {off:.0f}°",
            f"at most {_LEANS_DEG:.0f}° off",
        )


def _furthest(leg: Leg) -> tuple[float, float]:
    """The furthest that an aircraft leans when it sets out."""
    ends_s = leg.samples[0].now_s + _SETS_OUT_S
    leans = [_lean(s.sensed.attitude) for s in leg.samples if s.now_s <= ends_s]
    return max(leans, key=lambda lean: math.hypot(*lean))


def _lean(attitude: tuple[float, float, float, float]) -> tuple[float, float]:
    """The horizontal part of the body's upward axis."""
    w, x, y, z = attitude
    return 2 * (x * z + w * y), 2 * (y * z - w * x)


def velocity(bench: Bench, found: Measures) -> None:
    """The velocity that it tells adds up to how far it says that it got."""
    off, words = max((_off(one), one.words) for one in course(bench).legs)
    found.at_most(off, 0.1 + 0.2 * LEG_M, f"led {words}, off by")


def _off(leg: Leg) -> float:
    """How far what velocities add up to is from how far it got, in m."""
    summed = [0.0, 0.0]
    for a, b in pairwise(leg.samples):
        for k in (0, 1):
            mean = (a.sensed.velocity_mps[k] + b.sensed.velocity_mps[k]) / 2
            summed[k] += mean * (b.now_s - a.now_s)
    return math.dist(summed, leg.moved[:2])


def units(bench: Bench, found: Measures) -> None:
    """Metres, seconds, radians: as far, as fast and as much of a turn as it is led."""
    led, subject = course(bench), bench.subject
    ways = [math.hypot(*flat(one.moved)) for one in led.legs]
    low, high = 0.6 * LEG_M, 1.3 * LEG_M + 0.1
    found.expect(
        low <= min(ways) and max(ways) <= high,
        f"led {LEG_M:g} m, it moved {min(ways):.2f} to {max(ways):.2f} m",
        f"{low:.2f} to {high:.2f} m",
    )
    speeds = [max(math.hypot(*s.sensed.velocity_mps) for s in one.samples) for one in led.legs]
    low, high = 0.4 * subject.speed_mps, 2.5 * subject.speed_mps
    found.expect(
        low <= min(speeds) and max(speeds) <= high,
        f"led at {subject.speed_mps:g} m/s, it says {min(speeds):.2f} to {max(speeds):.2f} m/s",
        f"{low:.2f} to {high:.2f} m/s",
    )
    if led.bend is not None:
        turned = sum(_steps([yaw_of(one.sensed.attitude) for one in led.bend.samples]))
        found.expect(
            0.4 * BEND_RAD <= turned <= 1.5 * BEND_RAD,
            f"led to turn by {BEND_RAD:.2f} rad, it says {turned:.2f} rad",
            f"{0.4 * BEND_RAD:.2f} to {1.5 * BEND_RAD:.2f} rad",
        )


def speed(bench: Bench, found: Measures) -> None:
    """It is never faster than it is led."""
    most, led_mps = 0.0, bench.subject.speed_mps
    for one in course(bench).legs:
        most = max(most, _fastest(one.samples))
    found.at_most(most, 1.25 * led_mps + 0.1, f"led at {led_mps:g} m/s, it went", "m/s")


def holds(bench: Bench, found: Measures) -> None:
    """Tell it to hold on its way: it stops soon, and stays."""
    subject = bench.subject
    samples, before = under_way(bench)
    after = bench.run(subject.stops_within_s + 1.0, Hold())
    stopped_m = drift([before, *after])
    found.at_most(stopped_m, subject.stops_within_m + 0.3, "it stopped within")
    found.at_most(drift(bench.run(3.0, Hold())), 0.12, "in 3 s it drifted by")
    back(bench, samples)


def under_way(bench: Bench, room_m: float = 1.2) -> tuple[list[Sample], Sample]:
    """Lead it, until it has gone half a metre; return all of it, and the last tick."""
    first = bench.ready().sensed
    subject, told = bench.subject, bench.driver.capabilities
    line = Line(first.position_m, ahead(bench, first), room_m, subject.speed_mps)
    samples = bench.until(
        lambda s: math.dist(s.sensed.position_m, first.position_m) > 0.5,
        along(told, subject.body, line, bench.clock.now()),
        10 + 2 * line.lasts_s,
        "it is led half a metre",
    )
    return samples, samples[-1]


def ahead(bench: Bench, sensed: Sensed) -> Point:
    """Where it can be led: where it points if it is steered, else to the east."""
    if not steers(bench.driver.capabilities, bench.subject.body):
        return EAST
    heading = yaw_of(sensed.attitude)
    return math.cos(heading), math.sin(heading), 0.0


def back(bench: Bench, samples: Sequence[Sample]) -> None:
    """Lead it back to where it was, as well as it goes."""
    start, here = samples[0].sensed.position_m, bench.tick().sensed
    subject, told = bench.subject, bench.driver.capabilities
    gap = flat(minus(start, here.position_m))
    far_m = math.hypot(*gap)
    if far_m < 0.1:
        return
    line = Line(here.position_m, (gap[0] / far_m, gap[1] / far_m, 0.0), far_m, subject.speed_mps)
    heading = yaw_of(here.attitude)
    backwards = gap[0] * math.cos(heading) + gap[1] * math.sin(heading) < 0
    telling = along(told, subject.body, line, bench.clock.now(), backwards=backwards)
    bench.run(line.lasts_s, telling)
    bench.run(1.0, Hold())


# --- what samples say -----------------------------------------------------------------------------


def _named(direction: Point) -> str:
    """A direction of the plane in words."""
    for words, one in (("east", EAST), ("north", NORTH)):
        if math.dist(one, direction) < 0.05:
            return words
        if math.dist(one, (-direction[0], -direction[1], 0.0)) < 0.05:
            return {"east": "west", "north": "south"}[words]
    return f"at {math.degrees(math.atan2(direction[1], direction[0])):.0f}°"


def _moving(samples: Sequence[Sample]) -> list[tuple[float, Sample]]:
    """The direction in which it moves about each sample, where it does."""
    span = 4
    found = []
    for k in range(span, len(samples) - span):
        x, y, _ = minus(samples[k + span].sensed.position_m, samples[k - span].sensed.position_m)
        if math.hypot(x, y) > 0.03:
            found.append((math.atan2(y, x), samples[k]))
    return found


def _tangents(samples: Sequence[Sample]) -> list[float]:
    found = [way for way, _ in _moving(samples)]
    if len(found) < 2:
        raise Failed("led along a bend, it does not say that it moves")
    return found


def _steps(headings: Sequence[float]) -> list[float]:
    return [math.remainder(b - a, math.tau) for a, b in pairwise(headings)]


def _middle(values: list[float]) -> float:
    if not values:
        raise Skipped("it does not move fast enough to say")
    return sorted(values)[len(values) // 2]


def _fastest(samples: Sequence[Sample]) -> float:
    """The fastest that it got on over some tenths of a second, by its positions."""
    best, k = 0.0, 0
    for one in samples:
        while samples[k].now_s < one.now_s - _OVER_S - 0.03:
            k += 1
        lasted_s = one.sensed.measured_at_s - samples[k].sensed.measured_at_s
        if lasted_s >= 0.8 * _OVER_S:
            gone = math.dist(one.sensed.position_m, samples[k].sensed.position_m)
            best = max(best, gone / lasted_s)
    return best
