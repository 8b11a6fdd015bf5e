"""Robots with a differential drive: limits, turns on the spot, contact, and how near to paths."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from koord.cli.main import main
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, DifferentialDrive, Level, PlannerName
from koord.runtime.motion.geometry import point_path
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import Hindrance, Pose
from koord.runtime.motion.world import Disc, Point, World
from koord.sim.fleet import Fleet, Placed
from koord.sim.squads import DeviceModel, Wheeled, WheeledSquad
from koord.sim.vehicles.contact import Colliding, Floor
from koord.sim.vehicles.rovers import Differentials
from koord.sim.vehicles.wheels import Hull
from tests.runtime.motion.worlds import CLUTTERED

ROVER = DifferentialDrive()
WIDE = World((-20, -20, 0), (20, 20, 3))
HERE = np.zeros((1, 3))
EXAMPLES = Path(__file__).parents[2] / "specs/examples"

#: A path with a corner to each side, and back where it came from.
CORNERS: list[Point] = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (2, 1, 0), (1.2, 1, 0)]


def rovers(level: Level = Level.FULL) -> DeviceModel:
    return DeviceModel(ROVER, PlannerName.RRT_DIFF, level)


def alone() -> Differentials:
    return Differentials(ROVER, HERE, np.zeros(1))


def in_contact() -> Colliding:
    hull = Hull(ROVER.mass_kg, *ROVER.outline_m, is_disc=True)
    return Colliding(alone(), hull, Floor(WIDE))


@pytest.mark.parametrize("made", [alone, in_contact])
def test_wheels_keep_their_limits(made: Callable[[], Wheeled]) -> None:
    vehicle, draw = made(), np.random.default_rng(2)
    wheels, place = np.zeros(2), HERE
    for _ in range(300):
        vehicle.advance(draw.uniform(-2, 2, (1, 2)), 0.01, 1)
        moved = vehicle.model if isinstance(vehicle, Colliding) else vehicle
        assert isinstance(moved, Differentials)
        now = moved.wheels[0]
        assert np.abs(now).max() <= ROVER.wheel_mps * 1.001
        assert np.abs(now - wheels).max() <= ROVER.wheel_accel_mps2 * 0.01 * 1.01
        assert np.hypot(*(vehicle.position - place)[0, :2]) <= ROVER.wheel_mps * 0.01 * 1.001
        wheels, place = now, vehicle.position.copy()


@pytest.mark.parametrize("made", [alone, in_contact])
def test_it_turns_on_the_spot(made: Callable[[], Wheeled]) -> None:
    vehicle, command = made(), np.array([[-0.2, 0.2]])
    vehicle.advance(command, 0.01, 100)
    assert np.abs(vehicle.position).max() < 1e-3
    assert vehicle.heading[0] == pytest.approx(0.4 / ROVER.track_m, rel=0.1)


def test_in_contact_it_moves_as_alone() -> None:
    one, other = alone(), in_contact()
    for k in range(200):
        command = np.array([[0.4 + 0.2 * math.sin(k / 9), 0.4 - 0.2 * math.sin(k / 11)]])
        one.advance(command, 0.01, 5)
        other.advance(command, 0.01, 5)
    assert other.position == pytest.approx(one.position, abs=0.05)
    assert other.heading == pytest.approx(one.heading, abs=0.05)


def followed(level: Level) -> tuple[Floats, Fleet]:
    """Where a robot is at each tick while it follows the corners, pointing elsewhere at first."""
    fleet = Fleet(World(), [Placed(rovers(level), (0, 0, 0), 2.5)])
    fleet.follow(0, CORNERS)
    places: list[Floats] = []
    fleet.advance_to(22.0, lambda fleet: places.append(fleet.positions()[0]))
    return np.array(places), fleet


@pytest.mark.slow
def test_it_follows_corners_at_every_level() -> None:
    ways = {}
    for level in Level:
        if level is Level.MUJOCO:
            pytest.importorskip("mujoco")
        ways[level], fleet = followed(level)
        assert fleet.reached()[0], level
        apart = max(point_path(place, np.array(CORNERS)) for place in ways[level])
        assert apart < 0.05, level
        steps = np.hypot(*np.diff(ways[level][:, :2], axis=0).T)
        assert steps.max() <= 1.15 * ROVER.cruise_mps * 0.05, level
    assert np.array_equal(ways[Level.FULL], ways[Level.FAST])
    for level in (Level.FULL, Level.MUJOCO):
        apart = np.abs(ways[level] - ways[Level.SIMPLE]).max()
        assert 0 < apart < 0.25, level  # in time: each goes around corners at its own pace
    assert np.abs(ways[Level.FULL][-1] - ways[Level.SIMPLE][-1]).max() < 0.05


def test_planned_paths_are_in_the_plane_and_free() -> None:
    made = planner(PlannerName.RRT_DIFF, CLUTTERED, ROVER)
    path = made.plan(Pose((-2.5, -2.5, 0.0)), (2.5, 2.5, 0.0), 3)
    assert path is not None
    assert len(path) > 2
    assert (path[:, 2] == 0).all()
    again = made.plan(Pose((-2.5, -2.5, 0.0)), (2.5, 2.5, 0.0), 3)
    assert np.array_equal(path, again if again is not None else [])


def test_rovers_and_cars_do_not_pass_through_one_another() -> None:
    car = DeviceModel(Car(), PlannerName.STRAIGHT)
    robots = [Placed(rovers(), (-1.5, 0, 0)), Placed(car, (1.5, 0, 0), math.pi)]
    fleet = Fleet(World(), robots)
    fleet.follow(0, [(-1.5, 0, 0), (2.5, 0, 0)])
    fleet.follow(1, [(1.5, 0, 0), (-2.5, 0, 0)])
    apart: list[float] = []
    fleet.advance_to(5.0, lambda f: apart.append(math.dist(*f.positions())))
    nearest = ROVER.radius_m + Car().middle_m + Car().length_m / 2
    assert min(apart) == pytest.approx(nearest, abs=0.03)
    assert fleet.touched(0) == ((Hindrance.ROBOT, 1),)
    assert isinstance(fleet._squads[0][0], WheeledSquad)


def test_it_stops_at_what_stands_in_its_way() -> None:
    world = World(obstacles=(Disc((1.5, 0.0), 0.4),))
    fleet = Fleet(world, [Placed(rovers(), (0, 0, 0))])
    fleet.follow(0, [(0, 0, 0), (3, 0, 0)])
    fleet.advance_to(6.0)
    assert fleet.positions()[0][0] == pytest.approx(1.1 - ROVER.radius_m, abs=0.02)
    assert fleet.touched(0) == ((Hindrance.OBSTACLE, 0),)


@pytest.mark.slow
def test_what_task_claims_holds_with_slack(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sim", str(EXAMPLES / "task.krd"), str(EXAMPLES / "task_diff.yaml"), "--no-html"]
    assert main([*words, "--rounds", "120", "--check-summaries"]) == 0
    assert "claims      11" in capsys.readouterr().out
