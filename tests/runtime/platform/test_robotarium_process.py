"""The driver of the Robotarium over UDP, and the bridge in a process of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.robotarium.bridge import main
from koord.runtime.drivers.robotarium.driver import RobotariumDriver
from koord.runtime.drivers.robotarium.options import RobotariumOptions
from koord.runtime.drivers.setpoints import Drive, Hold, Sensed, Setpoint
from koord.runtime.motion.world import World
from tests.runtime.platform.autopilots import SPAWN, running

WORLD = World((-1.6, -1.0, 0.0), (1.6, 1.0, 1.0))
PATIENCE_S = 60.0
TICK_S = 0.05

FAKE = "koord.testing.robotarium.arena:Arena"

#: Where .ci/peers puts the simulator of the Robotarium.
SIMULATOR = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "koord/robotarium"

REAL = pytest.param(
    "rps.robotarium:Robotarium",
    marks=[
        pytest.mark.slow,
        pytest.mark.sample,
        pytest.mark.skipif(
            find_spec("rps") is None and not (SIMULATOR / "rps").exists(),
            reason="the simulator is not there: run .ci/peers, or pip install koord[robotarium]",
        ),
    ],
)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        return int(bound.getsockname()[1])


@contextmanager
def bridge(arena: str, *places: str) -> Iterator[str]:
    """A bridge in a process of its own; yields where it is."""
    where = f"127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "koord.runtime.drivers.robotarium.bridge", "--bind", where]
    command += ["--robots", str(len(places)), "--arena", arena]
    command += [f"--at={place}" for place in places]
    modules = os.pathsep.join([str(SIMULATOR), *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        command, env=os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": modules}
    )
    try:
        yield where
    finally:
        process.kill()
        process.wait()


def made(where: str, pid: int = 0) -> RobotariumDriver:
    options = RobotariumOptions(bridge=where, connect=PATIENCE_S)
    driver = RobotariumDriver(
        Device(pid, Vehicle("rover", "DIFF"), WORLD, (0.0, 0.0, 0.0), options=options)
    )
    driver.open(time.monotonic())
    return driver


def tell(
    driver: RobotariumDriver, setpoint: Setpoint | None, until: Callable[[Sensed], bool]
) -> Sensed:
    """Tell it something at each tick until it has come of it; None: look on."""
    begun = time.monotonic()
    while True:
        now = time.monotonic()
        sensed = driver.sense(now)
        assert sensed is not None, "it was known at the start where it is"
        if until(sensed):
            return sensed
        assert now - begun < PATIENCE_S, (setpoint, sensed, driver.remarks)
        if setpoint is not None:
            driver.command(setpoint, now)
        time.sleep(TICK_S)


@pytest.mark.parametrize("arena", [FAKE, REAL])
def test_it_drives_there_and_stands(arena: str) -> None:
    with bridge(arena, "-1,0,0", "1,0.5,3.1") as where:
        driver, other = made(where), made(where, 1)
        tell(driver, Drive(0.2), lambda sensed: sensed.position_m[0] > -0.9)
        still = tell(driver, Hold(), lambda sensed: abs(sensed.velocity_mps[0]) < 0.01)
        assert still.position_m[0] < 0.0
        assert still.link
        assert other.sense(time.monotonic()).position_m[:2] == (1.0, 0.5)  # type: ignore[union-attr]
        driver.close()
        other.close()


def drive(where: str, drives: Event) -> None:
    """What the process does that is killed."""
    driver = made(where)
    tell(driver, Drive(0.05), lambda sensed: sensed.position_m[0] > -0.95)
    drives.set()
    tell(driver, Drive(0.05), lambda sensed: False)


@pytest.mark.slow
@pytest.mark.parametrize("arena", [FAKE, REAL])
def test_a_robot_stands_when_koord_is_killed(arena: str) -> None:
    """Who looks on is let in when nobody else drives any more, and moves nothing. (B-SILENCE)"""
    drives = SPAWN.Event()
    with bridge(arena, "-1,0,0") as where:
        with running(drive, where, drives) as driving:
            assert drives.wait(PATIENCE_S)
            driving.kill()
        looking = made(where)
        first = tell(looking, None, lambda sensed: True)
        later_s = first.measured_at_s + 1.0
        last = tell(looking, None, lambda sensed: sensed.measured_at_s > later_s)
        assert -0.95 < last.position_m[0] < 0.0
        assert last.position_m == first.position_m
        looking.close()


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (["--robots", "0"], "there are 1 to 50"),
        (["--robots", "2", "--at", "0,0,0"], "1 places for 2 robots"),
        (["--robots", "1", "--bind", "0.0.0.0:5550"], "invalid address_of value"),
        (["--robots", "1", "--arena", "no_such_module:Arena"], "pip install 'koord[robotarium]'"),
    ],
)
def test_what_is_wrong_on_its_command_line_is_named(
    told: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(told)
    assert said in capsys.readouterr().err
