"""Printing of invariants in Koord, quantified over robots that may change places."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import combinations

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.printing.quoting import print_number
from koord.syntax.system import Status, System
from koord.syntax.types import BoolType, EnumType, IntType, within
from koord.syntax.walk import nodes
from koord.verify.engines.bits.invariant_core import Needed
from koord.verify.engines.bits.prime_implicants import PlaceTable, UnsaidError, Values
from koord.verify.engines.bits.state_decoder import (
    EQUALS_SIGN,
    OUTSIDE,
    ArrayIndex,
    Held,
    Piece,
    RobotIndex,
    StateVariable,
)

#: What robots and numbers are called in statements, where the program leaves the name free.
ROBOTS = ("i", "j", "m", "n", "robot1", "robot2", "robot3", "robot4")
NUMBERS = ("k", "l", "number1", "number2")

#: A number that a quantifier stands for.
ANY_NUMBER = -10_000_000


class InvariantText(Struct, frozen=True):
    """An invariant in Koord; ``at_round``: it holds at the ends of rounds, maybe not inside."""

    text: str
    at_round: bool


class _Clause(Struct, frozen=True):
    """A negated conjunction: places with values, and two places that are ``alike``.

    ``over`` is the range of numbers that a quantifier goes through; what is there said of the least
    is meant of each.
    """

    values: Values
    alike: tuple[int, int] | None = None
    over: tuple[int, int] | None = None


def invariant_texts(system: System, table: PlaceTable, found: Needed) -> list[InvariantText]:
    """Print an invariant in Koord: first ranges, then clauses. Raises UnsaidError."""
    words = _Words(system, table)
    clauses = _joined([_Clause(orbit.first) for orbit in found.orbits], table)
    clauses = _over_numbers([*_ranges(found.ranged, table), *clauses], table)
    statements = [words.clause(clause) for clause in clauses]
    return list(dict.fromkeys(statements))


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
        if one.type is not None and _plain(one) == _plain(other) and OUTSIDE not in one.values:
            return a, b
    return None


def _plain(place: StateVariable) -> tuple[Piece, ...]:
    return tuple(RobotIndex(0) if isinstance(piece, RobotIndex) else piece for piece in place.name)


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
            piece.number
            for k, _ in clause.values
            for piece in table.places[k].name
            if isinstance(piece, ArrayIndex)
        }
        for number in sorted(indices):
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
        name = tuple(
            ArrayIndex(ANY_NUMBER) if isinstance(p, ArrayIndex) and p.number == number else p
            for p in place.name
        )
        parts.append((str(name), _opened(place, held, number)))
    return tuple(sorted(parts, key=str)), clause.alike


def _opened(place: StateVariable, held: frozenset[Held], number: int) -> frozenset[Held] | str:
    is_it = isinstance(place.type, IntType) and not place.of_robots and held == {number}
    return "the number" if is_it else held


# --- words ----------------------------------------------------------------------------------------


class _Words:
    def __init__(self, system: System, table: PlaceTable) -> None:
        self.system = system
        self.table = table
        program = self.system.program
        self._taken: frozenset[str] = frozenset(_called(program))
        # The first robots of a round that has urgent events do not make a round by themselves.
        self._hurried: bool = any(
            event.urgent for agent in program.agents for event in agent.events
        )

    def clause(self, clause: _Clause) -> InvariantText:
        """Print a clause, for all robots that it may be about."""
        table = self.table
        alike = [table.places[k] for k in clause.alike or ()]
        parts = [(table.places[k], held) for k, held in clause.values]
        names = self._names(clause)
        speaking = _Speaking(names, clause.over, self._free(NUMBERS)[0])

        def has(place: StateVariable, held: frozenset[Held], excluded: frozenset[Held]) -> str:
            return speaking.has(place, held, is_number=speaking.is_number(place, excluded))

        premises = [speaking.same(*alike)] if alike else []
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
        premises += [has(place, held, held) for place, held in first]
        conclusions = [has(p, frozenset(p.values) - held, held) for p, held in last]
        if alike and not conclusions:
            conclusions, premises = [speaking.different(*alike)], premises[1:]
        text = _implied([*self._who(names), *premises], conclusions)
        moves = any(place.moves for place in (*alike, *(place for place, _ in parts)))
        return InvariantText(self._quantified(text, names, speaking), moves or self._hurried)

    def _free(self, names: Sequence[str]) -> list[str]:
        free = [name for name in names if name not in self._taken]
        if not free:
            raise UnsaidError("the program leaves no name free")
        return free

    # --- robots ---------------------------------------------------------------------------------

    def _names(self, clause: _Clause) -> dict[int, str]:
        """Name the robots of a clause that need one: interchangeable ones, and ones with a kind."""
        values = clause.values + tuple((k, frozenset[Held]()) for k in clause.alike or ())
        robots = self.table.robots_of(values)
        several = len(self.system.program.agents) > 1
        named = [r for r in robots if several or self._group(r)]
        free = self._free(ROBOTS)
        if len(named) > len(free):
            raise UnsaidError(f"one of its clauses is about {len(robots)} robots at once")
        return dict(zip(named, free, strict=False))

    def _group(self, robot: int) -> tuple[int, ...]:
        return next((group for group in self.table.groups if robot in group), ())

    def _who(self, names: Mapping[int, str]) -> Iterator[str]:
        """The conditions on a clause's robots: distinct, and none with a role of its own."""
        for robot, name in names.items():
            if not self._group(robot):
                yield f"{name} == {robot}"
                continue
            kind = self.system.kinds[robot]
            others = [r for r, k in enumerate(self.system.kinds) if k == kind]
            yield from (f"{name} != {r}" for r in others if r not in self._group(robot))
        for a, b in combinations(names, 2):
            if self._group(a) and self._group(a) == self._group(b):
                yield f"{names[a]} != {names[b]}"

    def _quantified(self, text: str, names: Mapping[int, str], speaking: _Speaking) -> str:
        agents = self.system.program.agents
        if len(agents) > 1:
            for robot, name in list(names.items())[::-1]:
                text = f"forall {agents[self.system.kinds[robot]].name} {name}: {text}"
        elif names:
            text = f"forall {', '.join(names.values())}: {text}"
        if speaking.over is not None:
            low, high = speaking.over
            text = f"forall {speaking.number} in {low}, {high}: {text}"
        return text


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


class _Speaking(Struct, frozen=True):
    """The printer of places and values in one statement."""

    names: Mapping[int, str]
    over: tuple[int, int] | None
    number: str

    def name(self, place: StateVariable) -> str:
        """Print a place."""
        return "".join(self._piece(piece) for piece in place.name)

    def _piece(self, piece: Piece) -> str:
        match piece:
            case RobotIndex(number=number):
                return self.names.get(number, str(number))
            case ArrayIndex(number=number):
                return self._number(number)
            case _:
                return piece

    def _number(self, number: int) -> str:
        return self.number if self.over is not None and number == self.over[0] else str(number)

    def same(self, a: StateVariable, b: StateVariable) -> str:
        return f"{self.name(a)} == {self.name(b)}"

    def different(self, a: StateVariable, b: StateVariable) -> str:
        return f"{self.name(a)} != {self.name(b)}"

    def is_number(self, place: StateVariable, held: frozenset[Held]) -> bool:
        """Return whether the one value of a place is the number that the quantifier stands for."""
        if self.over is None or place.of_robots or not isinstance(place.type, IntType):
            return False
        return held == {self.over[0]}

    def has(self, place: StateVariable, held: frozenset[Held], *, is_number: bool = False) -> str:
        """Print that a place has one of some values. Raises UnsaidError."""
        name = self.name(place)
        everything = frozenset(place.values)
        if place.type is None:
            return self._of_robot(place, name, held)
        if isinstance(place.type, BoolType):
            return self._truth(name, held)
        missing = sorted(everything - held, key=place.values.index)
        if OUTSIDE not in everything and 0 < len(missing) < min(3, len(held)):
            values = [self._valued(place, v, is_number=is_number) for v in missing]
            return " and ".join(f"{name} != {value}" for value in values)
        return self._one_of(place, name, held, is_number=is_number)

    def _truth(self, name: str, held: frozenset[Held]) -> str:
        if held != {True} and held != {False}:
            return f"{name} == {name}" if held else "false"
        if True in held:
            return name
        return name.replace(EQUALS_SIGN, " != ") if EQUALS_SIGN in name else f"not {name}"

    def _of_robot(self, place: StateVariable, name: str, held: frozenset[Held]) -> str:
        """Print whether a robot is stopped. Raises UnsaidError for other distinctions of status."""
        if place.name[0] != "stopped":
            raise UnsaidError("it is about which event a robot ran last")
        stopped, running = Status.STOPPED in held, Status.RUNNING in held
        if stopped == running or (place.moves and (Status.ASKED in held) != running):
            raise UnsaidError("it is about who asked to stop")
        return name if stopped else f"not {name}"

    def _one_of(
        self, place: StateVariable, name: str, held: frozenset[Held], *, is_number: bool = False
    ) -> str:
        """Print that a number is one of some, as ranges; other values are listed."""
        if not held:
            return "false"
        pieces = []
        for run in _runs(place, held):
            first, last = (self._valued(place, run[k], is_number=is_number) for k in (0, -1))
            if len(run) == 1:
                pieces.append(f"{name} == {first}")
            elif len(run) == 2 and len(held) == 2:
                pieces += [f"{name} == {first}", f"{name} == {last}"]
            elif OUTSIDE not in place.values and len(run) < len(place.values):
                # The least and the greatest value are said elsewhere.
                least, most = run[0] == place.values[0], run[-1] == place.values[-1]
                ends = [] if least else [f"{first} <= {name}"]
                pieces.append(" and ".join(ends if most else [*ends, f"{name} <= {last}"]))
            else:
                pieces.append(f"{first} <= {name} and {name} <= {last}")
        text = " or ".join(pieces)
        return text if len(pieces) == 1 else f"({text})"

    def _valued(self, place: StateVariable, value: Held, *, is_number: bool = False) -> str:
        return self.number if is_number else self.value(place, value)

    def value(self, place: StateVariable, value: Held) -> str:
        """Print a value."""
        match place.type:
            case EnumType(members=members):
                assert isinstance(value, int)
                return members[value]
            case _ if isinstance(value, str):
                return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
            case _:
                assert isinstance(value, int | Fraction)
                if place.of_robots and value in self.names:
                    return self.names[int(value)]
                return print_number(Fraction(value))


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
    yield run


def _implied(premises: Sequence[str], conclusions: Sequence[str]) -> str:
    several = len(conclusions) > 1
    if not premises and not several and conclusions and conclusions[0].startswith("("):
        return conclusions[0][1:-1]
    parts = [f"({text})" if several and " and " in text else text for text in conclusions]
    conclusion = " or ".join(parts) or "false"  # no state is left: nothing starts
    return f"{' and '.join(premises)} implies {conclusion}" if premises else conclusion
