"""Definedness analysis: expressions and statements that surely cannot fault. [SYMMETRY]"""

from __future__ import annotations

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, Start, slot_in
from koord.syntax.system import System
from koord.syntax.types import ArrayType, RecordType, Robots, Type
from koord.syntax.walk import operands


class Sure(Struct, frozen=True):
    """The context of an expression for the definedness analysis.

    ``filled`` are the slots of bound variables that hold a value; ``robots`` those that range over
    robots, with the kind (None: any); ``within`` those that range over the indices of a place.
    ``bounds`` are those that range from 0 to a number, with that number. ``kind`` is the robot's
    own, None in a statement about configurations. ``initialized`` are the slots of ``allwrite``
    variables that INIT sets, in all parts, if it ends at all.
    """

    system: System
    kind: int | None
    in_init: bool = False
    filled: frozenset[int] = frozenset()
    robots: dict[int, int | None] = field(default_factory=dict)
    within: dict[int, core.Expr] = field(default_factory=dict)
    bounds: dict[int, int] = field(default_factory=dict)
    initialized: frozenset[int] = frozenset()

    def with_bound(self, slot: int, size: int) -> Sure:
        """The context in which a bound variable ranges from 0 to a number."""
        return replace(self, filled=self.filled | {slot}, bounds={**self.bounds, slot: size})

    def with_robot(self, slot: int, kind: int | None) -> Sure:
        """The context in which a bound variable ranges over robots."""
        return replace(self, filled=self.filled | {slot}, robots={**self.robots, slot: kind})

    def with_index(self, slot: int, of: core.Expr) -> Sure:
        """The context in which a bound variable ranges over the indices of a list."""
        return replace(self, filled=self.filled | {slot}, within={**self.within, slot: of})

    def with_value(self, slot: int) -> Sure:
        """The context in which a bound variable holds some value."""
        return replace(self, filled=self.filled | {slot})

    def in_range(self, slot: int, low: core.Expr, high: core.Expr) -> Sure:
        """The context inside a loop over a range."""
        match low, high:
            case core.Const(value=0), core.NumAgents():
                return self.with_robot(slot, None)
            case _:
                return self.with_value(slot)

    def of_statement(self, s: core.Stmt) -> bool:
        """Return whether a statement itself cannot fault, apart from those in it."""
        match s:
            case core.Assign(place=place, value=value):
                return self.of(value) and self._may_write(place)
            case core.Append(place=place, value=value) | core.Remove(place=place, value=value):
                return self.of(value) and self._place(place)
            case core.Pop():
                return False
            case core.Return():
                raise AssertionError("only functions return")
            case _:
                return all(self.of(e) for e in operands(s) if not isinstance(e, core.Place))

    def of(self, e: core.Expr) -> bool:
        """Return whether an expression cannot fault."""
        match e:
            case core.Const() | core.Pid() | core.NumAgents() | core.Delta():
                return True
            case core.Read(place=place):
                return self._place(place)
            case core.Unary(operand=operand):
                return self.of(operand)
            case core.Binary(op=op, left=left, right=right):
                divides = op in (BinaryOp.DIV, BinaryOp.MOD)
                safe = not divides or (isinstance(right, core.Const) and bool(right.value))
                return safe and self.of(left) and self.of(right)
            case core.Builtin(op=op, arguments=arguments):
                return op not in (ListOp.MIN, ListOp.MAX) and all(map(self.of, arguments))
            case core.MakeList(items=parts) | core.MakeRecord(fields=parts):
                return all(map(self.of, parts))
            case core.Select(base=base, step=core.FieldStep()):
                return self.of(base)
            case core.MakeMap(entries=entries):
                return all(self.of(key) and self.of(value) for key, value in entries)
            case core.Quantified():
                return self._quantified(e)
            case core.Ran(robot=robot) | core.Stopped(robot=robot):
                return self.of(robot)
            case core.ExternalCall(function=name, arguments=arguments):
                function = self.system.program.external(name)
                return not function.requires and all(map(self.of, arguments))
            case _:
                return False

    def _quantified(self, e: core.Quantified) -> bool:
        slot = e.variable.slot
        match e.domain:
            case core.RobotRange(agent=kind):
                return self.with_robot(slot, kind).of(e.body)
            case core.IntRange(low=low, high=high):
                of = indices(low, high)
                inner = self.with_value(slot) if of is None else self.with_index(slot, of)
                return self.of(low) and self.of(high) and inner.of(e.body)
            case core.Elements(sequence=over):
                return self.of(over) and self.with_value(slot).of(e.body)
            case core.AllValues():
                return self.with_value(slot).of(e.body)

    # --- places ---------------------------------------------------------------------------------

    def _may_write(self, place: core.Place) -> bool:
        """Return whether the place surely exists for writing. [S-ASSIGN]"""
        own_entry = (
            place.variable.home is Home.ALLREAD
            and len(place.steps) == 1
            and isinstance(place.steps[0], core.IndexStep)
            and isinstance(place.steps[0].index, core.Pid)
        )
        if not place.steps or own_entry:
            return True
        match place.steps[-1]:
            case core.KeyStep(key=key):  # an entry that is not there is made
                return self.of(key) and self._place(replace(place, steps=place.steps[:-1]))
            case _:
                return self._place(place)

    def _place(self, place: core.Place) -> bool:
        return self._is_set(place) and self._is_there(place)

    def _is_set(self, place: core.Place) -> bool:
        """Return whether the variable is surely set, in all its parts, whenever it is read here."""
        variable = place.variable
        program = self.system.program
        match variable.home:
            case Home.BOUND:
                return variable.slot in self.filled
            case Home.ALLWRITE:
                if variable.slot in self.initialized and not self.in_init:
                    return True
                return _is_whole(program.allwrite[variable.slot], variable.type)
            case Home.ALLREAD:
                assert isinstance(variable.type, ArrayType)
                entry = program.allread[variable.slot]
                return not self.in_init and _is_whole(entry, variable.type.element)
            case Home.LOCAL | Home.PORT:
                return all(self._is_set_in(kind, variable) for kind in self._kinds(place))

    def _kinds(self, place: core.Place) -> list[int]:
        """The kinds of robots whose variable may be meant."""
        if self.kind is not None:
            return [self.kind]
        match place.robot:
            case core.Read(place=core.Place(variable=core.Variable(home=Home.BOUND, slot=slot))):
                kind = self.robots.get(slot)
                if kind is not None:
                    return [kind]
        return sorted(set(self.system.kinds))

    def _is_set_in(self, kind: int, variable: core.Variable) -> bool:
        agent = self.system.program.agents[kind]
        slot = slot_in(agent, variable)
        if slot is None:
            return False
        if variable.home is Home.LOCAL:
            return _is_whole(agent.locals[slot], variable.type)
        return _is_whole(agent.ports[slot].declaration, variable.type)

    def _is_there(self, place: core.Place) -> bool:
        """Return whether the steps of a place surely exist, and ``v@i`` names a robot."""
        if place.robot is not None and not self._is_robot(place.robot):
            return False
        type_: Type = place.variable.type
        for position, step in enumerate(place.steps):
            match step:
                case core.FieldStep():
                    pass
                case core.IndexStep(index=index):
                    before = replace(place, steps=place.steps[:position])
                    if not self._is_index(index, type_, core.Read(before)):
                        return False
                case core.KeyStep():
                    return False
            type_ = step.type
        return True

    def _is_robot(self, e: core.Expr) -> bool:
        match e:
            case core.Pid():
                return True
            case core.Read(place=core.Place(variable=core.Variable(home=Home.BOUND, slot=slot))):
                return slot in self.robots
            case _:
                return False

    def _is_index(self, index: core.Expr, type_: Type, of: core.Expr) -> bool:
        if isinstance(type_, ArrayType) and type_.size is Robots.ALL and self._is_robot(index):
            return True
        match index:
            case core.Const(value=int(value)):
                size = type_.size if isinstance(type_, ArrayType) else None
                return isinstance(size, int) and 0 <= value < size
            case core.Read(place=core.Place(variable=core.Variable(home=Home.BOUND, slot=slot))):
                size = type_.size if isinstance(type_, ArrayType) else None
                if isinstance(size, int) and self.bounds.get(slot, size + 1) <= size:
                    return True
                return self.within.get(slot) == of
            case _:
                return False


def size_of(low: core.Expr, high: core.Expr) -> int | None:
    """The number of a range from 0 to a constant, if it is one."""
    match low, high:
        case core.Const(value=0), core.Const(value=int(size)) if size > 0:
            return size
        case _:
            return None


def indices(low: core.Expr, high: core.Expr) -> core.Expr | None:
    """The list whose indices a range ``[low, high)`` covers, if it is one."""
    if isinstance(low, core.Const) and low.value == 0:
        match high:
            case core.Builtin(op=ListOp.LENGTH, arguments=(of,)):
                return of
            case _:
                pass
    return None


def _is_whole(entry: core.Declaration, type_: Type) -> bool:
    """Return whether a variable starts set, in all its parts."""
    if entry.initial is Start.UNSET:
        return False
    return entry.initial is Start.ARBITRARY or _fills(entry.initial, type_)


def _fills(initial: core.Expr, type_: Type) -> bool:
    """Return whether an initial value has all elements of its arrays."""
    if not _has_array(type_):
        return True
    if isinstance(type_, ArrayType) and isinstance(initial, core.MakeList):
        return len(initial.items) == type_.size and not _has_array(type_.element)
    return False


def _has_array(type_: Type) -> bool:
    own = type_.parts if isinstance(type_, RecordType) else ()
    return isinstance(type_, ArrayType) or any(map(_has_array, own))
