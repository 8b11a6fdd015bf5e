"""The MAVLink driver over UDP, and the simulated autopilot in a process of its own.

Few and in real time: what is looked for comes when it comes, and nothing is said of how soon.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import common as mavlink

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
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
    Setpoint,
    Takeoff,
)
from koord.runtime.motion.world import World
from koord.testing.autopilot.machine import Settings
from koord.testing.sockets import Address
from tests.runtime.platform.autopilots import autopilot, running

WORLD = World((-5.0, -5.0, 0.0), (5.0, 5.0, 4.0))
PATIENCE_S = 60.0
TICK_S = 0.05


def driver(firmware: str, address: Address) -> MavlinkDriver:
    host, port = address
    options = MavlinkOptions(
        connection=f"udpout:{host}:{port}",
        autopilot=AutopilotKind(firmware),
        connect=PATIENCE_S,
        climb=2.0,
        silence=PATIENCE_S,
    )
    device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
    made = MavlinkDriver(device)
    made.open(time.monotonic())
    return made


def tell(made: MavlinkDriver, setpoint: Setpoint, until: Callable[[Sensed], bool]) -> None:
    """Tell an aircraft something at each tick until it has come of it."""
    begun = time.monotonic()
    while True:
        now = time.monotonic()
        sensed = made.sense(now)
        assert sensed is not None, "it was known at the start where it is"
        if until(sensed):
            return
        assert now - begun < PATIENCE_S, (setpoint, sensed, made.remarks)
        made.command(setpoint, now)
        time.sleep(TICK_S)


SLOW = pytest.mark.slow


@pytest.mark.parametrize("firmware", ["px4", pytest.param("ardupilot", marks=SLOW)])
def test_it_flies_there_and_lands(firmware: str) -> None:
    with autopilot(Settings(firmware, stream_loss_s=PATIENCE_S)) as address:
        made = driver(firmware, address)
        tell(made, Arm(), lambda sensed: sensed.armed is True)
        tell(made, Takeoff(0.5), lambda sensed: sensed.position_m[2] > 0.45)
        tell(made, Position((0.5, -0.5, 0.5), None, 1.0), _is_there)
        assert made.sense(time.monotonic()).link  # type: ignore[union-attr]
        tell(made, Land(), lambda sensed: sensed.airborne is False)
        tell(made, Disarm(), lambda sensed: sensed.armed is False)
        assert made.remarks == ()
        made.close()


def _is_there(sensed: Sensed) -> bool:
    x, y, z = sensed.position_m
    return abs(x - 0.5) < 0.1 and abs(y + 0.5) < 0.1 and abs(z - 0.5) < 0.1


def fly(firmware: str, address: Address) -> None:
    """What the process does that is killed."""
    made = driver(firmware, address)
    tell(made, Arm(), lambda sensed: sensed.armed is True)
    tell(made, Takeoff(0.5), lambda sensed: sensed.position_m[2] > 0.45)
    tell(made, Hold(), lambda sensed: False)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (Settings("px4", stream_loss_s=2.5, ground_loss_s=PATIENCE_S), "No offboard signal"),
        pytest.param(Settings("ardupilot", ground_loss_s=2.5), "GCS failsafe", marks=SLOW),
    ],
    ids=["px4", "ardupilot"],
)
def test_the_autopilot_lands_when_koord_is_killed(settings: Settings, said: str) -> None:
    with autopilot(settings) as address, Observer(address) as observer:
        with running(fly, settings.firmware, address) as flying:
            observer.wait_until(lambda: observer.height_m > 0.4)
            assert said not in observer.texts
            flying.kill()
        observer.wait_until(lambda: said in observer.texts)
        observer.wait_until(lambda: observer.height_m < 0.05 and observer.armed is False)


class Observer:
    """Somebody who looks on, and whose heartbeats are no ground station's."""

    def __init__(self, address: Address) -> None:
        self.texts: list[str] = []
        self.height_m = 0.0
        self.armed: bool | None = None
        self._codec = Codec(254, mavlink.MAV_COMP_ID_LOG)
        self._address = address
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.2)

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def wait_until(self, condition: Callable[[], bool]) -> None:
        begun = time.monotonic()
        while not condition():
            assert time.monotonic() - begun < PATIENCE_S, (self.texts, self.height_m, self.armed)
            interval = mavlink.MAVLink_command_long_message(
                1,
                1,
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
                0,
                *(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 33_333.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            )
            self._socket.sendto(self._codec.encoded(interval), self._address)
            self._hear_some()

    def _hear_some(self) -> None:
        for _ in range(20):
            try:
                data = self._socket.recv(2048)
            except TimeoutError:
                return
            for message in self._codec.decoded(data):
                match message.get_type():
                    case "STATUSTEXT":
                        self.texts.append(message.text)
                    case "LOCAL_POSITION_NED":
                        self.height_m = -message.z
                    case "HEARTBEAT":
                        flags = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
                        self.armed = bool(flags)


def test_nobody_there_is_an_error_that_says_where() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        port = bound.getsockname()[1]
        options = MavlinkOptions(connection=f"udpout:127.0.0.1:{port}", connect=0.3)
        device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
        with pytest.raises(DriverError, match=f"nothing is heard of system 1 at .*{port}"):
            MavlinkDriver(device).open(time.monotonic())
