"""What a program asks of many robots at once, as literals of lemmas. [T-EVERY-N]

Guards and claims ask whether a quorum has voted for a robot, how many have, whether there is one
that was asked. What a guard has seen often holds later still, where a claim needs it. So the
*conditions* that guards and claims are made of, beside comparisons of scalars, are what lemmas may
say: of robot i or j, or of none, and of an index k.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from msgspec import Struct

from koord.sampling.compiled.configurations import statement_code
from koord.sampling.compiled.operations import Code
from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.expressions import condition
from koord.semantics.oracle import NoInputs, Phase
from koord.semantics.statements import machine
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import System
from koord.syntax.types import INT
from koord.syntax.walk import nodes, reached, rebuilt
from koord.verify.engines.every_n.bound import FREE_SLOT, READ_I, READ_K
from koord.verify.engines.every_n.candidates import for_robot

#: More conditions are not looked at.
_MOST = 12

#: Names of what quantifiers inside of conditions are about.
_INNER = "mnopqr"

#: The value of a condition that faults, as of what is not set. [PROP-FAULT]
UNSET = object()


class Condition(Struct, frozen=True):
    """A condition of robot i (``of`` is 1) or of none (0); ``indexed``: and of index k."""

    said: core.Expr
    of: int
    indexed: bool

    def at(self, robot: core.Expr | None, index: core.Expr | None = None) -> core.Expr:
        """The condition with something else in the place of i, and of k."""
        found = self.said
        for old, new in ((READ_I, robot), (READ_K, index)):
            if new is not None:
                found = _with(found, old, new)
        return found

    @property
    def bound(self) -> int:
        """How many slots its variables need."""
        return 1 + max(
            (
                node.slot
                for node in nodes(self.said)
                if isinstance(node, core.Variable) and node.home is Home.BOUND
            ),
            default=-1,
        )


#: The values of conditions: by position, robot (None: of none), and index (0: it has none).
Asked: TypeAlias = "Mapping[tuple[int, int | None, int], object]"


def conditions_of(program: core.Program, size: int) -> list[Condition]:
    """The conditions of a program with one kind of robots, those of its guards first."""
    found: dict[str, Condition] = {}
    quoting = Quoting.of(program)

    def keep(e: core.Expr) -> None:
        if _is_worth_it(program, e):
            made = Condition(e, int(_mentions(e, READ_I)), _mentions(e, READ_K))
            # Calls differ by their sites, and mean the same.
            found.setdefault(quoting.text(e), made)

    for event in program.agents[0].events:
        for atom in _atoms(event.guard):
            keep(for_robot(atom, READ_I))
    for stated in program.properties:
        for atom in _of_claim(stated.condition, size):
            keep(atom)
    return list(found.values())[:_MOST]


def _atoms(e: core.Expr) -> Iterator[core.Expr]:
    """Yield what a formula is made of by connectives."""
    match e:
        case core.Unary(op=UnaryOp.NOT, operand=operand):
            yield from _atoms(operand)
        case core.Binary(op=BinaryOp.AND | BinaryOp.OR | BinaryOp.IMPLIES, left=left, right=right):
            yield from _atoms(left)
            yield from _atoms(right)
        case _:
            yield e


def _of_claim(e: core.Expr, size: int) -> Iterator[core.Expr]:
    """Yield what a claim asks of one robot at most, and of one index."""
    robots: list[core.Expr] = []
    indices: list[core.Expr] = []
    while isinstance(e, core.Quantified) and e.quantifier is core.QuantifierKind.FORALL:
        read = core.Read(core.Place(e.variable))
        match e.domain:
            case core.RobotRange():
                robots.append(read)
            case core.IntRange(low=core.Const(value=0), high=core.Const(value=high)):
                indices += [read] if high == size else []
            case _:
                break
        e = e.body
    for atom in _atoms(e):
        mine = [r for r in robots if _mentions(atom, r)]
        where = [k for k in indices if _mentions(atom, k)]
        if len(mine) > 1 or len(where) > 1:
            continue
        made = _with_free_slots(atom)
        for old, new in [*((r, READ_I) for r in mine), *((k, READ_K) for k in where)]:
            made = _with(made, old, new)
        yield made


def _with_free_slots(e: core.Expr) -> core.Expr:
    """An expression whose own variables have slots and names that no variable of a lemma has."""
    own = dict.fromkeys(node.variable for node in nodes(e) if isinstance(node, core.Quantified))
    moved = {
        old: core.Variable(Home.BOUND, FREE_SLOT + k, name, old.type)
        for k, (old, name) in enumerate(zip(own, _INNER, strict=False))
    }

    def put(node: Any) -> Any:
        if isinstance(node, core.Variable):
            return moved.get(node, node)
        return rebuilt(node, put)

    made: core.Expr = put(e)
    return made


def _mentions(e: core.Expr, read: core.Expr) -> bool:
    return any(node == read for node in nodes(e))


def _with(node: Any, old: core.Expr, new: core.Expr) -> Any:
    return new if node == old else rebuilt(node, lambda part: _with(part, old, new))


_OF_MANY = (core.Call, core.Quantified)
_OPEN = (core.ExternalCall, core.Choose, core.Ran, core.Stopped, core.Pid)


def _is_worth_it(program: core.Program, e: core.Expr) -> bool:
    """Return whether a condition asks more than literals say, and may stand in a lemma."""
    asks = any(
        isinstance(node, _OF_MANY)
        or (isinstance(node, core.Builtin) and node.op in (ListOp.ANY, ListOp.ALL))
        or (isinstance(node, core.Place) and _is_of_one(node))
        for node in nodes(e)
    )
    bodies = list(reached(program, e))
    inner = {node.variable for node in nodes(e) if isinstance(node, core.Quantified)}
    free = {
        node
        for node in nodes(e)
        if isinstance(node, core.Variable) and node.home is Home.BOUND and node not in inner
    }
    lemma = {read.place.variable for read in (READ_I, READ_K)}
    return (
        asks
        and free <= lemma
        and len(inner) <= len(_INNER)
        and not any(
            isinstance(node, _OPEN) or (isinstance(node, core.Variable) and node.home is Home.PORT)
            for node in bodies
        )
    )


def _is_of_one(place: core.Place) -> bool:
    """Return whether a place belongs to a robot with a number of its own: 0, most often."""
    if place.variable.home not in (Home.ALLREAD, Home.ALLWRITE) or not place.steps:
        return False
    first = place.steps[0]
    return isinstance(first, core.IndexStep) and isinstance(first.index, core.Const)


# --- in samples -----------------------------------------------------------------------------------


def asked_of(
    conditions: Sequence[Condition], size: int
) -> Callable[[System, Configuration[Constant]], Asked]:
    """A function that says how conditions of a program are in configurations of small systems.

    Each is worked out once for what it reads, which is the same in most configurations.
    """
    made: dict[tuple[int, int | None, int], tuple[core.Expr, int]] = {}
    codes: dict[tuple[int, int], Code] = {}
    reads: dict[int, list[core.Variable]] = {}
    known: dict[Hashable, Asked] = {}

    def expression(position: int, robot: int | None, k: int) -> tuple[core.Expr, int]:
        key = position, robot, k
        if key not in made:
            x = conditions[position]
            who = None if robot is None else core.Const(robot, INT)
            made[key] = x.at(who, core.Const(k, INT)), x.bound
        return made[key]

    def code(position: int, system: System) -> Code:
        key = position, system.robots
        if key not in codes:
            given = [read.place.variable for read in (READ_I, READ_K)]
            codes[key] = statement_code(EXACT, system, given, conditions[position].said)
        return codes[key]

    def value(
        position: int, system: System, here: Configuration[Constant], robot: int | None, k: int
    ) -> object:
        system.budget.spend()
        found = code(position, system).ask(here, robot, k)
        if found is None:
            return value_in(system, here, *expression(position, robot, k))
        return found

    def worked_out(position: int, system: System, here: Configuration[Constant]) -> Asked:
        x = conditions[position]
        return {
            (position, robot, k): value(position, system, here, robot, k)
            for robot in (range(len(here.robots)) if x.of else (None,))
            for k in range(size if x.indexed else 1)
        }

    def look(system: System, here: Configuration[Constant]) -> Asked:
        found: dict[tuple[int, int | None, int], object] = {}
        for position, x in enumerate(conditions):
            if position not in reads:
                reads[position] = _variables(system.program, x.said)
            key = position, len(here.robots), *(_held(v, here) for v in reads[position])
            if key not in known:
                known[key] = worked_out(position, system, here)
            found |= known[key]
        return found

    return look


def _variables(program: core.Program, e: core.Expr) -> list[core.Variable]:
    """The variables of a system that a condition reads, itself or in functions."""
    found = (node for node in reached(program, e) if isinstance(node, core.Variable))
    return [v for v in dict.fromkeys(found) if v.home is not Home.BOUND]


def _held(variable: core.Variable, here: Configuration[Constant]) -> Hashable:
    """What a variable holds, for all robots."""
    slot = variable.slot
    match variable.home:
        case Home.ALLREAD:
            return here.store.allread[slot]
        case Home.ALLWRITE:
            return here.store.allwrite[slot]
        case Home.LOCAL:
            return tuple(robot.locals[slot] for robot in here.robots)
        case Home.PORT:
            return tuple(robot.ports[slot] for robot in here.robots)
        case Home.BOUND:
            raise AssertionError("it is of an expression, and not of a system")


def value_in(system: System, here: Configuration[Constant], e: core.Expr, bound: int) -> object:
    """The value of a condition in a configuration; ``UNSET`` if it faults. [PROP-FAULT]"""
    m = machine(EXACT, system, NoInputs().oracle(Phase.CHECK, 0), bound=bound, view=here)
    value = condition(m, e)
    return UNSET if any(fault is True for fault, _ in m.faults) else value
