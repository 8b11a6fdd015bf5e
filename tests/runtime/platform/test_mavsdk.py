"""The driver of autopilots, with a vehicle by MAVSDK at the other end: a second opinion.

Heartbeats, modes, arming, parameters and acknowledgements are those of MAVSDK's server plugins.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.mavlink.driver import MavlinkDriver
from koord.runtime.drivers.mavlink.options import MavlinkOptions
from koord.runtime.drivers.setpoints import Arm, Disarm, Hold, Land, Position, Sensed, Takeoff
from tests.runtime.platform.autopilots import SPAWN, running
from tests.runtime.platform.test_mavlink_process import PATIENCE_S, WORLD, tell
from tests.runtime.platform.test_robotarium_process import free_port

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("mavsdk") is None, reason="needs: pip install mavsdk"),
]


@contextmanager
def vehicle(*more: str) -> Iterator[int]:
    """A vehicle in a process of its own; yields the port to which it speaks."""
    port = free_port()
    command = [sys.executable, "-m", "koord.testing.autopilot.by_mavsdk", *more]
    command += ["--connection", f"udpout://127.0.0.1:{port}"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        yield port
    finally:
        process.kill()
        process.wait()


def driver(port: int) -> MavlinkDriver:
    options = MavlinkOptions(
        connection=f"udpin:127.0.0.1:{port}", connect=PATIENCE_S, climb=1.0, silence=2.0
    )
    device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
    made = MavlinkDriver(device)
    made.open(time.monotonic())
    return made


@pytest.mark.sample
def test_it_flies_there_with_its_nose_where_it_is_told_and_lands() -> None:
    with vehicle() as port:
        made = driver(port)
        tell(made, Arm(), lambda sensed: sensed.armed is True)
        tell(made, Takeoff(1.0), lambda sensed: sensed.position_m[2] > 0.95)
        tell(made, Position((1.0, 0.5, 1.0), 0.5, 0.8), _is_there)
        sensed = made.sense(time.monotonic())
        assert sensed is not None
        assert sensed.battery == pytest.approx(0.8, abs=0.01)
        assert sensed.airborne is True
        tell(made, Land(), lambda sensed: sensed.airborne is False)
        tell(made, Disarm(), lambda sensed: sensed.armed is False)
        assert made.remarks == ()
        made.close()


def _is_there(sensed: Sensed) -> bool:
    x, y, z = sensed.position_m
    is_near = abs(x - 1.0) < 0.1 and abs(y - 0.5) < 0.1 and abs(z - 1.0) < 0.1
    return is_near and abs(yaw_of(sensed.attitude) - 0.5) < 0.05


def test_a_vehicle_that_refuses_to_arm_is_named() -> None:
    with vehicle("--refuses") as port:
        made = driver(port)
        tell(made, Arm(), lambda _: any("does not arm" in one for one in made.remarks))
        assert made.sense(time.monotonic()).armed is False  # type: ignore[union-attr]
        made.close()


def fly(port: int, flies: object) -> None:
    """What the process does that is killed."""
    made = driver(port)
    tell(made, Arm(), lambda sensed: sensed.armed is True)
    tell(made, Takeoff(1.0), lambda sensed: sensed.position_m[2] > 0.8)
    flies.set()  # type: ignore[attr-defined]
    tell(made, Hold(), lambda sensed: False)


def test_it_lands_when_koord_is_killed() -> None:
    flies = SPAWN.Event()
    with vehicle() as port:
        with running(fly, port, flies) as flying:
            assert flies.wait(PATIENCE_S)
            flying.kill()
        looking = driver(port)
        begun = time.monotonic()
        while not ((sensed := looking.sense(time.monotonic())) and sensed.armed is False):
            assert time.monotonic() - begun < PATIENCE_S, sensed
            time.sleep(0.05)
        assert sensed.position_m[2] < 0.05
        looking.close()
