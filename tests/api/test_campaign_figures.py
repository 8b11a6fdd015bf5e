"""Intervals hold as often as they say, also where a campaign ends because they are narrow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice
from random import Random

import numpy as np
import pytest
from msgspec.structs import replace

from koord.api.campaign_course import Course
from koord.api.campaign_figures import (
    ALPHA,
    FIRST_LOOK,
    Metric,
    Until,
    alpha_of,
    interval,
    looks,
    rate,
    rate_words,
    settled,
    until_of,
)
from koord.api.campaign_runs import Order, Row
from koord.api.fitting import FitRequest
from koord.api.results import ArgumentError
from koord.syntax.source import Source
from tests.sampling import first

PLAIN = Row(
    *("", 2, "", 0, "stopped", 1.0, 0, 0, None, 1.0, None, 0.5, 0.0, 0, 0, 0, 0),
    *(0, 0, 0, 0, 0, 0, "", 0.0, 0.0, 1.0, 1),
)  # fmt: skip


def row(seed: int, *, time_s: float = 1.0, broken: int = 0, swept: str = "") -> Row:
    return replace(PLAIN, seed=seed, time_s=time_s, broken=broken, swept=swept)


def rows(values: Sequence[float], metric: Metric) -> list[Row]:
    if metric is Metric.BROKEN:
        return [row(seed, broken=int(value)) for seed, value in enumerate(values)]
    return [row(seed, time_s=value) for seed, value in enumerate(values)]


def orders(count: int, swept: Sequence[str] = ("",)) -> list[Order]:
    request = FitRequest(Source("a.krd", ""), None, (), {})
    return [
        Order(replace(request, seed=seed), None, None, False, value)
        for value in swept
        for seed in range(count)
    ]


@pytest.mark.parametrize("runs", [1, 7, 20, 45])
@pytest.mark.parametrize("alpha", [ALPHA, alpha_of(3)])
def test_rates_are_in_their_intervals_as_often_as_is_said(runs: int, alpha: float) -> None:
    binom = pytest.importorskip("scipy.stats").binom
    found = [rate(count, runs, alpha) for count in range(runs + 1)]
    low, high = np.array([one.low for one in found]), np.array([one.high for one in found])
    for p in np.linspace(0, 1, 101):  # exactly, for each rate that there may be
        inside = (low <= p) & (p <= high)
        assert binom.pmf(np.arange(runs + 1), runs, p)[inside].sum() >= 1 - alpha - 1e-12


def test_intervals_of_rates_are_those_of_others() -> None:
    stats = pytest.importorskip("scipy.stats")
    for count, runs in ((0, 20), (1, 20), (13, 30), (30, 30)):
        other = stats.binomtest(count, runs).proportion_ci(0.95, "exact")
        found = rate(count, runs)
        assert (found.low, found.high) == pytest.approx((other.low, other.high), abs=1e-9)
    assert rate_words(0, 300) == "0.0–1.2"


def test_all_looks_together_are_wrong_no_more_often_than_one_may_be() -> None:
    assert sum(alpha_of(k) for k in range(1, 10_000)) <= ALPHA
    assert [*islice(looks(), 5)] == [20, 30, 45, 67, 100]


@pytest.mark.parametrize(
    ("metric", "draw", "truth", "reach"),
    first(
        1,
        [
            (Metric.TIME, lambda d, n: d.normal(50, 10, n), 50.0, 4.0),
            (Metric.TIME, lambda d, n: d.uniform(0, 60, n), 30.0, 6.0),
            (Metric.BROKEN, lambda d, n: d.random(n) < 0.3, 0.3, 0.15),
            (Metric.BROKEN, lambda d, n: d.random(n) < 0.02, 0.02, 0.05),
        ],
    ),
)
def test_intervals_hold_where_a_campaign_ends_because_they_are_narrow(
    metric: Metric, draw: Callable[[np.random.Generator, int], object], truth: float, reach: float
) -> None:
    chance, until = np.random.default_rng(5), Until(metric, reach)
    missed = ended = 0
    for _ in range(400):
        made = rows(np.asarray(draw(chance, 300), float).tolist(), metric)
        enough = settled(made, until)
        if enough is None:
            continue
        runs, look = enough
        values = [value for one in made[:runs] if (value := metric.of(one)) is not None]
        found = interval(metric, values, alpha_of(look))
        assert found.reach <= reach
        ended += 1
        missed += not found.low <= truth <= found.high
    assert ended > 300
    assert missed <= 20  # 5 % of 400; where each look had them all it would be more


def test_equal_values_end_no_campaign() -> None:
    same = rows([5.0] * 500, Metric.TIME)
    assert settled(same, Until(Metric.TIME, 1.0)) is None
    assert settled([replace(one, tasks=3) for one in same], Until(Metric.TIME, 1.0)) is None
    assert settled(rows([0.0] * 500, Metric.BROKEN), Until(Metric.BROKEN, 0.05)) is not None


@pytest.mark.parametrize("seed", range(5))
def test_a_campaign_ends_after_the_same_runs_in_whatever_order_they_come(seed: int) -> None:
    chance = Random(seed)
    made = [row(k, time_s=chance.gauss(50, 10), swept=v) for v in "ab" for k in range(200)]
    until = Until(Metric.TIME, 5.0)
    ends = set()
    for shuffles in (0, 1, 30):
        course, coming = Course(orders(200, "ab"), until), list(made)
        for _ in range(shuffles * 20):  # neighbours change places
            k = chance.randrange(len(coming) - 1)
            coming[k : k + 2] = coming[k + 1], coming[k]
        for one in coming:
            course.add(one)
            if course.is_over:
                break
        ends.add(tuple(one.key for one in course.rows()))
        assert course.made == len(course.rows())
    assert len(ends) == 1
    groups = [[one for one in made if one.swept == value] for value in "ab"]
    enough = [found[0] for group in groups if (found := settled(group, until)) is not None]
    (end,) = ends
    assert end == tuple((v, k) for v, count in zip("ab", enough, strict=True) for k in range(count))
    assert FIRST_LOOK <= min(enough) < 200


def test_orders_end_with_the_runs_that_are_enough() -> None:
    course = Course(orders(500, "ab"), Until(Metric.TIME, 6.0))
    chance, given = Random(1), list[tuple[str, int]]()
    for order in course.wanted():
        given.append(order.key)
        swept, number = order.key
        course.add(row(number, time_s=chance.gauss(50, 10), swept=swept))
    assert course.is_over
    assert given == [one.key for one in course.rows()]
    assert len(given) < 400


def test_without_a_wish_all_runs_are_made() -> None:
    course = Course(orders(30), None)
    assert len([*course.wanted()]) == len(course.missing()) == 30
    for seed in (*range(1, 30), 99):
        course.add(row(seed))
    assert not course.is_over
    assert [order.key for order in course.missing()] == [("", 0)]
    assert course.is_whole([row(seed) for seed in range(30)])


@pytest.mark.parametrize(
    "given", [{}, {"speed": 1.0}, {"time": 0.0}, {"time": float("nan")}, {"time": 1, "waited": 1}]
)
def test_wishes_that_are_none(given: dict[str, float]) -> None:
    with pytest.raises(ArgumentError):
        until_of(given)
