"""Processes that plan meanwhile: equal runs with any number of them, and a clean end."""

from __future__ import annotations

import gc
import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from multiprocessing.process import BaseProcess

import numpy as np
import pytest
from msgspec.structs import replace

import koord
from koord.api.fitting import FitRequest, fit
from koord.api.sim_setup import simulation
from koord.runtime.configuration.checking import load
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Drone, PlannerName
from koord.runtime.motion.planning import LateSeed, Pose
from koord.runtime.motion.workers import Workers
from koord.runtime.motion.world import Point
from koord.sim.fleet import Fleet, Placed
from koord.sim.running import Ending, Simulation
from koord.sim.squads import DeviceModel
from koord.syntax.source import Source
from tests.runtime.motion.worlds import CLUTTERED

CAR = DeviceModel(Car(), PlannerName.RRT_CAR)
DRONE = DeviceModel(Drone(), PlannerName.RRT_DRONE, plan_takes_s=0.1)
ROBOTS = [
    *(Placed(CAR, (-2.5 + 0.2 * k, -2.5, 0.0), 0.5 * k) for k in (0, 4)),
    *(Placed(replace(CAR, plan_takes_s=0.15), (2.6, y, 0.0), 2.0) for y in (-3.0, 3.0)),
    *(Placed(DRONE, (x, -2.5, 1.0)) for x in (-2.5, 0.0, 2.5)),
]


@pytest.fixture(autouse=True)
def alone() -> None:
    """Nobody forks beside other threads: `tests/conftest.py` has these tests run first."""
    assert threading.active_count() == 1, threading.enumerate()


def digest(fleet: Fleet, spoil_at: int = -1) -> str:
    found = hashlib.sha256()
    for tick in range(24):
        if tick % 12 == 0:
            for k, robot in enumerate(ROBOTS):
                x, y, z = robot.start
                fleet.go_to(k, (-x, -y, z) if tick == 0 else (x, y, z))
        if tick == 13:
            fleet.go_to(3, (0.5, 3.2, 0.0))  # a plan is given up
        if tick == spoil_at:
            for process in workers(fleet).processes:
                assert process.pid is not None
                os.kill(process.pid, signal.SIGKILL)
        fleet.advance_to(fleet.now_s + 0.05)
        found.update(fleet.positions().tobytes())
        found.update(b"".join(fleet.path(k).tobytes() for k in range(len(ROBOTS))))
    return found.hexdigest()


def workers(fleet: Fleet) -> Workers:
    return fleet._squads[0][0].group._workers


def test_equal_seeds_make_equal_runs_whoever_plans() -> None:
    """And if those who plan are killed on the way."""
    alone = digest(Fleet(CLUTTERED, ROBOTS, 1, planners=0))
    for count in (1, 2):
        fleet = Fleet(CLUTTERED, ROBOTS, 1, planners=count)
        assert digest(fleet) == alone
        assert len(workers(fleet).processes) == count
    fleet = Fleet(CLUTTERED, ROBOTS, 1, planners=2)
    assert digest(fleet, spoil_at=12) == alone
    assert not workers(fleet).processes
    assert digest(Fleet(CLUTTERED, ROBOTS, 2, planners=1)) != alone


class Slow:
    """A planner that tells who made its plans, and fails for some."""

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        if seed == 13:
            raise ValueError("not this one")
        time.sleep(0.01)
        return np.array([[seed, os.getpid(), 0.0]])


def test_plans_are_made_by_others_as_well() -> None:
    made = Workers(2)
    number = made.know(Slow())
    jobs = [made.ask(number, Pose((0, 0, 0)), (1, 1, 1), seed) for seed in range(13)]
    answers = [made.answer(job) for job in jobs]
    assert [a[0, 0] for a in answers if a is not None] == list(range(13))
    by = {int(a[0, 1]) for a in answers if a is not None}
    assert by <= {os.getpid(), *(process.pid for process in made.processes)}
    assert len(by) == 3


@pytest.mark.parametrize("count", [0, 1])
def test_what_a_planner_raises_is_raised_where_its_plan_is_due(count: int) -> None:
    made = Workers(count)
    number = made.know(Slow())
    bad, good = (made.ask(number, Pose((0, 0, 0)), (1, 1, 1), seed) for seed in (13, 14))
    assert made.answer(good) is not None
    with pytest.raises(ValueError, match="not this one"):
        made.answer(bad)


def test_nobody_is_left_behind() -> None:
    made = Workers(2)
    number = made.know(Slow())
    job = made.ask(number, Pose((0, 0, 0)), (1, 1, 1), 1)
    processes = made.processes
    assert len(processes) == 2
    assert all(process.is_alive() for process in processes)
    made.answer(job)
    del made
    gc.collect()
    # They have seen that nobody asks any more; nobody had to kill them.
    assert [process.exitcode for process in processes] == [0, 0]


def test_a_fleet_that_is_closed_goes_on_without() -> None:
    """Plans that others were at are made when they are due."""
    whole, closed = (Fleet(CLUTTERED, ROBOTS, 1, planners=2) for _ in range(2))
    processes: tuple[BaseProcess, ...] = ()
    for fleet in (whole, closed):
        for k, robot in enumerate(ROBOTS):
            x, y, z = robot.start
            fleet.go_to(k, (-x, -y, z))
        fleet.advance_to(0.05)
        if fleet is closed:
            processes = workers(fleet).processes
            fleet.close()
        fleet.advance_to(0.4)
    assert len(processes) == 2
    assert not any(process.is_alive() for process in processes)
    assert np.array_equal(whole.positions(), closed.positions())
    assert all(np.array_equal(whole.path(k), closed.path(k)) for k in range(len(ROBOTS)))


PROGRAM_OF_ONE = """
using Motion:
    actuators:
        pos target

local:
    bool told = false

Go:
    pre: not told
    eff:
        told = true
        Motion.target = pos(1.5, 1.0, 0.0)
"""

ONE = """
agents: [{pid: 0, on_device: car, position: [-2, 0]}]
world: {bounds: {low: [-4, -4, 0], high: [4, 4, 3]}}
devices: {car: {bot_type: CAR, planner: RRT_CAR}}
"""


@pytest.mark.parametrize("count", [0, 2])
def test_the_end_of_a_run_ends_them(count: int) -> None:
    made = simulation(
        fit(FitRequest(Source("one.krd", PROGRAM_OF_ONE), load(Source("one.yaml", ONE)), (), {})),
        Simulation,
    )
    made.fleet.plan_with(count)
    made.begin()
    made.round()
    processes = workers(made.fleet).processes
    assert len(processes) == count
    made.end(Ending.LIMIT)
    assert not any(process.is_alive() for process in processes)


@pytest.mark.parametrize("count", [0, 2])
def test_who_simulates_says_how_many_plan(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    at_the_end = []

    def close(fleet: Fleet) -> None:
        at_the_end.append(len(workers(fleet).processes))
        ended(fleet)

    ended = Fleet.close
    monkeypatch.setattr(Fleet, "close", close)
    made = koord.simulate(
        Source("one.krd", PROGRAM_OF_ONE), Source("one.yaml", ONE), duration_s=1.0, planners=count
    )
    assert at_the_end == [count]
    alone = koord.simulate(
        Source("one.krd", PROGRAM_OF_ONE), Source("one.yaml", ONE), duration_s=1.0
    )
    assert made.figures.digest == alone.figures.digest
    assert made.figures.distance_m > 0


def test_nothing_is_forked_beside_other_threads() -> None:
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        made = Workers(2)
        job = made.ask(made.know(Slow()), Pose((0, 0, 0)), (1, 1, 1), 1)
        assert made.processes == ()
        assert made.answer(job) is not None
    finally:
        done.set()
        other.join()


PROGRAM = """
import signal, time
from koord.runtime.motion.planning import LateSeed, Pose
from koord.runtime.motion.workers import Workers
from tests.sim.test_planning_workers import Slow

signal.signal(signal.SIGINT, signal.default_int_handler)  # also where who started this ignores it
made = Workers(2)
job = made.ask(made.know(Slow()), Pose((0, 0, 0)), (1, 1, 1), 1)
print(*(process.pid for process in made.processes), flush=True)
made.answer(job)
time.sleep(30)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_those_who_plan_end_with_who_asks(how: signal.Signals) -> None:
    """Also if it is killed; and Ctrl-C, which all of them hear, is told once."""
    asks = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert asks.stdout is not None
        planners = [int(pid) for pid in asks.stdout.readline().split()]
        assert len(planners) == 2
        if how is signal.SIGINT:
            os.killpg(asks.pid, how)
        else:
            asks.kill()
        _, errors = asks.communicate(timeout=20)
    finally:
        asks.kill()
        asks.communicate()
    assert errors.count("Traceback") == (how is signal.SIGINT)
    until = time.monotonic() + 20
    while any(_is_there(pid) for pid in planners):
        assert time.monotonic() < until
        time.sleep(0.01)


def _is_there(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_seeds_are_numbers_where_somebody_wants_them() -> None:
    """A planner of another kind is told a number; one of trees works it out if it grows one."""
    seeds = [7, 8]
    known = int(np.random.SeedSequence((8, 3)).generate_state(1)[0])
    late = LateSeed(seeds, 1, 3)
    told: list[object] = []

    class Noting:
        def plan(self, start: Pose, goal: Point, seed: object, avoid: object = ()) -> None:
            told.append(seed)

    class Lately(Noting):
        takes_late_seeds = True

    workers = Workers()
    for made in (Noting(), Lately()):
        number = workers.know(made)
        workers.answer(workers.ask(number, Pose((0.0, 0.0, 0.0)), (1.0, 0.0, 0.0), late))
    assert told == [known, late]
    assert isinstance(told[0], int)
