"""Orders that mean nothing: parts of a program that may change places are put in one order.

Whoever turns round a guard, or two assignments, has changed nothing that a verdict depends on. What
may change places is what is the same in any order by the rules, without a look at any values:

- operands of an operator for which ``a op b`` is ``b op a``, as both are evaluated [E-EQUAL];
- operands of ``and`` and ``or`` of which none can fault or ask, as only then it is the same which
  of them is not looked at [E-SHORT];
- in a statement about configurations, whose faults make it false, also others [PROP-FAULT];
- assignments to different locals one behind the other, of values that cannot fault, ask, or read
  what another one of them writes [LOCAL-ASSIGN].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from fractions import Fraction
from functools import reduce
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, Start
from koord.syntax.types import FLOAT, INT
from koord.syntax.walk import asks, chained, nodes, with_blocks

#: These look at both operands, and are the same turned round; of numbers, the latter as well.
_TURNING = frozenset({BinaryOp.EQ, BinaryOp.NE})
_TURNING_NUMBERS = frozenset({BinaryOp.ADD, BinaryOp.MUL, BinaryOp.MIN, BinaryOp.MAX})

#: What may ask for answers, which are told apart by where they are asked for.
_CALLS = core.Call | core.ExternalCall | core.Choose

#: Fields that say where something stands, and not what it is.
_ASIDE = frozenset({"span", "slot", "site"})


def in_order(program: core.Program) -> core.Program:
    """The program with what robots do in one order: it has the same runs."""
    agents = tuple(_Order(program, kind).agent() for kind in range(len(program.agents)))
    return replace(program, agents=agents)


def statement_in_order(program: core.Program, said: core.Expr) -> core.Expr:
    """A statement about configurations with its parts in one order: it is true in the same ones."""
    return _Order(program, None).statement(said, frozenset())


class _Order(Struct, frozen=True):
    """The order of parts of a program: of what robots of a ``kind`` do, or of what is claimed."""

    program: core.Program
    kind: int | None

    def agent(self) -> core.Agent:
        assert self.kind is not None
        agent = self.program.agents[self.kind]
        events = tuple(
            replace(
                event,
                guard=self.expression(event.guard, frozenset()),
                effect=self.block(event.effect, frozenset()),
            )
            for event in agent.events
        )
        return replace(agent, init=self.block(agent.init, frozenset()), events=events)

    # --- expressions ----------------------------------------------------------------------------

    def statement(self, e: core.Expr, robots: frozenset[int]) -> core.Expr:
        """Order a statement: it is false where evaluating it faults, as is one of its parts.

        ``robots`` are the slots of quantified variables that number robots.
        """
        match e:
            case core.Binary(op=BinaryOp.AND):
                parts = [self.statement(part, robots) for part in chained(e, e.op)]
                return _joined(e, _sorted_runs(parts, lambda part: not asks(self.program, part)))
            case core.Binary(op=BinaryOp.IMPLIES):
                left = self.expression(e.left, robots)
                return replace(e, left=left, right=self.statement(e.right, robots))
            case core.Quantified(quantifier=core.QuantifierKind.FORALL, domain=core.RobotRange()):
                return replace(e, body=self.statement(e.body, robots | {e.variable.slot}))
            case _:
                return self.expression(e, robots)

    def expression(self, e: core.Expr, robots: frozenset[int]) -> core.Expr:
        """Order an expression; ``robots`` are slots of variables that have a value here."""
        match e:
            case core.Binary(op=BinaryOp.AND | BinaryOp.OR as op):
                parts = [self.expression(part, robots) for part in chained(e, op)]
                return _joined(e, _sorted_runs(parts, lambda part: self._is_calm(part, robots)))
            case core.Binary():
                left, right = self.expression(e.left, robots), self.expression(e.right, robots)
                turns = e.op in _TURNING or (e.op in _TURNING_NUMBERS and e.type in (INT, FLOAT))
                if turns and not _calls(left) and not _calls(right):
                    left, right = sorted((left, right), key=_key)
                return replace(e, left=left, right=right)
            case core.Unary():
                return replace(e, operand=self.expression(e.operand, robots))
            case core.Quantified(domain=core.RobotRange()):
                return replace(e, body=self.expression(e.body, robots | {e.variable.slot}))
            case _:
                return e

    def _is_calm(self, e: core.Expr, bound: frozenset[int]) -> bool:
        """Return whether an expression has a value whatever there is, without a question."""
        match e:
            case core.Const() | core.Pid() | core.NumAgents() | core.Delta():
                return True
            case core.Read():
                return self._is_set(e.place, bound)
            case core.Unary():
                return self._is_calm(e.operand, bound)
            case core.Binary(op=BinaryOp.DIV | BinaryOp.MOD):
                return False
            case core.Binary():
                return self._is_calm(e.left, bound) and self._is_calm(e.right, bound)
            case core.Quantified(domain=core.RobotRange()):
                return self._is_calm(e.body, bound | {e.variable.slot})
            case core.Stopped() | core.Ran():
                return self._is_calm(e.robot, bound)
            case _:
                return False

    def _is_set(self, place: core.Place, bound: frozenset[int]) -> bool:
        """Return whether a place always has a value: nothing that is set is ever unset."""
        variable = place.variable
        if place.primed or not all(isinstance(step, core.FieldStep) for step in place.steps):
            return False
        if variable.home is Home.BOUND:
            return variable.slot in bound
        if place.robot is None and self.kind is None and variable.home in _OF_ROBOTS:
            return False
        if place.robot is not None and not self._names_one(place.robot, bound):
            return False
        return self._starts(variable)

    def _names_one(self, robot: core.Expr, bound: frozenset[int]) -> bool:
        """Return whether an expression names a robot that has what all robots have."""
        match robot:
            case core.Read(place=core.Place(variable=variable, steps=())):
                is_one = variable.home is Home.BOUND and variable.slot in bound
                return is_one and len(self.program.agents) == 1
            case _:
                return False

    def _starts(self, variable: core.Variable) -> bool:
        """Return whether a variable has a value from the start."""
        agent = self.program.agents[self.kind or 0]
        match variable.home:
            case Home.LOCAL:
                entry = agent.locals[variable.slot]
            case Home.PORT:
                entry = agent.ports[variable.slot].declaration
            case Home.ALLWRITE:
                entry = self.program.allwrite[variable.slot]
            case _:
                return False
        return entry.initial is not Start.UNSET

    # --- statements -----------------------------------------------------------------------------

    def block(self, block: core.Block, bound: frozenset[int]) -> core.Block:
        """Order a block; ``bound`` are the slots of the variables of loops around it."""
        made = [self._statement(s, bound) for s in block]
        found: list[core.Stmt] = []
        run: list[core.Assign] = []
        for s in made:
            if isinstance(s, core.Assign) and self._is_own(s, bound):
                if not all(_apart(s, other) for other in run):
                    found += sorted(run, key=_key)
                    run = []
                run.append(s)
            else:
                found += [*sorted(run, key=_key), s]
                run = []
        return (*found, *sorted(run, key=_key))

    def _statement(self, s: core.Stmt, bound: frozenset[int]) -> core.Stmt:
        match s:
            case core.Assign():
                return replace(s, value=self.expression(s.value, bound))
            case core.If():
                s = replace(s, condition=self.expression(s.condition, bound))
            case core.ForRange():
                bound |= {s.variable.slot}
            case core.ForEach():
                bound |= {s.value.slot, *({s.key.slot} if s.key is not None else ())}
            case _:
                pass
        return with_blocks(s, lambda inner: self.block(inner, bound))

    def _is_own(self, s: core.Assign, bound: frozenset[int]) -> bool:
        """Return whether a statement sets a whole local to a value that it has in any case."""
        is_whole = s.place.variable.home is Home.LOCAL and not s.place.steps
        return is_whole and self._is_calm(s.value, bound)


_OF_ROBOTS = (Home.LOCAL, Home.PORT)


def _apart(one: core.Assign, other: core.Assign) -> bool:
    """Return whether of two assignments to locals neither has a part in what the other does."""
    pairs = ((one, other), (other, one))
    if one.place.variable == other.place.variable:
        return False
    return not any(a.place.variable in nodes(b.value) for a, b in pairs)


def _joined(e: core.Binary, parts: Sequence[core.Expr]) -> core.Expr:
    """A chain of an expression's operator."""
    return reduce(lambda left, right: replace(e, left=left, right=right), parts)


def _sorted_runs(
    parts: Sequence[core.Expr], may_move: Callable[[core.Expr], bool]
) -> list[core.Expr]:
    """Parts of which those that may move are sorted among their neighbours that may."""
    found: list[core.Expr] = []
    run: list[core.Expr] = []
    for part in parts:
        if may_move(part):
            run.append(part)
        else:
            found += [*sorted(run, key=_key), part]
            run = []
    return [*found, *sorted(run, key=_key)]


def _calls(e: core.Expr) -> bool:
    """Return whether an expression calls something, so that answers are told apart by order."""
    return any(isinstance(node, _CALLS) for node in nodes(e))


def _key(part: object) -> str:
    """What a part says, to sort by. It is the same wherever the part stands."""
    return repr([_words(node) for node in nodes(part)])


def _words(node: Any) -> list[str]:
    fields = (getattr(node, name) for name in node.__struct_fields__ if name not in _ASIDE)
    plain = [repr(each) for each in fields if isinstance(each, str | int | Fraction | Enum | None)]
    return [type(node).__name__, *plain]
