"""What is recorded of a run is what happened in it."""

from __future__ import annotations

import numpy as np
import pytest

from koord.runtime.motion.bodies import Car, Drone
from koord.runtime.motion.world import World
from koord.runtime.shapes import from_plain
from koord.sim.run_log import (
    SHARED,
    WHOLE,
    Idle,
    LoggedHome,
    RunLog,
    TaskState,
    tilts_of,
    turns_of,
)
from tests.sim.recorded import TASKS, TEAM, Recorded, lineform, recorded, recorded_text, task


@pytest.fixture(scope="module")
def run() -> Recorded:
    return task()


def test_the_header_says_what_is_drawn(run: Recorded) -> None:
    header = run.recording.header
    assert [robot.look for robot in header.robots] == [Car.LOOK, Drone.LOOK, Drone.LOOK]
    assert header.agents[0].events == ("Assign", "Complete")
    assert [(v.name, v.home) for v in header.shared] == [
        ("route", LoggedHome.ALLREAD),
        ("list", LoggedHome.ALLWRITE),
    ]
    own = {v.name for v in header.agents[0].variables}
    assert own == {"isOnTask", "mine", "testRoute", "Motion_path", "Motion_reached"}


def test_what_a_model_writes_is_a_sensor() -> None:
    header = recorded("waypoints", World((-5, -5, 0), (20, 9, 3)), TEAM[1:], 2).recording.header
    homes = {v.name: v.home for v in header.agents[0].variables}
    assert homes["Motion_psn"] is homes["Motion_reached"] is LoggedHome.SENSOR
    assert homes["Motion_target"] is LoggedHome.ACTUATOR


def test_poses_are_those_of_the_fleet(run: Recorded) -> None:
    recording = run.recording
    assert np.allclose(np.diff(recording.times_s), recording.header.sample_s)
    assert np.allclose(recording.poses[-1][:, :3], run.last[0], atol=1e-6)
    assert np.allclose(recording.poses[-1][:, 3], run.last[1], atol=1e-6)


def test_attitudes_are_those_of_the_fleet() -> None:
    """As quaternions, up to their sign."""
    run = lineform(robots=6, rounds=12)
    told, real = turns_of(run.recording.poses[-1]), run.attitudes
    assert np.abs(real[:, 1:3]).max() > 0.02
    assert np.abs(np.einsum("ij,ij->i", told, real)).min() > 1 - 1e-5


def test_what_is_kept_of_attitudes_gives_them_back() -> None:
    poses = np.random.default_rng(3).uniform(-1.2, 1.2, (200, 6)).astype(np.float32)
    assert np.allclose(np.linalg.norm(turns_of(poses), axis=1), 1.0, atol=1e-6)
    assert np.allclose(tilts_of(turns_of(poses).astype(np.float64)), poses[:, 4:], atol=1e-5)
    heading = np.zeros((1, 6), np.float32)
    heading[0, 3] = np.pi / 2
    assert np.allclose(turns_of(heading), [[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], atol=1e-6)


def test_changes_add_up_to_the_store_and_to_the_robots(run: Recorded) -> None:
    recording = run.recording
    shared, own = replayed(recording)
    for number, variable in enumerate(recording.header.shared):
        held = from_plain(variable.shape, shared[number], len(own), unset=True)
        assert held == run.engine.store.values[variable.name]
    for robot in run.engine.robots:
        for number, variable in enumerate(recording.header.agents[0].variables):
            plain = own[robot.pid].get(number)
            held = from_plain(variable.shape, plain, len(own), unset=True)
            assert held == vars(robot)[variable.name] or variable.home is LoggedHome.SENSOR


def test_deeds_are_events_skips_blocks_and_stops(run: Recorded) -> None:
    deeds = np.stack([r.deeds for r in run.recording.rounds])
    assert (deeds[0] == Idle.SKIPPED).all()  # INIT
    assert (deeds == 0).sum() >= 6  # Assign, for each task
    assert (deeds == 1).sum() == 6  # Complete
    assert deeds[1].tolist().count(Idle.BLOCKED) == 2  # all want to Assign, and one may
    assert (deeds[-1] == Idle.STOPPED).all()


def test_tasks_are_assigned_once(run: Recorded) -> None:
    assigned = [c for c in run.recording.tasks if c.state is TaskState.ASSIGNED]
    assert sorted(c.task for c in assigned) == list(range(6))
    for change in assigned:
        assert run.engine.store.values["list"][change.task].assignedTo == change.robot
    done = [(c.task, c.robot) for c in run.recording.tasks if c.state is TaskState.DONE]
    assert sorted(done) == sorted((c.task, c.robot) for c in assigned)


def test_paths_lead_to_the_tasks(run: Recorded) -> None:
    for change in run.recording.tasks:
        if change.state is not TaskState.ASSIGNED:
            continue
        later = [
            planned.points[-1]
            for planned in run.recording.paths
            if planned.robot == change.robot
            and change.time_s - 1e-9 <= planned.time_s < change.time_s + 0.5
        ]
        goal = run.recording.header.world.tasks[change.task]
        assert any(np.allclose(end, goal, atol=0.01) for end in later)


def test_only_what_changed_is_kept() -> None:
    recording = lineform(robots=4, rounds=20).recording
    first = [c for c in recording.rounds[1].changes if c.robot == SHARED]
    assert all(c.part != WHOLE for c in first)
    ends = {c.part for r in recording.rounds[2:] for c in r.changes if c.robot == SHARED}
    assert ends <= {1, 2}  # the ends of the line stand still


def test_of_a_crowd_values_are_kept_now_and_then_and_in_the_end() -> None:
    run = lineform(robots=150, rounds=6)
    rounds = run.recording.rounds
    # Every 0.15 s; what happens in round 5 is kept with the end, which is round 6.
    assert [done.number for done in rounds if done.changes] == [-1, 2, 4, 6]
    assert all((done.deeds == 0).all() for done in rounds[1:-1])  # events are in every round
    shared, _ = replayed(run.recording)
    (variable,) = run.recording.header.shared
    held = from_plain(variable.shape, shared[0], 150)
    assert held == run.engine.store.values[variable.name]


def test_a_fault_is_told_with_its_place() -> None:
    text = "local:\n    int n = 0\n\nGo:\n    eff:\n        n = 1\n        n = n / (n - 1)\n"
    recording = recorded_text("bad", text, TASKS, TEAM, 9).recording
    (fault,) = recording.violations
    assert (fault.claim, fault.robots, fault.time_s) == ("fault", (0,), 0.0)
    assert fault.words.startswith("division by zero at bad.krd:7:")
    assert recording.ending == "a fault"


def replayed(recording: RunLog) -> tuple[dict[int, object], list[dict[int, object]]]:
    """All changes, one after the other."""
    shared: dict[int, object] = {}
    own: list[dict[int, object]] = [{} for _ in recording.header.robots]
    for done in recording.rounds:
        for robot, variable, part, value in done.changes:
            held = shared if robot == SHARED else own[robot]
            if part == WHOLE:
                held[variable] = value
            else:
                before = held[variable]
                assert isinstance(before, tuple)
                held[variable] = (*before[:part], value, *before[part + 1 :])
    return shared, own
