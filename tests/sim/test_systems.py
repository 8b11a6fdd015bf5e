"""The examples of other systems do in simulation what they are for (specs/examples/systems)."""

from __future__ import annotations

import re
from random import Random
from typing import Any

import numpy as np
import pytest

from koord.api.fitting import FitRequest, fit, fit_request
from koord.api.sim_setup import simulation
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load
from koord.runtime.robot import Robot
from koord.runtime.shapes import Array, PerRobot, Record, Scalar, ScalarKind, Shape
from koord.sim.running import Ending, Simulation, run
from koord.syntax.source import Source
from tests.loading import EXAMPLES, program_of

SYSTEMS = EXAMPLES / "systems"
BUZZ = ["buzz_barrier", "buzz_hexagon", "buzz_maximum", "buzz_split"]


def begun(name: str) -> Simulation:
    """A run of an example with its configuration."""
    path = SYSTEMS / f"{name}.krd"
    request = fit_request(path, path.with_suffix(".yaml"), None, None, None, None)
    made = simulation(fit(request), Simulation)
    made.begin()
    return made


def finished(name: str, duration_s: float = 60.0) -> Simulation:
    """The same when it has ended; no claim is broken in it."""
    made = begun(name)
    list(run(made, duration_s))
    assert (made.broken, made.standing, made.fault) == ([], (), None)
    return made


# --- what robots read of each other ---------------------------------------------------------------


def drawn(shape: Shape, robots: int, rng: Random) -> Any:
    """Any value of a shape, of the kind that these programs have."""
    match shape:
        case Scalar(kind=ScalarKind.BOOL):
            return rng.random() < 0.5
        case Scalar(kind=ScalarKind.INT):
            return rng.randrange(-1, robots)
        case Scalar(kind=ScalarKind.FLOAT):
            return rng.uniform(-3.0, 3.0)
        case Record(make=make, fields=fields):
            return tuple.__new__(make, [drawn(one, robots, rng) for one in fields])
        case PerRobot(element=element):
            return tuple(drawn(element, robots, rng) for _ in range(robots))
        case Array(element=element, size=size):
            return tuple(drawn(element, robots, rng) for _ in range(size))
        case _:
            raise AssertionError(shape)


def reads_what_it_does_not_hear(text: str, robots: int = 5, tries: int = 300) -> bool:
    """Return whether what a robot does hangs on entries of robots that it does not hear."""
    (program,) = loaded(compiled(program_of(text)))
    rng = Random(1)

    def deeds(state: dict[str, Any], pid: int) -> list[Any]:
        robot: Robot = program(pid, [0] * robots, 0.1, None)  # type: ignore[arg-type]
        vars(robot).update(state)
        found: list[Any] = []
        for event in range(len(program.EVENTS)):
            buffer = robot.try_event(event)
            if buffer is None:
                found.append(None)
            else:
                own = {name: buffer.state[name] for name in (*program.LOCALS, *program.PORTS)}
                found.append((own, list(buffer.writes), buffer.fault))
        return found

    for _ in range(tries):
        pid = rng.randrange(robots)
        state = {
            name: drawn(shape, robots, rng)
            for name, shape in {**program.LOCALS, **program.PORTS}.items()
        }
        hears = state["Radio_inRange"]
        other = dict(state)
        for one in program.SHARED.variables:
            first, second = (drawn(one.shape, robots, rng) for _ in range(2))
            state[one.name] = first
            other[one.name] = tuple(
                first[j] if j == pid or hears[j] else second[j] for j in range(robots)
            )
        if deeds(state, pid) != deeds(other, pid):
            return True
    return False


@pytest.mark.parametrize("name", BUZZ)
def test_robots_of_buzz_know_of_others_only_what_they_hear(name: str) -> None:
    text = (SYSTEMS / f"{name}.krd").read_text("utf-8")
    assert not reads_what_it_does_not_hear(text)
    deaf = re.sub(r"(Radio\.)?inRange\[j\]", r"(\g<0> or true)", text)
    assert deaf != text
    assert reads_what_it_does_not_hear(deaf)


# --- what swarms come to --------------------------------------------------------------------------


def test_the_maximum_comes_to_all_one_hop_a_round() -> None:
    made = begun("buzz_maximum")
    found = [made.engine.store.values["best"]]
    while found[-1] != (8.0,) * 5:
        made.round()
        found.append(made.engine.store.values["best"])
    assert found[1:] == [(2, 4, 6, 8, 8), (4, 6, 8, 8, 8), (6, 8, 8, 8, 8), (8, 8, 8, 8, 8)]


def test_the_barrier_opens_when_all_have_been_heard_of() -> None:
    made = finished("buzz_barrier")
    assert all(vars(robot)["passed"] for robot in made.engine.robots)
    # Come, heard by those beside and then across, gone on.
    (barrier,) = {vars(robot)["roll"] for robot in made.engine.robots}
    assert all(map(all, barrier))


def test_the_swarm_splits_and_each_half_has_its_leader() -> None:
    made = finished("buzz_split")
    assert made.engine.store.values["leader"] == (0, 1, 0, 1, 0, 1)
    x = made.fleet.positions()[:, 0]
    assert np.allclose(x, [-3, 3, -3, 3, -3, 3], atol=0.3)


def test_drones_that_hear_their_neighbours_form_a_hexagon() -> None:
    made = finished("buzz_hexagon", 15.0)
    places = made.fleet.positions()[:, :2]
    gaps = np.linalg.norm(places[:, None] - places, axis=-1)
    sides = gaps[np.triu_indices(7, 1)]
    edges = sides[sides < 2.7]
    # Six around one: twelve edges of one length.
    assert len(edges) == 12
    assert np.allclose(edges, 2.0, atol=0.15)
    assert sorted((gaps < 2.7).sum(1).tolist()) == [4, 4, 4, 4, 4, 4, 7]


# --- barrier certificates -------------------------------------------------------------------------

#: The distance in metres that the configurations ask of the controller.
APART_M = 0.4


def least_apart_m(name: str, duration_s: float, *, certified: bool = True, **params: int) -> float:
    """How near robots come to each other in a run, with and without barrier certificates."""
    path = (SYSTEMS / f"{name}.krd").with_suffix(".yaml")
    text = path.read_text("utf-8")
    if not certified:
        text, count = re.subn(r", controller: barrier, controller_options: {[^}]*}", "", text)
        assert count == 1
    source = Source(f"{name}.krd", (SYSTEMS / f"{name}.krd").read_text("utf-8"))
    made = simulation(
        fit(FitRequest(source, load(Source(path.name, text)), (), dict(params))), Simulation
    )
    made.keep_going = True
    made.begin()
    list(run(made, duration_s))
    nearest = made.figures().nearest
    assert nearest is not None
    broken = {one.claim for one in made.broken}
    assert broken == (set() if certified else {"separation"})
    return nearest.distance_m


@pytest.mark.slow
def test_robots_that_cross_are_kept_apart_by_certificates_alone() -> None:
    assert least_apart_m("robotarium_points", 60.0, laps=1) >= APART_M
    assert least_apart_m("robotarium_points", 8.0, certified=False, laps=1) < APART_M - 0.04


@pytest.mark.slow
@pytest.mark.parametrize("name", ["robotarium_consensus", "robotarium_formation"])
def test_certificates_keep_all_apart_that_meet(name: str) -> None:
    assert least_apart_m(name, 40.0) >= APART_M
    assert least_apart_m(name, 10.0, certified=False) < APART_M - 0.04


def test_robots_come_to_their_formation() -> None:
    made = finished("robotarium_formation")
    assert made.ending is Ending.STILL
    places = made.fleet.positions()[:, :2]
    wanted = np.array([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)])
    assert np.abs(places - places[0] - wanted).max() < 0.25


@pytest.mark.slow
def test_robots_share_a_strip() -> None:
    made = finished("robotarium_coverage")
    x = made.fleet.positions()[:, 0]
    ends = np.concatenate([[0.0], (x[1:] + x[:-1]) / 2, [6.0]])
    # Each is near the middle of its part, and so parts are nearly of one length.
    assert np.abs(x - (ends[1:] + ends[:-1]) / 2).max() < 0.12
    assert np.abs(np.diff(ends) - 1.2).max() < 0.4


# --- one program on several platforms -------------------------------------------------------------


@pytest.mark.parametrize("platform", ["", "_car", "_drone"])
def test_one_program_goes_around_its_square_on_each_platform(platform: str) -> None:
    path = SYSTEMS / "pyrobot_square.krd"
    file = SYSTEMS / f"pyrobot_square{platform}.yaml"
    made = simulation(fit(fit_request(path, file, None, None, None, None)), Simulation)
    made.begin()
    corners = [made.fleet.positions()[0, :2] + c for c in ((2, 0), (2, 2), (0, 2), (0, 0))]
    nearest = np.full(4, np.inf)
    for _ in run(made, 60.0):
        here = made.fleet.positions()[0, :2]
        nearest = np.minimum(nearest, [np.hypot(*(here - corner)) for corner in corners])
    assert (made.ending, made.broken) == (Ending.STOPPED, [])
    assert nearest.max() < 0.3
    assert np.hypot(*(here - corners[-1])) < 0.3


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_with_a_map_finds_out_where_it_is(seed: int) -> None:
    path = SYSTEMS / "mrpt_relocalise.krd"
    request = fit_request(path, path.with_suffix(".yaml"), None, None, seed, None)
    made = simulation(fit(request), Simulation)
    made.begin()
    list(run(made, 10.0))
    assert (made.ending, made.broken) == (Ending.STOPPED, [])
    held = vars(made.engine.robots[0])
    assert [k for k, may_be in enumerate(held["maybe"]) if may_be] == [held["Corridor_cell"]]


# --- Drona ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_drones_deliver_on_plans_that_keep_clear_and_come_home() -> None:
    made = begun("drona_delivery")
    pads = made.fleet.positions().copy()
    assert list(run(made, 60.0))
    assert (made.broken, made.standing, made.fault) == ([], (), None)
    assert made.ending is Ending.STOPPED
    assert np.linalg.norm(made.fleet.positions() - pads, axis=1).max() < 0.3
