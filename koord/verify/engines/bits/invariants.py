"""Invariants of proofs on circuits as statements of Koord, quantified over robots.

They are for people, for other engines, and for certificates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from itertools import combinations
from typing import Any, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.core import BinaryOp, Home, PropertyKind, UnaryOp
from koord.syntax.system import Status, System
from koord.syntax.types import BOOL, FLOAT, INT, BoolType, EnumType, IntType, within
from koord.syntax.walk import nodes, rebuilt
from koord.verify.claims import Claim
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.clauses import NoAnswerError
from koord.verify.engines.bits.ic3 import Cube, SafetyQuery
from koord.verify.engines.bits.invariant_core import Needed, needed
from koord.verify.engines.bits.prime_implicants import PlaceTable, Primes, UnsaidError, Values
from koord.verify.engines.bits.robot_permutations import speaking_last
from koord.verify.engines.bits.state_decoder import OUTSIDE, Held, StateVariable, places_of
from koord.verify.ledger import Ledger

#: What robots and numbers are called in statements, where the program leaves the name free.
ROBOTS = ("i", "j", "m", "n", "robot1", "robot2", "robot3", "robot4")
NUMBERS = ("k", "l", "number1", "number2")


class Lemmas(Struct, frozen=True):
    """Statements that make claims inductive, or the reason why there are none."""

    statements: tuple[core.Property, ...] = ()
    unsaid: str = ""

    @property
    def is_checked(self) -> bool:
        """True if they were looked at again, with the claims, by a solver of its own."""
        return not self.unsaid


def lemmas(
    ledger: Ledger,
    circuit: Circuit,
    question: SafetyQuery,
    cubes: Sequence[Cube],
    claims: Sequence[Claim],
) -> Lemmas:
    """Find lemmas for the claims: an inductive invariant, given the proved claims.

    Robots that may change places are spoken of together, unless the invariant sets them apart.
    """
    given, deadline = ledger.proved(), ledger.deadline
    properties = tuple(c.stated for c in (*claims, *given) if c.stated is not None)
    symmetry = symmetry_of(speaking_last(ledger.system), properties)
    alike = symmetry if isinstance(symmetry, Symmetry) else None
    reason = ""
    for each in (alike, None) if alike else (None,):
        places = places_of(ledger.problem, circuit, each)
        table = PlaceTable(circuit.d, places, each.groups if each else ())
        primes = Primes(table, question, cubes, deadline)
        try:
            found = needed(circuit, table, primes.orbits(), claims, given, deadline)
            return Lemmas(statements(ledger.problem.original, table, found))
        except UnsaidError as error:
            reason = primes.unsaid or str(error)
        except NoAnswerError:
            return Lemmas((), "there was no time to say it in Koord")
    return Lemmas((), reason)


class _Clause(Struct, frozen=True):
    """A negated conjunction: places with values, and two places that are ``alike``.

    ``over`` is the range of numbers that a quantifier goes through; what is there said of the least
    is meant of each.
    """

    values: Values
    alike: tuple[int, int] | None = None
    over: tuple[int, int] | None = None


def statements(system: System, table: PlaceTable, found: Needed) -> tuple[core.Property, ...]:
    """An invariant as unnamed properties: first ranges, then clauses. Raises UnsaidError."""
    writer = _Writer(system, table)
    clauses = _joined([_Clause(orbit.first) for orbit in found.orbits], table)
    clauses = _over_numbers([*_ranges(found.ranged, table), *clauses], table)
    return tuple(dict.fromkeys(map(writer.stated, clauses)))


# --- clauses that are one -------------------------------------------------------------------------


def _joined(clauses: Sequence[_Clause], table: PlaceTable) -> list[_Clause]:
    """Join clauses that exclude that two places hold k, for several k: the places are alike."""
    groups: dict[tuple[int, int, Values], list[_Clause]] = {}
    left: list[_Clause] = []
    for clause in clauses:
        pair = _pair(clause.values, table)
        if pair is None:
            left.append(clause)
        else:
            rest = tuple(part for part in clause.values if part[0] not in pair)
            groups.setdefault((*pair, rest), []).append(clause)
    for (a, b, rest), same in groups.items():
        if len(same) < 2:
            left += same
            continue
        held = frozenset(v for c in same for k, values in c.values if k == a for v in values)
        left.append(_Clause(tuple(sorted([*rest, (a, held)])), (a, b)))
    return left


def _pair(values: Values, table: PlaceTable) -> tuple[int, int] | None:
    """A pair of places of one kind that hold the same number."""
    for (a, x), (b, y) in combinations(values, 2):
        one, other = table.places[a], table.places[b]
        if x != y or len(x) != 1 or one.of_robots or isinstance(one.type, BoolType):
            continue
        if one.type is not None and one.expr == other.expr and OUTSIDE not in one.values:
            return a, b
    return None


def _ranges(ranged: Iterable[int], table: PlaceTable) -> Iterator[_Clause]:
    """Statements that places hold one of their values, for places that are always inside."""
    found: dict[Values, None] = {}
    for k in ranged:
        place = table.places[k]
        all_members = isinstance(place.type, EnumType) and len(place.values) == len(
            place.type.members
        )
        if (
            not all_members
            and place.type is not None
            and place.written
            and OUTSIDE not in place.values
        ):
            found.setdefault(table.orbit(((k, frozenset()),)).first)
    yield from map(_Clause, found)


def _over_numbers(clauses: Sequence[_Clause], table: PlaceTable) -> list[_Clause]:
    """Join clauses that differ in one number, which is an index, into one over a range."""
    forms: dict[object, dict[int, _Clause]] = {}
    for clause in clauses:
        indices = {
            step.index.value
            for k, _ in clause.values
            for step in nodes(table.places[k].expr)
            if isinstance(step, core.IndexStep) and isinstance(step.index, core.Const)
        }
        for number in sorted(index for index in indices if isinstance(index, int)):
            forms.setdefault(_form(clause, number, table), {})[number] = clause
    done: set[_Clause] = set()
    found = []
    for form in sorted(forms, key=lambda f: -len(forms[f])):
        numbers = {k: clause for k, clause in forms[form].items() if clause not in done}
        low, high = min(numbers, default=0), max(numbers, default=0)
        if len(numbers) > 1 and len(numbers) == high - low + 1:
            done |= set(numbers.values())
            found.append(replace(numbers[low], over=(low, high + 1)))
    return [*found, *(clause for clause in clauses if clause not in done)]


def _form(clause: _Clause, number: int, table: PlaceTable) -> object:
    """A clause with a number abstracted, wherever it is an index or a place's one value."""
    parts = []
    for k, held in clause.values:
        place = table.places[k]
        expr = _with_index(place.expr, number, core.NumAgents(INT))  # which is no index elsewhere
        is_it = isinstance(place.type, IntType) and not place.of_robots and held == {number}
        parts.append((expr, place.robots, None if is_it else held))
    return frozenset(parts), clause.alike


def _with_index(node: Any, number: int, other: core.Expr) -> Any:
    """Replace the index that is the number by another, in an expression."""
    match node:
        case core.IndexStep(index=core.Const(value=value)) if value == number:
            return replace(node, index=other)
        case core.Variable():
            return node
        case _:
            return rebuilt(node, lambda part: _with_index(part, number, other))


# --- expressions ----------------------------------------------------------------------------------

#: What holds where one of these does.
_Ways: TypeAlias = list[core.Expr]


def _all(parts: Iterable[core.Expr]) -> core.Expr:
    return reduce(lambda one, other: core.Binary(BinaryOp.AND, one, other, BOOL), parts)


def _any(ways: _Ways) -> core.Expr:
    if not ways:
        return core.Const(False, BOOL)  # no state is left: nothing starts
    return reduce(lambda one, other: core.Binary(BinaryOp.OR, one, other, BOOL), ways)


def _compared(one: core.Expr, op: BinaryOp, other: core.Expr) -> core.Expr:
    return core.Binary(op, one, other, BOOL)


def _not(e: core.Expr) -> core.Expr:
    if isinstance(e, core.Binary) and e.op is BinaryOp.EQ:
        return replace(e, op=BinaryOp.NE)
    return core.Unary(UnaryOp.NOT, e, BOOL)


class _Writer:
    """A translation of clauses to statements about the robots of a system."""

    def __init__(self, system: System, table: PlaceTable) -> None:
        self.system = system
        self.table = table
        program = self.system.program
        self._taken: frozenset[str] = frozenset(_called(program))
        # The first robots of a round that has urgent events do not make a round by themselves.
        self._hurried: bool = any(
            event.urgent for agent in program.agents for event in agent.events
        )

    def stated(self, clause: _Clause) -> core.Property:
        """The statement of a clause, for all robots that it may be about."""
        table = self.table
        alike = [table.places[k] for k in clause.alike or ()]
        parts = [(table.places[k], held) for k, held in clause.values]
        number = core.Variable(Home.BOUND, 0, self._free(NUMBERS)[0], INT)
        robots = self._robots(clause)
        words = _Words(robots, clause.over, number)

        def ways(place: StateVariable, held: frozenset[Held], out: frozenset[Held]) -> _Ways:
            return words.ways(place, held, is_number=words.is_number(place, out))

        premises: list[core.Expr] = []
        if alike:
            premises.append(_compared(words.read(alike[0]), BinaryOp.EQ, words.read(alike[1])))
        # What may be unset is read last; of what is not followed nothing else can be supposed.
        last = sorted((p for p in parts if OUTSIDE in p[0].values), key=lambda p: p[0].may_fault)
        first = [p for p in parts if OUTSIDE not in p[0].values]
        full = [p for p in first if alike and p[0] is alike[0] and len(p[1]) == len(p[0].values)]
        first = [p for p in first if p not in full]
        if any(OUTSIDE not in held for _, held in last):
            raise UnsaidError("it says of a value that it is none of those that are followed")
        if sum(place.may_fault for place, _ in last) > 1:
            raise UnsaidError("it is about several values that may be unset")
        if not last and first:
            last = [max(first, key=lambda p: (p[1] == {False}, len(p[1])))]
            first.remove(last[0])
        premises += [_any(ways(place, held, held)) for place, held in first]
        conclusions = [e for p, held in last for e in ways(p, frozenset(p.values) - held, held)]
        if alike and not conclusions:
            conclusions = [_not(premises.pop(0))]
        body = _any(conclusions)
        supposed = [*self._who(robots), *premises]
        if supposed:
            body = _compared(_all(supposed), BinaryOp.IMPLIES, body)
        moves = any(place.moves for place in (*alike, *(place for place, _ in parts)))
        kind = PropertyKind.AT_ROUND if moves or self._hurried else PropertyKind.INVARIANT
        return core.Property("", kind, self._quantified(body, words), 1 + len(robots))

    def _free(self, names: Sequence[str]) -> list[str]:
        free = [name for name in names if name not in self._taken]
        if not free:
            raise UnsaidError("the program leaves no name free")
        return free

    # --- robots ---------------------------------------------------------------------------------

    def _robots(self, clause: _Clause) -> dict[int, core.Variable]:
        """The robots of a clause that stand for others, or have a kind, with their variables."""
        values = clause.values + tuple((k, frozenset[Held]()) for k in clause.alike or ())
        robots = self.table.robots_of(values)
        several = len(self.system.program.agents) > 1
        named = [r for r in robots if several or self._group(r)]
        free = self._free(ROBOTS)
        if len(named) > len(free):
            raise UnsaidError(f"one of its clauses is about {len(robots)} robots at once")
        return {
            robot: core.Variable(Home.BOUND, slot, free[slot - 1], INT)
            for slot, robot in enumerate(named, start=1)
        }

    def _group(self, robot: int) -> tuple[int, ...]:
        return next((group for group in self.table.groups if robot in group), ())

    def _who(self, robots: Mapping[int, core.Variable]) -> Iterator[core.Expr]:
        """The conditions on a clause's robots: distinct, and none with a role of its own."""
        for robot, variable in robots.items():
            if not self._group(robot):
                yield _compared(_read(variable), BinaryOp.EQ, core.Const(robot, INT))
                continue
            kind = self.system.kinds[robot]
            for r, k in enumerate(self.system.kinds):
                if k == kind and r not in self._group(robot):
                    yield _compared(_read(variable), BinaryOp.NE, core.Const(r, INT))
        for a, b in combinations(robots, 2):
            if self._group(a) and self._group(a) == self._group(b):
                yield _compared(_read(robots[a]), BinaryOp.NE, _read(robots[b]))

    def _quantified(self, body: core.Expr, words: _Words) -> core.Expr:
        several = len(self.system.program.agents) > 1
        for robot, variable in list(words.robots.items())[::-1]:
            which = core.RobotRange(self.system.kinds[robot] if several else None)
            body = core.Quantified(core.QuantifierKind.FORALL, variable, which, body)
        if words.over is not None:
            low, high = (core.Const(end, INT) for end in words.over)
            numbers = core.IntRange(low, high)
            body = core.Quantified(core.QuantifierKind.FORALL, words.number, numbers, body)
        return body


def _called(program: core.Program) -> Iterator[str]:
    """The names that have a meaning everywhere in a program."""
    yield from (given.name for given in program.parameters)
    for node in nodes(program):
        match node:
            case core.Variable(home=home, name=name, type=type_):
                if home is not Home.BOUND:
                    yield name
                for part in within(type_):
                    if isinstance(part, EnumType):
                        yield from part.members
            case core.Function(name=name) | core.External(name=name):
                yield name


def _read(variable: core.Variable) -> core.Expr:
    return core.Read(core.Place(variable))


class _Words(Struct, frozen=True):
    """The expressions for places and values in one statement."""

    robots: Mapping[int, core.Variable]
    over: tuple[int, int] | None
    number: core.Variable

    def read(self, place: StateVariable) -> core.Expr:
        """The expression that reads a place."""
        found = place.of([self._robot(robot) for robot in place.robots])
        if self.over is None:
            return found
        read: core.Expr = _with_index(found, self.over[0], _read(self.number))
        return read

    def _robot(self, robot: int) -> core.Expr:
        return _read(self.robots[robot]) if robot in self.robots else core.Const(robot, INT)

    def is_number(self, place: StateVariable, held: frozenset[Held]) -> bool:
        """Return whether the one value of a place is the number that the quantifier stands for."""
        if self.over is None or place.of_robots or not isinstance(place.type, IntType):
            return False
        return held == {self.over[0]}

    def ways(self, place: StateVariable, held: frozenset[Held], *, is_number: bool) -> _Ways:
        """The statements of which one holds if a place has one of some values.

        Raises UnsaidError.
        """
        read = self.read(place)
        everything = frozenset(place.values)
        if place.type is None:
            return [self._of_robot(place, read, held)]
        if isinstance(place.type, BoolType):
            if len(held) == 1:
                return [read if True in held else _not(read)]
            return [_compared(read, BinaryOp.EQ, read)] if held else []
        missing = sorted(everything - held, key=place.values.index)
        if OUTSIDE not in everything and 0 < len(missing) < min(3, len(held)):
            values = (self._valued(place, v, is_number=is_number) for v in missing)
            return [_all(_compared(read, BinaryOp.NE, value) for value in values)]
        return list(self._runs(place, read, held, is_number=is_number))

    def _of_robot(self, place: StateVariable, read: core.Expr, held: frozenset[Held]) -> core.Expr:
        """The statement that a robot is, or is not, stopped. Raises UnsaidError otherwise."""
        if isinstance(read, core.Ran):
            raise UnsaidError("it is about which event a robot ran last")
        stopped, running = Status.STOPPED in held, Status.RUNNING in held
        if stopped == running or (place.moves and (Status.ASKED in held) != running):
            raise UnsaidError("it is about who asked to stop")
        return read if stopped else _not(read)

    def _runs(
        self, place: StateVariable, read: core.Expr, held: frozenset[Held], *, is_number: bool
    ) -> Iterator[core.Expr]:
        """Yield ranges of numbers; single values else."""
        for run in _runs(place, held):
            first, last = (self._valued(place, run[k], is_number=is_number) for k in (0, -1))
            if len(run) == 1 or (len(run) == 2 and len(held) == 2):
                yield from (_compared(read, BinaryOp.EQ, v) for v in (first, last)[: len(run)])
                continue
            ends = [
                _compared(first, BinaryOp.LE, read),
                _compared(read, BinaryOp.LE, last),
            ]
            if OUTSIDE not in place.values and len(run) < len(place.values):
                # The least and the greatest value are said elsewhere.
                if run[0] == place.values[0]:
                    ends = ends[1:]
                elif run[-1] == place.values[-1]:
                    ends = ends[:1]
            yield _all(ends)

    def _valued(self, place: StateVariable, value: Held, *, is_number: bool) -> core.Expr:
        if is_number:
            return _read(self.number)
        assert place.type is not None
        assert isinstance(value, int | Fraction | str)
        if place.of_robots and isinstance(value, int) and value in self.robots:
            return _read(self.robots[value])
        return core.Const(Fraction(value) if place.type == FLOAT else value, place.type)


def _runs(place: StateVariable, held: frozenset[Held]) -> Iterator[list[Held]]:
    """Group values in order; consecutive integers together."""
    run: list[Held] = []
    # Robots have no order, but all values together are a range.
    in_order = isinstance(place.type, IntType) and (
        not place.of_robots or held >= frozenset(place.values) - {OUTSIDE}
    )
    for value in (v for v in place.values if v in held):
        before = run[-1] if run else OUTSIDE
        if in_order and isinstance(before, int) and value == before + 1:
            run.append(value)
            continue
        if run:
            yield run
        run = [value]
    if run:
        yield run
