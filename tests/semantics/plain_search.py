"""The yardstick of the search: every order of robots, one turn at a time, by the sequential rules.

Nothing is reduced, hashed cleverly, or worked out once. What is left open is tried by brute force:
any small value, and the rules say which are legal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import permutations, product
from typing import TypeVar

from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Turn
from koord.semantics.domain import EXACT, Constant
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Concrete
from koord.semantics.rounds import (
    IllegalStepError,
    Stepped,
    evolved,
    initialised,
    run_event,
    run_skip,
)
from koord.semantics.storage import Cell, Storage, Tree, unset
from koord.semantics.values import Rec
from koord.syntax import core
from koord.syntax.core import Home, PropertyKind
from koord.syntax.system import System
from koord.syntax.types import INT, ArrayType, BoolType, EnumType, IntType, RecordType, Type

T = TypeVar("T")

#: Integers that are tried where one is left open.
_INTS = range(-1, 4)


def every_value(type_: Type) -> list[Concrete]:
    match type_:
        case BoolType():
            return [False, True]
        case EnumType(members=members):
            return list(range(len(members)))
        case IntType():
            return list(_INTS)
        case RecordType(fields=fields):
            return [Rec(parts) for parts in product(*(every_value(f) for _, f in fields))]
        case _:
            raise AssertionError(f"too many values of {type_}")


# --- answers by brute force -----------------------------------------------------------------------


@dataclass(slots=True)
class _Guesses:
    """Answers in a fixed sequence; asking beyond it shows how far to go on."""

    script: list[int]
    sizes: list[int] = field(default_factory=list)
    noted: dict[object, Concrete] = field(default_factory=dict)

    def guess(self, where: object, values: list[Concrete]) -> Concrete:
        if where not in self.noted:
            position = len(self.sizes)
            self.sizes.append(len(values))
            chosen = self.script[position] if position < len(self.script) else 0
            if not values:
                raise IllegalStepError("CHOOSE", "nothing to choose from")
            self.noted[where] = values[chosen]
        return self.noted[where]

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        return self.guess((variable.home, variable.slot, robot), every_value(type_))

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        variable = port.declaration.variable
        return self.guess((robot, variable.slot), every_value(variable.type))

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _GuessingOracle(self, phase, robot)


@dataclass(slots=True)
class _GuessingOracle:
    guesses: _Guesses
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        assert type_ == INT
        assert isinstance(low, int)
        assert isinstance(high, int)
        values: list[Concrete] = list(range(low, max(low, high) + 1))
        answer = self.guesses.guess((self.phase, self.robot, key), values)
        assert not isinstance(answer, Rec)
        return answer  # type: ignore[return-value]

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        return self.guesses.guess((self.phase, self.robot, key), every_value(function.result.type))

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        raise AssertionError("summaries here speak of no type")

    def vouches_for(self, function: core.External) -> bool:
        return False


def every_outcome(step: Callable[[_Guesses], T]) -> Iterator[T]:
    """Every legal outcome of a step."""
    script: list[int] = []
    while True:
        guesses = _Guesses(script)
        with suppress(IllegalStepError):
            yield step(guesses)
        script = [*script, *[0] * (len(guesses.sizes) - len(script))][: len(guesses.sizes)]
        while script and script[-1] + 1 >= guesses.sizes[len(script) - 1]:
            script.pop()
        if not script:
            return
        script[-1] += 1


# --- the search -----------------------------------------------------------------------------------


@dataclass(slots=True)
class Seen:
    """What the exploration saw: the first round in which each claim was violated."""

    violated: dict[tuple[str, str], int] = field(default_factory=dict)
    states: int = 0
    depth: int = 0
    is_exhausted: bool = False


class TooMuchError(Exception):
    """The system is too large for this."""


class PlainSearch:
    """Looks at everything, up to a number of rounds; ``limit`` bounds the steps taken."""

    def __init__(
        self, system: System, properties: tuple[core.Property, ...], *, limit: int
    ) -> None:
        self.system = system
        self.properties = properties
        self.limit = limit
        self.steps = 0
        self.round = 0
        self.seen = Seen()
        self.looked_at: set[tuple[Configuration[Constant], bool]] = set()
        self.tracks_ran = "Ran(" in repr(properties)

    def run(self, rounds: int) -> Seen:
        frontier: dict[Configuration[Constant], None] = {}
        for first in self._initial():
            self._look(first, at_round=True)
            frontier[self._plain(first)] = None
        known = set(frontier)
        for self.round in range(1, rounds + 1):
            further: dict[Configuration[Constant], None] = {}
            for start in frontier:
                for after in self._round(start):
                    if after not in known:
                        known.add(after)
                        further[after] = None
            frontier = further
            if not frontier:
                self.seen.is_exhausted = True
                break
            self.seen.depth = self.round
        self.seen.states = len(known)
        return self.seen

    def _plain(self, c: Configuration[Constant]) -> Configuration[Constant]:
        """Without what no property reads and no rule: the round, ``ran``, values of unset atoms."""
        robots = []
        for r in c.robots:
            agent = self.system.program.agents[r.kind]
            ports = [port.declaration for port in agent.ports]
            plain = replace(
                r,
                ran=r.ran if self.tracks_ran else NO_EVENT,
                locals=self._plain_storages(agent.locals, r.locals),
                ports=self._plain_storages(ports, r.ports),
            )
            robots.append(plain)
        return replace(c, robots=tuple(robots), round=0)

    def _plain_storages(
        self, declared: Iterable[core.Declaration], stored: Iterable[Storage[Constant]]
    ) -> tuple[Storage[Constant], ...]:
        pairs = zip(declared, stored, strict=True)
        return tuple(self._plain_storage(s, d.variable.type) for d, s in pairs)

    def _plain_storage(self, storage: Storage[Constant], type_: Type) -> Storage[Constant]:
        """An unset atom holds the default of its type: a turn that reads it goes on to its end."""
        if isinstance(storage, Cell):
            return storage if storage.is_set else unset(EXACT, type_, self.system.robots)
        if isinstance(type_, RecordType):
            types = [field for _, field in type_.fields]
        else:
            assert isinstance(type_, ArrayType)
            types = [type_.element] * len(storage.parts)
        pairs = zip(storage.parts, types, strict=True)
        return Tree(tuple(self._plain_storage(part, t) for part, t in pairs))

    def _initial(self) -> Iterator[Configuration[Constant]]:
        for order in permutations(range(self.system.robots)):
            for stepped in every_outcome(partial(initialised, EXACT, self.system, order=order)):
                self._count()
                c = stepped.configuration
                conditions = [(a.condition, a.bound) for a in self.system.program.assumptions]
                if all(self._holds(e, bound, c) for e, bound in conditions):
                    if c.fault is not None:
                        self._note("fault", "")
                    else:
                        yield c

    def _count(self) -> None:
        self.steps += 1
        if self.steps > self.limit:
            raise TooMuchError

    def _holds(self, e: core.Expr, bound: int, c: Configuration[Constant]) -> bool:
        holds, _ = holds_in(EXACT, self.system, c, e, bound, _Guesses([]))
        return holds is True

    def _look(self, c: Configuration[Constant], *, at_round: bool) -> None:
        if (c, at_round) in self.looked_at:
            return
        self.looked_at.add((c, at_round))
        for p in self.properties:
            wanted = p.kind is PropertyKind.INVARIANT or at_round
            if wanted and not self._holds(p.condition, p.bound, c):
                self._note("property", p.name)

    def _note(self, subject: str, name: str) -> None:
        self.seen.violated.setdefault((subject, name), self.round)

    def _round(self, start: Configuration[Constant]) -> Iterator[Configuration[Constant]]:
        """Every end of a round: all orders, all events, one turn at a time."""
        reached, done = {start: None}, set()
        while reached:
            c, _ = reached.popitem()
            if c in done:
                continue
            done.add(c)
            if c.turn is Turn.ENV:
                yield from self._environment(c)
                continue
            for stepped in self._turns(c):
                self._count()
                after = stepped.configuration
                if after.fault is not None:
                    self._note("fault", "")
                else:
                    self._look(after, at_round=False)
                    reached[after] = None

    def _turns(self, c: Configuration[Constant]) -> Iterator[Stepped[Constant]]:
        for robot, state in enumerate(c.robots):
            if state.turn is not Turn.PROG:
                continue
            yield from every_outcome(partial(run_skip, EXACT, self.system, c, robot))
            for position in range(len(self.system.agent(robot).events)):
                if state.status != 2:
                    yield from every_outcome(
                        partial(run_event, EXACT, self.system, c, robot, position)
                    )

    def _environment(self, c: Configuration[Constant]) -> Iterator[Configuration[Constant]]:
        for stepped in every_outcome(partial(evolved, EXACT, self.system, c)):
            self._count()
            after = stepped.configuration
            if after.fault is not None:
                self._note("fault", "")
                continue
            for _, contract in stepped.promises:
                self._note("contract promise", contract.name)
            self._look(after, at_round=True)
            yield self._plain(after)
