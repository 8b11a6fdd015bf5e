"""Deployments whose robots are killed, crash or stop: who is told of, and who comes back."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import koord
from koord.api.deployed import FleetHeard
from koord.cli.deployed import summary
from koord.runtime.deploy import local, supervision
from koord.runtime.deploy.news import News
from koord.runtime.deploy.running import Runner
from koord.runtime.deploy.supervision import EndCause, ProcessState

COUNT = koord.Source("count.krd", "local:\n  int x = 0\nUp:\n  pre: true\n  eff: x = x + 1\n")
THREE = koord.read_configuration(koord.Source("three.yaml", "num_robots: 3\ndelta: 0.05\n"))


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that can decide nothing are given up soon."""
    monkeypatch.setattr(supervision, "STUCK_S", 0.3)


class Strike:
    """A listener that sends a signal to the processes of robots, when they have done some rounds.

    ``left`` are those that it has yet to send it to.
    """

    def __init__(self, number: int, *robots: int) -> None:
        self.left = set(robots)
        self._number = number

    def __call__(self, told: koord.Progress) -> None:
        assert isinstance(told, FleetHeard)
        if any(pid not in told.statuses or told.statuses[pid].round < 3 for pid in self.left):
            return
        children = multiprocessing.active_children()
        robots = {process.name: process.pid for process in children if process.pid is not None}
        for pid in self.left & {pid for pid in range(3) if f"robot {pid}" in robots}:
            self.left.remove(pid)
            os.kill(robots[f"robot {pid}"], self._number)


def test_a_robot_whose_process_is_killed_is_restarted_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    strikes = Strike(signal.SIGKILL, 1)
    deployed = koord.deploy(COUNT, THREE, rounds=40, restart=True, progress=strikes)
    assert deployed.ok
    assert {pid: one.round for pid, one in deployed.statuses.items()} == {0: 40, 1: 40, 2: 40}
    assert {pid: one.restarts for pid, one in deployed.processes.items()} == {0: 0, 1: 1, 2: 0}
    assert not deployed.statuses[1].is_mute
    process = deployed.to_dict()["robots"][1]["process"]  # type: ignore[index]
    assert process["restarts"] == 1
    assert (process["end"]["cause"], process["end"]["signal"]) == ("killed", signal.SIGKILL)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fresh", [False, True])
def test_all_robots_may_be_killed_at_once_and_go_on(fresh: bool) -> None:
    strikes = Strike(signal.SIGKILL, 0, 1, 2)
    deployed = koord.deploy(COUNT, THREE, rounds=30, restart=True, fresh=fresh, progress=strikes)
    assert deployed.ok
    assert [deployed.processes[pid].restarts for pid in range(3)] == [1, 1, 1]
    assert [deployed.statuses[pid].round for pid in range(3)] == [30, 30, 30]
    assert not any(status.is_mute for status in deployed.statuses.values())


def test_a_run_that_has_lost_its_majority_ends_and_says_so() -> None:
    deployed = koord.deploy(COUNT, THREE, progress=Strike(signal.SIGKILL, 1, 2))
    assert not deployed.ok
    assert not deployed.interrupted
    assert deployed.stuck == (
        "no round can be decided any more without robots 1 and 2: 1 of 3 is no majority"
    )
    assert [deployed.processes[pid].is_lost for pid in range(3)] == [False, True, True]
    assert "its process was killed (signal 9) in round" in deployed._repr_html_()
    assert "not all robots came to the end" in repr(deployed)


def test_a_robot_that_is_asked_to_end_stops_and_the_others_go_on() -> None:
    strikes = Strike(signal.SIGTERM, 1)
    deployed = koord.deploy(COUNT, THREE, rounds=20, restart=True, progress=strikes)
    end = deployed.processes[1].end
    assert end is not None
    assert (end.cause, end.signal) == (EndCause.STOPPED, signal.SIGTERM)
    assert [deployed.statuses[pid].is_over for pid in range(3)] == [True, False, True]
    assert deployed.stuck is None
    assert not deployed.is_complete


class Crashing(Runner):
    """A robot that falls over at once, if it is robot 1."""

    def going(self, *arguments: Any) -> Any:
        if self.member.robot.pid == 1:
            raise ValueError("no such thing")
        return super().going(*arguments)


@pytest.mark.parametrize("restart", [False, True])
def test_a_robot_that_crashes_at_once_is_told_of_and_given_up(
    restart: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(local, "Runner", Crashing)
    deployed = koord.deploy(COUNT, THREE, restart=restart)
    assert capfd.readouterr() == ("", "")
    assert deployed.stuck == "the run cannot begin without robot 1"
    process = deployed.processes[1]
    assert process.end is not None
    assert process.end.cause is EndCause.CRASHED
    assert "ValueError: no such thing (test_supervised.py:" in process.story
    assert process.restarts == (supervision.MOST_DEATHS - 1 if restart else 0)
    assert (process.state is ProcessState.GIVEN_UP) == restart


def test_robots_that_are_all_killed_at_the_start_are_all_told_of(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Dead(Runner):
        def going(self, *_: Any) -> Any:
            os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(local, "Runner", Dead)
    deployed = koord.deploy(COUNT, THREE)
    assert not deployed.is_complete
    assert "3 of 3 robots: 0 rounds" in repr(deployed)
    told = summary(deployed).splitlines()
    assert told[0].startswith("0 rounds of 3 robots: 0 events")
    assert told[3:] == [
        f"robot {pid}: its process was killed (signal 9) before it took part" for pid in range(3)
    ]


class Deaf(Runner):
    """A robot that hears that it is to stop, says so, and goes on; unless it is robot 0."""

    def going(
        self, is_told_to_stop: Callable[[], bool], report: Callable[[News], None]
    ) -> Iterator[float | None]:
        if self.member.robot.pid == 0:
            yield from super().going(is_told_to_stop, report)
            return
        report(News(replace(self.status, round=3)))
        while not is_told_to_stop():
            time.sleep(0.01)
        report(News(replace(self.status, round=4)))
        while True:  # a signal between the report and a pause would be waited for in vain
            time.sleep(0.01)


@pytest.fixture
def hangups_count() -> Iterator[None]:
    """SIGHUP as it is without nohup, under which the tests may run."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hangups_count")
def test_a_second_signal_ends_a_robot_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local, "Runner", Deaf)
    once, again = Strike(signal.SIGTERM, 1), Strike(signal.SIGHUP, 1)

    def hear(told: koord.Progress) -> None:
        assert isinstance(told, FleetHeard)
        if 1 in told.statuses:
            (once if told.statuses[1].round == 3 else again)(told)

    two = koord.read_configuration(koord.Source("two.yaml", "num_robots: 2\ndelta: 0.05\n"))
    deployed = koord.deploy(COUNT, two, progress=hear)
    end = deployed.processes[1].end
    assert end is not None
    assert (end.cause, end.signal) == (EndCause.KILLED, signal.SIGHUP)
    assert deployed.stuck is not None


def test_a_robot_that_does_not_stop_is_killed_and_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervision, "STOP_S", 1.0)
    stop, strikes = koord.Cancellation(), Strike(signal.SIGSTOP, 1)

    def hear(told: koord.Progress) -> None:
        strikes(told)
        if not strikes.left:
            stop.cancel()

    deployed = koord.deploy(COUNT, THREE, progress=hear, cancellation=stop)
    assert deployed.interrupted
    assert "did not stop, and was killed" in deployed.processes[1].story
    assert not deployed.processes[0].story


def test_one_robot_is_not_restarted_by_itself() -> None:
    with pytest.raises(koord.KoordError, match="what starts one restarts it"):
        koord.deploy(COUNT, THREE, pid=0, restart=True)
