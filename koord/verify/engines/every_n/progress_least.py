"""Robots that go one after the other, by numbers that they drew: the first goes. [T-PROGRESS]

Where robots wait in the order of numbers that they show each other, somebody is the first of those
who wait, by the number and then by who it is; and others are outnumbered once they have drawn a
number greater than that of the robot that is meant.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import product

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.footprint import reads_of
from koord.syntax.core import BinaryOp
from koord.syntax.types import INT, ArrayType, BoolType, EnumType, IntType
from koord.syntax.walk import chained, nodes, renamed, statements, written
from koord.verify.engines.every_n.candidates import binary
from koord.verify.engines.every_n.progress_parts import (
    MEANT,
    READ_ROBOT,
    ROBOT,
    Help,
    Measure,
    Phrase,
    Words,
    changes,
    is_certain,
    said_of,
)


class Least(Struct, frozen=True):
    """The first of the robots in a state: by a number of each, and then by who it is."""

    state: Phrase
    number: Phrase


def least_of(program: core.Program) -> Iterator[Least]:
    """Yield who may be the first: of those in a state in which a guard asks for all numbers."""
    if len(program.agents) != 1:
        return
    plain = Words(program, 0).plain_states(READ_ROBOT)
    found: dict[Least, None] = {}
    for event in program.agents[0].events:
        states = [
            state
            for state in (said_of(part, ROBOT) for part in chained(event.guard, BinaryOp.AND))
            if state in plain
        ]
        for state, number in product(states, _numbers(program, event.guard)):
            found[Least(Phrase(state), Phrase(number))] = None
    yield from found


def _numbers(program: core.Program, guard: core.Expr) -> Iterator[core.Expr]:
    """Yield the numbers that robots show each other and a guard asks for, of a robot."""
    asked = reads_of(program, guard).arrays
    for entry in program.allread:
        type_ = entry.variable.type
        if entry.variable.slot in asked and isinstance(type_, ArrayType) and type_.element == INT:
            yield core.Read(_entry(entry.variable))


def outnumbered(program: core.Program, stated: core.Property) -> Iterator[Measure]:
    """Yield whether a robot has a greater number than the one that is meant shows."""
    if stated.each is None:
        return
    numbers = dict.fromkeys(least.number.said for least in least_of(program))
    drawn = [own for own in Words(program, 0).own(READ_ROBOT) if own.type == INT]
    for shown, own in product(numbers, drawn):
        greater = binary(BinaryOp.LT, renamed(shown, ROBOT, MEANT), own)
        yield from changes([greater], core.RobotRange())


def states_of_numbers(program: core.Program) -> list[tuple[core.Expr, int]]:
    """What a robot's state may say of a number of its own: that it is drawn, or is not."""
    words = Words(program, 0)
    states = [state for state in words.plain_states(READ_ROBOT) if not _is_of_number(state)]
    numbers = [state for state in words.states(READ_ROBOT) if _is_of_number(state)]
    return [
        (
            core.Quantified(
                core.QuantifierKind.FORALL,
                ROBOT,
                core.RobotRange(),
                binary(BinaryOp.IMPLIES, state, number),
            ),
            ROBOT.slot + 1,
        )
        for state, number in product(states, numbers)
    ]


def _is_of_number(state: core.Expr) -> bool:
    return isinstance(state, core.Binary) and state.left.type == INT


def who_draws(program: core.Program, measure: Measure) -> Iterator[core.Expr]:
    """Yield the guards of events that write a robot's number, as statements of a robot."""
    comparison = next(node for node in nodes(measure.term.said) if isinstance(node, core.Binary))
    assert isinstance(comparison.right, core.Read)
    for event in program.agents[0].events:
        is_plain = not any(isinstance(node, core.Call) for node in nodes(event.guard))
        if is_plain and is_certain(program, event.guard):
            places = (place for each in statements(event.effect) for place in written(each))
            if any(place.variable == comparison.right.place.variable for place in places):
                yield said_of(event.guard, ROBOT)


def read_by(program: core.Program, way: Help) -> tuple[Measure, ...] | None:
    """All that a way to help reads of configurations, as measures; None if that is not seen.

    Where none of these differs between two configurations, of any robot, it holds of the same
    robots in both.
    """
    if len(program.agents) != 1 or not is_certain(program, way.state.said):
        return None
    agent = program.agents[0]
    reads = reads_of(program, way.state.said, agent=agent)
    if reads.ports or reads.entries or reads.ran or reads.status:
        return None
    own = [
        *(core.Place(x.variable, robot=READ_ROBOT) for x in _at(agent.locals, reads.locals)),
        *(_entry(x.variable) for x in _at(program.allread, reads.arrays)),
    ]
    shared = [core.Place(x.variable) for x in _at(program.allwrite, reads.allwrite)]
    if any(not isinstance(x.type, BoolType | EnumType | IntType) for x in (*own, *shared)):
        return None
    return (
        *(Measure(Phrase(core.Read(place)), core.RobotRange()) for place in own),
        *(Measure(Phrase(core.Read(place))) for place in shared),
    )


def _at(declared: Sequence[core.Declaration], slots: Iterable[int]) -> Iterator[core.Declaration]:
    """Yield the declarations of some slots."""
    yield from (entry for entry in declared if entry.variable.slot in slots)


def _entry(variable: core.Variable) -> core.Place:
    """A robot's entry of an allread variable."""
    assert isinstance(variable.type, ArrayType)
    return core.Place(variable, (core.IndexStep(READ_ROBOT, variable.type.element),))
