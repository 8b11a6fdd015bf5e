"""Quantifiers and sums over as many numbers as there are robots. [T-SUM]"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from math import factorial, lcm
from typing import assert_never

from msgspec.structs import replace

from koord.recheck import all_robots
from koord.recheck.body import RunningBody
from koord.recheck.sorts import NotRecheckedError, Value
from koord.recheck.terms import INT, Term, Terms, subterms
from koord.recheck.values import Sum, Values
from koord.syntax import core
from koord.syntax.core import QuantifierKind
from koord.syntax.types import MapType, Type, contains


def quantified(body: RunningBody, e: core.Quantified) -> Term:
    slot, universal = e.variable.slot, e.quantifier is QuantifierKind.FORALL
    if isinstance(e.domain, core.AllValues):
        return every_value(body, e, e.domain.type)
    if all_robots.is_open(body, e.domain):
        return all_robots.quantified(body, e)
    result = body.t.truth(universal)
    for value in instances(body, e):
        # What is decided already is not looked at, and cannot fault.
        undecided = result if universal else body.t.negation(result)
        body.bound[slot] = body.s.stored(value, e.variable.type)
        with body.where(undecided):
            holds = body.condition(e.body)
        result = body.t.both(result, holds) if universal else body.t.either(result, holds)
    return result


def instances(body: RunningBody, e: core.Quantified) -> list[Value]:
    match e.domain:
        case core.RobotRange(agent=agent):
            kinds = body.world.kinds
            return [body.t.integer(i) for i, k in enumerate(kinds) if agent in (None, k)]
        case core.IntRange(low=low, high=high):
            return [body.t.integer(k) for k in fixed_range(body, low, high)]
        case core.Elements(sequence=over):
            return list(body.items(body.value(over), e.span))
        case core.AllValues():
            raise AssertionError("has no list of values")
    assert_never(e.domain)


def fixed_range(body: RunningBody, low: core.Expr, high: core.Expr) -> range:
    start, end = body.condition(low).value, body.condition(high).value
    if start is None or end is None:
        where = low if start is None else high
        raise NotRecheckedError(
            "a range whose bounds are not fixed by the text is not rechecked", where.span
        )
    return range(int(start), int(end))


def every_value(body: RunningBody, e: core.Quantified, type_: Type) -> Term:
    """Evaluate a quantifier over all values of a type, in a summary."""
    assert e.quantifier is QuantifierKind.FORALL
    if contains(type_, MapType):
        raise NotRecheckedError("statements about all maps are not rechecked", e.span)
    binders: list[Term] = []
    body.bound[e.variable.slot] = body.s.stored(
        binder(body, e.variable.name, type_, binders), type_
    )
    with body.v.scoped((*body.v.scope, *binders)):
        holds = body.statement(e.body)
    ranges = [b for x in binders for b in body.v.bounds(x, type_)]
    return body.t.for_all(binders, body.t.implies(body.t.conjunction(ranges), holds))


def binder(body: RunningBody, name: str, type_: Type, binders: list[Term]) -> Value:
    """Introduce bound variables for a value of a quantifier."""
    parts = body.v.parts(type_)
    if parts is not None:
        return tuple(binder(body, name + label, part, binders) for label, part in parts)
    symbol = body.t.symbol(f"?{name}", body.v.sort(type_))
    binders.append(symbol)
    return symbol


#: Parts are recognised as polynomials of their number up to this degree.
_MOST_DEGREE = 3


def total(v: Values, low: Term, high: Term, index: Term, part: Term) -> Term:
    """The sum of ``part``, in which ``index`` is free, for indices in ``[low, high)``.

    What depends on the variables of quantifiers is a function of them.
    """
    t = v.t
    free = t.free(part)
    used = tuple(x for x in v.scope if x.head in free)
    ends = t.free(low) | t.free(high)
    if any(x.head in ends for x in v.scope) or any(x.sort != INT for x in used):
        return v.symbol("sum", part.sort)  # what hangs on more is not compared with anything
    names = tuple(t.symbol(f"?robot {k} of a sum", INT) for k in range(len(used)))
    for old, new in zip(used, names, strict=True):
        part = t.put(part, old, new)
    known = next((one for one in v.sums if _is_alike(t, one, low, high, index, part)), None)
    if known is None:
        known = _met(v, Sum(_symbol(v, names, part), low, high, index, part, names))
    found = known.total
    for old, new in zip(names, used, strict=True):
        found = t.put(found, old, new)
    return found


def _is_alike(t: Terms, one: Sum, low: Term, high: Term, index: Term, part: Term) -> bool:
    return (one.low, one.high, t.put(one.part, one.index, index)) == (low, high, part)


def _symbol(v: Values, names: tuple[Term, ...], part: Term) -> Term:
    with v.scoped(names):
        return v.symbol("sum", part.sort)


def _met(v: Values, made: Sum) -> Sum:
    """Say what is known of a sum, and of it and others over the same range."""
    t = v.t
    v.ranges += [t.for_all(made.names, axiom) for axiom in _alone(t, made)]
    for other in v.sums:
        if (
            other.low is not made.low
            or other.high is not made.high
            or other.total.sort != made.total.sort
        ):
            continue
        if len(other.names) == len(made.names):
            pairs = [_at_most(t, other, made), _at_most(t, made, other)]
            if not made.names:
                pairs += [_compared(t, other, made), *_together(t, other, made)]
            v.ranges += [t.for_all(made.names, axiom) for axiom in pairs]
    if made.names:
        others = tuple(t.symbol(f"?other robot {k} of a sum", INT) for k in range(len(made.names)))
        twin = made
        for old, new in zip(made.names, others, strict=True):
            twin = replace(twin, total=t.put(twin.total, old, new), part=t.put(twin.part, old, new))
        v.ranges += [t.for_all((*made.names, *others), a) for a in _together(t, made, twin)]
    v.sums.append(made)
    return made


def _inside(t: Terms, one: Sum, index: Term) -> Term:
    return t.both(t.at_most(one.low, index), t.less(index, one.high))


def _every(t: Terms, one: Sum, holds: Term) -> Term:
    return t.for_all([one.index], t.implies(_inside(t, one, one.index), holds))


def _alone(t: Terms, one: Sum) -> Iterator[Term]:
    """Yield axioms of one sum: all parts are zero, or a polynomial, or at most that."""
    yield _naturally(t, one)
    nothing = t.minus(one.part, one.part)
    yield t.implies(_every(t, one, t.equal(one.part, nothing)), t.equal(one.total, nothing))
    ahead = t.at_most(one.low, one.high)
    for piece, whole in _polynomials(t, one):
        whole_sum = t.minus(_at(t, whole, one.high, one), _at(t, whole, one.low, one))
        scale = _denominator(whole)
        scaled = t.times(_number(t, scale, one), one.total)
        same = _every(t, one, t.equal(one.part, piece))
        below = _every(t, one, t.at_most(one.part, piece))
        reached = t.equal(scaled, whole_sum)
        yield t.implies(t.both(ahead, same), reached)
        yield t.implies(t.both(ahead, below), t.at_most(scaled, whole_sum))
        yield t.implies(t.conjunction([ahead, below, reached]), same)


def _naturally(t: Terms, one: Sum) -> Term:
    """A part is at most the sum, where none is negative."""
    nothing, some = t.minus(one.part, one.part), t.bound(0)
    natural = _every(t, one, t.at_most(nothing, one.part))
    part = t.put(one.part, one.index, some)
    known = t.both(_inside(t, one, some), natural)
    return t.for_all([some], t.implies(known, t.at_most(part, one.total)))


def _at_most(t: Terms, one: Sum, two: Sum) -> Term:
    """A sum is at most another, if each of its parts is."""
    below = _every(t, one, t.at_most(one.part, t.put(two.part, two.index, one.index)))
    return t.implies(below, t.at_most(one.total, two.total))


def _together(t: Terms, one: Sum, two: Sum) -> Iterator[Term]:
    """Two sums are together at most that of a number, if their parts are."""
    other = t.put(two.part, two.index, one.index)
    pieces = dict.fromkeys(p for s in (one, two) for p, _ in _polynomials(t, s) if p.value)
    for piece in pieces:
        below = _every(t, one, t.at_most(t.plus(one.part, other), piece))
        times = t.times(piece, t.minus(*_ends(t, one)))
        known = t.both(t.at_most(one.low, one.high), below)
        yield t.implies(known, t.at_most(t.plus(one.total, two.total), times))


def _ends(t: Terms, one: Sum) -> tuple[Term, Term]:
    """The ends of a sum's range, the higher first, as numbers like its parts."""
    if one.part.sort == INT:
        return one.high, one.low
    return t.widened(one.high), t.widened(one.low)


def _compared(t: Terms, one: Sum, two: Sum) -> Term:
    """Axioms of two sums: if they differ in one part, the sums differ as that part does."""
    changed, index = t.bound(0), t.bound(1)

    def at(s: Sum, k: Term) -> Term:
        return t.put(s.part, s.index, k)

    elsewhere = t.either(t.equal(index, changed), t.equal(at(one, index), at(two, index)))
    alike = t.for_all([index], t.implies(_inside(t, one, index), elsewhere))
    grown = t.minus(two.total, one.total)
    change = t.minus(at(two, changed), at(one, changed))
    known = t.both(_inside(t, one, changed), alike)
    return t.for_all([changed], t.implies(known, t.equal(grown, change)))


# --- polynomials, by coefficients from the constant on --------------------------------------------


def _polynomials(t: Terms, one: Sum) -> Iterator[tuple[Term, tuple[Fraction, ...]]]:
    """Polynomials of the index in the part, with their sums."""
    for piece in subterms([one.part]):
        if piece.sort != one.part.sort or piece.value == 0 or not _is_polynomial(piece, one.index):
            continue
        values = [t.put(piece, one.index, t.integer(n)).value for n in range(_MOST_DEGREE + 1)]
        if all(value is not None for value in values):
            yield piece, _summed([Fraction(value) for value in values if value is not None])


def _is_polynomial(piece: Term, index: Term) -> bool:
    """Return whether a term is a polynomial of its index of degree at most ``_MOST_DEGREE``."""
    return _degree(piece, index) <= _MOST_DEGREE


def _degree(piece: Term, index: Term) -> int:
    if piece is index:
        return 1
    if piece.value is not None:
        return 0
    below = [_degree(a, index) for a in piece.args]
    if piece.head == "to_real" and below:
        return below[0]
    if piece.head in ("+", "-") and below:
        return max(below)
    if piece.head == "*" and below:
        return sum(below)
    return _MOST_DEGREE + 1


def _summed(values: list[Fraction]) -> tuple[Fraction, ...]:
    """The polynomial V with V(0) = 0 whose steps V(n + 1) - V(n) have these values at 0, 1, 2, …"""
    made = [Fraction(0)] * (len(values) + 2)
    differences = list(values)
    for k in range(len(values)):
        # The k-th difference counts n over k + 1 times.
        for power, c in enumerate(_choose(k + 1)):
            made[power] += differences[0] * c
        differences = [b - a for a, b in pairwise(differences)]
    return tuple(made)


def _choose(k: int) -> list[Fraction]:
    """The polynomial n over k."""
    made = [Fraction(1)]
    for root in range(k):
        shifted = [Fraction(0), *made]
        made = [a - root * b for a, b in zip(shifted, [*made, Fraction(0)], strict=True)]
    return [c / factorial(k) for c in made]


def _denominator(polynomial: tuple[Fraction, ...]) -> int:
    return lcm(*(c.denominator for c in polynomial))


def _number(t: Terms, value: Fraction | int, one: Sum) -> Term:
    return t.integer(int(value)) if one.part.sort == INT else t.real(Fraction(value))


def _at(t: Terms, polynomial: tuple[Fraction, ...], index: Term, one: Sum) -> Term:
    """The value of a polynomial, times its denominator."""
    scale = _denominator(polynomial)
    x = index if one.part.sort == INT else t.widened(index)
    power, value = _number(t, 1, one), _number(t, 0, one)
    for c in polynomial:
        value = t.plus(value, t.times(_number(t, c * scale, one), power))
        power = t.times(power, x)
    return value
