"""Vectors of literals against Python's integers and fractions, value by value."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import product

import pytest

from koord.semantics.domain import EXACT, Constant
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import INT
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits
from koord.verify.engines.bits.graph import FALSE, Graph
from koord.verify.engines.bits.numbers import Number, lifted, width

RANGES = [(-3, 4), (0, 5), (-6, -1), (2, 2), (-1, 0)]

COMPARED = {BinaryOp.EQ, BinaryOp.NE, BinaryOp.LT, BinaryOp.LE}
CALCULATED = [op for op in BinaryOp if op not in (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES)]


def value_of(d: BitDomain, value: Bits, given: dict[int, bool]) -> object:
    """What a scalar is where inputs are as given; its range has to be right."""
    if isinstance(value, Bit):
        return d.graph.values([value.literal], given)[0]
    if not isinstance(value, Number):
        return value
    assert value.loose == FALSE
    assert len(value.literals) == width(value.low, value.high)
    bits = d.graph.values(value.literals, given)
    whole = sum(1 << k for k, bit in enumerate(bits) if bit) - (bits[-1] << len(bits))
    assert value.low <= whole <= value.high
    return Fraction(whole, value.scale) if value.scale else whole


def assigned(d: BitDomain, number: Bits, value: int) -> dict[int, bool]:
    literals = number.literals if isinstance(number, Number) else ()
    return {x >> 1: bool((value >> k) & 1) for k, x in enumerate(literals) if x > 1}


@pytest.mark.parametrize("op", CALCULATED, ids=lambda op: op.name)
@pytest.mark.parametrize("scale", [0, 3])
def test_operators(op: BinaryOp, scale: int) -> None:
    if op is BinaryOp.MOD and scale:
        return
    for first, second in product(RANGES, RANGES):
        d = BitDomain()
        a = d.vector("a", *first, scale) if first[0] < first[1] else lifted(first[0])
        b = d.vector("b", *second, scale and 2) if second[0] < second[1] else lifted(second[0])
        if scale:
            a, b = a._replace(scale=scale), b._replace(scale=2)
        if op is BinaryOp.DIV and scale:  # by what is known, for else it is not kept
            b = lifted(Fraction(second[0], 2))
            second = (second[0], second[0])
        found = d.binary(op, a, b)
        for x, y in product(range(first[0], first[1] + 1), range(second[0], second[1] + 1)):
            given = assigned(d, a, x) | assigned(d, b, y)
            one, two = (Fraction(x, scale), Fraction(y, 2)) if scale else (x, y)
            assert value_of(d, found, given) == EXACT.binary(op, one, two), (x, y, first, second)


@pytest.mark.parametrize("op", [UnaryOp.NEG, UnaryOp.ABS, UnaryOp.WIDEN], ids=lambda op: op.name)
def test_unary_operators(op: UnaryOp) -> None:
    for low, high in RANGES:
        d = BitDomain()
        number = d.between("a", low, high)
        found = d.unary(op, number)
        for x in range(low, high + 1):
            assert value_of(d, found, assigned(d, number, x)) == EXACT.unary(op, x)


def test_few_bits_tell_a_value_from_all_others_of_a_range() -> None:
    for low, high in [*RANGES, (-1, 9), (3, 12), (-8, 7), (0, 300)]:
        for value in range(low, high + 1):
            d = BitDomain()
            number = d.between("a", low, high)
            found = d.binary(BinaryOp.EQ, value, number)
            for x in range(low, high + 1) if high < 100 else (low, value, high):
                assert value_of(d, found, assigned(d, number, x)) == (x == value), (x, value)
    d = BitDomain()
    number = d.between("a", -1, 9)
    assert isinstance(number, Number)
    assert d.binary(BinaryOp.EQ, number, -1) == Bit(number.literals[-1])


def test_choices() -> None:
    for first, second in product(RANGES, RANGES):
        d = BitDomain()
        a, b = d.between("a", *first), d.between("b", *second)
        condition = d.graph.input("c")
        found = d.ite(Bit(condition), a, b)
        for x, y in product(range(first[0], first[1] + 1), range(second[0], second[1] + 1)):
            given = assigned(d, a, x) | assigned(d, b, y)
            assert value_of(d, found, given | {condition >> 1: True}) == x
            assert value_of(d, found, given | {condition >> 1: False}) == y


def test_a_fresh_number_keeps_to_its_range() -> None:
    for low, high in RANGES:
        d = BitDomain()
        number = d.between("a", low, high)
        if not isinstance(number, Number):
            continue
        inputs = [x >> 1 for x in number.literals if x > 1]
        allowed = set()
        for bits in product((False, True), repeat=len(inputs)):
            given = dict(zip(inputs, bits, strict=True))
            if all(d.graph.values(d.required, given)):
                allowed.add(value_of(d, number, given))
        assert allowed == set(range(low, high + 1))


def loose(d: BitDomain, name: str) -> Bits:
    return d.fresh(name, INT)


@pytest.mark.parametrize(
    "change",
    [
        lambda d, x: d.binary(BinaryOp.ADD, x, x),
        lambda d, x: d.unary(UnaryOp.NEG, x),
        lambda d, x: d.unary(UnaryOp.ABS, x),
        lambda d, x: d.binary(BinaryOp.MUL, x, 2),
        lambda d, x: loose(d, "another"),
    ],
)
def test_what_is_calculated_from_any_number_may_differ_from_it(
    change: Callable[[BitDomain, Bits], Bits],
) -> None:
    d = BitDomain()
    x = loose(d, "x")
    assert d.known(d.binary(BinaryOp.EQ, x, x)) is True
    assert d.known(d.binary(BinaryOp.EQ, x, change(d, x))) is None


def test_comparisons_with_any_number_are_open_but_the_same_each_time() -> None:
    d = BitDomain()
    x = loose(d, "x")
    less, more = d.binary(BinaryOp.LT, x, 3), d.binary(BinaryOp.LE, 3, x)
    assert d.known(less) is None
    assert d.binary(BinaryOp.LT, x, 3) == less
    assert d.unary(UnaryOp.NOT, more) == less


def test_constraints_tell_ranges() -> None:
    d = BitDomain()
    x = loose(d, "x")
    above = d.binary(BinaryOp.LE, -2, x)
    below = d.binary(BinaryOp.OR, d.binary(BinaryOp.LT, x, 3), d.binary(BinaryOp.EQ, x, 7))
    both = d.binary(BinaryOp.AND, above, below)
    assert isinstance(both, Bit)
    assert d.learned(both.literal) == {"x": (-2, 7)}


def test_a_graph_keeps_each_conjunction_once() -> None:
    g = Graph()
    a, b, c = g.input("a"), g.input("b"), g.input("c")
    assert g.both(a, b) == g.both(b, a)
    assert g.both(a, a ^ 1) == FALSE
    assert g.both(a, g.both(a, b)) == g.both(a, b)
    assert g.both(a, g.both(a, b) ^ 1) == g.both(a, b ^ 1)
    assert g.choose(c, a, a ^ 1) == g.differ(c, a) ^ 1
    for literals in product((False, True), repeat=3):
        given = dict(zip((a >> 1, b >> 1, c >> 1), literals, strict=True))
        x, y, z = literals
        made = [g.choose(a, b, c), g.differ(a, b), g.either(a, c), g.choose(a, a, c)]
        assert g.values(made, given) == [y if x else z, x != y, x or z, x or z]


def _wide(d: BitDomain, p: Bits) -> list[tuple[Bits, tuple[Constant, Constant]]]:
    """Scalars, some of them too wide to be kept, with what they are where ``p`` holds and not."""
    plain: list[tuple[Bits, tuple[Constant, Constant]]] = []
    for one, other in [
        (1, 3),
        (2**45, 0),
        (2**60, 0),
        (2**60, -(2**60)),
        (2**60, 2**60 + 1),
        (-(2**47), 5),
        (2**200, 2),
    ]:
        plain.append((d.ite(p, one, other), (one, other)))
        plain.append((one, (one, one)))
    half, third = Fraction(2**50, 2), Fraction(2**50, 3)
    plain += [(d.ite(p, half, third), (half, third)), (third, (third, third))]
    return plain


@pytest.mark.parametrize("op", CALCULATED, ids=lambda op: op.name)
def test_numbers_too_wide_to_be_kept_are_never_mistaken_for_others(op: BinaryOp) -> None:
    """Whatever a comparison says of them, what is so is allowed."""
    d = BitDomain()
    choice = d.graph.input("p")
    wide = _wide(d, Bit(choice))
    kept = 0
    for (a, xs), (b, ys) in product(wide, wide):
        if op is BinaryOp.MOD and any(isinstance(x, Fraction) for x in (*xs, *ys)):
            continue
        made = d.binary(op, a, b)
        truths = [EXACT.binary(op, x, y) for x, y in zip(xs, ys, strict=True)]
        if op in COMPARED:
            assert admits(d, made, choice, truths), (op, xs, ys)
            continue
        for compare, (c, zs) in product((BinaryOp.EQ, BinaryOp.LE), wide[::3]):
            found = d.binary(compare, made, c)
            expected = [EXACT.binary(compare, x, z) for x, z in zip(truths, zs, strict=True)]
            assert admits(d, found, choice, expected), (op, xs, ys, compare, zs)
            kept += found is True or found is False
    assert op in COMPARED or kept > 100


@pytest.mark.parametrize("op", [UnaryOp.NEG, UnaryOp.ABS], ids=lambda op: op.name)
def test_signs_of_numbers_too_wide_to_be_kept(op: UnaryOp) -> None:
    d = BitDomain()
    choice = d.graph.input("p")
    wide = _wide(d, Bit(choice))
    for (a, xs), (c, zs) in product(wide, wide):
        found = d.binary(BinaryOp.LE, d.unary(op, a), c)
        truths = zip([EXACT.unary(op, x) for x in xs], zs, strict=True)
        assert admits(d, found, choice, [EXACT.binary(BinaryOp.LE, x, z) for x, z in truths])


def admits(d: BitDomain, found: Bits, choice: int, truths: list[Constant]) -> bool:
    """Whether a Boolean may be what it should be where the choice holds, and where not."""
    if not isinstance(found, Bit):
        return truths == [found, found]
    always = {x >> 1: True for x in d.required}
    inputs = {x for x in d.graph.cone([found.literal]) if d.graph.is_input(x)}
    free = sorted(inputs - always.keys() - {choice >> 1})
    for here, truth in zip((True, False), truths, strict=True):
        given = always | {choice >> 1: here}
        values = {
            d.graph.values([found.literal], given | dict(zip(free, bits, strict=True)))[0]
            for bits in product((False, True), repeat=len(free))
        }
        if truth not in values:
            return False
    return True
