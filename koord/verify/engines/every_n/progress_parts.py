"""The parts of a proof of progress: measures that settle, and help that is not refused.

Measures and help are made from the program: states of robots and shared variables, differences of
numbers that are compared, guards of events, and what is expected of the environment. Which of them
a proof may rest on is shown; nothing here is trusted. [T-PROGRESS]
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from itertools import combinations
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.liveness import LIVENESS
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home
from koord.syntax.types import INT, ArrayType, BoolType, EnumType, IntType, RecordType
from koord.syntax.walk import nodes, reached, rebuilt, renamed
from koord.verify.engines.every_n.candidates import Vocabulary, binary, negated

#: The robot that a measure or help is of, and the one that the claim means.
ROBOT = core.Variable(Home.BOUND, 0, "i", INT)
MEANT = core.Variable(Home.BOUND, 1, "me", INT)

READ_ROBOT, READ_MEANT = (core.Read(core.Place(v)) for v in (ROBOT, MEANT))

#: Elements of longer arrays are no measures.
_MOST_ELEMENTS = 32

#: More states of a robot are not looked at where pairs of them are.
_MOST_STATES = 10

#: More measures are not tried.
_MOST_MEASURES = 400


class Phrase(Struct, frozen=True):
    """An expression about a robot, and about the one that a claim means: the slots of both."""

    said: core.Expr
    bound: int = 2
    robot: int | None = 0
    meant: int | None = 1


class Measure(Struct, frozen=True):
    """A measure that settles: a Boolean that only falls, or a natural number that does not grow.

    It is of each robot of a kind if ``each`` is told.
    """

    term: Phrase
    each: core.RobotRange | None = None


class HelpKind(Enum):
    """The kinds of help, by the fairness that it rests on."""

    ROBOT = "robot"  #: the robot is ready, and what it runs changes a measure [FAIR-ROBOT]
    EXPECTED = "expected"  #: an assumption promises what would change a measure [FAIR-ASSUME]
    AFTER_RUN = "after a run"  #: both: what the robot runs makes an assumption promise
    TIME = "time"  #: the robot waits for what comes about as rounds pass


class Help(Struct, frozen=True):
    """Robots that help where ``state`` holds of them, as long as no measure changes.

    ``expectation`` is the position of the assumption that it rests on; ``falls`` is a real number
    that gets less as time passes, and is not negative.
    """

    kind: HelpKind
    state: Phrase
    each: core.RobotRange
    expectation: int | None = None
    falls: Phrase | None = None


# --- what lasts -----------------------------------------------------------------------------------


def lasting_of(program: core.Program, stated: core.Property) -> Iterator[list[core.Expr]]:
    """Yield what may last from the trigger until the goal, the simplest first.

    It is the trigger, or one of it and one or two states: of the robot that is meant, or of some.
    """
    trigger, each = stated.trigger, stated.each
    if trigger is None:
        return
    yield [trigger]
    states = _somebodys_states(program) if each is None else _own_states(program, each)
    states = states[:_MOST_STATES]
    yield [binary(BinaryOp.OR, trigger, state) for state in states]
    yield [
        binary(BinaryOp.OR, binary(BinaryOp.OR, trigger, one), other)
        for one, other in combinations(states, 2)
    ]


def _own_states(program: core.Program, each: core.Each) -> list[core.Expr]:
    """The states of the robot that a claim means."""
    me = core.Read(core.Place(each.variable))
    return [
        state
        for kind in range(len(program.agents))
        if each.agent in (None, kind)
        for state in Words(program, kind).plain_states(me)
        if not _names_a_robot(state, me)
    ]


def _somebodys_states(program: core.Program) -> list[core.Expr]:
    """That a robot is in a state."""
    return [
        core.Quantified(core.QuantifierKind.EXISTS, ROBOT, range_of(program, kind), state)
        for kind in range(len(program.agents))
        for state in Words(program, kind).plain_states(READ_ROBOT)
        if not _names_a_robot(state, READ_ROBOT)
    ]


def _names_a_robot(state: core.Expr, robot: core.Expr) -> bool:
    """Return whether a state is that a shared variable is the number of a robot."""
    return isinstance(state, core.Binary) and state.right == robot


# --- measures -------------------------------------------------------------------------------------


def measures_of(program: core.Program, stated: core.Property) -> tuple[Measure, ...]:
    """The candidates for measures of a claim, the simplest first."""
    found = dict.fromkeys(_measures(program, stated))
    return tuple(found)[:_MOST_MEASURES]


def _measures(program: core.Program, stated: core.Property) -> Iterator[Measure]:
    for kind in range(len(program.agents)):
        each = range_of(program, kind)
        if _may_stop(program):
            yield Measure(Phrase(negated(core.Stopped(READ_ROBOT))), each)
        yield from changes(Words(program, kind).plain_states(READ_ROBOT), each)
    if stated.each is not None:
        for kind in range(len(program.agents)):
            if stated.each.agent in (None, kind):
                yield from changes(Words(program, kind).plain_states(READ_MEANT))
    yield from changes(shared_states(program))
    yield from _turns(program, stated)
    for left, right in _compared(program, stated):
        for one, other in ((left, right), (right, left)):
            difference = core.Binary(BinaryOp.SUB, one, other, INT)
            if not _speaks_of_robots(difference):
                yield Measure(Phrase(difference))
                continue
            for kind in range(len(program.agents)):
                yield Measure(Phrase(said_of(difference, ROBOT)), range_of(program, kind))
            if stated.each is not None:
                yield Measure(Phrase(said_of(difference, MEANT)))


def _turns(program: core.Program, stated: core.Property) -> Iterator[Measure]:
    """Yield how far a turn that goes round by the numbers of robots is from who waits for it."""
    for entry in program.allwrite:
        read = core.Read(core.Place(entry.variable))
        if entry.variable.type != INT or not _is_a_turn(program, read):
            continue
        if stated.each is not None:
            yield Measure(Phrase(binary(BinaryOp.LT, READ_MEANT, read)))
            yield Measure(Phrase(binary(BinaryOp.LT, read, READ_MEANT)))
        yield Measure(Phrase(core.Binary(BinaryOp.SUB, core.NumAgents(INT), read, INT)))
        yield Measure(Phrase(read))


def _is_a_turn(program: core.Program, read: core.Expr) -> bool:
    """Return whether a guard asks whether a shared variable is the robot's own number."""
    return any(
        isinstance(node, core.Binary)
        and node.op is BinaryOp.EQ
        and read in (node.left, node.right)
        and any(isinstance(side, core.Pid) for side in (node.left, node.right))
        for node in nodes(_guards(program))
    )


def changes(states: Iterable[core.Expr], each: core.RobotRange | None = None) -> Iterator[Measure]:
    """Yield that something is in a state, and that it is not: either may settle."""
    for state in states:
        for said in both_ways(state):
            yield Measure(Phrase(said), each)


def both_ways(state: core.Expr) -> tuple[core.Expr, core.Expr]:
    """A state, and that it does not hold."""
    return state, negated(state)


def _is_negation(state: core.Expr) -> bool:
    """Return whether a state is the negation of another."""
    return isinstance(state, core.Unary) or (
        isinstance(state, core.Binary) and state.op is BinaryOp.NE
    )


def range_of(program: core.Program, kind: int) -> core.RobotRange:
    """The robots of a kind, or all where there is one kind."""
    return core.RobotRange(kind if len(program.agents) > 1 else None)


class Words(Vocabulary, frozen=True):
    """The atoms of one kind of robots."""

    kind: int = 0

    @property
    def agent(self) -> core.Agent:
        return self.program.agents[self.kind]

    def plain_states(self, robot: core.Expr) -> list[core.Expr]:
        """The atoms on a robot's state that are no negations of others."""
        return [state for state in self.states(robot) if not _is_negation(state)]


def shared_states(program: core.Program) -> Iterator[core.Expr]:
    """Yield the states of shared variables and of elements of arrays."""
    for entry in program.allwrite:
        for place in _elements(core.Place(entry.variable)):
            match place.type:
                case BoolType():
                    yield core.Read(place)
                case EnumType(members=members) as type_:
                    for k in range(len(members)):
                        yield binary(BinaryOp.EQ, core.Read(place), core.Const(k, type_))
                case IntType():
                    for constant in _constants(program):
                        yield binary(BinaryOp.EQ, core.Read(place), constant)
                case _:
                    pass


def _constants(program: core.Program) -> list[core.Expr]:
    """The integers that guards ask for."""
    found: dict[core.Expr, None] = {}
    for node in nodes(_guards(program)):
        if isinstance(node, core.Binary) and node.op in (BinaryOp.EQ, BinaryOp.NE):
            for side in (node.left, node.right):
                if isinstance(side, core.Const | core.Unary) and side.type == INT:
                    found[side] = None
    return list(found)[:2]


def _guards(program: core.Program) -> tuple[core.Expr, ...]:
    return tuple(event.guard for agent in program.agents for event in agent.events)


def _elements(place: core.Place) -> Iterator[core.Place]:
    match place.type:
        case RecordType(fields=parts):
            for k, (name, type_) in enumerate(parts):
                yield from _elements(place.part(core.FieldStep(k, name, type_)))
        case ArrayType(element=element, size=int(size)) if size <= _MOST_ELEMENTS:
            for k in range(size):
                yield from _elements(place.part(core.IndexStep(core.Const(k, INT), element)))
        case _:
            yield place


_COMPARISONS = (BinaryOp.EQ, BinaryOp.NE, BinaryOp.LT, BinaryOp.LE)

#: What counts robots, or asks for answers, is no measure.
_OPEN = core.Choose | core.ExternalCall | core.Quantified | core.ForRange | core.ForEach


def _compared(
    program: core.Program, stated: core.Property
) -> Iterator[tuple[core.Expr, core.Expr]]:
    """Yield pairs of integers, of one robot at most, that the program compares."""
    stated_too = tuple(p.condition for p in program.properties if p.kind not in LIVENESS)
    for node in nodes((_guards(program), stated_too, stated.condition)):
        if not isinstance(node, core.Binary) or node.op not in _COMPARISONS:
            continue
        pair = (node.left, node.right)
        others = {
            part.variable.slot
            for part in nodes(pair)
            if isinstance(part, core.Place) and part.variable.home is Home.BOUND
        }
        asks = any(isinstance(part, _OPEN) for part in reached(program, pair))
        if node.left.type == INT and not asks and len(others) <= 1:
            yield pair


def _speaks_of_robots(e: core.Expr) -> bool:
    return any(
        isinstance(part, core.Pid)
        or (isinstance(part, core.Place) and part.variable.home in _OF_ROBOTS)
        for part in nodes(e)
    )


_OF_ROBOTS = (Home.BOUND, Home.LOCAL, Home.PORT)


def said_of(node: Any, robot: core.Variable) -> Any:
    """An expression of a robot's turn, or with one bound variable, as one about a robot."""
    if isinstance(node, core.Variable):
        return node
    if isinstance(node, core.Pid):
        return core.Read(core.Place(robot))
    if isinstance(node, core.Read) and node.place.variable.home is Home.BOUND:
        return core.Read(core.Place(robot, node.place.steps))
    made = rebuilt(node, lambda part: said_of(part, robot))
    if isinstance(made, core.Place) and made.variable.home in (Home.LOCAL, Home.PORT):
        return replace(made, robot=core.Read(core.Place(robot)))
    return made


# --- help -----------------------------------------------------------------------------------------


def help_of(program: core.Program) -> tuple[Help, ...]:
    """The candidates for help: what assumptions start from, and guards of events."""
    return tuple(_help(program))


def own_help(stated: core.Property, others: Sequence[Help]) -> tuple[Help, ...]:
    """The same help of the robot that a claim means, if it means one, and of no other."""
    if stated.each is None:
        return ()
    is_meant = binary(BinaryOp.EQ, READ_ROBOT, READ_MEANT)
    return tuple(
        replace(each, state=Phrase(binary(BinaryOp.AND, is_meant, each.state.said)))
        for each in others
        if each.kind is HelpKind.ROBOT and stated.each.agent in (None, each.each.agent)
    )


def _help(program: core.Program) -> Iterator[Help]:
    expected = [
        (k, each)
        for k, each in enumerate(program.expectations)
        if each.each is not None and each.each.variable.slot == ROBOT.slot
    ]
    for k, each in expected:
        assert each.each is not None
        assert each.trigger is not None
        where = core.RobotRange(each.each.agent)
        for state in (each.trigger, binary(BinaryOp.AND, each.trigger, negated(each.condition))):
            phrase = Phrase(state, each.bound, each.each.variable.slot, None)
            yield Help(HelpKind.EXPECTED, phrase, where, k)
    for kind, agent in enumerate(program.agents):
        where = range_of(program, kind)
        for event in agent.events:
            if not is_certain(program, event.guard):
                continue
            # No variable is bound in a guard (K301): the robot's slot is free.
            state = said_of(event.guard, ROBOT)
            if _may_stop(program):
                state = binary(BinaryOp.AND, state, negated(core.Stopped(READ_ROBOT)))
            yield Help(HelpKind.ROBOT, Phrase(state), where)
            for k, each in expected:
                assert each.each is not None
                if each.each.agent in (None, where.agent):
                    goal = renamed(each.condition, each.each.variable, ROBOT)
                    waits = binary(BinaryOp.AND, state, negated(goal))
                    yield Help(HelpKind.AFTER_RUN, Phrase(waits, each.bound, meant=None), where, k)


def _may_stop(program: core.Program) -> bool:
    """Return whether robots may stop. [STOP]"""
    return any(isinstance(node, core.Stop | core.TryStop) for node in nodes(program.agents))


def is_certain(program: core.Program, guard: core.Expr) -> bool:
    """Return whether a guard asks for no answer, so that who may run an event can run it."""
    return not any(
        isinstance(node, core.Choose | core.ExternalCall) for node in reached(program, guard)
    )


# --- lemmas ---------------------------------------------------------------------------------------


def lemmas_of(program: core.Program) -> Iterator[core.Property]:
    """Yield candidates for lemmas: who stopped found the conditions under which robots stop."""
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            for conditions in _ways_to_stop(event.effect, ()):
                for condition in conditions:
                    stopped = core.Stopped(READ_ROBOT)
                    said = binary(BinaryOp.IMPLIES, stopped, said_of(condition, ROBOT))
                    each = core.Quantified(
                        core.QuantifierKind.FORALL, ROBOT, range_of(program, kind), said
                    )
                    yield core.Property("", core.PropertyKind.INVARIANT, each, 1)


def _ways_to_stop(
    block: core.Block, conditions: tuple[core.Expr, ...]
) -> Iterator[tuple[core.Expr, ...]]:
    """Yield the conditions under which each ``stop`` of a block is reached, as far as ifs say."""
    for statement in block:
        match statement:
            case core.Stop():
                yield conditions
            case core.If(condition=condition, then=then, otherwise=otherwise):
                yield from _ways_to_stop(then, (*conditions, condition))
                yield from _ways_to_stop(otherwise, (*conditions, negated(condition)))
            case core.Atomic(body=body):
                yield from _ways_to_stop(body, conditions)
            case _:
                pass
