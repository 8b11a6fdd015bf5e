"""Compiled programs in the simulated world: the examples do what they are for."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import numpy as np
import pytest

from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.engine import AtRandom, Deployed, Schedule
from koord.runtime.engine import RoundEngine as Engine
from koord.runtime.motion.bodies import Car, Drone, IdealBody, PlannerName
from koord.runtime.motion.clearance import clearance_of
from koord.runtime.motion.library import Chart, Library, occupied
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import Pose
from koord.runtime.motion.world import Box, World
from koord.runtime.robot import Robot
from koord.sim.fleet import Fleet, Placed
from koord.sim.hosting import Hosted
from koord.sim.lidar import Lidar, Scanner
from koord.sim.separation import nearest
from koord.sim.squads import DeviceModel
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.sampling import first

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"
DELTA_S = 0.1
DEPLOYED = Deployed()
CAR = DeviceModel(Car(), PlannerName.RRT_CAR)
DRONE = DeviceModel(Drone(), PlannerName.RRT_DRONE)
POINT = DeviceModel(IdealBody(), PlannerName.STRAIGHT)


def program(name: str, **params: ParamValue) -> tuple[type[Robot], ...]:
    text = (EXAMPLES / f"{name}.krd").read_text("utf-8")
    found = load(Source(f"{name}.krd", text), Settings(params=params)).program
    assert found is not None
    return loaded(compiled(found))


@dataclass
class Run:
    """A run of compiled robots in a world."""

    classes: tuple[type[Robot], ...]
    world: World
    robots: list[Placed]
    seed: int = 1
    scanners: dict[int, Scanner] = field(default_factory=dict)

    def __post_init__(self) -> None:
        kinds = [0] * len(self.robots)
        self.fleet = Fleet(self.world, self.robots, self.seed)
        self.clearance = clearance_of([p.model.body for p in self.robots], tracking_m=0.15)
        planners = {
            k: planner(p.model.planner, self.world, p.model.body) for k, p in enumerate(self.robots)
        }
        chart = Chart(self.world.grid, 3.0)
        library = Library(planners, self.pose, self.clearance, chart, self.seed)
        self.host = Hosted(self.classes, kinds, self.fleet, library, self.seed, self.scanners)
        self.engine = Engine(self.classes, kinds, DELTA_S, self.host)
        self.engine.begin()
        self.least_m = math.inf
        self.digest = hashlib.sha256()

    def pose(self, robot: int) -> Pose:
        sensed = self.fleet.sensed()[robot]
        return Pose(sensed.psn, sensed.heading_rad)

    def round(self, schedule: Schedule = DEPLOYED) -> None:
        self.engine.program_turns(schedule)
        self.host.pass_time(self.engine.robots, (self.engine.round + 1) * DELTA_S, self.watch)
        self.engine.environment_turn()
        assert self.engine.ended is None
        self.digest.update(repr(self.engine.store.values).encode())

    def watch(self, fleet: Fleet) -> None:
        pair = nearest(fleet.positions())
        if pair is not None:
            self.least_m = min(self.least_m, pair.distance_m)
        self.digest.update(fleet.positions().tobytes())


TASKS = World(tasks=((2, 2, 0), (-1, 2, 1.5), (0, -2, 1.2), (-2, 0, 0), (2.5, 0, 2), (1, 1, 1.5)))
TEAM = [
    Placed(CAR, (-2.5, -3.0, 0.0)),
    Placed(DRONE, (2.5, -3.0, 0.0)),
    Placed(DRONE, (-2.5, 3, 0)),
]


def made_task_run() -> Run:
    run = Run(program("task", tasks=len(TASKS.tasks)), TASKS, TEAM)
    while not run.engine.all_stopped:
        run.round()
        assert run.engine.round < 900
    return run


@pytest.fixture(scope="module")
def task_run() -> Run:
    return made_task_run()


def test_task_is_done_by_cars_and_drones_at_a_safe_distance(task_run: Run) -> None:
    run = task_run
    tasks = run.engine.store.values["list"]
    assert all(task.assigned for task in tasks)
    on_ground = [task.assignedTo for task in tasks if task.loc.z == 0]
    assert on_ground == [0, 0]  # drones find no way to the ground, and the car none into the air
    assert 0 not in [task.assignedTo for task in tasks if task.loc.z > 0]
    assert run.least_m > run.clearance.safety_m


def test_a_whole_run_repeats_to_the_bit(task_run: Run) -> None:
    assert made_task_run().digest.hexdigest() == task_run.digest.hexdigest()


@pytest.mark.parametrize("kind", first(1, [POINT, DRONE]))
def test_a_line_forms(kind: DeviceModel) -> None:
    starts = [(-3.0, -3.0, 1.0), (2.0, -1.0, 1.2), (-2.0, 2.0, 1.4), (3.0, 3.0, 1.0)]
    robots = [Placed(kind, start) for start in starts]
    run = Run(program("lineform"), World((-10, -10, 0), (10, 10, 4)), robots)
    for _ in range(300):
        run.round()
    ends = np.array([starts[0], starts[-1]])
    line = ends[0] + np.linspace(0, 1, 4)[:, None] * (ends[1] - ends[0])
    assert np.linalg.norm(run.fleet.positions() - line, axis=1).max() < 0.03


@pytest.mark.slow
def test_the_map_of_a_u_is_right_and_grows() -> None:
    world = World(
        (0, 0, 0),
        (8, 8, 3),
        (Box((2, 2, 0), (3, 6, 3)), Box((3, 2, 0), (5, 3, 3)), Box((5, 2, 0), (6, 6, 3))),
        cell_m=1.0,
    )
    robots = [Placed(DRONE, (0.5, 0.5, 1.0)), Placed(DRONE, (7.5, 7.5, 1.0))]
    scanners = {k: Scanner(Lidar(90, 3.0), world, 1.0) for k in range(2)}
    run = Run(program("mapping", cells=64), world, robots, scanners=scanners)
    walls, known = occupied(world), []
    # Each robot can always look; who takes the first event that it can would do nothing else.
    schedule = AtRandom(Random(3))
    for _ in range(600):
        run.round(schedule)
        drawn = run.engine.store.values["map"]
        for cell, state in enumerate(drawn):
            assert state == 0 or (state == 2) == (cell in walls)
        known.append(sum(state != 0 for state in drawn))
    assert known == sorted(known)
    assert known[-1] >= 60
    assert run.least_m > run.clearance.safety_m
