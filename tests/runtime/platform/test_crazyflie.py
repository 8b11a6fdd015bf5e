"""The driver of Crazyflies and a simulated one in one process, in virtual time."""

from __future__ import annotations

import math
import struct

import msgspec
import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.crazyflie.driver import CrazyflieDriver
from koord.runtime.drivers.crazyflie.link import Down
from koord.runtime.drivers.crazyflie.options import CrazyflieOptions
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Hold,
    Land,
    Located,
    Position,
    Takeoff,
    Track,
    Velocity,
)
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.bodies import PlannerName
from koord.runtime.motion.field import field
from koord.runtime.motion.world import Point
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.testing.crazyflie.machine import Settings, SimulatedCrazyflie, State
from tests.runtime.platform.bench import TICK_S, WORLD
from tests.runtime.platform.flown import Air, Bench


def test_it_takes_off_follows_a_way_holds_lands_and_disarms() -> None:
    bench = Bench(Air(Settings(arms_itself=False))).risen()
    assert bench.here == pytest.approx((0.0, 0.0, 1.0), abs=0.05)
    assert bench.sensed.airborne is True
    furthest, begun, rate = 0.0, bench.air.now, 0.5  # on a circle of 1 m that begins here
    for _ in range(200):
        angle = rate * (bench.air.now + TICK_S - begun) - math.pi / 2
        x, y = math.cos(angle), math.sin(angle)
        there = (x, 1.0 + y, 1.0)
        velocity = (-rate * y, rate * x, 0.0)
        bench.tick(Track(there, velocity, (-rate * rate * x, -rate * rate * y, 0.0)))
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
    bench.tick(Disarm(), 100)
    assert bench.state() is State.CHECKS_PASS
    assert bench.remarks() == ()
    bench.risen()  # and again


# --- frames and set-points ------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0, 90, -135, 30])
def test_poses_are_east_north_up_with_the_nose_counter_clockwise_from_east(degrees: float) -> None:
    settings = Settings(start_m=(2.0, 3.0, 0.5), yaw_rad=math.radians(degrees))
    bench = Bench(Air(settings))
    assert bench.here == pytest.approx((2.0, 3.0, 0.5))
    assert math.degrees(yaw_of(bench.sensed.attitude)) == pytest.approx(degrees, abs=0.1)


@pytest.mark.parametrize(
    ("origin", "there"), [((1.0, -1.0, 0.25), (1.5, -1.0, 0.25)), ("start", (1.5, 2.0, 0.0))]
)
def test_the_origin_of_its_estimate_is_where_the_options_say(
    origin: tuple[float, float, float], there: Point
) -> None:
    bench = Bench(Air(Settings(start_m=(0.5, 0.0, 0.0))), origin=origin)
    assert bench.here == pytest.approx(there)
    bench.risen()
    x, y, _ = there
    bench.tick(Position((x + 1.0, y - 0.5, 1.5), math.radians(30), 0.8), 120)
    assert bench.here == pytest.approx((x + 1.0, y - 0.5, 1.5), abs=0.05)
    assert yaw_of(bench.sensed.attitude) == pytest.approx(math.radians(30), abs=0.02)
    assert bench.crazyflie.position_m[:2] == pytest.approx((1.5, -0.5), abs=0.05)


def test_who_flies_east_lifts_its_tail_and_who_flies_north_lifts_its_right() -> None:
    """The nose is to the east: forward tilts it down, to the left lifts the right side."""
    bench = Bench().risen()
    bench.tick(Velocity((1.0, 0.0, 0.0)), 3)
    _, x, y, _ = (c * math.copysign(1.0, bench.sensed.attitude[0]) for c in bench.sensed.attitude)
    assert y > 0.05
    assert x == pytest.approx(0.0, abs=0.02)
    bench.tick(Hold(), 100)
    bench.tick(Velocity((0.0, 1.0, 0.0)), 3)
    _, x, y, _ = (c * math.copysign(1.0, bench.sensed.attitude[0]) for c in bench.sensed.attitude)
    assert x < -0.05
    assert y == pytest.approx(0.0, abs=0.02)


def test_velocities_turn_counter_clockwise() -> None:
    bench = Bench().risen()
    bench.tick(Velocity((0.5, 0.0, 0.0), 0.2), 40)
    assert bench.here[0] > 0.5
    assert yaw_of(bench.sensed.attitude) == pytest.approx(0.4, abs=0.05)
    assert bench.sensed.velocity_mps == pytest.approx((0.5, 0.0, 0.0), abs=0.05)


def test_a_tracked_position_goes_out_with_its_speed_and_acceleration() -> None:
    """It is a full set-point: millimetres, and a quaternion of 32 bits."""
    bench = Bench().risen()
    bench.tick(Track((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), (0.01, 0.02, 0.03), 0.0))
    kind, *numbers = struct.unpack_from("<B9h", bench.sent(7)[-1])
    assert kind == 6
    assert numbers == [1000, 2000, 3000, 100, 200, 300, 10, 20, 30]


def test_a_place_that_is_far_away_goes_out_as_a_position() -> None:
    """Full set-points end at 32 m."""
    bench = Bench().risen()
    bench.tick(Track((40.0, 0.0, 1.0), (0.0, 0.0, 0.0), heading_rad=math.pi / 2))
    kind, *numbers = struct.unpack("<B4f", bench.sent(7)[-1])
    assert kind == 7
    assert numbers == pytest.approx([40.0, 0.0, 1.0, 90.0])


def test_who_has_no_wish_for_a_heading_keeps_it() -> None:
    bench = Bench(Air(Settings(yaw_rad=1.0))).risen()
    bench.tick(Position((0.5, 0.0, 1.0), None, 0.5), 60)
    assert yaw_of(bench.sensed.attitude) == pytest.approx(1.0, abs=0.02)


def test_who_holds_stops_where_it_can_and_not_where_it_was() -> None:
    bench = Bench().risen()
    bench.tick(Velocity((1.0, 0.0, 0.0)), 40)
    there = bench.here
    bench.tick(Hold(), 80)
    assert 0.1 < bench.here[0] - there[0] < 0.5


# --- arming ---------------------------------------------------------------------------------------


def test_who_is_armed_stays_on_the_ground_until_it_takes_off() -> None:
    bench = Bench(Air(Settings(arms_itself=False))).armed()
    bench.tick(Arm(), 20)
    bench.tick(Hold(), 20)
    assert bench.sent(7) == []
    assert bench.crazyflie.runs is False


def test_what_arms_itself_is_not_asked_to_and_is_armed_when_it_is_told() -> None:
    """A Crazyflie 2.1 could fly when it lies on its feet; so nothing is said to it. (C-ARM)"""
    bench = Bench()
    for told in (Disarm(), Takeoff(1.0), Position((1.0, 0.0, 1.0), None, 0.5)):
        bench.tick(told, 20)
        assert bench.sensed.armed is False
    bench.tick(Arm(), 40)
    assert bench.sensed.armed is True
    assert bench.sent(9, 1) == []
    assert bench.sent(7) == []
    bench.tick(Disarm(), 2)
    assert bench.sensed.armed is False


def test_who_takes_over_in_the_air_holds_and_lands_it() -> None:
    """It was flown by a process that is no more: it is nobody's wish that it falls."""
    air = Air(Settings())
    Bench(air).risen()
    late = Bench(air)
    late.tick(Hold(), 60)
    assert late.here[2] > 0.9
    assert late.state() is State.FLYING
    late.until(Land(), lambda: late.sensed.airborne is False)


def test_a_crazyflie_that_refuses_to_arm_is_named_with_its_reason() -> None:
    bench = Bench(Air(Settings(arms_itself=False, tumbled=True)))
    bench.tick(Arm(), 100)
    assert bench.remarks() == (
        "the Crazyflie cannot fly: it does not lie as it should: put it on its feet",
    )
    assert not bench.sensed.link
    assert 1 < len(bench.sent(9, 1)) < 8, "it asks again, and not at each tick"
    bench.crazyflie.tumbled = False
    bench.armed()
    assert bench.remarks() == ()
    assert bench.sensed.link


def test_a_refusal_without_a_known_reason_is_named_too() -> None:
    bench = Bench(Air(Settings(arms_itself=False)))
    bench.crazyflie.state = State.CHECKS_FAIL
    bench.crazyflie._watch = lambda: None  # type: ignore[method-assign]
    bench.tick(Arm(), 20)
    assert bench.remarks() == ("the Crazyflie does not arm: its supervisor refuses",)


def test_who_disarms_itself_is_not_armed_again_by_a_wish() -> None:
    """Nobody flew for half a minute: somebody may have their hands at it. (C-ARM)"""
    bench = Bench(Air(Settings(arms_itself=False))).armed()
    bench.until(Hold(), lambda: bench.sensed.armed is False, 40.0)
    bench.tick(Takeoff(1.0), 60)
    assert bench.crazyflie.armed is False
    assert "does not arm it again by itself" in bench.remarks()[0]
    bench.tick(Disarm(), 5)
    bench.risen()


@pytest.mark.parametrize("arms_itself", [True, False])
def test_disarmed_in_the_air_its_motors_stop_and_it_does_not_lock_itself(arms_itself: bool) -> None:
    bench = Bench(Air(Settings(arms_itself=arms_itself))).risen()
    bench.tick(Disarm())
    assert bench.crazyflie.runs is False
    bench.tick(Disarm(), 150)
    assert bench.state() is (State.READY if arms_itself else State.CHECKS_PASS)
    assert bench.remarks() == ()


def test_firmware_before_the_supervisors_port_is_armed_by_the_platforms() -> None:
    bench = Bench(Air(Settings(arms_itself=False)))
    bench.driver._protocol = 11
    bench.tick(Arm())
    assert bench.sent(13, 0) == [b"\1\1"]
    assert bench.sent(9, 1) == []


# --- landing --------------------------------------------------------------------------------------


def test_it_is_told_once_to_land_and_does_so_though_koord_is_silent() -> None:
    """(C-LAND)"""
    bench = Bench().risen()
    bench.tick(Land(), 3)
    assert len(bench.sent(8)) == 1
    bench.until(None, lambda: not bench.crazyflie.runs)
    assert bench.crazyflie.position_m[2] < 0.1
    assert bench.state() is not State.LOCKED


def test_it_is_told_to_land_until_it_has_heard() -> None:
    air = Air(Settings(), seed=5)
    bench = Bench(air).risen()
    air.loss = 0.4
    bench.until(Land(), lambda: bench.sensed.airborne is False)
    assert bench.crazyflie.position_m[2] < 0.05
    assert bench.state() is not State.LOCKED


def test_who_is_told_to_hold_while_it_lands_holds_and_lands_again() -> None:
    bench = Bench().risen()
    bench.tick(Land(), 20)
    bench.tick(Hold(), 40)
    there = bench.here
    bench.tick(Hold(), 20)
    assert math.dist(there, bench.here) < 0.02
    bench.until(Land(), lambda: bench.sensed.airborne is False)


# --- silence, links and estimates -----------------------------------------------------------------


def test_it_levels_out_and_stops_its_motors_when_koord_falls_silent() -> None:
    """(C-SILENCE)"""
    bench = Bench().risen()
    sent = len(bench.air.sent)
    bench.tick(None, 12)
    assert bench.state() is State.LEVEL_OUT
    bench.tick(None, 40)
    assert len(bench.air.sent) == sent, "nothing is sent but at ticks"
    assert bench.state() is State.LOCKED
    bench.tick(None, 40)
    assert bench.crazyflie.position_m[2] == 0.0
    bench.tick(Hold(), 5)
    assert not bench.sensed.link
    first, *texts = bench.remarks()
    assert first == (
        "the Crazyflie cannot fly: it has locked itself (after a fall or an emergency stop):"
        " start it again"
    )
    assert texts == ["the Crazyflie says: SUP: Locked, reboot required"]


def test_it_flies_with_a_third_of_what_it_is_told_lost() -> None:
    air = Air(Settings(), seed=3)
    bench = Bench(air)
    air.loss = 0.3
    bench.risen()
    bench.tick(Position((1.0, 1.0, 1.0), None, 0.5), 120)
    assert bench.here == pytest.approx((1.0, 1.0, 1.0), abs=0.1)
    bench.until(Land(), lambda: bench.sensed.airborne is False)


def test_a_link_that_is_lost_is_told_and_found_again() -> None:
    """It is switched off on the ground, and on again: its tables are asked for anew. (C-LINK)"""
    bench = Bench()
    bench.tick(Disarm(), 20)
    bench.air.down = bench.air.up = False
    bench.tick(Disarm(), 30)
    assert not bench.is_linked()
    assert bench.remarks() == ("nothing was heard of the Crazyflie for 1.5 s: is it in reach?",)
    bench.tick(Disarm(), 60)
    assert bench.remarks() == ("the link to the Crazyflie is lost: Too many packets lost",)
    bench.air.crazyflie = SimulatedCrazyflie(Settings(start_m=(1.0, 0.0, 0.0)), bench.air.now)
    bench.air.down = bench.air.up = True
    bench.tick(Disarm(), 80)
    assert bench.is_linked()
    assert bench.here == pytest.approx((1.0, 0.0, 0.0))
    assert bench.air.now - bench.sensed.measured_at_s < 0.1
    assert bench.remarks() == ()
    assert bench.air.connects == 2
    bench.risen()


def test_a_pose_that_its_estimate_is_not_sure_of_does_not_count() -> None:
    """(C-POSE)"""
    bench = Bench().risen()
    bench.crazyflie.settings = Settings(wants_poses=True)
    bench.tick(Hold(), 20)
    assert bench.air.now - bench.sensed.measured_at_s > 0.5
    (told,) = bench.remarks()
    assert told == (
        "the Crazyflie does not know where it is: its estimate is sure to 10 m, and `spread` is"
        " 0.2 m"
    )


def test_its_clock_of_24_bits_begins_anew_and_poses_do_not_grow_old() -> None:
    air = Air(Settings())
    air.crazyflie._boot_s -= 2**24 / 1000 - 2.0
    bench = Bench(air)
    bench.tick(Disarm(), 100)
    assert bench.air.now - bench.sensed.measured_at_s < 0.05


def test_its_battery_is_a_share_of_its_voltage() -> None:
    bench = Bench(Air(Settings(battery=0.5)), battery=(3.0, 4.2))
    assert bench.sensed.battery == pytest.approx(0.5)
    assert Bench(Air(Settings(battery=0.5)), battery=(3.7, 4.2)).sensed.battery == 0.0


# --- poses from outside ---------------------------------------------------------------------------


def test_it_is_told_where_it_is_in_the_frame_of_its_estimate() -> None:
    """(C-LOCATE)"""
    vehicle = Vehicle("drone", "QUAD", localiser="natnet")
    bench = Bench(Air(Settings(wants_poses=True)), vehicle, origin=(1.0, -1.0, 0.0))
    assert bench.sense() is None
    half = math.sqrt(0.5)
    for _ in range(10):
        located = Located((1.5, 0.5, 0.0), (half, 0.0, 0.0, half), bench.air.now)
        bench.driver.locate(located, bench.air.now)
        bench.tick(Disarm())
    assert bench.here == pytest.approx((1.5, 0.5, 0.0))
    x, y, z, *attitude = bench.crazyflie.poses[-1]
    assert (x, y, z) == (0.5, 1.5, 0.0)
    assert attitude == pytest.approx([0.0, 0.0, half, half])
    bench.driver.locate(Located((1.5, 0.5, 0.0), None, bench.air.now), bench.air.now)
    assert bench.crazyflie.poses[-1] == (0.5, 1.5, 0.0)


# --- what is wrong at the start -------------------------------------------------------------------


def opened(air: Air, **given: float) -> DriverError:
    options = CrazyflieOptions(uri="udp://127.0.0.1:19850", **given)  # type: ignore[arg-type]
    device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
    with pytest.raises(DriverError) as caught:
        CrazyflieDriver(device, air.connected(options)).open(air.now)
    return caught.value


@pytest.mark.parametrize(
    ("why", "message", "hint"),
    [
        (
            "Couldn't load link driver: Cannot find a Crazyradio Dongle\n\nTr…",
            "there is no",
            "plug",
        ),
        ("Couldn't load link driver: [Errno 16] Resource busy\n\n", "another process", "radio://1"),
        ("Too many packets lost", "nothing is heard of", "is it switched on?"),
        ("", "nothing is heard of", "is it switched on?"),
    ],
)
def test_whoever_cannot_be_reached_is_named_with_what_would_help(
    why: str, message: str, hint: str
) -> None:
    air = Air(Settings())
    air.up = air.down = False
    air._lost.append(Down(why))
    error = opened(air)
    assert error.message.startswith(message)
    assert "udp://127.0.0.1:19850" in error.message
    assert "\n" not in error.message
    assert hint in error.hint


def test_firmware_that_does_not_tell_what_is_needed_is_named() -> None:
    error = opened(Air(Settings(forgets=("supervisor.info",))))
    assert "its firmware is too old: Variable supervisor.info not in TOC" in error.message


def test_who_does_not_know_where_it_is_at_the_start_is_named() -> None:
    error = opened(Air(Settings(wants_poses=True)), connect=1.0)
    assert "does not know where it is: its estimate is sure to 10 m" in error.message
    assert "`localiser`" in error.hint


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ('{"uri": "radio://0/80/3M"}', "no address of a Crazyflie"),
        ('{"uri": "udp://127.0.0.1"}', "no address of a Crazyflie"),
        ('{"uri": "usb://0", "battery": [4.2, 3.0]}', "the lower one first"),
        ('{"uri": "usb://0", "origin": [0.0, 1e999, 0.0]}', "out of range"),
        ('{"uri": "usb://0", "height": 1}', "height"),
        ("{}", "uri"),
    ],
)
def test_options_that_make_no_sense_are_refused(told: str, said: str) -> None:
    with pytest.raises(msgspec.MsgspecError, match=said):
        msgspec.json.decode(told, type=CrazyflieOptions)


@pytest.mark.parametrize(
    "uri",
    ["radio://0/80/2M/E7E7E7E7E7", "radio://0/80/250K", "usb://0", "udp://10.0.0.7:19850"],
)
def test_addresses_are_as_cflib_writes_them(uri: str) -> None:
    assert CrazyflieOptions(uri=uri).uri == uri


# --- with a guardian ------------------------------------------------------------------------------


class Flight:
    """A Crazyflie with its driver, pilot and guardian."""

    def __init__(self, settings: Settings, **options: float) -> None:
        self.air = Air(settings)
        told = CrazyflieOptions(uri="udp://127.0.0.1:19850", **options)  # type: ignore[arg-type]
        described = Vehicle("drone", "QUAD")
        device = Device(0, described, WORLD, (0.0, 0.0, 0.0), options=told)
        driver = CrazyflieDriver(device, self.air.connected(told))
        steering = PilotSettings(described.body, PlannerName.STRAIGHT)
        steersman = pilot(steering, WORLD, 1, wishes=driver.capabilities.wishes)
        setup = Setup(usual(described.body), field(WORLD, flat=False), 0.2)
        self.vehicle = DrivenVehicle(driver, steersman, setup, self.air.now)

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.air.pass_time(self.air.now + TICK_S)
            self.vehicle.tick(self.air.now, 0.1)

    def started(self) -> Flight:
        self.tick(30)
        self.vehicle.order(Order.ARM, self.air.now)
        self.tick(30)
        self.vehicle.order(Order.START, self.air.now)
        self.tick(2)
        assert self.vehicle.mode is Mode.RUNNING, list(self.vehicle.notes)
        return self


@pytest.mark.parametrize("arms_itself", [True, False])
def test_it_flies_to_a_place_and_lands_when_it_is_told_to(arms_itself: bool) -> None:
    flight = Flight(Settings(arms_itself=arms_itself)).started()
    flight.vehicle.go_to((2.0, 1.0, 1.5))
    flight.tick(260)
    assert flight.air.crazyflie.position_m == pytest.approx((2.0, 1.0, 1.5), abs=0.15)
    flight.vehicle.order(Order.LAND, flight.air.now)
    flight.tick(240)
    assert flight.vehicle.mode is Mode.STOPPED
    assert flight.vehicle.is_at_rest
    assert flight.air.crazyflie.state is not State.LOCKED


def test_a_battery_that_runs_low_lands_it() -> None:
    flight = Flight(Settings(battery=0.9, drain_per_s=0.08)).started()
    flight.vehicle.go_to((2.0, 1.0, 1.5))
    flight.tick(400)
    assert flight.vehicle.mode in (Mode.LANDING, Mode.STOPPED)
    assert any(note.condition is Condition.BATTERY for note in flight.vehicle.notes)
    flight.tick(100)
    assert flight.air.crazyflie.runs is False
    assert flight.air.crazyflie.state is not State.LOCKED


def test_an_estop_lands_it_and_it_is_disarmed_on_the_ground() -> None:
    flight = Flight(Settings(arms_itself=False)).started()
    flight.vehicle.go_to((1.0, 0.0, 1.0))
    flight.tick(120)
    flight.vehicle.order(Order.ESTOP, flight.air.now)
    flight.tick(200)
    assert flight.vehicle.mode is Mode.ESTOPPED
    assert flight.air.crazyflie.position_m[2] == 0.0
    assert flight.air.crazyflie.armed is False
