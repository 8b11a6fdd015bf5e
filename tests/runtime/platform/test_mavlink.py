"""The MAVLink driver and a simulated autopilot in one process, in virtual time."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import common as mavlink

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.mavlink.driver import MavlinkDriver
from koord.runtime.drivers.mavlink.link import Codec
from koord.runtime.drivers.mavlink.options import AutopilotKind, MavlinkOptions
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Hold,
    Land,
    Position,
    Sensed,
    Takeoff,
    Track,
    Velocity,
)
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode as GuardianMode
from koord.runtime.motion.bodies import PlannerName
from koord.runtime.motion.field import field
from koord.runtime.motion.world import Point
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.testing.autopilot.machine import Mode, Settings, SimulatedAutopilot
from koord.testing.autopilot.serving import Wire
from tests.runtime.platform.bench import TICK_S, WORLD, AircraftBench

FIRMWARES = ("px4", "ardupilot")


class Air:
    """A link in virtual time, on which datagrams are lost or late as is said."""

    def __init__(self, settings: Settings, seed: int = 0) -> None:
        self.now = 100.0
        self.autopilot = SimulatedAutopilot(settings, self.now)
        self.loss = 0.0  #: of datagrams, in both directions
        self.up = self.down = True
        self.sent: list[Any] = []
        self._random = random.Random(seed)
        self._codec = Codec(settings.ground_system, 190)
        self._far = Wire(settings.system)
        self._arrived: list[Any] = []

    def pass_time(self, until_s: float) -> None:
        while self.now < until_s - 1e-9:
            self.now = min(until_s, self.now + 0.01)
            self.autopilot.advance(self.now)
            for data in self._far.told(self.autopilot):
                if self.down and self._random.random() >= self.loss:
                    self._arrived += self._codec.decoded(data)

    def receive(self) -> list[Any]:
        found, self._arrived = self._arrived, []
        return found

    def send(self, message: Any) -> None:
        self.sent.append(message)
        if self.up and self._random.random() >= self.loss:
            self._far.heard(self.autopilot, self._codec.encoded(message))

    def wait(self, most_s: float) -> float:
        self.pass_time(self.now + most_s)
        return most_s

    def close(self) -> None:
        self.up = self.down = False


class Bench(AircraftBench[Air, MavlinkDriver]):
    """A driver and its autopilot."""

    def __init__(self, firmware: str = "px4", air: Air | None = None, **options: Any) -> None:
        air = air or Air(Settings(firmware))
        told = MavlinkOptions(
            connection="udpin:127.0.0.1:0", autopilot=AutopilotKind(firmware), **options
        )
        device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=told)
        super().__init__(air, MavlinkDriver(device, air))

    @property
    def autopilot(self) -> SimulatedAutopilot:
        return self.air.autopilot

    def sense(self) -> Sensed:
        super().sense()
        return self.sensed


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_it_takes_off_follows_a_way_holds_lands_and_disarms(firmware: str) -> None:
    """(M-TAKEOFF)"""
    bench = Bench(firmware).risen()
    assert bench.here == pytest.approx((0.0, 0.0, 1.0), abs=0.05)
    assert bench.sensed.airborne is True
    furthest = 0.0
    begun, centre = bench.air.now, (0.0, 1.0)
    rate = 0.5  # rad/s, on a circle of 1 m that begins here
    for _ in range(200):
        angle = rate * (bench.air.now + TICK_S - begun) - math.pi / 2
        x, y = math.cos(angle), math.sin(angle)
        there = (centre[0] + x, centre[1] + y, 1.0)
        velocity = (-rate * y, rate * x, 0.0)
        acceleration = (-rate * rate * x, -rate * rate * y, 0.0)
        bench.tick(Track(there, velocity, acceleration))
        if bench.air.now - begun > 2.0:  # it cannot be as fast at once
            furthest = max(furthest, math.dist(bench.here, there))
    assert furthest < 0.15
    bench.tick(Hold(), 60)
    there = bench.here
    bench.tick(Hold(), 60)
    assert math.dist(bench.here, there) < 0.02
    bench.until(Land(), lambda: bench.sensed.airborne is False)
    assert bench.here[:2] == pytest.approx(there[:2], abs=0.1)
    bench.until(Disarm(), lambda: bench.sensed.armed is False, 3.0)
    assert bench.autopilot.failsafes == []
    assert bench.driver.remarks == ()


# --- frames and set-points ------------------------------------------------------------------------


def test_poses_are_east_north_up() -> None:
    """Three metres to the north, two to the east, the nose to the north-west. (M-FRAME)"""
    settings = Settings(start_m=(3.0, 2.0, -0.5), yaw_rad=-math.pi / 4)
    bench = Bench(air=Air(settings))
    assert bench.here == pytest.approx((2.0, 3.0, 0.5))
    assert yaw_of(bench.sensed.attitude) == pytest.approx(math.radians(135))


@pytest.mark.parametrize(
    ("origin", "there"),
    [((1.0, -1.0, 0.25), (3.0, 2.0, 0.75)), ("start", (2.0, 3.0, 0.5))],
)
def test_the_origin_of_its_frame_is_where_the_options_say(origin: Any, there: Point) -> None:
    bench = Bench(air=Air(Settings(start_m=(3.0, 2.0, -0.5))), origin=origin)
    assert bench.here == pytest.approx(there)


def test_it_flies_where_it_is_told_in_the_frame_of_the_world() -> None:
    """The autopilot's frame begins elsewhere, and its nose is turned on the way."""
    bench = Bench(air=Air(Settings(start_m=(1.0, 0.5, 0.0))), origin=(-1.0, 2.0, 0.0)).risen()
    assert bench.here[:2] == pytest.approx((-0.5, 3.0), abs=0.05)
    goal = (1.0, 2.0, 1.5)
    bench.tick(Position(goal, math.radians(30), 0.8), 120)
    assert bench.here == pytest.approx(goal, abs=0.05)
    assert yaw_of(bench.sensed.attitude) == pytest.approx(math.radians(30), abs=0.02)
    assert bench.autopilot.airframe.position_m == pytest.approx((0.0, 2.0, -1.5), abs=0.05)


def last_setpoint(bench: Bench) -> Any:
    return next(
        one for one in reversed(bench.air.sent) if one.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    )


def test_a_tracked_position_goes_out_with_its_speed_and_acceleration() -> None:
    bench = Bench().risen()
    bench.tick(Track((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), (0.01, 0.02, 0.03), 0.0))
    sent = last_setpoint(bench)
    assert (sent.x, sent.y, sent.z) == (2.0, 1.0, -3.0)
    assert (sent.vx, sent.vy, sent.vz) == (0.2, 0.1, -0.3)
    assert (sent.afx, sent.afy, sent.afz) == (0.02, 0.01, -0.03)
    assert sent.yaw == pytest.approx(math.pi / 2)
    assert sent.type_mask == mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    assert sent.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
    bench.tick(Track((1.0, 2.0, 3.0), (0.0, 0.0, 0.0)))
    ignored = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    ignored |= mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    assert last_setpoint(bench).type_mask == ignored


def test_velocities_turn_counter_clockwise_in_koord_and_clockwise_in_mavlink() -> None:
    bench = Bench().risen()
    before = yaw_of(bench.sensed.attitude)
    bench.tick(Velocity((0.5, 0.0, 0.0), 0.2), 40)
    assert bench.here[0] > 0.5
    turned = math.remainder(yaw_of(bench.sensed.attitude) - before, math.tau)
    assert turned == pytest.approx(0.4, abs=0.05)
    assert last_setpoint(bench).type_mask & 0b111 == 0b111


def test_who_holds_stops_where_it_can_and_not_where_it_was() -> None:
    bench = Bench().risen()
    bench.tick(Velocity((1.0, 0.0, 0.0)), 40)
    there = bench.here
    bench.tick(Hold(), 80)
    assert 0.1 < bench.here[0] - there[0] < 0.5
    east = [bench.here[0]]
    for _ in range(20):
        bench.tick(Hold())
        east.append(bench.here[0])
    assert max(east) - min(east) < 0.02


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_who_is_armed_stays_on_the_ground_until_it_takes_off(firmware: str) -> None:
    bench = Bench(firmware).armed()
    bench.tick(Arm(), 20)
    bench.tick(Hold(), 20)
    assert bench.autopilot.airframe.height_m == 0.0
    assert bench.sensed.airborne is False


# --- arming ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("firmware", "said"), [("px4", "Preflight Fail"), ("ardupilot", "PreArm")])
def test_an_autopilot_that_refuses_to_arm_is_named_with_its_reason(
    firmware: str, said: str
) -> None:
    """(M-COMMAND)"""
    reason = "compass 0 is inconsistent with the compass that is inside of it"
    bench = Bench(firmware, Air(Settings(firmware, failing=(reason,))))
    bench.tick(Arm(), 100)
    refusal, *texts = bench.driver.remarks
    assert refusal.startswith("the autopilot does not arm (")
    assert texts == [f"the autopilot says: {said}: {reason}"]
    asked = [one for one in bench.air.sent if is_command(one, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)]
    assert 1 < len(asked) < 6, "it asks again, and not at each tick"
    bench.autopilot.failing = ()
    bench.armed()
    bench.tick(Hold(), 300)
    assert not any(text in bench.driver.remarks for text in (refusal, *texts))


def is_command(message: Any, command: int) -> bool:
    return message.get_type() == "COMMAND_LONG" and bool(message.command == command)


def test_px4_is_sent_set_points_before_it_is_asked_for_offboard_mode() -> None:
    """(M-MODE)"""
    bench = Bench("px4").armed()
    kinds = [
        one.get_type()
        for one in bench.air.sent
        if one.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
        or is_command(one, mavlink.MAV_CMD_DO_SET_MODE)
    ]
    first = kinds.index("COMMAND_LONG")
    assert first >= 1.0 / TICK_S
    assert bench.driver.remarks == (), "the autopilot never had to say no"


def test_who_disarms_itself_is_not_armed_again_by_a_wish() -> None:
    """Somebody may have their hands at it. (M-ARM)"""
    bench = Bench().armed()
    bench.until(Hold(), lambda: bench.sensed.armed is False)
    bench.tick(Takeoff(1.0), 60)
    assert bench.autopilot.armed is False
    assert "does not arm it again by itself" in bench.driver.remarks[0]
    bench.tick(Disarm(), 5)
    bench.risen()


def test_what_is_in_the_air_is_disarmed_by_force_and_what_stands_is_not() -> None:
    bench = Bench().armed()
    bench.tick(Disarm(), 30)
    asked = [one for one in bench.air.sent if is_command(one, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)]
    assert (asked[-1].param1, asked[-1].param2) == (0.0, 0.0)
    assert bench.autopilot.armed is False
    bench.risen()
    bench.tick(Disarm())
    bench.tick(Disarm())
    assert bench.autopilot.armed is False


# --- links ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_it_flies_with_a_third_of_the_datagrams_lost(firmware: str) -> None:
    air = Air(Settings(firmware), seed=3)
    air.loss = 0.3
    bench = Bench(firmware, air).risen()
    bench.tick(Position((1.0, 1.0, 1.0), None, 0.5), 120)
    assert bench.here == pytest.approx((1.0, 1.0, 1.0), abs=0.1)
    bench.until(Land(), lambda: bench.sensed.airborne is False)
    bench.until(Disarm(), lambda: bench.sensed.armed is False)


def test_a_link_that_is_lost_is_told_and_so_is_its_return() -> None:
    bench = Bench().risen()
    bench.air.down = False
    bench.tick(Hold(), 20)
    assert bench.air.now - bench.sensed.measured_at_s > 0.9
    assert bench.is_linked()
    bench.tick(Hold(), 60)
    assert not bench.is_linked()
    bench.air.down = True
    bench.tick(Hold(), 40)
    assert bench.is_linked()
    assert bench.air.now - bench.sensed.measured_at_s < 0.1
    bench.tick(Position((1.0, 0.0, 1.0), None, 0.5), 80)
    assert bench.here == pytest.approx((1.0, 0.0, 1.0), abs=0.1)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_the_autopilot_acts_when_koord_falls_silent(firmware: str) -> None:
    """(M-TICK)"""
    bench = Bench(firmware).risen()
    sent = len(bench.air.sent)
    bench.tick(None, 200)
    assert len(bench.air.sent) == sent, "nothing is sent but at ticks"
    assert bench.autopilot.failsafes
    assert bench.autopilot.airframe.height_m < 0.1


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_who_comes_back_goes_on_when_it_is_told_to_move(firmware: str) -> None:
    silence = 1.0 if firmware == "px4" else 5.0
    air = Air(Settings(firmware, loss_mode=Mode.HOLD))
    bench = Bench(firmware, air, silence=silence).risen()
    air.up = air.down = False
    bench.tick(Hold(), 120)
    assert bench.autopilot.mode is Mode.HOLD
    air.up = air.down = True
    bench.tick(Hold(), 40)
    assert bench.autopilot.mode is Mode.HOLD, "holding it is, and is left so"
    assert bench.is_linked()
    bench.tick(Position((1.0, 0.0, 1.0), None, 0.5), 120)
    assert bench.here == pytest.approx((1.0, 0.0, 1.0), abs=0.1)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_who_steers_by_hand_is_not_disturbed(firmware: str) -> None:
    """(M-HANDS)"""
    bench = Bench(firmware).risen()
    bench.autopilot._enter(Mode.MANUAL)
    bench.tick(Track((1.0, 0.0, 1.0), (0.0, 0.0, 0.0)), 40)
    assert not bench.is_linked()
    assert "koord does not command it" in bench.driver.remarks[0]
    before = len(commands(bench))
    bench.tick(Hold(), 40)
    bench.tick(Land(), 40)
    assert len(commands(bench)) == before
    assert bench.autopilot.mode is Mode.MANUAL
    bench.autopilot._enter(Mode.LAND)
    bench.until(None, lambda: not bench.autopilot.is_in_the_air)
    bench.tick(Disarm(), 40)
    assert bench.is_linked()
    assert bench.driver.remarks == ()
    bench.risen()


def commands(bench: Bench) -> list[Any]:
    return [one for one in bench.air.sent if one.get_type() == "COMMAND_LONG"]


def test_who_was_told_to_hold_by_a_ground_station_is_not_led_on_but_lands() -> None:
    bench = Bench().risen()
    bench.autopilot._enter(Mode.HOLD)
    bench.tick(Track((1.0, 0.0, 1.0), (0.0, 0.0, 0.0)), 60)
    bench.tick(Hold(), 20)
    bench.tick(Track((1.0, 0.0, 1.0), (0.0, 0.0, 0.0)), 20)
    assert bench.autopilot.mode is Mode.HOLD
    assert bench.here[:2] == pytest.approx((0.0, 0.0), abs=0.05)
    bench.until(Land(), lambda: bench.sensed.airborne is False)


def test_an_autopilot_that_was_started_anew_is_asked_for_its_poses_again() -> None:
    bench = Bench()
    bench.tick(Disarm(), 200)
    bench.air.autopilot = SimulatedAutopilot(Settings(start_m=(1.0, 0.0, 0.0)), bench.air.now)
    bench.tick(Disarm(), 100)
    assert bench.here == pytest.approx((0.0, 1.0, 0.0))
    assert bench.air.now - bench.sensed.measured_at_s < 0.1


def test_poses_that_waited_in_a_queue_are_as_old_as_they_are() -> None:
    bench = Bench()
    bench.tick(Hold(), 20)
    before = bench.sensed.measured_at_s
    bench.air.pass_time(bench.air.now + 0.1)
    told = bench.air.receive()
    bench.air.pass_time(bench.air.now + 1.0)
    bench.air._arrived = told
    measured = bench.sense().measured_at_s
    assert measured > before
    assert bench.air.now - measured == pytest.approx(1.0, abs=0.05)


def test_other_systems_are_not_listened_to() -> None:
    """Several vehicles may talk to one port."""
    with pytest.raises(DriverError, match="nothing is heard of system 7"):
        Bench(air=Air(Settings(system=1)), system=7)


def test_what_the_battery_has_is_told() -> None:
    bench = Bench(air=Air(Settings(battery=0.42)))
    bench.tick(Hold(), 40)
    assert bench.sensed.battery == pytest.approx(0.42)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (Settings("px4", stream_loss_s=7.5), "its COM_OF_LOSS_T is 7.5 s, and the option"),
        (Settings("ardupilot", ground_loss_s=math.inf), "its FS_GCS_ENABLE is 0"),
    ],
)
def test_a_failsafe_that_is_not_set_up_is_told(settings: Settings, said: str) -> None:
    """(M-FAILSAFE)"""
    bench = Bench(settings.firmware, Air(settings))
    bench.tick(Disarm(), 40)
    (told,) = bench.driver.remarks
    assert said in told
    well = Bench(settings.firmware)
    well.tick(Disarm(), 40)
    assert well.driver.remarks == ()


# --- options --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "missing required field `connection`"),
        ({"connection": "/dev/ttyUSB0"}, "`/dev/ttyUSB0` is no connection: write one of udpin:"),
        ({"connection": "udpin:localhost"}, "is no connection"),
        ({"connection": "udpin:0.0.0.0:70000"}, "there is no port 70000"),
        ({"connection": "udpin:0.0.0.0:1", "autopilot": "inav"}, "Invalid enum value 'inav'"),
        ({"connection": "udpin:0.0.0.0:1", "takeoff": 1}, "unknown field `takeoff`"),
        ({"connection": "udpin:0.0.0.0:1", "takeoff_height": 0}, "`\\$.takeoff_height`"),
        ({"connection": "udpin:0.0.0.0:1", "system": 255}, "have to differ"),
    ],
)
def test_an_option_that_is_wrong_is_named(options: dict[str, Any], said: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=said):
        msgspec.convert(options, MavlinkOptions)


# pymavlink leaves a socket that cannot be bound to the collector of garbage.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_vehicle_without_options_and_a_place_that_cannot_be_opened_are_errors() -> None:
    vehicle = Vehicle("drone", "QUAD")
    with pytest.raises(DriverError, match="needs a `connection`"):
        MavlinkDriver(Device(0, vehicle, WORLD, (0.0, 0.0, 0.0)))
    for connection in ("udpin:192.0.2.1:14540", "serial:/dev/no_such_device:57600"):
        options = MavlinkOptions(connection=connection)
        driver = MavlinkDriver(Device(0, vehicle, WORLD, (0.0, 0.0, 0.0), options=options))
        with pytest.raises(DriverError, match=r"cannot open|pyserial is needed"):
            driver.open(0.0)


# --- with pilot and guardian ----------------------------------------------------------------------


class Guarded:
    """A driven vehicle: pilot, guardian, driver and autopilot."""

    def __init__(self, firmware: str, settings: Settings | None = None) -> None:
        self.air = Air(settings or Settings(firmware))
        options = MavlinkOptions(
            connection="udpin:127.0.0.1:0", autopilot=AutopilotKind(firmware), takeoff_height=1.0
        )
        told = Vehicle("drone", "QUAD", speed_mps=0.5)
        device = Device(0, told, WORLD, (0.0, 0.0, 0.0), options=options)
        self.body = told.body
        setup = Setup(usual(self.body), field(WORLD, flat=False), 0.1)
        steersman = pilot(PilotSettings(self.body, PlannerName.RRT_DRONE), WORLD)
        self.driven = DrivenVehicle(MavlinkDriver(device, self.air), steersman, setup, self.air.now)
        self.starts = True

    def tick(self) -> None:
        self.air.pass_time(self.air.now + TICK_S)
        driven, now = self.driven, self.air.now
        driven.tick(now, 0.05)
        if self.starts and driven.mode is GuardianMode.DISARMED:
            driven.order(Order.ARM, now)
        elif self.starts and driven.mode is GuardianMode.ARMED and driven.sensed.armed:
            driven.order(Order.START, now)

    def until(self, condition: Callable[[], bool], most_s: float = 40.0) -> None:
        begun = self.air.now
        while not condition():
            assert self.air.now - begun < most_s, (self.driven.mode, self.driven.sensed)
            self.tick()


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_guarded_vehicle_takes_off_by_itself_and_reaches_its_place(firmware: str) -> None:
    one = Guarded(firmware)
    one.until(lambda: one.driven.mode is GuardianMode.RUNNING)
    one.driven.go_to((2.0, -1.0, 1.5))
    one.tick()
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.driven.sensed.position_m, (2.0, -1.0, 1.5)) < 0.2
    one.starts = False
    one.driven.order(Order.LAND, one.air.now)
    one.until(lambda: one.driven.is_at_rest and not one.air.autopilot.armed)
    assert {note.condition for note in one.driven.notes} <= {None, Condition.LINK}
    assert one.driven.remarks == ()
    assert one.air.autopilot.failsafes == []


def test_people_hear_why_a_guarded_vehicle_does_not_start() -> None:
    one = Guarded("px4", Settings(failing=("no GPS fix",)))
    one.until(lambda: bool(one.driven.remarks))
    one.until(lambda: "the autopilot says: Preflight Fail: no GPS fix" in one.driven.remarks)
    assert one.driven.mode is GuardianMode.ARMED
    one.air.autopilot.failing = ()
    one.until(lambda: one.driven.mode is GuardianMode.RUNNING)
    one.driven.go_to((1.0, 0.0, 1.0))
    one.until(lambda: one.driven.sensed.position_m[2] > 0.9)


def test_a_lost_link_is_held_for_and_flown_on_after() -> None:
    one = Guarded("px4", Settings(loss_mode=Mode.HOLD))
    one.driven.go_to((3.0, 0.0, 1.0))
    one.until(lambda: one.driven.sensed.position_m[2] > 0.9)
    one.until(lambda: one.driven.sensed.position_m[0] > 1.0)
    one.air.up = one.air.down = False
    one.until(lambda: one.driven.mode is GuardianMode.HOLDING, 1.0)
    one.until(lambda: one.air.autopilot.failsafes != [], 3.0)
    assert one.air.autopilot.airframe.position_m[1] < 2.5
    one.air.up = one.air.down = True
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.driven.sensed.position_m, (3.0, 0.0, 1.0)) < 0.2
