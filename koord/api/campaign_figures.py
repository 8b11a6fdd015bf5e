"""Figures of campaigns: means and rates with intervals, and when these are narrow enough.

Who looks at an interval again and again, and ends when it is narrow, is wrong more often than the
interval says. So looks are few (after 20 runs, and half as many more each time), and the k-th may
be wrong with a probability of α / (k (k + 1)) alone: together, for however many looks, with at most
α. So each interval holds wherever a campaign ends, and one that goes on with more runs later is
right, too.

Intervals of rates are those of Clopper and Pearson, which hold for every rate and number of runs.
Those of means are Student's, which hold where values are distributed normally and nearly so where
means of so many are. Values that are all equal say nothing of others: they end no campaign.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from itertools import dropwhile
from statistics import fmean, stdev

from msgspec import Struct

from koord.api.campaign_runs import Row
from koord.api.results import ArgumentError

#: With such a probability an interval may be wrong.
ALPHA = 0.05

#: The first look is after so many runs.
FIRST_LOOK = 20


class Metric(Enum):
    """The figures of a run that campaigns can be made precise in."""

    TIME = "time"
    DISTANCE = "distance"
    WAITED = "waited"
    BROKEN = "broken"

    def of(self, row: Row) -> float | None:
        """The figure of a run; None if it has none. *Broken* is 1 or 0."""
        match self:
            case Metric.TIME:
                return row.taken_s
            case Metric.DISTANCE:
                return row.distance_m
            case Metric.WAITED:
                return row.waited_s
            case Metric.BROKEN:
                return float(row.is_bad)


class Interval(Struct, frozen=True):
    """A mean, or a rate, and its confidence interval; without bounds where nothing is known."""

    mean: float
    low: float
    high: float

    @property
    def reach(self) -> float:
        """Half the width."""
        return (self.high - self.low) / 2


class Until(Struct, frozen=True):
    """The wish for an interval that reaches no further than so much to each side."""

    metric: Metric
    reach: float

    def is_met(self, rows: Sequence[Row], look: int) -> bool:
        """Return whether the interval is narrow enough at the k-th look."""
        values = [value for row in rows if (value := self.metric.of(row)) is not None]
        if self.metric is not Metric.BROKEN and (len(values) < FIRST_LOOK or len({*values}) == 1):
            return False
        return interval(self.metric, values, alpha_of(look)).reach <= self.reach


def until_of(given: Mapping[str, float]) -> Until:
    """The wish that a figure's name and a reach say. Raises ArgumentError."""
    names = [metric.value for metric in Metric]
    if len(given) != 1 or not {*given} <= {*names}:
        raise ArgumentError("until", f"name one of {', '.join(names)}, and how far it may reach")
    ((name, reach),) = given.items()
    if not (math.isfinite(reach) and reach > 0):
        raise ArgumentError("until", f"an interval reaches further than {reach!r}")
    return Until(Metric(name), float(reach))


def looks() -> Iterator[int]:
    """After how many runs it is looked whether an interval is narrow enough."""
    runs = FIRST_LOOK
    while True:
        yield runs
        runs += runs // 2


def is_look(runs: int) -> bool:
    """Return whether it is looked after so many runs."""
    return next(dropwhile(lambda look: look < runs, looks())) == runs


def alpha_of(look: int) -> float:
    """With which probability the k-th look may be wrong (from 1); all together with ALPHA."""
    return ALPHA / (look * (look + 1))


def settled(rows: Sequence[Row], until: Until) -> tuple[int, int] | None:
    """The runs, and the look, after which first ones of a value's runs are enough; None if never.

    ``rows`` are the first runs without a gap, by seed: whoever makes more of them at a time, and in
    another order, ends after the same one.
    """
    for look, runs in enumerate(looks(), 1):
        if runs > len(rows):
            return None
        if until.is_met(rows[:runs], look):
            return runs, look
    return None


def interval(metric: Metric, values: Sequence[float], alpha: float = ALPHA) -> Interval:
    """The interval of a figure's mean."""
    if metric is Metric.BROKEN:
        return rate(round(sum(values)), len(values), alpha)
    mean, reach = mean_and_reach(values, alpha)
    return Interval(mean, mean - reach, mean + reach)


def rate(count: int, runs: int, alpha: float = ALPHA) -> Interval:
    """A rate with its interval: so many of some runs. (Clopper and Pearson 1934)"""
    from scipy.special import betaincinv

    low = float(betaincinv(count, runs - count + 1, alpha / 2)) if count else 0.0
    high = float(betaincinv(count + 1, runs - count, 1 - alpha / 2)) if count < runs else 1.0
    return Interval(count / runs, low, high)


def mean_and_reach(values: Sequence[float], alpha: float = ALPHA) -> tuple[float, float]:
    """The mean, and half the width of its confidence interval (Student's t)."""
    n = len(values)
    if n < 2:
        return fmean(values), math.nan
    from scipy.special import stdtrit

    quantile = float(stdtrit(n - 1, 1 - alpha / 2))
    return fmean(values), quantile * stdev(values) / math.sqrt(n)


def mean_words(values: Sequence[float], alpha: float = ALPHA) -> str:
    """The mean in words, with its interval if there are several values."""
    if not values:
        return "-"
    mean, reach = mean_and_reach(values, alpha)
    return f"{mean:.1f}" if math.isnan(reach) else f"{mean:.1f} ± {reach:.1f}"


def rate_words(count: int, runs: int, alpha: float = ALPHA) -> str:
    """The interval of a rate in per cent, with two digits of its upper end."""
    found = rate(count, runs, alpha)
    places = max(0, 1 - math.floor(math.log10(100 * found.high)))
    return f"{100 * found.low:.{places}f}–{100 * found.high:.{places}f}"
