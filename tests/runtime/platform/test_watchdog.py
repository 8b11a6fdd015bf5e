"""Watchdogs: processes that stop vehicles whose robots are killed or stuck. (P-WATCHDOG)"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.setpoints import Capabilities, Hold, Setpoint, Stopper
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.limits import DeadMan, SafetyLimits, usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.field import field
from koord.runtime.motion.group import TICK_S
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.platform.watchdog import Watchdog, watchdog_of
from koord.sim.driver import vehicle
from koord.sim.scene import device_model
from tests.runtime.platform.stoppers import kept
from tests.runtime.platform.test_driven import WORLD

ROOT = Path(__file__).parents[3]
LIMIT_S = 0.15


def wait_until(condition: Callable[[], bool], most_s: float = 20.0) -> float:
    """Wait until something holds; return how long it took."""
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() - begun < most_s
        time.sleep(0.005)
    return time.monotonic() - begun


def stops(file: Path) -> int:
    return file.read_bytes().count(b"s") if file.exists() else 0


@contextmanager
def robot(file: Path) -> Iterator[subprocess.Popen[str]]:
    """A robot as a process of its own, that feeds its watchdog."""
    with subprocess.Popen(
        [sys.executable, "-m", "tests.runtime.platform.stoppers", str(file), str(LIMIT_S)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip().isdecimal()
        try:
            yield process
        finally:
            process.kill()


def test_a_robot_that_is_there_is_left_alone_and_lets_go(tmp_path: Path) -> None:
    """(P-WATCHDOG)"""
    file = tmp_path / "told"
    watchdog = Watchdog(kept(file), LIMIT_S)
    for _ in range(20):
        assert watchdog.feed() is None
        time.sleep(0.02)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(watchdog.process, number)
    time.sleep(0.05)
    assert watchdog.feed() is None
    watchdog.close()
    assert file.read_bytes() == b"c"


def test_the_vehicle_of_a_killed_robot_is_stopped(tmp_path: Path) -> None:
    """(P-WATCHDOG) For as long as was said, and then the watchdog ends as well."""
    file = tmp_path / "told"
    with robot(file) as process:
        assert stops(file) == 0
        process.kill()
        assert wait_until(lambda: stops(file) > 0) < 1.0
        wait_until(lambda: file.read_bytes().endswith(b"c"))
    assert stops(file) >= 5


def test_the_vehicle_of_a_stuck_robot_is_stopped_until_it_is_back(tmp_path: Path) -> None:
    """(P-WATCHDOG) SIGSTOP, and SIGCONT."""
    file = tmp_path / "told"
    with robot(file) as process:
        process.send_signal(signal.SIGSTOP)
        assert wait_until(lambda: stops(file) > 0) < LIMIT_S + 1.0
        before = stops(file)
        wait_until(lambda: stops(file) > before + 5)
        process.send_signal(signal.SIGCONT)
        assert process.stdout is not None
        said = [process.stdout.readline() for _ in range(60)]
        assert any("was stuck for more than 0.15 s" in line for line in said)
        while "stuck" in process.stdout.readline():
            pass
        before = stops(file)
        time.sleep(0.2)
        assert stops(file) == before


def test_a_watchdog_that_is_killed_is_missed(tmp_path: Path) -> None:
    """(P-WATCHDOG) (G-WATCHDOG)"""
    watchdog = Watchdog(kept(tmp_path / "told"), LIMIT_S)
    assert watchdog.feed() is None
    os.kill(watchdog.process, signal.SIGKILL)
    wait_until(lambda: watchdog.feed() is not None)
    assert "has ended" in (watchdog.feed() or "")
    watchdog.close()


def test_a_watchdog_that_is_stuck_is_missed(tmp_path: Path) -> None:
    watchdog = Watchdog(kept(tmp_path / "told"), LIMIT_S)
    os.kill(watchdog.process, signal.SIGSTOP)
    wait_until(lambda: watchdog.feed() is not None)
    assert "has said nothing" in (watchdog.feed() or "")
    os.kill(watchdog.process, signal.SIGCONT)
    watchdog.close()


@pytest.mark.parametrize(
    "target", ["tests.runtime.platform.stoppers:Broken", "no.such:Thing", "os:nothing"]
)
def test_a_watchdog_that_cannot_reach_the_vehicle_is_an_error(target: str) -> None:
    with pytest.raises(DriverError, match=r"does not begin: \w+Error: .*(such|No module|nothing)"):
        Watchdog(Stopper(target), LIMIT_S)


# --- whether there is one -------------------------------------------------------------------------


def capabilities(dead_man_s: float | None, stopper: Stopper | None) -> Capabilities:
    return Capabilities(("CAR",), (), 20.0, 0.1, dead_man_s=dead_man_s, stopper=stopper)


def test_a_vehicle_with_a_timer_needs_none(tmp_path: Path) -> None:
    assert watchdog_of(capabilities(0.5, None), SafetyLimits()) is None
    assert watchdog_of(capabilities(0.5, kept(tmp_path / "told")), SafetyLimits()) is None


def test_a_vehicle_that_nothing_stops_is_an_error_unless_that_is_said() -> None:
    """(P-WATCHDOG)"""
    with pytest.raises(DriverError, match="nothing would stop the vehicle") as raised:
        watchdog_of(capabilities(None, None), SafetyLimits())
    assert "dead_man: none" in raised.value.hint
    limits = SafetyLimits(dead_man=DeadMan.NONE)
    assert watchdog_of(capabilities(None, None), limits) is None


@pytest.mark.parametrize(
    ("dead_man_s", "wanted"), [(None, None), (0.5, DeadMan.WATCHDOG), (None, DeadMan.WATCHDOG)]
)
def test_a_vehicle_without_a_timer_has_a_watchdog(
    tmp_path: Path, dead_man_s: float | None, wanted: DeadMan | None
) -> None:
    limits = SafetyLimits(dead_man=wanted)
    made = watchdog_of(capabilities(dead_man_s, kept(tmp_path / "told")), limits)
    assert made is not None
    made.close()


def test_a_robot_whose_watchdog_is_killed_holds_and_says_so(tmp_path: Path) -> None:
    """(G-WATCHDOG)"""
    told = Vehicle("CAR", "CAR")
    model = device_model(told)
    driver = vehicle(Device(0, told, WORLD, (0.0, 0.0, 0.0)))
    stopper = kept(tmp_path / "told")
    driver.capabilities = replace(driver.capabilities, dead_man_s=None, stopper=stopper)
    commanded: list[Setpoint] = []
    command = driver.command

    def noted(setpoint: Setpoint, now_s: float) -> None:
        commanded.append(setpoint)
        command(setpoint, now_s)

    driver.command = noted  # type: ignore[method-assign]
    limits = replace(usual(model.body), watchdog_s=30.0)
    setup = Setup(limits, field(WORLD, flat=True), 0.1)
    steersman = pilot(PilotSettings(model.body, model.planner), WORLD)
    now = 100.0
    driven = DrivenVehicle(driver, steersman, setup, now, watched=True)
    assert driven._watchdog is not None

    def tick() -> None:
        nonlocal now
        now += TICK_S
        driven.tick(now, 0.05)

    def is_running() -> bool:
        tick()
        driven.order(Order.START if driven.mode is Mode.ARMED else Order.ARM, now)
        return driven.mode is Mode.RUNNING

    wait_until(is_running)
    os.kill(driven._watchdog.process, signal.SIGKILL)

    def is_holding() -> bool:
        tick()
        return driven.mode is Mode.HOLDING

    wait_until(is_holding)
    assert commanded[-1] == Hold()
    assert driven.conditions == {Condition.WATCHDOG}
    assert any("the watchdog has ended" in remark for remark in driven.remarks)
    driven.close()
