"""Claims as code: loops over robots that look at what has changed. [PROP-INVARIANT] [E-QUANT]

A claim is split at ``and``, at quantifiers over all robots, and behind ``implies``. Each part is a
function for all robots, and one for each of its quantifiers with the robot given: after a step
only those instances are looked at that read what the step changed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from math import lcm
from typing import Protocol

from msgspec import Struct

from koord.sampling.compiled.columns import Column, Columns, Watcher
from koord.sampling.compiled.expressions import Names, NoCodeError, Writer
from koord.sampling.compiled.operations import InDoubt
from koord.sampling.compiled.statements import INDENT, call_text
from koord.semantics.domain import EXACT, Constant, Domain
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind
from koord.syntax.system import Status, System
from koord.syntax.types import INT, FloatType, Type
from koord.syntax.walk import chained, nodes

#: A larger unit saves nothing: numbers counted in it are longer than machine words.
_LARGEST_UNIT = 10**9

#: So often the reference is asked where code is in doubt, before it is asked at once.
_MOST_DOUBTS = 100


class Part(Struct, eq=False):
    """A part of a claim: for all robots, and for one at a time, by position of the quantifier."""

    watcher: Watcher
    kinds: tuple[frozenset[int], ...]
    of_all: Callable[[], bool]
    of_one: tuple[Callable[[int], bool], ...]

    def holds(self) -> bool:
        """Return whether the part holds, by what has changed since it last did."""
        watcher = self.watcher
        if not watcher.is_stale:
            return True
        if not self._instances_hold():
            return False
        watcher.settle()
        return True

    def _instances_hold(self) -> bool:
        touched = self.watcher.touched
        if self.watcher.everything or sum(map(len, touched)) > len(self.kinds[0]):
            return self.of_all()
        return all(
            of_one(robot)
            for robots, kind, of_one in zip(touched, self.kinds, self.of_one, strict=True)
            for robot in robots
            if robot in kind
        )


class Claim:
    """A claim as code, as far as there is code for it.

    Where floats are no whole numbers of a unit they are fractions; where the reference semantics
    was needed too often it is asked at once.
    """

    def __init__(self, columns: Columns, condition: core.Expr) -> None:
        self._condition = condition
        self._columns = columns
        self._unit = unit_of(columns.d, columns.system, condition)
        self._doubts = 0
        self._parts = self._made()

    def _made(self) -> list[Part] | None:
        columns = self._columns
        for unit in (self._unit, None) if self._unit is not None else (None,):
            self._unit = unit
            try:
                splitting = Splitting(columns, Names(columns.d, columns.system), unit=unit)
                return splitting.parts(self._condition)
            except NoCodeError:
                continue
        return None

    def holds(self) -> bool | None:
        """Return whether the claim holds in the configuration that the columns show.

        None where only the reference semantics can tell.
        """
        if self._parts is None:
            return None
        try:
            return all(part.holds() for part in self._parts)
        except (InDoubt, ArithmeticError):
            self._doubts += 1
            if self._unit is not None:
                self._unit = None
                self._parts = self._made()
            elif self._doubts > _MOST_DOUBTS:
                self._parts = None
            return None


def unit_of(d: Domain[Constant], system: System, part: object) -> int | None:
    """A unit of which all constant floats of a part are whole numbers, where floats are exact."""
    if d is not EXACT:
        return None
    found = [
        Fraction(node.value) if isinstance(node, core.Const) else system.delta_s
        for node in nodes(part)
        if isinstance(node, core.Const | core.Delta) and isinstance(node.type, FloatType)
    ]
    unit = lcm(system.delta_s.denominator, *(number.denominator for number in found))
    return unit if unit <= _LARGEST_UNIT else None


class _Shape(Struct, frozen=True):
    """A part as text: quantified variables with their kinds, conditions, and what then holds."""

    variables: tuple[tuple[str, int | None], ...]
    conditions: tuple[str, ...]
    body: str
    reads: frozenset[tuple[str, str | None]]


class WrittenPart(Struct, frozen=True):
    """A part whose functions are known by their names.

    ``axes`` are as in :class:`Watcher`, ``kinds`` as in :class:`Part`.
    """

    axes: dict[str, frozenset[int] | None]
    kinds: tuple[frozenset[int], ...]
    of_all: str
    of_one: tuple[str, ...]


class Holding(Protocol):
    """Columns of variables."""

    @property
    def d(self) -> Domain[Constant]:
        """The numbers that they hold."""

    @property
    def system(self) -> System:
        """The system whose variables they are."""

    def of(self, variable: core.Variable, unit: int | None) -> Column:
        """The column of a variable. Raises NoCodeError."""

    def of_turns(self, what: str, type_: Type) -> Column:
        """The column of the robots' ``ran`` or ``status``."""


class Splitting(Writer):
    """A writer of claims. Where it does not spend, whoever calls the code does."""

    def __init__(
        self,
        columns: Holding,
        names: Names,
        *,
        unit: int | None,
        short: bool = False,
        spends: bool = True,
    ) -> None:
        super().__init__(names, unit=unit, short=short)
        self.columns = columns
        self.reads: set[tuple[str, str | None]] = set()
        self.watched: dict[str, list[Watcher]] = {}
        self.spends = spends
        names.values["spend"] = columns.system.budget.spend

    def parts(self, condition: core.Expr) -> list[Part]:
        """The parts of a claim. Raises NoCodeError."""
        return [self._part(written) for written in self.written(condition)]

    def written(self, condition: core.Expr) -> list[WrittenPart]:
        """The parts of a claim, whose texts are among those of the names. Raises NoCodeError."""
        return [self._written(shape) for shape in list(self._split(condition, (), ()))]

    # --- places ----------------------------------------------------------------------------------

    def read(self, place: core.Place) -> str:
        """A variable of a robot, or a shared one. [PROP-READ]"""
        if place.primed:
            raise NoCodeError("a claim is about one configuration")
        variable, steps = place.variable, place.steps
        unit = self.unit if isinstance(variable.own_type, FloatType) else None
        column = self._column(variable, unit)
        match variable.home:
            case Home.ALLWRITE:
                self.reads.add((column, None))
                text = f"{column}[0]"
            case Home.ALLREAD if not steps:
                self.uncounted(variable.type)
                self.reads.add((column, None))
                return f"gathered({column})"
            case Home.ALLREAD:
                first, *others = steps
                assert isinstance(first, core.IndexStep)
                steps = tuple(others)
                text = self._at(column, first.index)
            case _:
                assert place.robot is not None
                text = self._at(column, place.robot)
        return self.below(f"sure({text})", steps) if steps else text

    def _column(self, variable: core.Variable, unit: int | None) -> str:
        column = self.columns.of(variable, unit)
        self.names.values[column.name] = column.values
        self.watched[column.name] = column.watchers
        return column.name

    def _at(self, column: str, index: core.Expr) -> str:
        text = self.expression(index)
        if text in self.robots:
            self.reads.add((column, text))
            return f"{column}[{text}]"
        self.reads.add((column, None))
        return f"pick({column}, {text})"

    def ran(self, e: core.Ran) -> str:
        """Whether a robot ran one of these events. [PROP-RAN]"""
        kinds = self.names.new("k", self.names.system.kinds)
        events = self.names.new("k", frozenset(e.events))
        index, ran = self._turn("ran", e.robot)
        return f"(({kinds}[{index}], {ran}) in {events})"

    def stopped(self, e: core.Stopped) -> str:
        """Whether a robot has stopped. [PROP-STOPPED]"""
        _, status = self._turn("status", e.robot)
        return f"({status} == {int(Status.STOPPED)})"

    def _turn(self, what: str, robot: core.Expr) -> tuple[str, str]:
        index = self.expression(robot)
        if index not in self.robots:
            raise NoCodeError("a robot is named by a number")
        column = self.columns.of_turns(what, INT)
        self.names.values[column.name] = column.values
        self.watched[column.name] = column.watchers
        self.reads.add((column.name, index))
        return index, f"{column.name}[{index}]"

    def call(self, e: core.Call) -> str:
        # A function that asks is in doubt at once.
        return call_text(self, e, "UNSET, UNSET", [])

    # --- parts -----------------------------------------------------------------------------------

    def _split(
        self,
        e: core.Expr,
        variables: tuple[tuple[str, int | None], ...],
        conditions: tuple[str, ...],
        reads: frozenset[tuple[str, str | None]] = frozenset(),
    ) -> Iterator[_Shape]:
        """The parts of a statement: it holds if and only if all of them do. [E-SHORT] [E-QUANT]"""
        match e:
            case core.Binary(op=BinaryOp.AND, left=left, right=right):
                yield from self._split(left, variables, conditions, reads)
                yield from self._split(right, variables, conditions, reads)
            case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
                self.reads = set(reads)
                told = tuple(self.expression(one) for one in chained(left, BinaryOp.AND))
                known = frozenset(self.reads)
                yield from self._split(right, variables, (*conditions, *told), known)
            case core.Quantified(
                quantifier=QuantifierKind.FORALL, domain=core.RobotRange(agent=agent)
            ):
                with self.binding(e.variable, is_robot=True) as name:
                    bound = (*variables, (name, agent))
                    yield from self._split(e.body, bound, conditions, reads)
            case _:
                self.reads = set(reads)
                body = self.expression(e)
                yield _Shape(variables, conditions, body, frozenset(self.reads))

    def _part(self, written: WrittenPart) -> Part:
        watcher = Watcher(written.axes, [set() for _ in written.kinds])
        for column in written.axes:
            self.watched[column].append(watcher)
        of_one = tuple(map(self.names.made, written.of_one))
        return Part(watcher, written.kinds, self.names.made(written.of_all), of_one)

    def _written(self, shape: _Shape) -> WrittenPart:
        position = {name: at for at, (name, _) in enumerate(shape.variables)}
        axes: dict[str, frozenset[int] | None] = {}
        for column, name in shape.reads:
            known = axes.get(column, frozenset())
            if name is None or name not in position or known is None:
                axes[column] = None
            else:
                axes[column] = known | {position[name]}
        kinds = self.names.system.kinds
        members = tuple(
            frozenset(i for i, kind in enumerate(kinds) if agent is None or agent == kind)
            for _, agent in shape.variables
        )
        of_one = tuple(self._function(shape, name) for name, _ in shape.variables)
        return WrittenPart(axes, members, self._function(shape, None), of_one)

    def _function(self, shape: _Shape, given: str | None) -> str:
        """A function of no robot, or of the one given, that says whether the part holds."""
        name = self.names.new("part")
        lines = [f"def {name}({given or ''}):"]
        if self.spends:
            lines.append(f"{INDENT}spend()")
        indent = INDENT
        free = [(one, agent) for one, agent in shape.variables if one != given]
        unknown = {one for one, _ in free}
        waiting = list(shape.conditions)
        for one, agent in [("", None), *free]:
            if one:
                lines.append(f"{indent}for {one} in {self.of_kind(agent)}:")
                indent += INDENT
                unknown.discard(one)
            # A condition is looked at as soon as its variables are known, so not again and again.
            known = [text for text in waiting if not unknown.intersection(_words(text))]
            waiting = [text for text in waiting if text not in known]
            if known:
                lines.append(f"{indent}if {' and '.join(known)}:")
                indent += INDENT
        lines += [f"{indent}if not {shape.body}:", f"{indent}{INDENT}return False"]
        self.names.texts += [*lines, f"{INDENT}return True"]
        return name


def _words(text: str) -> list[str]:
    return re.findall(r"\w+", text)
