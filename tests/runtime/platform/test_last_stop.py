"""Drivers that raise: their vehicles are brought to the last stop all the same. (P-LAST-STOP)"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import cast

import pytest

from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.member import LANDING_S, Platform
from koord.runtime.deploy.running import Runner
from koord.runtime.drivers.setpoints import Disarm, Hold, Sensed, Setpoint
from koord.runtime.guardian.modes import Mode
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from koord.syntax.source import Source
from tests.loading import example_program
from tests.runtime.hub import Hub
from tests.runtime.platform.test_driven import Guarded


class BrokenError(Exception):
    """What a driver raises."""


class Robot:
    """One robot with a simulated car, of whose driver something breaks."""

    def __init__(self) -> None:
        self.now = 100.0
        self.commanded: list[Setpoint] = []
        self.is_closed = False
        self.driven = Guarded("CAR").driven
        driver = self.driven.driver
        command = driver.command
        sense = driver.sense
        self.command: Callable[[Setpoint, float], None] = command
        self.sense: Callable[[float], Sensed | None] = sense

        def commanded(setpoint: Setpoint, now_s: float) -> None:
            self.command(setpoint, now_s)
            self.commanded.append(setpoint)

        driver.command = commanded  # type: ignore[method-assign]
        driver.sense = lambda now_s: self.sense(now_s)  # type: ignore[method-assign]
        driver.close = self._close  # type: ignore[method-assign]
        classes = loaded(compiled(example_program("sum_of_ids")))
        configuration = load_configuration(Source("c.yaml", "num_robots: 1\n"))
        self.job = Job(
            classes, (0,), configuration, b"key", "run", 0.1, 0.1, None, None, platforms=self._make
        )
        self.hub = Hub(1)
        self.runner = Runner(self.job, 0, self.hub.transport(0), self._clock)

    def _clock(self) -> float:
        self.now += 0.002
        return self.now

    def _make(self, job: Job, pid: int) -> Platform:
        host = cast(VehicleHost, _host(job))
        return cast(Platform, VehiclePlatform(host, self.driven, stated=Stated()))

    def _close(self) -> None:
        self.is_closed = True

    def begin(self) -> Robot:
        """Run it until its vehicle may move."""
        begun = self.now
        while self.driven.mode is not Mode.RUNNING:
            self.runner.step()
            assert self.now < begun + 60
        return self

    def run_until(self, condition: Callable[[], bool]) -> None:
        """Run it until something holds, and then as long as it takes."""
        begun = self.now
        self.last = self.runner.run(
            lambda: condition() or self.now > begun + 300, lambda news: None
        )


def _host(job: Job) -> object:
    """As much of a vehicle's host as a program without sensors asks for."""
    from koord.runtime.deploy.job import ideal_host

    made = ideal_host(job, 0)
    made.kinds = job.kinds  # type: ignore[attr-defined]
    made.order = _idle  # type: ignore[assignment, method-assign]
    made.library = SimpleNamespace(begin_round=lambda: None)  # type: ignore[attr-defined]
    return made


def _idle(robot: object) -> None:
    """Nobody moves by it."""


def raising(*arguments: object) -> None:
    raise BrokenError("the line is cut")


@pytest.fixture
def robot() -> Robot:
    return Robot().begin()


def test_who_is_told_to_stop_comes_to_rest(robot: Robot) -> None:
    robot.run_until(lambda: True)
    assert robot.driven.mode is Mode.STOPPED
    assert (robot.is_closed, robot.last.trouble) == (True, None)


def test_a_driver_that_senses_nothing_any_more_is_told_to_stop(robot: Robot) -> None:
    """(P-LAST-STOP)"""
    robot.sense = raising
    robot.commanded.clear()
    begun = robot.now
    robot.run_until(lambda: False)
    assert "BrokenError: the line is cut" in (robot.last.trouble or "")
    assert robot.driven.mode is Mode.LANDING
    assert len(robot.commanded) > 15 * LANDING_S
    assert set(robot.commanded) == {Hold()}
    assert robot.is_closed
    assert robot.now - begun < LANDING_S + 1.0


def test_a_driver_that_raises_for_a_while_is_told_again(robot: Robot) -> None:
    """(P-LAST-STOP)"""
    command, since = robot.command, robot.now

    def cut(setpoint: Setpoint, now_s: float) -> None:
        if now_s < since + 3.0:
            raise BrokenError("the line is cut")
        command(setpoint, now_s)

    robot.command = cut
    robot.commanded.clear()
    robot.run_until(lambda: False)
    assert "BrokenError: the line is cut" in (robot.last.trouble or "")
    assert robot.driven.mode is Mode.STOPPED
    assert robot.commanded[-1] == Disarm()
    assert robot.is_closed


def test_a_driver_that_raises_at_its_end_is_told_of(robot: Robot) -> None:
    robot.driven.driver.close = raising  # type: ignore[method-assign]
    robot.run_until(lambda: True)
    assert "BrokenError: the line is cut" in (robot.last.trouble or "")


def test_a_program_that_raises_stops_its_vehicle(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-LAST-STOP)"""
    monkeypatch.setattr(robot.runner.member, "propose", raising)
    robot.run_until(lambda: False)
    assert "BrokenError: the line is cut" in (robot.last.trouble or "")
    assert robot.driven.mode is Mode.STOPPED
    assert robot.is_closed
