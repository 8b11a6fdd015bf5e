"""Terms against the exact domain: what machine code computes of cells, and of constants alone.
[E-ARITH]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from random import Random
from typing import Any

import numpy as np
import pytest

from koord.semantics.domain import EXACT, Constant, Domain
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import dealt
from koord.syntax.types import BOOL, INT
from tests.agreement.triples import exact_steps, steps, triple
from tests.loading import program_of
from tests.sampling import blocks

pytest.importorskip("llvmlite")

from llvmlite import ir

from koord.kernels.assembling import Cells, Evaluation
from koord.kernels.layout import Layout
from koord.kernels.terms import Scalar, Term, TermDomain
from koord.machine.code import BYTES, I1, I64, Code, Loaded

#: An operator with what it is applied to; a constant; or a letter of a cell.
Recipe = Any

PROGRAM = """\
local:
    int a = 0
    int b = 0
    int c = 0
    bool p = false
    bool q = false
Go:
    pre: false
    eff: a = 0
"""

INTS, BOOLS = "abc", "pq"

#: Integers of every sign, and those next to where something changes.
VALUES = (-128, -7, -3, -2, -1, 0, 1, 2, 3, 7, 127)

ARITHMETIC = (
    BinaryOp.ADD,
    BinaryOp.SUB,
    BinaryOp.MUL,
    BinaryOp.DIV,
    BinaryOp.MOD,
    BinaryOp.MIN,
    BinaryOp.MAX,
)
ORDER = (BinaryOp.LT, BinaryOp.LE, BinaryOp.EQ, BinaryOp.NE)
LOGIC = (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES, BinaryOp.EQ, BinaryOp.NE)


def number(random: Random, depth: int) -> Recipe:
    """A recipe of an integer."""
    if depth == 0 or random.random() < 0.1:
        return random.choice((*INTS, random.choice(VALUES)))
    match random.randrange(6):
        case 0:
            return UnaryOp.NEG, number(random, depth - 1)
        case 1:
            return UnaryOp.ABS, number(random, depth - 1)
        case 2:
            return "ite", truth(random, depth - 1), *(number(random, depth - 1) for _ in range(2))
        case _:
            op = random.choice(ARITHMETIC)
            return op, number(random, depth - 1), number(random, depth - 1)


def truth(random: Random, depth: int) -> Recipe:
    """A recipe of a Boolean."""
    if depth == 0:
        return random.choice((*BOOLS, True, False))
    match random.randrange(5):
        case 0:
            return UnaryOp.NOT, truth(random, depth - 1)
        case 1:
            return "ite", *(truth(random, depth - 1) for _ in range(3))
        case 2:
            return random.choice(LOGIC), truth(random, depth - 1), truth(random, depth - 1)
        case _:
            return random.choice(ORDER), number(random, depth - 1), number(random, depth - 1)


def cooked(d: Domain[Any], recipe: Recipe, cells: Mapping[str, Any]) -> Any:
    """A recipe on a domain. What is divided by zero is divided by -3 instead."""
    match recipe:
        case str():
            return cells[recipe]
        case bool() | int():
            return recipe
    op, *parts = recipe
    done = [cooked(d, part, cells) for part in parts]
    match op:
        case "ite":
            return d.ite(*done)
        case UnaryOp():
            return d.unary(op, *done)
        case BinaryOp.DIV | BinaryOp.MOD:
            is_zero = d.binary(BinaryOp.EQ, done[1], 0)
            return d.binary(op, done[0], d.ite(is_zero, -3, done[1]))
        case _:
            return d.binary(op, *done)


class Machine:
    """Machine code of some terms of the five cells."""

    def __init__(self, recipes: list[Recipe]) -> None:
        layout = Layout(dealt(program_of(PROGRAM), 1), None, frozenset(), tracks_ran=False)
        self._cells = Cells(layout, 8)
        self._domain = TermDomain()
        self._letters = {
            letter: self._domain.cell(k, None if layout.cells[k].is_bool else (-128, 127))
            for k, letter in enumerate(INTS + BOOLS)
        }
        self.terms = [cooked(self._domain, recipe, self._letters) for recipe in recipes]
        module = ir.Module("terms")
        for k, term in enumerate(self.terms):
            self._write(module, f"term_{k}", term)
        self._loaded = Loaded(module)
        self._functions = [self._loaded.function(f"term_{k}", 1) for k in range(len(recipes))]

    def _write(self, module: Any, name: str, term: Scalar) -> None:
        code = Code(module, name, (BYTES,), I64)
        value = Evaluation(code, self._cells, code.arguments[0], ()).value(term)
        code.b.ret(code.b.zext(value, I64) if value.type == I1 else value)

    def run(self, term: int, cells: Mapping[str, Constant]) -> int:
        """What the code of a term gives."""
        state = np.zeros(self._cells.state_bytes, dtype=np.int8)
        state[: len(cells)] = [int(cells[letter]) for letter in INTS + BOOLS]
        return self._functions[term](state.ctypes.data)


def states(random: Random, most: int) -> Iterator[dict[str, Constant]]:
    """What cells may hold."""
    for _ in range(most):
        yield {
            **{letter: random.choice(VALUES) for letter in INTS},
            **{letter: random.random() < 0.5 for letter in BOOLS},
        }


def check(recipes: list[Recipe], random: Random, most: int) -> None:
    """Machine code of each recipe gives what the exact domain gives, and is within its range."""
    machine = Machine(recipes)
    for k, recipe in enumerate(recipes):
        term = machine.terms[k]
        for cells in states(random, most):
            expected = cooked(EXACT, recipe, cells)
            assert machine.run(k, cells) == int(expected), (recipe, cells)
            if isinstance(term, Term) and not term.is_bool:
                assert term.low is not None
                assert term.high is not None
                assert term.low <= expected <= term.high, (recipe, cells)
            elif not isinstance(term, Term):
                assert term == expected, (recipe, cells)


def test_each_operator_on_numbers_of_every_sign() -> None:
    recipes: list[Recipe] = [(op, "a", "b") for op in (*ARITHMETIC, *ORDER)]
    recipes += [(op, "a", k) for op in (*ARITHMETIC, *ORDER) for k in (-128, -3, 2, 127)]
    recipes += [(op, "p", "q") for op in LOGIC] + [(UnaryOp.NOT, "p")]
    recipes += [(op, "a") for op in (UnaryOp.NEG, UnaryOp.ABS)]
    check(recipes, Random(1), 150)


@pytest.mark.parametrize("seeds", blocks(2, of=8, count=2))
def test_machine_code_of_generated_expressions(seeds: range) -> None:
    for seed in seeds:
        random = Random(seed)
        recipes = [random.choice((number, truth))(random, 3) for _ in range(60)]
        check(recipes, random, 60)


def test_an_order_that_ranges_settle_is_strict_or_not() -> None:
    """Of numbers whose ranges touch nothing is known but what holds of both ends."""
    d = TermDomain()
    low, high = d.cell(0, (0, 3)), d.cell(1, (3, 5))
    assert d.binary(BinaryOp.LE, low, high) is True
    assert isinstance(d.binary(BinaryOp.LT, low, high), Term)
    assert isinstance(d.binary(BinaryOp.LE, high, low), Term)
    assert d.binary(BinaryOp.LT, high, low) is False


@pytest.mark.parametrize("seeds", blocks(10, of=100, count=4))
def test_the_sequential_rules_agree(seeds: range) -> None:
    """Constants in, constants out."""
    d: Any = TermDomain()
    for seed in seeds:
        t = triple(seed)
        assert repr(list(steps(d, t))) == repr(exact_steps(t)), f"seed {seed}"


def test_constants_stand_for_themselves() -> None:
    d = TermDomain()
    assert d.const(3, INT) == 3
    assert d.known(d.const(True, BOOL)) is True
    assert d.known(d.cell(0, None)) is None
