"""What is done for all robots at once comes to what is done for one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.sim_setup import simulation
from koord.runtime.configuration.checking import load
from koord.runtime.robot import Forwarding, Host
from koord.sim.run_log import Idle
from koord.sim.running import Ending, Simulation, run
from koord.syntax.source import Source

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Robots of two kinds, which drive to and fro; one knows a coordinate only, the other a model.
LINES = """\
using Rail:
    sensors:
        float position
        bool done
    actuators:
        float goal
{model}local:
    int k = 0
    float home
init:
    home = Rail.position
Go:
    pre: Rail.done and k < 4
    eff:
        k = k + 1
        if k < 4:
            Rail.goal = home + 0.3 * k
        else:
            stop
invariant Counted: k <= 4
"""
MODEL = """\
using Clock:
    sensors:
        int rounds = 0
    environment:
        rounds = rounds + 1
"""
MANY = """\
num_robots: 3
positions: {0: [0, 0, 0], 1: [0, 2, 0], 2: [0, 4, 0]}
world: {bounds: {low: [-4, -4, 0], high: [9, 9, 3]}}
"""
POINTS = MANY + "device: {bot_type: IDEAL, planner: STRAIGHT}\n"
DRONES = MANY + (
    "device: {bot_type: QUAD, planner: STRAIGHT, "
    "simulation: {noise: {position: 0.01, rate: 5}, wind: {mean: [0.1, 0, 0], gust: 0.2}}}\n"
)

#: The same in space, straight up.
UP = (
    LINES.replace("float position", "pos psn")
    .replace("float goal", "pos target")
    .replace("float home", "pos home")
    .replace("Rail.position", "Rail.psn")
    .replace("Rail.goal = home + 0.3 * k", "Rail.target = home + pos(0.0, 0.0, 0.3 * k)")
)

#: A model of the environment orders the robot to go where it is to go.
DRIVEN = """\
using Rail:
    sensors:
        float position
    actuators:
        float goal = 0.0
    environment:
        goal = 0.5
Never:
    pre: Rail.position > 9
    eff: Rail.goal = 0.0
"""

#: INIT says it, and no event runs.
SENT = DRIVEN.replace("    environment:\n        goal = 0.5\n", "init:\n    Rail.goal = 0.5\n")

CASES = {
    "sent": (SENT, POINTS, 2.0),
    "driven": (DRIVEN, POINTS, 2.0),
    "up": (UP.format(model=""), POINTS, 6.0),
    "points": (LINES.format(model=""), POINTS, 6.0),
    "planned": (
        LINES.format(model="").replace("bool done", "bool done\n        string planner"),
        POINTS,
        2.0,
    ),
    "drones": (LINES.format(model=""), DRONES, 6.0),
    "modelled": (LINES.format(model=MODEL), POINTS, 2.0),
    **{
        name: (
            (EXAMPLES / f"{name}.krd").read_text("utf-8"),
            (EXAMPLES / f"{name}.yaml").read_text("utf-8"),
            1.5,
        )
        for name in ("mapping", "cars_and_drones")
    },
}


class AsksEverybody(Simulation):
    """A run in which all that robots have is looked at in every round."""

    def pass_time(self) -> None:
        self.acted.update(range(len(self.engine.robots)))
        until_s = (self.engine.round + 1) * self.scene.delta_s
        self.host.pass_time(self.engine.robots, until_s, self.tick)


def made(name: str, kind: type[Simulation], hears: bool) -> Simulation:
    """A run, whose readings somebody hears or nobody."""
    program, configuration, _ = CASES[name]

    def heard(host: Host, world: Host) -> Host:
        return Forwarding(host)

    return simulation(fitted(program, configuration), kind, tracing=heard if hears else None)


def fitted(program: str, configuration: str) -> Fitted:
    sources = Source("one.krd", program), load(Source("fleet.yaml", configuration))
    return fit(FitRequest(*sources, (), {}))


def states(of: Simulation, seconds: float) -> list[Any]:
    """After each round: the robots' variables, and which of them are other objects than before."""
    of.begin()
    found, before = [], [dict(vars(robot)) for robot in of.engine.robots]
    for _ in run(of, seconds):
        now = [dict(vars(robot)) for robot in of.engine.robots]
        ports = [robot.PORTS for robot in of.engine.robots]
        kept = [
            [one[p] is was[p] for p in named]
            for one, was, named in zip(now, before, ports, strict=True)
        ]
        found.append((now, kept))
        before = now
    return found


@pytest.mark.parametrize("name", CASES)
def test_sensors_are_read_at_once_as_one_by_one(name: str) -> None:
    """[ENV-FREE] [ENV-TRANS]: equal values, and the old objects where nothing has changed."""
    seconds = CASES[name][2]
    at_once, one_by_one = (made(name, Simulation, hears) for hears in (False, True))
    assert states(at_once, seconds) == states(one_by_one, seconds)
    assert at_once.engine.round > 10
    assert (at_once.engine.reader is None, one_by_one.engine.reader is None) == (False, True)
    assert at_once.figures() == one_by_one.figures()
    assert at_once.ending is one_by_one.ending


@pytest.mark.parametrize("name", ["up", "drones", "modelled", "mapping"])
def test_orders_of_who_ran_are_the_orders_of_all(name: str) -> None:
    seconds = CASES[name][2]
    some, all_ = (made(name, kind, hears=False) for kind in (Simulation, AsksEverybody))
    assert states(some, seconds) == states(all_, seconds)
    assert some.figures() == all_.figures()
    assert some.figures().distance_m > 0


@pytest.mark.parametrize("name", ["sent", "driven"])
def test_init_and_models_that_write_actuators_give_orders(name: str) -> None:
    """What they write is an order too, though no event has run."""
    of = made(name, Simulation, hears=False)
    states(of, CASES[name][2])
    assert all(robot.distance_m > 0.2 for robot in of.figures().robots)


@pytest.mark.parametrize(
    "more",
    ["", "invariant Home: home <= 100\n", "invariant At: home <= k + 100\n"],
    ids=["one", "two", "both"],
)
def test_what_changes_is_held_against_claims(more: str) -> None:
    """[PROP-INVARIANT]: by however many names; each robot is told of when it breaks a claim."""
    program = LINES.format(model="") + "invariant Few: k <= 2\n" + more
    of = simulation(fitted(program, POINTS), Simulation, keep_going=True)
    states(of, 6.0)
    broken = [one for one in of.broken if one.claim == "invariant Few"]
    assert [one.robots for one in broken] == [(0,), (1,), (2,)]
    # At once, not when the round is over.
    thirds = [
        one.time_s for one in of.recording.rounds for change in one.changes if change.value == 3
    ]
    assert [one.time_s for one in broken] == pytest.approx(thirds)


def test_what_is_sensed_is_held_against_claims() -> None:
    program = LINES.format(model="") + "invariant Near: Rail.position <= home + 0.35\n"
    of = simulation(fitted(program, POINTS), Simulation, keep_going=True)
    states(of, 6.0)
    broken = [one.robots for one in of.broken if one.claim == "invariant Near"]
    assert broken == [(0,), (1,), (2,)]


COUNTS = "local:\n    int k = 0\nCount:\n    pre: k < 45\n    eff: k = k + 1\n"
RESTS = "local:\n    int k = 0\nNever:\n    pre: k > 0\n    eff: k = 1\n"


@pytest.mark.parametrize(
    ("program", "ending", "rounds"),
    [(COUNTS, Ending.STILL, 75), (RESTS, Ending.STILL, 30), (MODEL + RESTS, Ending.LIMIT, 90)],
    ids=["counts", "rests", "modelled"],
)
def test_a_run_is_still_when_neither_events_nor_models_change_anything(
    program: str, ending: Ending, rounds: int
) -> None:
    of = simulation(fitted(program, POINTS), Simulation)
    states(of, 9.0)
    assert of.ending is ending
    assert of.engine.round == pytest.approx(rounds, abs=1)


def test_deeds_of_a_round_are_counted_by_robot() -> None:
    """[ATOMIC] [SKIP]: one of three enters in each round; who has stopped is not counted."""
    program = (
        "allwrite:\n    int total = 0\nlocal:\n    int k = 0\n"
        "Enter:\n    pre: k < 2\n    eff:\n        atomic:\n            total = total + 1\n"
        "        k = k + 1\n        if k == 2:\n            stop\n"
    )
    of = simulation(fitted(program, POINTS), Simulation)
    states(of, 2.0)
    assert of.ending is Ending.STOPPED
    found = of.figures().robots
    assert [one.events for one in found] == [2, 2, 2]
    deeds = [one.deeds.tolist() for one in of.recording.rounds if one.number >= 0]
    assert sum(deed == Idle.BLOCKED for row in deeds for deed in row) > 0
    for robot, one in enumerate(found):
        own = [row[robot] for row in deeds]
        assert one.blocked == own.count(Idle.BLOCKED)
        assert one.skips == own.count(Idle.BLOCKED) + own.count(Idle.SKIPPED)
        assert Idle.STOPPED not in own[: 1 + max(k for k, deed in enumerate(own) if deed >= 0)]


def test_whoever_asks_before_the_end_is_told_what_was_by_then() -> None:
    """And asking changes nothing: what robots did in some rounds is counted together."""
    of, asked = made("points", Simulation, hears=False), []
    of.begin()
    for _ in run(of, 6.0):
        asked.append([(one.events, one.skips, one.waited_s) for one in of.figures().robots])
    deeds = np.stack([done.deeds for done in of.recording.rounds if done.number >= 0])
    events = (deeds >= 0).cumsum(0)[: len(asked)]  # the end is recorded, too
    assert [[count for count, *_ in row] for row in asked] == events.tolist()
    once = made("points", Simulation, hears=False)
    once.begin()
    assert len(list(run(once, 6.0))) == len(asked)
    assert [(one.events, one.skips, one.waited_s) for one in once.figures().robots] == asked[-1]
