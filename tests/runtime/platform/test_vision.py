"""Aircraft that know where they are by a localiser alone, in virtual time."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers import localised as module
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import product, turned
from koord.runtime.drivers.localised import Localised
from koord.runtime.drivers.localiser import LocaliserOptions
from koord.runtime.drivers.mavlink.driver import MavlinkDriver
from koord.runtime.drivers.mavlink.options import AutopilotKind, MavlinkOptions, Vision
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Hold,
    Land,
    Located,
    Position,
    Sensed,
    Setpoint,
    Takeoff,
)
from koord.runtime.motion.world import Point
from koord.testing.autopilot.machine import Mode, Settings
from tests.runtime.platform.bench import TICK_S, WORLD
from tests.runtime.platform.test_mavlink import FIRMWARES, Air


class Cameras:
    """A localiser that sees where a simulated aircraft really is."""

    def __init__(self, air: Air, origin: Point) -> None:
        self.air, self.origin = air, origin
        self.remarks: tuple[str, ...] = ()
        self.sees = self.tells_attitude = True
        self.shift: Point = (0.0, 0.0, 0.0)
        self.turn = 0.0
        self._last: Located | None = None

    def open(self, now_s: float) -> None:
        return

    def locate(self, now_s: float) -> Located | None:
        self.air.pass_time(now_s)
        if self.sees:
            body = self.air.autopilot.airframe
            north, east, down = body.position_m
            x, y, z = (
                a + b + c
                for a, b, c in zip((east, north, -down), self.origin, self.shift, strict=True)
            )
            attitude = turned(math.pi / 2 - body.yaw_rad + self.turn)
            self._last = Located((x, y, z), attitude if self.tells_attitude else None, now_s)
        return self._last

    def close(self) -> None:
        return


class Flight:
    """An aircraft without GPS, its driver and its localiser."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        firmware: str = "px4",
        settings: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        told = {"vision": True, "start_m": (0.5, -0.5, 0.0), "yaw_rad": -0.8, **(settings or {})}
        self.air = Air(Settings(firmware, **told))
        clock = SimpleNamespace(monotonic=lambda: self.air.now, sleep=lambda _: None)
        clock.sleep = lambda seconds: self.air.pass_time(self.air.now + seconds)
        monkeypatch.setattr(module, "time", clock)
        origin = (1.0, 2.0, 0.0)
        self.cameras = Cameras(self.air, origin)
        made = MavlinkOptions(
            connection="udpin:127.0.0.1:0",
            autopilot=AutopilotKind(firmware),
            origin=origin,
            climb=1.0,
            **options,
        )
        device = Device(0, Vehicle("drone", "QUAD", localiser="cameras"), WORLD, (0.0, 0.0, 0.0))
        driver = MavlinkDriver(_with(device, made), self.air)
        self.driver = Localised(driver, self.cameras, _with(device, LocaliserOptions()))
        self.sensed: Sensed | None = None

    def open(self) -> Flight:
        self.driver.open(self.air.now)
        return self

    def tick(self, setpoint: Setpoint, times: int = 1) -> None:
        for _ in range(times):
            self.air.pass_time(self.air.now + TICK_S)
            self.sensed = self.driver.sense(self.air.now)
            self.driver.command(setpoint, self.air.now)

    def until(self, setpoint: Setpoint, what: str, value: Any, most_s: float = 20.0) -> None:
        end = self.air.now + most_s
        while getattr(self.sensed, what, None) is not value:
            assert self.air.now < end, (self.sensed, self.driver.remarks)
            self.tick(setpoint)

    def risen(self) -> Flight:
        self.until(Arm(), "armed", True)
        self.tick(Takeoff(1.0), 100)
        return self

    def answers(self) -> bool:
        return self.sensed is not None and self.sensed.link

    @property
    def true(self) -> Point:
        north, east, down = self.air.autopilot.airframe.position_m
        return east + 1.0, north + 2.0, -down


def _with(device: Device, options: Any) -> Device:
    return Device(0, device.vehicle, device.world, device.position_m, options=options)


@pytest.mark.parametrize("firmware", FIRMWARES)
@pytest.mark.parametrize("vision", [Vision.POSITION, Vision.ODOMETRY])
def test_it_flies_by_a_localiser_alone(
    firmware: str, vision: Vision, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(M-VISION) From start to landing, in frames that do not begin where the world does."""
    one = Flight(monkeypatch, firmware, vision=vision).open().risen()
    assert one.true == pytest.approx((0.5, 2.5, 1.0), abs=0.1)
    goal = (-0.5, 1.0, 1.5)
    one.tick(Position(goal, None, 0.8), 140)
    assert one.true == pytest.approx(goal, abs=0.08)
    assert one.sensed is not None
    assert one.sensed.position_m == pytest.approx(one.true)
    assert one.sensed.link
    one.until(Land(), "airborne", False)
    one.until(Disarm(), "armed", False)
    assert one.driver.remarks == ()
    estimate = one.air.autopilot.estimate
    assert estimate.heard > 300
    assert estimate.refused == 0, "its nose points where it is told"


def test_known_poses_go_out_north_east_down(monkeypatch: pytest.MonkeyPatch) -> None:
    """(M-VISION) It looks north, with its nose up, at two metres east, three north, one up."""
    nose_up = (math.cos(0.1), 0.0, -math.sin(0.1), 0.0)
    located = Located((3.0, 5.0, 1.0), product(turned(math.pi / 2), nose_up), 7.5)
    one = Flight(monkeypatch)
    one.driver.driver.locate(located, 8.0)  # type: ignore[attr-defined]
    (sent,) = one.air.sent
    assert sent.usec == 7_500_000
    assert (sent.x, sent.y, sent.z) == pytest.approx((3.0, 2.0, -1.0))
    assert (sent.roll, sent.pitch, sent.yaw) == pytest.approx((0.0, 0.2, 0.0), abs=1e-9)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_odometry_is_in_the_frames_that_the_autopilot_takes(
    firmware: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(M-VISION) It looks north and moves east, which is to its right."""
    one = Flight(monkeypatch, firmware, vision=Vision.ODOMETRY)
    for k in range(60):
        there = (1.0 + 0.02 * k, 2.0, 0.0)
        one.driver.driver.locate(Located(there, turned(math.pi / 2), 0.05 * k), 0.05 * k)  # type: ignore[attr-defined]
    sent = one.air.sent[-1]
    assert sent.frame_id == (1 if firmware == "px4" else 20)
    assert sent.child_frame_id == 12
    assert (sent.x, sent.y, sent.z) == pytest.approx((0.0, 0.02 * 59, 0.0), abs=1e-9)
    assert tuple(map(abs, sent.q)) == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert (sent.vx, sent.vy, sent.vz) == pytest.approx((0.0, 0.4, 0.0), abs=1e-6)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_who_is_not_seen_any_more_is_told_nothing_old_and_lands_by_itself(
    firmware: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(M-VISION)"""
    one = Flight(monkeypatch, firmware).open().risen()
    one.cameras.sees = False
    heard = one.air.autopilot.estimate.heard
    one.tick(Hold(), 60)
    assert one.air.autopilot.estimate.heard == heard
    assert one.air.autopilot.failsafes == ["Position estimate lost, landing"]
    assert one.air.autopilot.mode is Mode.LAND
    assert one.sensed is not None
    assert one.air.now - one.sensed.measured_at_s > 2.9
    assert math.dist(one.true[:2], (0.5, 2.5)) < 0.3


def test_an_autopilot_that_does_not_take_its_pose_does_not_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-LOCATE-DRIVER) The cameras' body has its axes otherwise: a frame that does not match."""
    one = Flight(monkeypatch)
    one.cameras.turn = math.pi / 2
    with pytest.raises(DriverError) as caught:
        one.open()
    assert "does not take where cameras says that it is" in caught.value.message
    assert "EKF2_EV_CTRL" in caught.value.message
    assert one.air.autopilot.estimate.refused > 100


def test_an_autopilot_that_is_elsewhere_by_its_own_estimate_does_not_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(M-VISION) It has an estimate of its own, and the localiser says something else."""
    one = Flight(monkeypatch, settings={"vision": False}, vision=Vision.NONE).open()
    one.tick(Disarm(), 40)
    assert one.answers()
    one.cameras.shift = (0.7, 0.0, 0.0)
    one.tick(Disarm(), 5)
    assert one.answers()
    one.tick(Disarm(), 15)
    assert not one.answers()
    (remark,) = one.driver.remarks
    assert "0.70 m from where the localiser says" in remark
    one.cameras.shift = (0.0, 0.0, 0.0)
    one.tick(Disarm(), 2)
    assert one.answers()
    assert one.driver.remarks == ()


def test_a_localiser_of_places_alone_is_too_little_for_an_autopilot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(M-VISION)"""
    one = Flight(monkeypatch)
    one.cameras.tells_attitude = False
    with pytest.raises(DriverError, match="the localiser tells no attitude"):
        one.open()
