"""Configurations that runs of a few robots reach, to tell what never happens from what does.

A small system's configurations are looked at one by one, those first that were left least often:
from each rounds are run in which one robot runs an event, each event of each robot once, and then
others in which robots move or skip at random. What is found is a sample. Nothing is shown by it;
it says which statements are not worth a proof.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from random import Random

from msgspec import Struct

from koord.sampling.compiled.turns import Turns
from koord.sampling.running import ProgramTurn, Run, RunState
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.rounds import IllegalStepError
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Numbers

#: Where so many rounds were run from each configuration, no others are expected.
_ENOUGH = 12

#: How often a robot has no turn in a round although it could: so that some are left behind.
_IDLE = 0.4


class Crossing(Struct):
    """A configuration between rounds: what robots may run, and what was not run by one robot yet.

    ``left`` counts the rounds that were run from it.
    """

    moment: RunState
    events: Mapping[int, list[int]]
    alone: list[ProgramTurn]
    left: int = 0

    @staticmethod
    def of(run: Run, rng: Random) -> Crossing:
        # Robots read what the store was when the round began: who goes first changes none of it.
        events = {robot: run.enabled(robot) for robot in run.waiting}
        alone = [ProgramTurn(robot, event) for robot, mine in events.items() for event in mine]
        rng.shuffle(alone)
        return Crossing(run.moment, events, alone)


class _Hasty(Sampler):
    """A sampler that gives up soon where assumptions are hard to meet: others start elsewhere."""

    start_tries = 40


def reached(
    system: System,
    turns: int,
    seed: int = 0,
    *,
    hasty: bool = False,
    code: Turns | None = None,
) -> list[Configuration[Constant]]:
    """Sample different configurations that a system reaches in runs of so many turns in all.

    Those of the middle of a round are among them. None where no start can be found: ``hasty``, it
    is not looked for long. The ``code`` of other runs of the system is used again.
    """
    rng = Random(seed)
    sampler = (_Hasty if hasty else Sampler)(system, Numbers.EXACT, rng)
    run = Run(system, Numbers.EXACT, SampledInputs(sampler), code, kept=False)
    seen: dict[Hashable, Configuration[Constant]] = {}
    crossings: list[Crossing] = []
    known: dict[Hashable, Crossing] = {}
    try:
        run.begin()
        while turns > 0:
            if _is_alive(run) and not run.waiting:
                run.evolve()
            key = _key(run.configuration)
            seen.setdefault(key, run.configuration)
            if key not in known and _is_alive(run):
                known[key] = Crossing.of(run, rng)
                crossings.append(known[key])
            if not crossings:
                break
            here = known.get(key)
            if here is None or here.left > 0:
                # The last of those that were left least often.
                here = min(reversed(crossings), key=lambda each: each.left)
                if here.left >= _ENOUGH and not here.alone:
                    break
                run.go_back(here.moment)
            here.left += 1
            turns -= _round(run, rng, here, seen)
    except (KoordError, OutOfBudgetError):
        pass  # What was seen by then is a sample too.
    return list(seen.values())


def _is_alive(run: Run) -> bool:
    return run.configuration.fault is None and not run.all_stopped


def _key(configuration: Configuration[Constant]) -> Hashable:
    robots = tuple((r.locals, r.ports, r.status) for r in configuration.robots)
    return robots, configuration.store


def _round(
    run: Run, rng: Random, here: Crossing, seen: dict[Hashable, Configuration[Constant]]
) -> int:
    """Run the turns of a round, and count them; where one robot goes first, others skip."""
    robots = list(run.waiting)
    rng.shuffle(robots)
    first = here.alone.pop() if here.alone else None
    if first is not None:
        robots.sort(key=lambda robot: robot != first.robot)
    for robot in robots:
        events = list(here.events[robot])
        rng.shuffle(events)
        if first is not None and first.robot == robot:
            events = [] if first.event is None else [first.event]
        elif (first is not None or rng.random() < _IDLE) and run.may_skip(robot):
            events = []
        if _turn(run, robot, events):
            seen.setdefault(_key(run.configuration), run.configuration)
        if run.configuration.fault is not None:
            break
    return max(1, len(robots))


def _turn(run: Run, robot: int, events: list[int]) -> bool:
    """Run the first event that the rules allow, or skip; return whether there was an event."""
    for event in events:
        try:
            run.make(ProgramTurn(robot, event))
        except IllegalStepError:
            continue
        return True
    run.make(ProgramTurn(robot, None))
    return False
