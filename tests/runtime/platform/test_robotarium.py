"""The driver and the bridge of the Robotarium, and an arena, in one process and virtual time."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.robotarium.bridge import DEAD_MAN_STEPS, STEP_S, Bridge, limited
from koord.runtime.drivers.robotarium.driver import RobotariumDriver
from koord.runtime.drivers.robotarium.messages import Told, encoded
from koord.runtime.drivers.robotarium.options import RobotariumOptions
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Drive,
    Hold,
    Land,
    Sensed,
    Setpoint,
    Velocity,
)
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.bodies import DifferentialDrive, PlannerName
from koord.runtime.motion.field import field
from koord.runtime.motion.world import World
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.testing.robotarium.arena import Arena

WORLD = World((-1.6, -1.0, 0.0), (1.6, 1.0, 1.0))
TICK_S = 0.05


class Loopback:
    """A wire in virtual time, to a bridge that steps an arena."""

    def __init__(self, *places: tuple[float, float, float]) -> None:
        self.now = 100.0
        self.arena = Arena(len(places), False, np.array(places).T)
        self.bridge = Bridge(self.arena, len(places))
        self.up = True
        self.steps = 0
        self._inboxes: dict[int, list[bytes]] = {}

    def wire(self) -> One:
        return One(self, len(self._inboxes))

    def pass_time(self, until_s: float) -> None:
        while self.now < until_s - 1e-9:
            self.now = min(until_s, self.now + 0.01)
            while self.steps * STEP_S <= self.now - 100.0:
                self.steps += 1
                for data, (_, number) in self.bridge.step(self.now):
                    if self.up:
                        self._inboxes[number].append(data)


class One:
    """The end of one driver."""

    def __init__(self, loopback: Loopback, number: int) -> None:
        self._loopback, self._number = loopback, number
        loopback._inboxes[number] = []

    def receive(self) -> list[bytes]:
        found, self._loopback._inboxes[self._number] = self._loopback._inboxes[self._number], []
        return found

    def send(self, data: bytes) -> None:
        self._loopback.bridge.hear(data, ("driver", self._number))

    def wait(self, most_s: float) -> float:
        self._loopback.pass_time(self._loopback.now + most_s)
        return most_s

    def close(self) -> None:
        return


def driver(
    loopback: Loopback, pid: int = 0, world: World = WORLD, **more: object
) -> RobotariumDriver:
    options = RobotariumOptions(**more)  # type: ignore[arg-type]
    device = Device(pid, Vehicle("rover", "DIFF"), world, (0.0, 0.0, 0.0), options=options)
    made = RobotariumDriver(device, loopback.wire())
    made.open(loopback.now)
    return made


def sensed(made: RobotariumDriver, loopback: Loopback) -> Sensed:
    found = made.sense(loopback.now)
    assert found is not None
    return found


def tell(
    made: RobotariumDriver, loopback: Loopback, setpoint: Setpoint | None, times: int = 1
) -> Sensed:
    """Sense and command for some ticks; None: say nothing."""
    for _ in range(times):
        loopback.pass_time(loopback.now + TICK_S)
        made.sense(loopback.now)
        if setpoint is not None:
            made.command(setpoint, loopback.now)
    return sensed(made, loopback)


def test_it_drives_and_turns_as_it_is_told_and_stands_when_it_holds() -> None:
    """(B-BRIDGE)"""
    loopback = Loopback((0.0, 0.0, math.pi / 2))
    made = driver(loopback)
    there = tell(made, loopback, Drive(0.1), 40)
    x, y, z = there.position_m
    assert (x, z) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert y == pytest.approx(0.2, abs=0.02)
    assert there.velocity_mps == pytest.approx((0.0, 0.1, 0.0), abs=0.02)
    assert there.armed is None
    for stop in (Hold(), Land(), Arm(), Disarm()):
        tell(made, loopback, Drive(0.1), 4)
        before = tell(made, loopback, stop, 2).position_m
        assert tell(made, loopback, stop, 10).position_m == before
    turned = tell(made, loopback, Drive(0.0, 0.5), 40)
    assert math.remainder(yaw_of(turned.attitude) - math.pi / 2, math.tau) == pytest.approx(
        1.0, abs=0.1
    )
    assert loopback.arena.errors == []


def test_a_velocity_is_followed_as_far_as_wheels_can() -> None:
    loopback = Loopback((0.0, 0.0, 0.0))
    made = driver(loopback)
    assert tell(made, loopback, Velocity((0.1, 0.3, 0.0)), 20).position_m == pytest.approx(
        (0.1, 0.0, 0.0), abs=0.02
    )


def test_a_robot_that_is_told_nothing_stands_after_half_a_second() -> None:
    """(B-SILENCE)"""
    loopback = Loopback((-1.0, 0.0, 0.0), (1.0, 0.5, 0.0))
    made, other = driver(loopback), driver(loopback, 1)
    tell(made, loopback, Drive(0.1), 4)
    x, _, _ = tell(made, loopback, None, 10).position_m
    stands = tell(made, loopback, None, 20).position_m
    assert stands[0] - x <= 0.1 * (DEAD_MAN_STEPS + 2) * STEP_S
    assert tell(made, loopback, None, 20).position_m == stands
    assert sensed(other, loopback).position_m == (1.0, 0.5, 0.0)
    assert tell(made, loopback, Drive(0.1), 20).position_m[0] > stands[0]


@pytest.mark.parametrize(("speed", "rate"), [(0.5, 0.0), (-0.2, 2.0), (0.0, 9.0), (0.15, -3.0)])
def test_what_is_too_fast_is_slowed_down_along_its_circle(speed: float, rate: float) -> None:
    """(B-LIMITS)"""
    loopback = Loopback((0.0, 0.0, 0.0))
    tell(driver(loopback), loopback, Drive(speed, rate), 10)
    assert loopback.arena.errors == []
    v, w = limited(speed, rate)
    assert v * rate == pytest.approx(w * speed)
    assert abs(v) + 0.055 * abs(w) == pytest.approx(0.2)


def test_what_can_be_done_is_done_and_what_is_no_number_is_to_stand() -> None:
    assert limited(0.1, -0.5) == (0.1, -0.5)
    assert limited(math.nan, 0.0) == limited(0.0, math.inf) == limited(0.0, 0.0) == (0.0, 0.0)


def test_a_robot_has_one_driver_and_the_next_one_when_that_is_silent() -> None:
    """(B-ONE)"""
    loopback = Loopback((0.0, 0.0, 0.0))
    made = driver(loopback)
    other = loopback.wire()
    for _ in range(5):
        other.send(encoded(Told(0, "another", 0.2, 0.0)))
        tell(made, loopback, Hold())
    assert sensed(made, loopback).position_m == (0.0, 0.0, 0.0)

    class Meanwhile(One):
        """The end of another one, while the first goes on."""

        def wait(self, most_s: float) -> float:
            made.command(Hold(), loopback.now)
            return super().wait(most_s)

    device = Device(0, Vehicle("r", "DIFF"), WORLD, (0.0, 0.0, 0.0))
    with pytest.raises(DriverError, match="another process drives it") as caught:
        RobotariumDriver(device, Meanwhile(loopback, 7)).open(loopback.now)
    assert "another run" in caught.value.hint
    tell(made, loopback, None, 40)
    driver(loopback)
    assert tell(made, loopback, Hold(), 4).link is False
    assert "another process drives it" in made.remarks[0]


def test_a_robot_that_is_not_there_is_named() -> None:
    with pytest.raises(DriverError, match="robot 3 be driven: there are robots 0 to 1"):
        driver(Loopback((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), pid=3)
    loopback = Loopback((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert sensed(driver(loopback, pid=3, robot=1), loopback).position_m[0] == 1.0


def test_a_world_that_is_larger_than_the_arena_is_refused() -> None:
    """(B-FENCE)"""
    larger = World((-2.0, -1.0, 0.0), (1.6, 1.0, 1.0))
    with pytest.raises(DriverError, match=r"ends 1.6 m and 1 m from its middle") as caught:
        driver(Loopback((0.0, 0.0, 0.0)), world=larger)
    assert caught.value.hint == "bounds: {low: [-1.6, -1, 0], high: [1.6, 1, 1]}"


def test_a_bridge_that_is_silent_is_no_link_and_comes_back() -> None:
    loopback = Loopback((0.0, 0.0, 0.0))
    made = driver(loopback)
    loopback.up = False
    assert tell(made, loopback, Hold(), 20).link is False
    loopback.up = True
    back = tell(made, loopback, Hold(), 4)
    assert back.link is True
    assert loopback.now - back.measured_at_s < 0.1


def test_no_bridge_is_named_with_the_command_that_starts_it() -> None:
    loopback = Loopback((0.0, 0.0, 0.0))
    loopback.up = False
    with pytest.raises(DriverError, match=r"no bridge .* answers at 127.0.0.1:5550") as caught:
        driver(loopback, connect=0.5)
    assert "koord.runtime.drivers.robotarium.bridge --robots" in caught.value.hint


def test_junk_is_not_listened_to() -> None:
    loopback = Loopback((0.0, 0.0, 0.0))
    made = driver(loopback)
    for junk in (b"", b"\xff\xfe", b"{}", b'{"type": "told", "robot": "0"}', b"[" * 2000):
        loopback.bridge.hear(junk, ("somebody", 0))
        loopback._inboxes[0].append(junk)
    assert tell(made, loopback, Drive(0.1), 10).link is True


@pytest.mark.parametrize(
    "told", ['{"bridge": "10.0.0.1:5550"}', '{"bridge": "127.0.0.1"}', '{"robot": 50}', '{"a": 1}']
)
def test_options_that_make_no_sense_are_refused(told: str) -> None:
    """Whoever can speak to the bridge drives: it is on this machine. (B-LOCAL)"""
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(told, type=RobotariumOptions)


def test_with_pilot_and_guardian_it_goes_to_a_place_and_stops_at_the_end() -> None:
    loopback = Loopback((-1.0, -0.4, 0.0))
    body = DifferentialDrive().cruising(0.15)
    device = Device(0, Vehicle("rover", "DIFF"), WORLD, (0.0, 0.0, 0.0))
    made = RobotariumDriver(device, loopback.wire())
    steersman = pilot(PilotSettings(body, PlannerName.STRAIGHT), WORLD, 1)
    setup = Setup(usual(body), field(WORLD, flat=True), 0.2)
    driven = DrivenVehicle(made, steersman, setup, loopback.now)

    def tick(times: int) -> None:
        for _ in range(times):
            loopback.pass_time(loopback.now + TICK_S)
            driven.tick(loopback.now, 0.1)

    tick(30)
    driven.order(Order.ARM, loopback.now)
    tick(30)
    driven.order(Order.START, loopback.now)
    driven.go_to((0.8, 0.5, 0.0))
    tick(600)
    assert driven.sensors.reached, list(driven.notes)
    assert loopback.arena.poses[:2, 0] == pytest.approx([0.8, 0.5], abs=0.15)
    driven.order(Order.LAND, loopback.now)
    tick(60)
    assert driven.mode is Mode.STOPPED
    assert driven.is_at_rest
    assert loopback.arena.errors == []
