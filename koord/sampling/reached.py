"""Configurations that runs of a few robots reach, to tell what never happens from what does.

A small system's configurations are looked at one by one, those first that were left least often:
from each a round is run in which robots move or skip at random. What is found is a sample. Nothing
is shown by it; it says which statements are not worth a proof.
"""

from __future__ import annotations

from collections.abc import Hashable
from random import Random

from koord.sampling.running import ProgramTurn, Run, RunState, new_run
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.rounds import IllegalStepError
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Numbers

#: How often a robot has no turn in a round although it could: so that some are left behind.
_IDLE = 0.4


def reached(system: System, turns: int, seed: int = 0) -> list[Configuration[Constant]]:
    """Sample different configurations that a system reaches in runs of so many turns in all.

    Those of the middle of a round are among them. None where no start can be found.
    """
    rng = Random(seed)
    run = new_run(system, Numbers.EXACT, rng)
    seen: dict[Hashable, Configuration[Constant]] = {}
    moments: list[RunState] = []
    known: dict[Hashable, int] = {}
    left: list[int] = []
    try:
        run.begin()
        while turns > 0:
            if _is_alive(run) and not run.waiting:
                run.evolve()
            key = _key(run.configuration)
            seen.setdefault(key, run.configuration)
            if key not in known and _is_alive(run):
                known[key] = len(moments)
                moments.append(run.moment)
                left.append(0)
            if not moments:
                break
            if key in known and _is_alive(run) and left[known[key]] == 0:
                here = known[key]
            else:
                here = min(range(len(moments)), key=lambda k: (left[k], -k))
                run.go_back(moments[here])
            left[here] += 1
            turns -= _round(run, rng, seen)
    except (KoordError, OutOfBudgetError):
        pass  # What was seen by then is a sample too.
    return list(seen.values())


def _is_alive(run: Run) -> bool:
    return run.configuration.fault is None and not run.all_stopped


def _key(configuration: Configuration[Constant]) -> Hashable:
    robots = tuple((r.locals, r.ports, r.status) for r in configuration.robots)
    return robots, configuration.store


def _round(run: Run, rng: Random, seen: dict[Hashable, Configuration[Constant]]) -> int:
    """Run the turns of a round, and count them."""
    robots = list(run.waiting)
    rng.shuffle(robots)
    for robot in robots:
        _turn(run, rng, robot)
        seen.setdefault(_key(run.configuration), run.configuration)
        if run.configuration.fault is not None:
            break
    return max(1, len(robots))


def _turn(run: Run, rng: Random, robot: int) -> None:
    """Run an event that the robot may select, or skip."""
    events = run.enabled(robot)
    rng.shuffle(events)
    if rng.random() < _IDLE and run.may_skip(robot):
        events = []
    for event in events:
        try:
            run.make(ProgramTurn(robot, event))
        except IllegalStepError:
            continue
        return
    run.make(ProgramTurn(robot, None))
