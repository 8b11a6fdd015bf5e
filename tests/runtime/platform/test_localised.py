"""Drivers whose vehicles are where a localiser says, in virtual time."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest
from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers import localised as module
from koord.runtime.drivers.clocks import RemoteClock
from koord.runtime.drivers.differences import Differences
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import LEVEL, turned
from koord.runtime.drivers.localised import Localised
from koord.runtime.drivers.localiser import LocaliserOptions
from koord.runtime.drivers.setpoints import Capabilities, Drive, Located, Sensed
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.field import field
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.sim.driver import SimulatedVehicle, vehicle
from koord.sim.scene import device_model

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))
HERE: Point = (1.0, 2.0, 0.0)


class Held:
    """A localiser that says what a test lets it say."""

    OPTIONS: ClassVar[type[Struct]] = LocaliserOptions

    def __init__(self, says: Located | None = None) -> None:
        self.says = says
        self.remarks: tuple[str, ...] = ()
        self.is_open = False

    def open(self, now_s: float) -> None:
        self.is_open = True

    def locate(self, now_s: float) -> Located | None:
        return self.says

    def close(self) -> None:
        self.is_open = False


def device(wait: float = 0.0, kind: str = "CAR") -> Device:
    told = Vehicle("car", kind, driver="sim", localiser="held")
    return Device(0, told, WORLD, (0.0, 0.0, 0.0), options=LocaliserOptions(wait=wait))


def localised(held: Held) -> Localised:
    one = device()
    return Localised(vehicle(replace(one, options=None)), held, one)


class Seen:
    """A localiser that sees where a simulated vehicle is, elsewhere than that thinks."""

    def __init__(self, body: SimulatedVehicle, shift: Point) -> None:
        self.body, self.shift = body, shift
        self.remarks: tuple[str, ...] = ()
        self.sees = True
        self._last: Located | None = None

    def open(self, now_s: float) -> None:
        return

    def locate(self, now_s: float) -> Located | None:
        if self.sees:
            position, heading = self.body.truth()
            x, y, z = (a + b for a, b in zip(position[0].tolist(), self.shift, strict=True))
            self._last = Located((x, y, z), turned(float(heading[0])), now_s)
        return self._last

    def close(self) -> None:
        return


class Guarded:
    """A car with pilot and guardian, which a localiser sees one metre to the north-east."""

    def __init__(self, shift: Point = (1.0, 1.0, 0.0), *, starts: bool = True) -> None:
        self.now = 100.0
        one = device()
        body = vehicle(one)
        self.seen = Seen(body, shift)
        model = device_model(one.vehicle)
        guarded = Setup(usual(model.body), field(WORLD, flat=True), 0.1)
        made = Localised(body, self.seen, one)
        settings = PilotSettings(model.body, model.planner)
        self.driven = DrivenVehicle(made, pilot(settings, WORLD), guarded, self.now)
        self.tick()
        self.driven.order(Order.ARM, self.now)
        self.tick(30)
        self.driven.order(Order.START, self.now)
        assert (self.mode is Mode.RUNNING) is starts, self.driven.notes

    @property
    def mode(self) -> Mode:
        return self.driven.mode

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.now += TICK_S
            self.driven.tick(self.now, 0.05)


def test_the_vehicle_is_where_the_localiser_says_and_the_rest_is_the_drivers() -> None:
    """(P-LOCATE)"""
    held = Held(Located(HERE, turned(1.0), 9.9))
    made = localised(held)
    made.open(10.0)
    sensed, own = made.sense(10.0), made.driver.sense(10.0)
    assert sensed is not None
    assert own is not None
    assert (sensed.position_m, sensed.attitude, sensed.measured_at_s) == (HERE, turned(1.0), 9.9)
    assert (sensed.armed, sensed.airborne, sensed.link) == (own.armed, own.airborne, own.link)
    held.says = Located(HERE, None, 10.0)
    sensed = made.sense(10.0)
    assert sensed is not None
    assert sensed.attitude == own.attitude  # of positions alone
    made.close()
    assert not held.is_open


def test_velocities_are_those_of_poses() -> None:
    """(P-LOCATE)"""
    held = Held(Located(HERE, LEVEL, 10.0))
    made = localised(held)
    made.open(10.0)
    for k in range(1, 60):
        held.says = Located((1.0 + 0.02 * k, 2.0, 0.0), LEVEL, 10.0 + 0.05 * k)
        sensed = made.sense(10.0 + 0.05 * k)
    assert sensed is not None
    assert sensed.velocity_mps == pytest.approx((0.4, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (Located((math.nan, 0.0, 0.0), LEVEL, 10.1), "no number"),
        (Located(HERE, LEVEL, math.inf), "no number"),
        (Located(HERE, (0.0, 0.0, 0.0, 0.0), 10.1), "length 0"),
    ],
)
def test_what_is_no_pose_does_not_count_and_the_last_one_grows_old(
    wrong: Located, told: str
) -> None:
    """(P-LOCATE-POSE)"""
    held = Held(Located(HERE, LEVEL, 10.0))
    made = localised(held)
    made.open(10.0)
    held.says = wrong
    sensed = made.sense(10.2)
    assert sensed is not None
    assert (sensed.position_m, sensed.measured_at_s) == (HERE, 10.0)
    (remark,) = made.remarks
    assert told in remark
    held.says = Located(HERE, LEVEL, 10.3)
    made.sense(10.3)
    assert made.remarks == ()


def test_without_a_pose_there_is_no_start_and_it_is_said_why() -> None:
    """(P-LOCATE-START)"""
    held = Held()
    made = localised(held)
    with pytest.raises(DriverError, match="held does not say where the vehicle is"):
        made.open(10.0)
    assert not held.is_open
    held.remarks = ("there is no rigid body `car`",)
    with pytest.raises(DriverError, match="there is no rigid body `car`"):
        made.open(10.0)


@pytest.mark.parametrize("where", [(5.0, 0.0, 0.0), (0.0, 0.0, 3.5), (0.0, -0.5, -1.0)])
def test_who_stands_outside_of_the_world_is_told_of_axes_and_origin(where: Point) -> None:
    """(P-LOCATE-START)"""
    held = Held(Located(where, LEVEL, 10.0))
    made = localised(held)
    made.open(10.0)
    (remark,) = made.remarks
    assert "outside of the world" in remark
    held.says = Located((0.0, 0.0, -0.05), LEVEL, 10.1)
    made.sense(10.1)
    assert made.remarks == ()


class Passed:
    """A driver that wants to know where its vehicle is, and knows it after some poses."""

    def __init__(self, needs: int) -> None:
        self.capabilities: Any = None
        self.needs, self.heard = needs, list[Located]()
        self.opened_with = -1
        self.remarks = ("the estimate is not ready",)
        self.closed = False

    def open(self, now_s: float) -> None:
        self.opened_with = len(self.heard)

    def locate(self, located: Located, now_s: float) -> None:
        self.heard.append(located)

    def sense(self, now_s: float) -> Any:
        return vehicle(device()).sense(now_s) if len(self.heard) >= self.needs else None

    def close(self) -> None:
        self.closed = True


class Counting(Held):
    """A localiser that says something new whenever it is asked."""

    def locate(self, now_s: float) -> Located | None:
        self.says = Located(HERE, LEVEL, now_s)
        return self.says


def test_a_driver_that_wants_to_know_is_told_each_pose_once() -> None:
    """(P-LOCATE-DRIVER)"""
    passed: Any = Passed(needs=3)
    made = Localised(passed, Counting(), device())
    made.open(10.0)
    assert passed.opened_with == 1
    assert len(passed.heard) == 3
    held = Held(Located(HERE, LEVEL, 20.0))
    made.localiser = held
    made.sense(20.0)
    made.sense(20.05)
    assert len(passed.heard) == 4
    held.says = Located((math.nan, 0.0, 0.0), LEVEL, 20.1)
    made.sense(20.1)
    assert len(passed.heard) == 4


class Slow:
    """A driver that takes four seconds to open, by a clock that a test has set."""

    def __init__(self, passing: list[float]) -> None:
        self.capabilities = Capabilities(("CAR",), (Drive,), 20.0, 0.1)
        self.remarks: tuple[str, ...] = ()
        self._passing = passing

    def open(self, now_s: float) -> None:
        self._passing[0] += 4.0

    def sense(self, now_s: float) -> Sensed:
        return Sensed(HERE, LEVEL, (0.0, 0.0, 0.0), now_s)


def test_what_is_read_when_a_vehicle_was_slow_to_answer_is_read_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else the clock of a localiser is believed to be so much behind, and its poses are old."""
    passing = [10.0]
    monkeypatch.setattr("koord.runtime.drivers.localised.time.monotonic", lambda: passing[0])
    times: list[float] = []

    class Noting(Counting):
        def locate(self, now_s: float) -> Located | None:
            times.append(now_s)
            return super().locate(now_s)

    made: Any = Localised(Slow(passing), Noting(), device())  # type: ignore[arg-type]
    model = device_model(device().vehicle)
    setup = Setup(usual(model.body), field(WORLD, flat=True), 0.1)
    steersman = pilot(PilotSettings(model.body, model.planner), WORLD)
    driven = DrivenVehicle(made, steersman, setup, 10.0)
    assert times == [10.0, 14.0, 14.0]
    assert driven.sensed.measured_at_s == 14.0


def test_a_vehicle_that_does_not_take_its_pose_does_not_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-LOCATE-DRIVER)"""
    monkeypatch.setattr("koord.runtime.drivers.localised._TAKES_S", 0.05)
    passed: Any = Passed(needs=10**9)
    with pytest.raises(DriverError, match=r"does not take where held .*estimate is not ready"):
        Localised(passed, Counting(), device()).open(10.0)
    assert passed.closed


def test_it_goes_to_places_by_the_localiser_and_holds_while_it_is_not_seen() -> None:
    """(P-LOCATE)"""
    one = Guarded()
    one.driven.go_to((2.5, 1.5, 0.0))
    one.tick(20)
    assert math.dist(one.driven.sensed.position_m, (1.0, 1.0, 0.0)) > 0.05
    one.seen.sees = False
    one.tick(40)
    assert one.mode is Mode.HOLDING
    assert any(note.condition is Condition.POSE for note in one.driven.notes)
    stood = one.seen.body.truth()[0].copy()
    one.tick(20)
    assert (one.seen.body.truth()[0] == stood).all()
    one.seen.sees = True
    one.tick(300)
    assert one.driven.mode is Mode.RUNNING
    assert one.driven.sensors.reached
    assert math.dist(one.driven.sensed.position_m, (2.5, 1.5, 0.0)) < 0.2
    assert one.seen.body.truth()[0][0, 0] == pytest.approx(1.5, abs=0.2)  # as it thinks itself


def test_a_pose_that_jumps_stops_it() -> None:
    """(P-LOCATE)"""
    one = Guarded()
    one.driven.go_to((2.5, 1.5, 0.0))
    one.tick(20)
    one.seen.shift = (1.0, 3.0, 0.0)
    one.tick(2)
    assert one.mode is Mode.HOLDING
    assert any(note.condition is Condition.JUMP for note in one.driven.notes)


def test_what_is_said_goes_to_the_driver() -> None:
    made = localised(Held(Located(HERE, LEVEL, 10.0)))
    made.open(10.0)
    made.act("gripper", 1.0)
    made.command(Drive(0.5), 10.0)
    assert made.ports() == {}
    assert made.driver._told  # type: ignore[attr-defined]


@pytest.mark.parametrize("stamped", [True, False])
def test_differences_of_poses_come_to_the_velocity(stamped: bool) -> None:
    differences = Differences(0.1)
    for k in range(40):
        late_s = 0.02 * (k % 2) if stamped else 0.0  # the network delays; stamps know better
        stamp_s = 0.05 * k if stamped else 0.0
        differences.hear((0.05 * 0.6 * k, 0.0, 0.0), stamp_s, 0.05 * k + late_s)
    assert differences.velocity_mps == pytest.approx((0.6, 0.0, 0.0), rel=1e-4)


def test_one_pose_that_jumps_tells_a_part_of_its_velocity_only() -> None:
    differences = Differences(0.1)
    for k in range(2):
        differences.hear((0.1 * k, 0.0, 0.0), 0.05 * k, 0.05 * k)
    assert differences.velocity_mps[0] == pytest.approx(2.0 / 3)


def test_who_stands_outside_of_the_fence_does_not_start() -> None:
    """(P-LOCATE-START) It is told why, and moves once it is seen inside."""
    one = Guarded(shift=(5.0, 0.0, 0.0), starts=False)
    assert one.driven.mode is Mode.ARMED
    one.driven.go_to((2.5, 1.5, 0.0))
    one.tick(40)
    assert one.seen.body.truth()[0].tolist() == [[0.0, 0.0, 0.0]]
    assert any("outside of the world" in remark for remark in one.driven.remarks)
    assert any(note.condition is Condition.FENCE for note in one.driven.notes)


class SlowToOpen(Held):
    """A localiser that takes time to open; its clock is another one. It notes when it is asked."""

    def __init__(self, clock: SimpleNamespace) -> None:
        super().__init__()
        self.clock, self.asked, self.remote = clock, list[float](), RemoteClock()

    def open(self, now_s: float) -> None:
        self.clock.now += 0.7

    def locate(self, now_s: float) -> Located | None:
        self.asked.append(now_s)
        sent_s = self.clock.now - 5000.0
        self.remote.hear(sent_s, now_s)
        return Located(HERE, LEVEL, self.remote.ours(sent_s))


def test_what_took_long_to_open_does_not_make_poses_old(monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-LOCATE-START)"""
    clock = SimpleNamespace(now=10.0, sleep=lambda _: None)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(module, "time", clock)
    slow = SlowToOpen(clock)
    made = Localised(vehicle(replace(device(), options=None)), slow, device())
    made.open(10.0)
    assert min(slow.asked) == pytest.approx(10.7)
    clock.now += 0.05
    sensed = made.sense(clock.now)
    assert sensed is not None
    assert clock.now - sensed.measured_at_s == pytest.approx(0.0)


def test_a_clock_that_was_started_again_soon_is_another_one() -> None:
    clock = RemoteClock()
    clock.hear(0.6, 100.0)
    clock.hear(0.5, 100.1)  # overtaken on its way
    assert clock.ours(0.6) == pytest.approx(100.0, abs=0.01)
    clock.hear(0.2, 107.0)
    assert clock.ours(0.2) == pytest.approx(107.0)


def test_a_clock_is_not_read_before_it_was() -> None:
    clock = RemoteClock()
    clock.hear(1.0, 101.0)
    clock.hear(1.1, 100.5)  # said by somebody who has waited
    assert clock.ours(1.1) == pytest.approx(101.0, abs=0.01)
