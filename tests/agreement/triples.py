"""Triples of a program, a configuration and a schedule, with what the schedule leaves open."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

from msgspec import Struct

from koord.refinement.generating.palette import GENERAL, WILD
from koord.refinement.generating.programs import system
from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant, Domain
from koord.semantics.recordings import RecordedInputs, Round
from koord.semantics.rounds import Stepped, evolved, run_event, run_skip
from koord.syntax.system import System
from tests.generators.configurations import configuration
from tests.generators.runs import Player


class Triple(Struct, frozen=True):
    """A configuration at the start of a round, and one round from it, which is legal."""

    seed: int
    system: System
    start: Configuration[Constant]
    round: Round


def triple(seed: int) -> Triple:
    """The triple of a seed. Any configuration will do, reachable or not."""
    random = Random(seed)
    made = system(random, random.choice((GENERAL, WILD)))
    start = configuration(random, made)
    played = Player(random, made).round(start)
    if played is None:
        # The environment has no turn: the contracts contradict each other here.
        order = tuple(range(made.robots))
        return Triple(seed, made, start, Round((), (None,) * len(order), cut=True))
    return Triple(seed, made, start, played[0])


def steps(d: Domain[Constant], t: Triple) -> Iterator[Stepped[Constant]]:
    """The round of a triple, step by step, by the sequential rules. [EVENT-TRANS] [ENV-TRANS]"""
    inputs = RecordedInputs(readings=t.round.readings, answers=t.round.answers)
    configuration = t.start
    for robot in t.round.order:
        position = t.round.events[robot]
        if position is None:
            stepped = run_skip(d, t.system, configuration, robot, inputs)
        else:
            stepped = run_event(d, t.system, configuration, robot, position, inputs)
        yield stepped
        configuration = stepped.configuration
    if not t.round.cut:
        yield evolved(d, t.system, configuration, inputs)


def exact_steps(t: Triple) -> list[Stepped[Constant]]:
    """The round on the reference domain."""
    return list(steps(EXACT, t))
