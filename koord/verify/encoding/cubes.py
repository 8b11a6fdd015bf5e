"""Cubes: a bounded question split into parts by what robots do first. [SKIP] [END-EVENT]

In each round a robot runs one event or none. So the runs of a system are split, for some robot and
round, into those in which it runs the first of its events there, those in which it runs the second,
and so on, and those in which it runs none; and each of these parts again for another robot. Every
run is in one of them: what holds in all parts holds, and what is violated in one is violated.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from msgspec import Struct

from koord.semantics.configurations import NO_EVENT
from koord.semantics.domain import disjunction
from koord.syntax.core import UnaryOp
from koord.syntax.system import System
from koord.verify.encoding.moments import EventOption
from koord.verify.encoding.terms import Term, Terms


class Choice(Struct, frozen=True):
    """What a robot does in a round, which counts from 0: the position of its event, or none."""

    round: int
    robot: int
    event: int


class Cube(Struct, frozen=True):
    """The runs in which some robots do certain things in certain rounds, if they last so long."""

    choices: tuple[Choice, ...] = ()

    def met(self, d: Terms, number: int, options: Sequence[EventOption]) -> list[Term]:
        """The constraints that a round, with its optional events, is one of the cube's runs."""
        return [_chosen(d, choice, options) for choice in self.choices if choice.round == number]


def _chosen(d: Terms, choice: Choice, options: Iterable[EventOption]) -> Term:
    own = [option for option in options if option.robot == choice.robot]
    if choice.event == NO_EVENT:
        return d.unary(UnaryOp.NOT, disjunction(d, [option.chosen for option in own]))
    return disjunction(d, [option.chosen for option in own if option.position == choice.event])


def cubes(system: System, least: int, rounds: int) -> tuple[Cube, ...]:
    """Split all runs into at least so many cubes, by what robots do in the first ``rounds``.

    There are fewer if robots have too few events for that. The order is that of the events.
    """
    found = [Cube()]
    for number, robot in _places(system, rounds):
        if len(found) >= least:
            break
        events = [*range(len(system.agent(robot).events)), NO_EVENT]
        found = [
            Cube((*cube.choices, Choice(number, robot, event)))
            for cube in found
            for event in events
        ]
    return tuple(found)


def _places(system: System, rounds: int) -> Iterator[tuple[int, int]]:
    for number in range(rounds):
        for robot in range(system.robots):
            yield number, robot
