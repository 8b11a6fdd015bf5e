"""Terms and lists: folded as they are made, and as the solver has them, they are the same."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import pytest

from koord.recheck.obligations import conjuncts
from koord.recheck.script import Script
from koord.recheck.solving import SolverAnswer, SolverSession, plain
from koord.recheck.sorts import Value
from koord.recheck.terms import INT, Term, Terms
from koord.recheck.values import Values
from koord.syntax.types import INT as INTEGER
from koord.syntax.types import ListType, RecordType
from tests.sampling import first

pytest.importorskip("cvc5")

INTS = ListType(INTEGER)
PAIR = RecordType("Pair", (("a", INTEGER), ("b", INTEGER)))


def follows(values: Values, facts: list[Term], goal: Term) -> bool:
    """Whether the solver shows a goal from facts."""
    script, commands = Script(), list[str]()
    for term in [*facts, values.t.negation(goal)]:
        definitions, text = script.text(term)
        commands += [*definitions, f"(assert {text})"]
    with SolverSession.start() as session:
        session.tell([*values.declarations, *commands])
        return session.check() is SolverAnswer.UNSAT


@pytest.mark.parametrize("divisor", [-3, -2, -1, 1, 2, 3])
def test_division_rounds_down_and_the_remainder_has_the_sign_of_the_divisor(divisor: int) -> None:
    t = Terms()
    values = Values(t, 2)
    x, y = values.symbol("x", INT), values.symbol("y", INT)
    goals, facts = [], [t.equal(y, t.integer(divisor))]
    for k in range(-7, 8):
        assert t.floored(t.integer(k), t.integer(divisor)) is t.integer(k // divisor)
        assert t.remainder(t.integer(k), t.integer(divisor)) is t.integer(k % divisor)
        for d in (y, t.integer(divisor)):
            same = t.both(
                t.equal(t.floored(x, d), t.integer(k // divisor)),
                t.equal(t.remainder(x, d), t.integer(k % divisor)),
            )
            goals.append(t.implies(t.equal(x, t.integer(k)), same))
    assert follows(values, facts, t.conjunction(goals))


@pytest.mark.parametrize("robots", first(1, [1, 2, 3]))
def test_places_in_a_ring_are_what_is_left_of_a_division(robots: int) -> None:
    """Of any number of robots: of what goes round once, and all are numbers of robots."""
    known = Values(Terms(), robots)
    for number in range(-2 * robots, 3 * robots):
        assert known.around(known.t.integer(number)).value == number % robots
    t = Terms()
    values = Values(t, None)
    x, count = values.symbol("x", INT), values.count
    place = values.around(x)
    facts = [*values.ranges, t.equal(count, t.integer(robots))]
    for number in range(-robots, 2 * robots):
        there = t.equal(place, t.integer(number % robots))
        assert follows(values, facts, t.implies(t.equal(x, t.integer(number)), there))
    assert follows(values, values.ranges, values.is_robot(place))
    for number in (-robots - 1, 2 * robots):
        if robots > 1:
            there = t.equal(place, t.integer(number % robots))
            assert not follows(values, facts, t.implies(t.equal(x, t.integer(number)), there))


def test_a_term_made_twice_is_one() -> None:
    t = Terms()
    x = t.symbol("x", INT)
    assert t.plus(x, t.integer(1)) is t.plus(x, t.integer(1))
    assert t.both(t.less(x, x), t.truth(True)) is t.truth(False)
    assert t.either(t.less(x, t.integer(1)), t.negation(t.less(x, t.integer(1)))).value is True
    assert t.quotient(t.real(Fraction(1)), t.real(Fraction(3))).value == Fraction(1, 3)


def test_cases_are_the_parts_of_what_is_to_be_shown() -> None:
    t = Terms()
    a, b, c = (t.symbol(name, "Bool") for name in "abc")
    assert conjuncts(t, t.both(a, t.either(b, c))) == [a, t.either(b, c)]
    assert conjuncts(t, t.implies(a, t.both(b, c))) == [t.implies(a, b), t.implies(a, c)]


def _listed(values: Values, numbers: list[int]) -> tuple[Value, ...]:
    return tuple(values.t.integer(n) for n in numbers)


LISTS: dict[str, Callable[[Values, Value], tuple[Value, list[int]]]] = {
    "appended": lambda v, x: (v.appended(x, v.t.integer(9), INTS), [4, 5, 4, 9]),
    "first gone": lambda v, x: (v.without(x, v.t.integer(0), INTS), [5, 4]),
    "last gone": lambda v, x: (v.without(x, v.t.integer(2), INTS), [4, 5]),
    "replaced": lambda v, x: (v.with_element(x, v.t.integer(1), v.t.integer(7), INTS), [4, 7, 4]),
    "replaced where nothing is": lambda v, x: (
        v.with_element(x, v.t.integer(3), v.t.integer(7), INTS),
        [4, 5, 4],
    ),
}


@pytest.mark.parametrize("change", LISTS.values(), ids=LISTS)
def test_lists_change_alike_whether_their_length_is_known(
    change: Callable[[Values, Value], tuple[Value, list[int]]],
) -> None:
    values = Values(Terms(), 2)
    known = _listed(values, [4, 5, 4])
    unknown = values.fresh("xs", INTS)
    given = values.equal(unknown, known, INTS)
    for start in (known, unknown):
        found, wanted = change(values, start)
        assert follows(values, [given], values.equal(found, _listed(values, wanted), INTS))


def test_what_lists_are_asked() -> None:
    values = Values(Terms(), 2)
    t = values.t
    known, unknown = _listed(values, [4, 5, 4]), values.fresh("xs", INTS)
    given = values.equal(unknown, known, INTS)
    for xs in (known, unknown):
        second = values.at(xs, t.integer(1), INTS)
        goals = [
            values.equal(second, t.integer(5), INTEGER),
            values.contains(xs, t.integer(5), INTS),
            t.negation(values.contains(xs, t.integer(6), INTS)),
            t.equal(values.length(xs), t.integer(3)),
            t.equal(values.position(xs, t.integer(4), INTS), t.integer(0)),
            t.less(values.position(xs, t.integer(6), INTS), t.integer(0)),
            values.inside(xs, t.integer(2)),
            t.negation(values.inside(xs, t.integer(3))),
            t.negation(values.inside(xs, t.integer(-1))),
        ]
        assert follows(values, [given], t.conjunction(goals))


def test_records_in_lists_keep_their_fields() -> None:
    values = Values(Terms(), 2)
    t, pairs = values.t, ListType(PAIR)
    xs = values.fresh("xs", pairs)
    pair = (t.integer(1), t.integer(2))
    longer = values.appended(xs, pair, pairs)
    last = values.at(longer, values.length(xs), pairs)
    assert follows(values, [], values.equal(last, pair, PAIR))


@pytest.mark.parametrize(
    ("said", "shown"),
    [("(- 5)", "-5"), ("(/ 1 2)", "1/2"), ("(/ (- 7) 2)", "-7/2"), ("(- (/ 7 2))", "-7/2"),
     ("3.0", "3"), ("true", "true"), ("(- 2.0)", "-2"), ("(/ 1.0 3.0)", "1/3")],
)  # fmt: skip
def test_values_are_shown_as_people_write_them(said: str, shown: str) -> None:
    assert plain(said) == shown
