"""Which integers of a program may be compared: numbers of robots, indices, tickets.

Integers that are assigned to one another or compared are of one *kind*, and so are counters that
are compared with the same number. This is a guess that keeps the statements few that are tried;
nothing rests on it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import ArrayType, IntType, Robots
from koord.syntax.walk import children

#: The kind of the numbers of robots.
ROBOT = "robot"

_ORDERS = frozenset({BinaryOp.LT, BinaryOp.LE})
_BOUNDS = frozenset({BinaryOp.MIN, BinaryOp.MAX})
_SUMS = frozenset({BinaryOp.ADD, BinaryOp.SUB}) | _BOUNDS


class KindsOfIntegers(Struct):
    """The kinds of a program's integers, by union of those that meet.

    ``ordered`` are kinds whose integers are compared by size or counted with; ``constants`` are
    those that are met.
    """

    _above: dict[Hashable, Hashable] = field(default_factory=dict)
    _ordered: set[Hashable] = field(default_factory=set)
    _constants: dict[int, Hashable] = field(default_factory=dict)
    _met: list[tuple[Hashable, int]] = field(default_factory=list)

    @staticmethod
    def of(program: core.Program) -> KindsOfIntegers:
        """Look at everything that a program says, its properties included."""
        found = KindsOfIntegers()
        for number, agent in enumerate(program.agents):
            found._look(agent.init, ("init", number), number)
            for position, event in enumerate(agent.events):
                scope = ("event", number, position)
                found._look((event.guard, event.effect), scope, number)
            for position, module in enumerate(agent.modules):
                found._look(module.environment, ("environment", number, position), number)
            for declaration in (*agent.locals, *(port.declaration for port in agent.ports)):
                found._start(declaration, number)
        for declaration in (*program.allread, *program.allwrite):
            found._start(declaration, 0)
        for function in program.functions:
            found._look(function.body, ("function", function.name), 0)
        for position, stated in enumerate(program.properties):
            found._look(stated.condition, ("property", position), 0)
        found._join_bounded_alike()
        return found

    def kind(self, key: Hashable) -> Hashable:
        """The kind of a variable or part of one."""
        while key in self._above:
            key = self._above[key]
        return key

    def is_ordered(self, kind: Hashable) -> bool:
        return any(self.kind(key) == kind for key in self._ordered)

    def constants(self, kind: Hashable) -> list[int]:
        """The constants that integers of a kind meet, each once."""
        return list(dict.fromkeys(value for key, value in self._met if self.kind(key) == kind))

    # --- meeting --------------------------------------------------------------------------------

    def _join(self, *keys: Hashable) -> None:
        kinds = [self.kind(key) for key in keys]
        for kind in kinds[1:]:
            if self.kind(kind) != self.kind(kinds[0]):
                self._above[self.kind(kind)] = self.kind(kinds[0])

    def _join_bounded_alike(self) -> None:
        """Join kinds that are counted with and meet the same number, other than 0, 1 or -1."""
        by_constant: dict[int, list[Hashable]] = {}
        for key, value in self._met:
            if abs(value) > 1 and self.is_ordered(self.kind(key)):
                by_constant.setdefault(value, []).append(key)
        for keys in by_constant.values():
            self._join(*keys)

    def _meet(self, *sides: list[Hashable]) -> None:
        """Integers of expressions meet; constants are noted with what they meet."""
        keys = [key for side in sides for key in side if not isinstance(key, int)]
        if not keys:
            return
        self._join(*keys)
        for side in sides:
            self._met += [(keys[0], key) for key in side if isinstance(key, int)]

    def _start(self, declaration: core.Declaration, agent: int) -> None:
        if isinstance(declaration.initial, core.Const):
            place = core.Place(declaration.variable)
            key = self._key(place, ("start",), agent)
            value = declaration.initial.value
            if isinstance(declaration.initial.type, IntType) and isinstance(value, int):
                self._meet([key], [value])

    def _look(self, node: object, scope: Hashable, agent: int) -> None:
        match node:
            case core.Choose():
                # The bounds of a choice are no order of what is chosen.
                return
            case core.Binary(op=op, left=left, right=right):
                sides = [self._integers(side, scope, agent) for side in (left, right)]
                if op in _ORDERS | _SUMS | {BinaryOp.EQ, BinaryOp.NE}:
                    # What an integer is bounded by is one that it meets; what is added is not.
                    adds = op in _SUMS - _BOUNDS
                    self._meet(*([_named(s) for s in sides] if adds else sides))
                if op in _ORDERS | _SUMS:
                    self._ordered.update(key for side in sides for key in _named(side))
            case core.Assign(place=place, value=value):
                self._meet([self._key(place, scope, agent)], self._integers(value, scope, agent))
            case core.ForRange(variable=variable, low=low, high=high):
                self._bound(variable, low, high, scope, agent)
            case core.Quantified(variable=variable, domain=core.RobotRange()):
                self._join((scope, variable.slot), ROBOT)
            case core.Quantified(variable=variable, domain=core.IntRange(low=low, high=high)):
                self._bound(variable, low, high, scope, agent)
            case core.Return(value=value) if value is not None:
                self._meet([("result", scope)], self._integers(value, scope, agent))
            case core.Call(function=name, arguments=arguments):
                for slot, argument in enumerate(arguments):
                    key = (("function", name), slot)
                    self._meet([key], _named(self._integers(argument, scope, agent)))
            case core.Place(variable=variable, steps=steps):
                type_ = variable.type
                for step in steps:
                    if isinstance(step, core.IndexStep) and isinstance(type_, ArrayType):
                        indexes = ROBOT if type_.size is Robots.ALL else ("below", type_.size)
                        self._meet([indexes], _named(self._integers(step.index, scope, agent)))
                    type_ = step.type
                if node.robot is not None:
                    self._meet([ROBOT], _named(self._integers(node.robot, scope, agent)))
        for part in children(node):
            self._look(part, scope, agent)

    def _bound(
        self, variable: core.Variable, low: core.Expr, high: core.Expr, scope: Hashable, agent: int
    ) -> None:
        key = (scope, variable.slot)
        if isinstance(high, core.Const):
            self._join(key, ("below", high.value))
        self._join(key, *_named(self._integers(high, scope, agent)))
        self._join(key, *_named(self._integers(low, scope, agent)))

    # --- where integers come from ---------------------------------------------------------------

    def _integers(self, e: object, scope: Hashable, agent: int) -> list[Hashable]:
        """Where an integer comes from; constants as they are."""
        return list(self._sources(e, scope, agent))

    def _sources(self, e: object, scope: Hashable, agent: int) -> Iterator[Hashable]:
        match e:
            case core.Const(value=value, type=IntType()) if isinstance(value, int):
                yield value
            case core.Unary(op=UnaryOp.NEG, operand=core.Const(value=int(value))):
                yield -value
            case core.Pid() | core.NumAgents():
                yield ROBOT
            case core.Read(place=place) if isinstance(place.type, IntType):
                yield self._key(place, scope, agent)
            case core.Binary(op=op, left=left, right=right) if op in _SUMS:
                for side in (left, right):
                    yield from _named(self._integers(side, scope, agent))
            case core.Call(function=name, type=IntType()):
                yield ("result", ("function", name))

    def _key(self, place: core.Place, scope: Hashable, agent: int) -> Hashable:
        variable = place.variable
        if variable.home is Home.BOUND:
            return (scope, variable.slot)
        if isinstance(place.type, IntType):
            return key_of(place, agent)
        return ("compound", key_of(place, agent))


def key_of(place: core.Place, agent: int) -> Hashable:
    """What stands for the integers at a place, whatever the indices."""
    home, fields = place.variable.home, []
    for step in place.steps:
        if isinstance(step, core.FieldStep):
            fields.append(step.position)
    whose = agent if home in (Home.LOCAL, Home.PORT) else 0
    return (home, whose, place.variable.slot, tuple(fields))


def _named(keys: list[Hashable]) -> list[Hashable]:
    return [key for key in keys if not isinstance(key, int)]
