"""The bench: a driver under test, time, and what was said and heard at each tick."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Protocol, TypeVar

from msgspec import Struct

from koord.runtime.drivers.driver import Driver, DriverError
from koord.runtime.drivers.setpoints import Arm, Disarm, Hold, Land, Sensed, Setpoint
from koord.runtime.motion.group import TICK_S
from koord.testing.conformance.findings import Failed, Measures, Skipped
from koord.testing.conformance.leading import Leading, rising
from koord.testing.conformance.peers import OtherSide, Truth
from koord.testing.conformance.subjects import Subject, flat

#: Slower than this it stands.
STILL_MPS = 0.06

#: How long it may take to answer, to arm, and to rise or come to rest.
_LINK_S, _ARMS_S, _REST_S = 5.0, 20.0, 40.0

Answer = TypeVar("Answer")


class StoppedError(Exception):
    """Raised where somebody has asked for the end."""


class Clock(Protocol):
    """Time, monotonic."""

    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None: ...


class RealClock:
    """The time of this machine."""

    now = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)


class VirtualClock:
    """A time that passes when it is waited for."""

    def __init__(self) -> None:
        self._now_s = 1000.0

    def now(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        self._now_s += seconds


class Sample(Struct, frozen=True):
    """A tick: what was sensed, what was said then, and how long both took."""

    now_s: float
    sensed: Sensed
    told: Setpoint | None
    sense_s: float
    command_s: float
    truth: Truth | None = None
    dead: bool = False  #: the other side was frozen or gone


class Call(Struct, frozen=True):
    """A call of the driver at a tick, and how long it took."""

    name: str
    took_s: float
    dead: bool = False  #: the other side was frozen or gone


#: What is said at a tick: a set-point, or what makes one.
Telling = Setpoint | Callable[[Sensed, float], Setpoint] | None


class Bench:
    """A driver that is opened, and asked and told at ticks. ``log`` has all of them."""

    def __init__(
        self,
        subject: Subject,
        peer: OtherSide | None,
        clock: Clock,
        is_cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        self.subject, self.peer, self.clock = subject, peer, clock
        self.log: list[Sample] = []
        self.is_dead = False  #: the other side is frozen or gone
        self.is_ending = False  #: nobody may cut short what is done now
        self.kept: dict[str, Any] = {}  #: what checks have in common
        self._driver: Driver | None = None
        self._is_cancelled = is_cancelled
        self._due_s = -math.inf

    # --- the driver -----------------------------------------------------------------------------

    @property
    def driver(self) -> Driver:
        """The driver, opened if it is not. Raises Failed."""
        if self._driver is None:
            self.open()
        assert self._driver is not None
        return self._driver

    @property
    def is_open(self) -> bool:
        return self._driver is not None

    def open(self) -> float:
        """Make the driver and open it; return how long that took. Raises Failed."""
        self.close()
        if self.peer is not None and not self.peer.is_running:
            self.peer.start()
        begun_s = time.monotonic()
        try:
            made = self.subject.driver()
            made.open(self.clock.now())
        except DriverError as error:
            raise Failed(f"it does not open: {error.message}; {error.hint}") from None
        self._driver = made
        return time.monotonic() - begun_s

    def close(self) -> None:
        """Let go of the vehicle."""
        driver, self._driver = self._driver, None
        if driver is not None:
            _guarded("close", driver.close)

    def needs_peer(self) -> OtherSide:
        """The other side. Raises Skipped if nobody may start, freeze and end it."""
        if self.peer is None:
            why = "the vehicle is in this process"
            if not self.subject.is_virtual:
                why = "nobody may freeze and end the other side"
            raise Skipped(why, "--peer COMMAND starts a simulated one")
        return self.peer

    # --- ticks ----------------------------------------------------------------------------------

    def tick(self, telling: Telling = None) -> Sample:
        """Sense, command, and wait for the next tick. Raises Failed for what drivers must not."""
        if self._is_cancelled() and not self.is_ending:
            raise StoppedError
        driver, now_s = self.driver, self.clock.now()
        sensed, sense_s = _timed(partial(driver.sense, now_s), "sense")
        if sensed is None:
            raise Failed("it is open, and does not say where it is")
        told = telling(sensed, now_s) if callable(telling) else telling
        command_s = 0.0
        if told is not None:
            _, command_s = _timed(partial(driver.command, told, now_s), "command")
        truth = None if self.peer is None or self.is_dead else self.peer.truth()
        sample = Sample(now_s, sensed, told, sense_s, command_s, truth, self.is_dead)
        self.log.append(sample)
        self._due_s = max(self._due_s + TICK_S, now_s)
        self.clock.sleep(max(0.0, self._due_s + TICK_S - self.clock.now()))
        return sample

    def run(self, seconds: float, telling: Telling = None) -> list[Sample]:
        """Tick for so long."""
        end_s, begun = self.clock.now() + seconds, len(self.log)
        while self.clock.now() < end_s:
            self.tick(telling)
        return self.log[begun:]

    def until(
        self,
        condition: Callable[[Sample], bool],
        telling: Telling,
        most_s: float,
        what: str,
    ) -> list[Sample]:
        """Tick until something holds. Raises Failed if it does not in time."""
        end_s, begun = self.clock.now() + most_s, len(self.log)
        while True:
            sample = self.tick(telling)
            if condition(sample):
                return self.log[begun:]
            if self.clock.now() >= end_s:
                said = "; ".join(self.driver.remarks)
                raise Failed(f"{what} not in {most_s:g} s{f' ({said})' if said else ''}")

    def calls(self) -> Iterator[Call]:
        """All calls of the driver at ticks."""
        for one in self.log:
            yield Call("sense", one.sense_s, one.dead)
            if one.told is not None:
                yield Call("command", one.command_s, one.dead)

    # --- the vehicle ----------------------------------------------------------------------------

    def may_move(self) -> None:
        """Raise Skipped if nobody has said that the vehicle may move."""
        if not self.subject.arms:
            raise Skipped("the vehicle may not move", "--arm says that it may, and that room is")

    def linked(self) -> None:
        """Wait until the vehicle answers: what it does not tell before, it may tell then."""
        self.until(lambda s: s.sensed.link, None, _LINK_S, "the vehicle answers")
        if "armed at rest" not in self.kept:
            self.kept["armed at rest"] = self.run(1.5, Disarm())[-1].sensed.armed

    def arm(self) -> None:
        """Arm it. Raises Failed."""
        self.until(lambda s: s.sensed.armed is not False, Arm(), _ARMS_S, "it is armed")

    def ready(self) -> Sample:
        """Bring it to where it can be led: armed, and in the air if it flies. Raises Skipped."""
        self.may_move()
        self.linked()
        if self.tick().sensed.armed is False:
            self.arm()
        if self.subject.flies:
            self.rise()
        return self.run(0.5, Hold())[-1]

    def rise(self) -> list[Sample]:
        """Let an aircraft take off, if it is not in the air."""
        height_m = self.takeoff_m
        up_m = self.subject.at_m[2] + 0.9 * height_m
        here = self.tick().sensed
        if here.position_m[2] >= up_m:
            return []
        return self.until(
            lambda s: s.sensed.position_m[2] >= up_m,
            self.rising(here),
            _REST_S,
            f"it has risen to {height_m:g} m",
        )

    def rising(self, sensed: Sensed) -> Leading:
        """What leads an aircraft up to the height of its take-off, above where it is."""
        ground_m = self.subject.at_m[2]
        return rising(self.driver.capabilities, sensed.position_m, self.takeoff_m, ground_m)

    @property
    def takeoff_m(self) -> float:
        """The height to which an aircraft rises."""
        return self.driver.capabilities.takeoff_height_m or 1.0

    def settle(self) -> list[Sample]:
        """Bring it to rest, on the ground and disarmed. Raises Failed if it does not come."""
        begun = len(self.log)
        self.linked()
        self.run(0.5, Hold())
        if self.subject.flies:
            self.until(_is_down, Land(), _REST_S, "it has come down")
        self.until(stands, Hold(), _REST_S, "it stands")
        self.until(self.is_disarmed, Disarm(), _REST_S, "it is disarmed")
        return self.log[begun:]

    def is_disarmed(self, sample: Sample) -> bool:
        """Return whether it is not armed, unless it arms itself."""
        return sample.sensed.armed is not True or self.arms_itself

    @property
    def arms_itself(self) -> bool:
        """True if it is armed whenever it stands, whatever it is told, as some small drones."""
        return self.kept.get("armed at rest") is True

    def keep(self, name: str, make: Callable[[], Answer]) -> Answer:
        """What checks have in common: made when it is first asked for."""
        if name not in self.kept:
            self.kept[name] = make()
        found: Answer = self.kept[name]
        return found


class Check(Struct, frozen=True):
    """A check of the suite."""

    name: str
    about: str  #: what it makes sure of
    run: Callable[[Bench, Measures], None]
    moves: bool = False  #: the vehicle has to move for it


def stands(sample: Sample) -> bool:
    """Return whether it does not move, as far as it knows."""
    return math.hypot(*sample.sensed.velocity_mps) <= STILL_MPS


def _is_down(sample: Sample) -> bool:
    sensed = sample.sensed
    return sensed.airborne is False or (sensed.airborne is None and stands(sample))


def drift(samples: Sequence[Sample]) -> float:
    """How far it got from where it was first, in the plane, in m."""
    first = samples[0].sensed.position_m
    return max(math.dist(flat(first), flat(one.sensed.position_m)) for one in samples)


def _timed(call: Callable[[], Answer], name: str) -> tuple[Answer, float]:
    """Call the driver, and say how long it took, but for what others had the processor for."""
    begun_s = time.perf_counter() - _waited_s()
    answer = _guarded(name, call)
    return answer, max(0.0, time.perf_counter() - _waited_s() - begun_s)


def _waited_s() -> float:
    """For how long this thread was ready to run and others ran; 0 where nobody counts it."""
    try:
        with open("/proc/thread-self/schedstat", "rb") as counted:
            return 1e-9 * int(counted.read().split()[1])
    except OSError:
        return 0.0


def _guarded(name: str, call: Callable[[], Answer]) -> Answer:
    """Call the driver. Raises Failed for whatever it raises."""
    try:
        return call()
    except Exception as error:
        raise Failed(f"`{name}` raised {type(error).__name__}: {error}", "never raises") from error
