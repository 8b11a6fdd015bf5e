"""The page of a fleet that moves elsewhere shows what its robots tell. (P-LIVE)"""

from __future__ import annotations

import http.client
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import koord
from koord.api.served_page import PageServed
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.deploy.member import Untimed
from koord.runtime.deploy.news import News, PoseReport, RoundReport
from koord.runtime.deploy.status import unheard
from koord.runtime.drivers.frames import turned
from koord.runtime.motion.world import Point, World
from koord.runtime.robot import Forwarding, Robot
from koord.runtime.shapes import Array, Record
from koord.runtime.shapes import Sequence as ListOf
from koord.runtime.store import AgreedStore
from koord.sim.mirror import FleetMirror
from koord.sim.observing import header_of
from koord.sim.run_log import Idle, TaskState
from koord.sim.scene import device_model

ROOT = Path(__file__).parents[2]
TASK = (ROOT / "specs" / "examples" / "task.krd").read_text("utf-8")
STARTS: list[Point] = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]


class _Nobody(Untimed, Forwarding):
    """A host that nobody asks."""

    def __init__(self) -> None:
        super().__init__(self)


class _Fleet:
    """Two robots of *Task* with a mirror, whose states the test sets."""

    def __init__(self) -> None:
        from koord.runtime.configuration.checking import load
        from koord.sim.fleet import Placed

        program = koord.load(koord.Source("task.krd", TASK)).core
        (made,) = classes = loaded(compiled(program))
        configuration = load(koord.Source("two.yaml", "num_robots: 2\n"))
        model = device_model(configuration.robots[0].vehicle)
        placed = [Placed(model, start, 0.0) for start in STARTS]
        kinds = (0, 0)
        header = header_of("task.krd", TASK, classes, kinds, World(), placed, delta_s=0.1, seed=0)
        self.robots: list[Robot] = [made(pid, kinds, 0.1, _Nobody()) for pid in range(2)]
        self.store = AgreedStore(made.SHARED, 2)
        self.mirror = FleetMirror(header, STARTS, self.robots, self.store)

    def tell(self, pid: int, *reports: RoundReport | PoseReport) -> None:
        rounds = tuple(one for one in reports if isinstance(one, RoundReport))
        poses = tuple(one for one in reports if isinstance(one, PoseReport))
        self.mirror.hear([News(unheard(pid), rounds, poses)])


def _pose(pid: int, at_s: float, x: float, path: tuple[Point, ...] | None = None) -> PoseReport:
    return PoseReport(pid, at_s, (x, 0.0, 0.0), turned(0.5), path)


def _round(pid: int, number: int, event: str | None, at_s: float) -> RoundReport:
    return RoundReport(pid, number, event, (0.0, 0.0, 0.0), (), False, 0.1, at_s)


@pytest.fixture
def fleet() -> _Fleet:
    return _Fleet()


def test_poses_of_all_robots_are_in_one_order_of_time(fleet: _Fleet) -> None:
    fleet.tell(0, _pose(0, 50.0, 0.1), _pose(0, 50.1, 0.2), _pose(0, 50.2, 0.3))
    fleet.tell(1, _pose(1, 50.05, 2.1), _pose(1, 50.15, 2.2))
    log = fleet.mirror.log
    times = list(log.times_s)
    assert times == sorted(times)
    assert times[0] == 0.0
    # Up to 0.15 s all is known: what robot 0 says of 0.2 s has to wait.
    assert times[-1] <= 0.15
    x = log.stacked()[:, :, 0]
    assert x[-1].tolist() == pytest.approx([0.2, 2.1])
    assert log.stacked()[-1, 0, 3] == pytest.approx(0.5)
    fleet.tell(1, _pose(1, 50.3, 2.5))
    assert fleet.mirror.log.stacked()[-1, 0, 0] == pytest.approx(0.3)


def test_a_robot_that_fell_silent_does_not_keep_the_others_from_being_shown(fleet: _Fleet) -> None:
    fleet.tell(0, _pose(0, 10.0, 0.1))
    fleet.tell(1, _pose(1, 10.0, 2.0))
    for tenth in range(1, 30):
        fleet.tell(0, _pose(0, 10.0 + tenth / 10, 0.1 * tenth))
    log = fleet.mirror.log
    assert log.times_s[-1] > 2.5
    assert log.stacked()[-1, 1, 0] == pytest.approx(2.0)


def test_paths_are_shown_when_they_change(fleet: _Fleet) -> None:
    way: tuple[Point, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    fleet.tell(0, _pose(0, 1.0, 0.0, way), _pose(0, 1.5, 0.5), _pose(0, 2.0, 1.0, ()))
    shown = [(one.robot, len(one.points)) for one in fleet.mirror.log.paths]
    assert shown == [(0, 2), (0, 0)]


def test_rounds_show_events_changes_and_tasks(fleet: _Fleet) -> None:
    fleet.tell(0, _pose(0, 1.0, 0.0), _round(0, 0, "Assign", 1.1))
    fleet.tell(1, _pose(1, 1.0, 2.0), _round(1, 0, None, 1.12))
    assert fleet.mirror.log.rounds == []
    vars(fleet.robots[0])["isOnTask"] = True
    (tasks,) = (v for v in fleet.store.layout.variables if v.name == "list")
    assert isinstance(tasks.shape, Array | ListOf)
    assert isinstance(tasks.shape.element, Record)
    values: dict[str, Any] = {"loc": (0.4, 0.0, 0.0), "assigned": True, "assignedTo": 0}
    fields = tasks.shape.element.make._fields  # type: ignore[attr-defined]
    task = tasks.shape.element.make(*(values.get(name, (0.4, 0.0, 0.0)) for name in fields))
    fleet.store.values["list"] = (task,)
    fleet.mirror.begun(1)
    (shown,) = fleet.mirror.log.rounds
    assert shown.number == 0
    assert shown.time_s == pytest.approx(0.12)
    assert shown.deeds.tolist() == [0, Idle.SKIPPED]
    header = fleet.mirror.log.header
    changed = {
        header.agents[0].variables[one.variable].name for one in shown.changes if one.robot == 0
    }
    assert "isOnTask" in changed
    fleet.tell(0, _pose(0, 1.5, 0.39))
    fleet.tell(1, _pose(1, 1.5, 2.0))
    states = [(one.task, one.state, one.robot) for one in fleet.mirror.log.tasks]
    assert states == [(0, TaskState.ASSIGNED, 0), (0, TaskState.DONE, 0)]


def test_what_is_not_logged_at_the_end_is(fleet: _Fleet) -> None:
    fleet.tell(0, _pose(0, 1.0, 0.0), _round(0, 0, "Assign", 1.1))
    fleet.mirror.violated("invariant A", "somewhere", (1,))
    fleet.mirror.end("the run is over")
    log = fleet.mirror.log
    assert [one.number for one in log.rounds] == [0]
    assert log.violations[0].place == (2.0, 0.0, 0.0)
    assert log.ending == "the run is over"
    assert np.isfinite(log.stacked()).all()


def test_a_run_is_served_while_it_goes_on() -> None:
    answers: list[bytes] = []

    def watch(address: str) -> None:
        host, port = address.removeprefix("http://").rstrip("/").split(":")
        connection = http.client.HTTPConnection(host, int(port), timeout=20)
        connection.request("GET", "/packs")
        answers.append(connection.getresponse().read())

    threads: list[threading.Thread] = []

    def hear(told: koord.Progress) -> None:
        if isinstance(told, PageServed):
            threads.append(threading.Thread(target=watch, args=(told.address,)))
            threads[-1].start()

    program = koord.Source("n.krd", "local:\n  int x = 0\nUp:\n  pre: x < 3\n  eff: x = x + 1\n")
    config = koord.read_configuration(koord.Source("two.yaml", "num_robots: 2\ndelta: 0.05\n"))
    done = koord.deploy(program, config, rounds=8, live=True, progress=hear)
    (thread,) = threads
    thread.join(20)
    assert done.ok
    (answer,) = answers
    assert answer.count(b"event: pack") >= 2
