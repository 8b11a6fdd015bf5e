"""Conjuncts of a property, and the places that each of them reads. [PROP-READ]

A part is a conjunct, or an instance of a quantifier over robots: the property holds if and only if
all of its parts do, and a part can change only if a place changes that it reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias, TypeVar

from msgspec import Struct, field

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant, Domain
from koord.semantics.expressions import statement
from koord.semantics.oracle import NoOracle, Oracle
from koord.semantics.statements import machine
from koord.semantics.storage import Storage, Tree, held
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind, slot_in
from koord.syntax.system import System
from koord.syntax.walk import nodes

#: A property of more parts is looked at as a whole.
_MOST_PARTS = 10_000

#: For all entries of an allread variable, or for what belongs to no robot.
_ALL = -1

Place: TypeAlias = tuple[Home | None, int, int]
"""A place of a configuration: home, slot, robot or entry. No home: how a robot's turn went."""


class Conjunct(Struct, frozen=True):
    """A conjunct of a property, for given robots, and the places that it reads.

    ``robots`` are by bound slot. Of places that are not known beforehand, such as ``x[y@i]``, it
    has every one that they may be.
    """

    condition: core.Expr
    robots: dict[int, int]
    trail: tuple[int, ...]
    places: frozenset[Place]


def conjuncts_of(system: System, condition: core.Expr) -> list[Conjunct]:
    """Split a property into conjuncts; itself alone where they are too many."""
    splitting = _Splitting(system)
    if _count(system, condition) > _MOST_PARTS:
        return [splitting.part(condition, {}, ())]
    return list(splitting.split(condition, {}, ()))


def _count(system: System, e: core.Expr) -> int:
    match e:
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            return _count(system, left) + _count(system, right)
        case core.Quantified(quantifier=QuantifierKind.FORALL, domain=core.RobotRange()):
            return system.robots * _count(system, e.body)
        case _:
            return 1


# --- what changes ---------------------------------------------------------------------------------


def changed(before: Configuration[Constant], after: Configuration[Constant]) -> Iterator[Place]:
    """The places whose values differ between two configurations."""
    for slot, (old, new) in enumerate(_pairs(before.store.allread, after.store.allread)):
        if old is new:
            continue
        assert isinstance(old, Tree)
        assert isinstance(new, Tree)
        for entry, (its_old, its_new) in enumerate(_pairs(old.parts, new.parts)):
            if _differ(its_old, its_new):
                yield Home.ALLREAD, slot, entry
                yield Home.ALLREAD, slot, _ALL
    for slot, (old, new) in enumerate(_pairs(before.store.allwrite, after.store.allwrite)):
        if _differ(old, new):
            yield Home.ALLWRITE, slot, _ALL
    for robot, (was, now) in enumerate(_pairs(before.robots, after.robots)):
        if was is now:
            continue
        for home, olds, news in (
            (Home.LOCAL, was.locals, now.locals),
            (Home.PORT, was.ports, now.ports),
        ):
            if olds is not news:
                for slot, (old, new) in enumerate(_pairs(olds, news)):
                    if _differ(old, new):
                        yield home, slot, robot
        if (was.status, was.ran) != (now.status, now.ran):
            yield None, 0, robot


T = TypeVar("T")


def _pairs(before: Sequence[T], after: Sequence[T]) -> Iterator[tuple[T, T]]:
    return zip(before, after, strict=True)


def _differ(old: Storage[Constant], new: Storage[Constant]) -> bool:
    return old is not new and old != new


# --- what is read ---------------------------------------------------------------------------------


class _Read(Struct, frozen=True):
    """A place that a statement reads, as in the text; ``index`` gives the robot or entry."""

    home: Home | None
    variable: core.Variable | None
    index: core.Expr | None
    called: bool  #: in a function, where a bound slot stands for something else


class _Splitting(Struct):
    """A splitter of properties; a statement's reads are computed once for all of its instances."""

    system: System
    _reads: dict[int, tuple[core.Expr, list[_Read], frozenset[int]]] = field(default_factory=dict)

    def split(
        self, e: core.Expr, robots: dict[int, int], trail: tuple[int, ...]
    ) -> Iterator[Conjunct]:
        """Split a statement into parts: it holds if and only if all of them do.
        [E-SHORT] [E-QUANT]
        """
        match e:
            case core.Binary(op=BinaryOp.AND, left=left, right=right):
                yield from self.split(left, robots, trail)
                yield from self.split(right, robots, trail)
            case core.Quantified(
                quantifier=QuantifierKind.FORALL, domain=core.RobotRange(agent=agent)
            ):
                for robot, kind in enumerate(self.system.kinds):
                    if agent is None or kind == agent:
                        bound = {**robots, e.variable.slot: robot}
                        yield from self.split(e.body, bound, (*trail, robot))
            case _:
                yield self.part(e, robots, trail)

    def part(self, e: core.Expr, robots: dict[int, int], trail: tuple[int, ...]) -> Conjunct:
        found = self._reads.get(id(e))
        if found is None:
            # Under a quantifier of its own a slot may stand for another robot.
            inner = {node.variable.slot for node in nodes(e) if isinstance(node, core.Quantified)}
            found = self._reads[id(e)] = (e, list(self._read_by(e)), frozenset(inner))
        _, reads, inner_slots = found
        fixed = {slot: robot for slot, robot in robots.items() if slot not in inner_slots}
        places = frozenset(place for read in reads for place in self._places(read, fixed))
        return Conjunct(e, robots, trail, places)

    def _read_by(self, e: core.Expr) -> Iterator[_Read]:
        own = ((node, False) for node in nodes(e))
        below = ((node, True) for node in called(self.system, e))
        for node, is_called in (*own, *below):
            match node:
                case core.Place(variable=core.Variable(home=Home.ALLREAD) as variable, steps=steps):
                    first = steps[0] if steps else None
                    index = first.index if isinstance(first, core.IndexStep) else None
                    yield _Read(Home.ALLREAD, variable, index, is_called)
                case core.Place(variable=variable) if variable.home is not Home.BOUND:
                    yield _Read(variable.home, variable, node.robot, is_called)
                case core.Ran(robot=index) | core.Stopped(robot=index):
                    yield _Read(None, None, index, is_called)
                case _:
                    pass

    def _places(self, read: _Read, fixed: dict[int, int]) -> Iterator[Place]:
        """The places that a read may be of, for robots that are known."""
        which = self._named(read.index, {} if read.called else fixed)
        every = range(self.system.robots) if which is None else (which,)
        match read.home:
            case Home.ALLREAD:
                assert read.variable is not None
                yield Home.ALLREAD, read.variable.slot, _ALL if which is None else which
            case Home.ALLWRITE:
                assert read.variable is not None
                yield Home.ALLWRITE, read.variable.slot, _ALL
            case Home.LOCAL | Home.PORT as home:
                assert read.variable is not None
                for robot in every:
                    slot = slot_in(self.system.agent(robot), read.variable)
                    if slot is not None:
                        yield home, slot, robot
            case _:
                for robot in every:
                    yield None, 0, robot

    def _named(self, index: core.Expr | None, fixed: dict[int, int]) -> int | None:
        """The robot that an index names, where that is known statically."""
        match index:
            case core.Const(value=int(value)) if value in range(self.system.robots):
                return value
            case core.Read(place=core.Place(variable=variable, steps=())) if (
                variable.home is Home.BOUND
            ):
                return fixed.get(variable.slot)
            case _:
                return None


def called(system: System, part: object) -> Iterator[object]:
    """The nodes of the functions and summaries that a part of a program calls."""
    for node in nodes(part):
        match node:
            case core.Call(function=name):
                body = system.program.function(name).body
                yield from nodes(body)
                yield from called(system, body)
            case core.ExternalCall(function=name):
                external = system.program.external(name)
                yield from nodes((external.requires, external.ensures))
            case _:
                pass


# --- parts that no run can change ----------------------------------------------------------------


def false_beforehand(
    d: Domain[Constant], system: System, configuration: Configuration[Constant]
) -> core.Expr | None:
    """A conjunct of an assumption that is false for every start, as of ``numAgents`` or a param."""
    for assumption in system.program.assumptions:
        for part in conjuncts_of(system, assumption.condition):
            if part.places or _asks(system, part):
                continue
            oracle: Oracle[Constant] = NoOracle()
            m = machine(d, system, oracle, bound=assumption.bound, view=configuration)
            for slot, robot in part.robots.items():
                m.memory.bound[slot] = held(d, robot)
            if statement(m, part.condition) is not True:
                return part.condition
    return None


def _asks(system: System, part: Conjunct) -> bool:
    return any(
        isinstance(node, core.Choose | core.ExternalCall)
        for node in (*nodes(part.condition), *called(system, part.condition))
    )
