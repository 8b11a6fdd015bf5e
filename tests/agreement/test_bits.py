"""The domain of bits against the exact domain: constants in, and bits in with values for them.

Every scalar of a configuration and of the inputs becomes bits of a range that its value lies in;
one turn is evaluated on them; then the graph is evaluated where the bits are those of the value.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction
from random import Random
from typing import Any, cast

import pytest

from koord.semantics.domain import EXACT, Constant
from koord.semantics.environment import environment_turn
from koord.semantics.every_number import NotFiniteError
from koord.semantics.oracle import Inputs
from koord.semantics.properties import holds_in
from koord.semantics.turns import committed, program_turn
from koord.syntax import core
from koord.syntax.types import (
    BOOL,
    BoolType,
    EnumType,
    OpaqueType,
    StreamType,
    StringType,
    Type,
)
from koord.verify.encoding.terms import Term
from koord.verify.engines.bits import numbers
from koord.verify.engines.bits.domain import BitDomain, Bits
from koord.verify.engines.bits.found_runs import Assignment, ValueNames
from koord.verify.engines.bits.numbers import Number
from tests.agreement.flattening import flat_evolved, flat_turned, itself
from tests.agreement.symbols import Asked, Symbols
from tests.agreement.triples import Triple, exact_steps, steps, triple
from tests.generators.configurations import configuration
from tests.generators.runs import RandomInputs
from tests.sampling import first

BLOCK = 120


class OpenError(Exception):
    """Something is not kept exactly, so that there is no value to compare."""


@dataclass(slots=True)
class BitSymbols(Symbols):
    """Fresh bits with what each stands for."""

    given: dict[int, bool] = field(default_factory=dict)

    @property
    def bits(self) -> BitDomain:
        return cast(BitDomain, self.d)

    def scalar(self, concrete: Constant, type_: Type) -> Term:
        d = self.bits
        if isinstance(type_, OpaqueType) or self.random.random() >= self.share:
            return cast(Term, d.const(concrete, type_))
        made: Bits
        match type_:
            case BoolType():
                made = d.fresh("s", type_)
                self._assign(tuple(made)[:1] if isinstance(made, tuple) else (), int(concrete))
                return cast(Term, made)
            case EnumType(members=members):
                made = d.between("s", 0, len(members) - 1)
                number = int(cast(int, concrete))
            case StringType() | StreamType():
                number = d.number(concrete).low
                made = d.between("s", max(0, number - 2), number + 1)
            case _:
                assert isinstance(concrete, int | Fraction)
                number, scale = concrete.numerator, concrete.denominator
                low = number - self.random.choice((0, 1, 2, 5))
                high = number + self.random.choice((0, 1, 3))
                is_int = isinstance(concrete, int)
                made = numbers.settled(d.vector("s", low, high, 0 if is_int else scale))
        if isinstance(made, Number):
            self._assign(made.literals, number)
        return cast(Term, made)

    def _assign(self, literals: tuple[Any, ...], number: int) -> None:
        for k, literal in enumerate(literals):
            if literal > 1:
                self.given[literal >> 1] = bool((number >> k) & 1)


@dataclass(slots=True)
class Meaning:
    """What bits come to under an assignment."""

    symbols: BitSymbols
    step: Assignment | None = None

    def __call__(self, value: Any, type_: Type) -> Constant:
        d = self.symbols.bits
        if d.is_inexact():
            raise OpenError
        if self.step is None:
            self.step = Assignment(d, self.symbols.given, ValueNames(d.opaques), 0)
        if not isinstance(value, tuple) and isinstance(type_, StringType | StreamType):
            return cast(Constant, value)
        return self.step.scalar(cast(Bits, value), type_)


class Comparison:
    """One triple on both domains."""

    def __init__(self, t: Triple) -> None:
        self.t = t
        self.random = Random(t.seed)
        share = self.random.choice((1.0, 0.7, 0.4))
        d = cast(Any, BitDomain())
        self.symbols = BitSymbols(d, self.random, t.system.robots, share)
        self.start = self.symbols.configuration(t.system, t.start)
        self.recorded = RandomInputs(self.random, t.system.robots, {})
        self.recorded.answers.update(((a.phase, a.robot, a.key), a) for a in t.round.answers)
        self.recorded.readings.update(((r.robot, r.slot), r) for r in t.round.readings)
        self.asked: Inputs[Term] = Asked(
            self.symbols, {}, self.recorded.readings, self.recorded.answers
        )

    def program_turn(self, robot: int, position: int) -> None:
        t, d = self.t, self.symbols.d
        other = configuration(self.random, t.system).store
        state = t.start.robots[robot]
        selectable, exact = program_turn(EXACT, t.system, robot, state, position, self.recorded)
        after = committed(EXACT, other, exact)
        found = program_turn(d, t.system, robot, self.start.robots[robot], position, self.asked)
        found_after = committed(d, self.symbols.store(t.system, other), found[1])
        meaning = Meaning(self.symbols)
        assert meaning(found[0], BOOL) == selectable
        assert flat_turned(meaning, t.system, robot, found[1], found_after) == flat_turned(
            itself, t.system, robot, exact, after
        )

    def environment_turn(self, robot: int) -> None:
        t, d = self.t, self.symbols.d
        exact = environment_turn(EXACT, t.system, robot, t.start.robots[robot], self.recorded)
        found = environment_turn(d, t.system, robot, self.start.robots[robot], self.asked)
        meaning = Meaning(self.symbols)
        assert flat_evolved(meaning, t.system, robot, found) == flat_evolved(
            itself, t.system, robot, exact
        )

    def property(self, p: core.Property) -> None:
        t = self.t
        exact, _ = holds_in(EXACT, t.system, t.start, p.condition, p.bound, self.recorded)
        found, _ = holds_in(self.symbols.d, t.system, self.start, p.condition, p.bound, self.asked)
        assert Meaning(self.symbols)(found, BOOL) == exact, p.name


def compare(seed: int) -> Counter[str]:
    """Compare all turns and properties of a triple, each on a graph of its own."""
    t = triple(seed)
    count: Counter[str] = Counter()
    robots = range(t.system.robots)
    tasks: list[tuple[str, Any]] = [("environment_turn", (i,)) for i in robots]
    tasks += [
        ("program_turn", (i, k)) for i in robots for k in range(len(t.system.agent(i).events))
    ]
    tasks += [("property", (p,)) for p in t.system.program.properties]
    for name, arguments in tasks:
        try:
            getattr(Comparison(t), name)(*arguments)
            count[name] += 1
        except OpenError:
            count["open"] += 1
        except NotFiniteError:
            count["not finite"] += 1
        except AssertionError as error:
            raise AssertionError(f"seed {seed}, {name} {arguments}: {error}") from error
    return count


@pytest.mark.parametrize("block", first(1, range(2)))
def test_constants_in_constants_out(block: int) -> None:
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        t = triple(seed)
        found = list(steps(cast(Any, BitDomain()), t))
        assert repr(found) == repr(exact_steps(t)), f"seed {seed}"


@pytest.mark.parametrize("block", first(1, range(3)))
def test_turns_and_properties_agree(block: int) -> None:
    count: Counter[str] = Counter()
    for seed in range(600_000 + block * BLOCK // 2, 600_000 + (block + 1) * BLOCK // 2):
        count += compare(seed)
    assert count["program_turn"] >= 100, count
    assert count["environment_turn"] >= 80, count
    assert count["property"] >= 30, count
    assert count["open"] < count.total() // 4, count


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4))
def test_turns_and_properties_agree_on_many(block: int) -> None:
    for seed in range(610_000 + block * 500, 610_500 + block * 500):
        compare(seed)
