"""Small recorded runs for tests, made the way that `koord sim` makes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.engine import RoundEngine as Engine
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Drone, PlannerName
from koord.runtime.motion.clearance import clearance_of
from koord.runtime.motion.world import World
from koord.sim.fleet import Placed
from koord.sim.measuring import Figures
from koord.sim.run_log import RunLog
from koord.sim.running import Cast, Simulation, run
from koord.sim.scene import Scene
from koord.sim.squads import DeviceModel
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"
DELTA_S = 0.1
CAR = DeviceModel(Car(), PlannerName.RRT_CAR)
DRONE = DeviceModel(Drone(), PlannerName.RRT_DRONE)
TASKS = World(tasks=((2, 2, 0), (-1, 2, 1.5), (0, -2, 1.2), (-2, 0, 0), (2.5, 0, 2), (1, 1, 1.5)))
TEAM = (
    Placed(CAR, (-2.5, -3.0, 0.0)),
    Placed(DRONE, (2.5, -3.0, 0.0)),
    Placed(DRONE, (-2.5, 3, 0)),
)


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run that is over, and its recording."""

    recording: RunLog
    engine: Engine
    last: tuple[Floats, Floats]  #: where robots were in the end, and where they pointed
    attitudes: Floats  #: in the end
    figures: Figures


def recorded(
    name: str, world: World, team: tuple[Placed, ...], rounds: int, **params: ParamValue
) -> Recorded:
    """At most so many rounds of an example."""
    text = (EXAMPLES / f"{name}.krd").read_text("utf-8")
    return recorded_text(name, text, world, team, rounds, **params)


def recorded_text(
    name: str,
    text: str,
    world: World,
    team: tuple[Placed, ...],
    rounds: int,
    **params: ParamValue,
) -> Recorded:
    """The same of any program."""
    program = load(Source(f"{name}.krd", text), Settings(params=params)).program
    assert program is not None
    clearance = clearance_of([placed.model.body for placed in team], tracking_m=0.15)
    scene = Scene(
        world,
        team,
        tuple("car" if placed.model is CAR else "drone" for placed in team),
        (None,) * len(team),
        {},
        clearance,
        0.2,
        DELTA_S,
        1,
    )
    cast = Cast(f"{name}.krd", text, loaded(compiled(program)), (0,) * len(team))
    simulation = Simulation(cast, scene, keep_going=True)
    simulation.begin()
    for _ in run(simulation, rounds * DELTA_S):
        pass
    fleet = simulation.fleet
    last = fleet.positions(), fleet.headings()
    figures = simulation.figures()
    return Recorded(simulation.recording, simulation.engine, last, fleet.attitudes(), figures)


@cache
def task() -> Recorded:
    """Six tasks, a car and two drones."""
    return recorded("task", TASKS, TEAM, 900, tasks=len(TASKS.tasks))


@cache
def lineform(robots: int = 4, rounds: int = 300) -> Recorded:
    """Drones on their way into a line."""
    starts = [(-8.0 + 16.0 * k / robots, 5.0 - 3.0 * (k % 4), 1.0) for k in range(robots)]
    team = tuple(Placed(DRONE, start) for start in starts)
    return recorded("lineform", World((-10, -10, 0), (10, 10, 4)), team, rounds)
