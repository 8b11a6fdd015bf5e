"""Plots of campaigns: figures by the value that was swept, or how runs of one are distributed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from koord.api.campaign_figures import mean_and_reach
from koord.api.campaign_runs import Row
from koord.api.pictures import keep_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Of so many runs and more a histogram is drawn; of fewer each run is a mark.
_HISTOGRAM = 12


class CampaignFigure(Struct, frozen=True):
    """What is drawn: a title, what was swept, and the runs of each value."""

    title: str
    swept: str
    groups: Mapping[str, Sequence[Row]]

    @property
    def safety_m(self) -> float | None:
        """The distance that robots have to keep, in metres, if it is one."""
        found = {row.safety_m for rows in self.groups.values() for row in rows}
        return found.pop() if len(found) == 1 else None


def finished(rows: Sequence[Row]) -> list[tuple[float, float]]:
    """The share of runs that are done by a time in seconds, in steps; it need not come to 1.

    A run is done when all its tasks are visited, or, without tasks, when it ends.
    """
    times = sorted(time for row in rows if row.is_done and (time := row.taken_s) is not None)
    steps = [(0.0, 0.0)]
    steps += [(time, (k + 1) / len(rows)) for k, time in enumerate(times)]
    return steps


def draw_campaign(path: str, what: CampaignFigure) -> None:
    """Plot a campaign. Raises KoordError where the file cannot be written."""
    if len(what.groups) == 1:
        _draw_runs(path, what)
    else:
        _draw_values(path, what)


def _draw_runs(path: str, what: CampaignFigure) -> None:
    """Plot how the runs of one value are distributed."""
    from matplotlib.figure import Figure

    (rows,) = what.groups.values()
    figure = Figure(figsize=(9, 6), layout="constrained")
    (time, ends), (distance, apart) = figure.subplots(2, 2)
    _draw_finished(time, rows)
    _draw_endings(ends, rows)
    _draw_spread(distance, "distance of all robots in m", [row.distance_m for row in rows])
    near = [row.separation_m for row in rows if row.separation_m is not None]
    _draw_spread(apart, "least separation in m", near)
    if what.safety_m:
        apart.axvline(what.safety_m, color="C3", linestyle="--", label="safe")
        apart.legend()
    figure.suptitle(what.title, wrap=True, parse_math=False)
    keep_figure(path, figure)


def _draw_finished(axis: Axes, rows: Sequence[Row]) -> None:
    steps = finished(rows)
    done = len(steps) - 1
    last = max([row.time_s for row in rows] + [steps[-1][0]])
    times, shares = [t for t, _ in steps] + [last], [100 * s for _, s in steps]
    axis.step(times, [*shares, shares[-1]], where="post", color="C0")
    if done:
        middle = next(t for t, share in steps if share >= 0.5 * done / len(rows))
        axis.axvline(middle, color="0.6", linestyle=":", label=f"median {middle:.3g} s")
        axis.legend(loc="lower right")
    of = "tasks are all visited" if rows[0].tasks else "it is over"
    axis.set(xlabel=f"time in s until {of}", ylabel="runs in %", ylim=(0, 104))
    axis.set_title(f"done: {done} of {len(rows)} runs", fontsize=10)
    axis.grid(visible=True, alpha=0.3)


def _draw_endings(axis: Axes, rows: Sequence[Row]) -> None:
    """Plot how runs ended; those that broke a claim or got stuck are told apart."""
    counts = Counter(map(told, rows))
    names = sorted(counts, key=lambda name: (counts[name], name))
    bad = {told(row) for row in rows if row.is_bad or row.stuck}
    done = {told(row) for row in rows if row.is_done}
    colours = ["C3" if name in bad else "C2" if name in done else "0.6" for name in names]
    axis.barh(names, [counts[name] for name in names], color=colours, height=0.6)
    axis.set_ylim(-0.8, max(len(names), 2) - 0.2)
    for place, name in enumerate(names):
        axis.text(counts[name], place, f" {counts[name]}", va="center")
    axis.set(xlabel="runs", xlim=(0, 1.15 * max(counts.values())))
    axis.set_title("how they ended", fontsize=10)


def told(row: Row) -> str:
    """How a run ended, in words; it broke a claim, or some of its robots got stuck."""
    from koord.sim.running import Ending

    if row.broken:
        return Ending.VIOLATED.value
    words = Ending[row.ending.upper()].value
    return f"{words}, some stuck" if row.stuck else words


def _draw_spread(axis: Axes, label: str, values: Sequence[float]) -> None:
    """Plot a histogram with the mean and its interval; of few runs a mark for each."""
    axis.set(xlabel=label)
    if not values:
        axis.set_yticks([])
        axis.text(0.5, 0.5, "no run has it", ha="center", transform=axis.transAxes)
        return
    mean, reach = mean_and_reach(values)
    if len(values) >= _HISTOGRAM and max(values) > min(values):
        axis.hist(values, bins=min(30, 5 + len(values) // 8), color="C0", alpha=0.75)
        axis.set(ylabel="runs")
    else:
        axis.plot(values, [0] * len(values), "|", color="C0", markersize=24)
        axis.set_yticks([])
    if not math.isnan(reach):
        axis.axvspan(mean - reach, mean + reach, color="0.5", alpha=0.2)
    axis.axvline(mean, color="0.35")
    axis.set_title(
        f"mean {mean:.3g}" + ("" if math.isnan(reach) else f" ± {reach:.2g}"), fontsize=10
    )
    axis.grid(visible=True, alpha=0.3)


def _draw_values(path: str, what: CampaignFigure) -> None:
    """Plot means and intervals of times, distances and separations by the value."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    axes = figure.subplots(1, 3)
    labels = list(what.groups)
    places = list(range(len(labels)))
    shown: list[tuple[str, Callable[[Row], float | None]]] = [
        ("time in s", lambda row: row.taken_s),
        ("distance in m", lambda row: row.distance_m),
        ("least separation in m", lambda row: row.separation_m),
    ]
    for axis, (label, value) in zip(axes, shown, strict=True):
        for place, group in zip(places, what.groups.values(), strict=True):
            values = [number for row in group if (number := value(row)) is not None]
            if not values:
                continue
            mean, reach = mean_and_reach(values)
            axis.plot([place] * len(values), values, ".", color="0.75", zorder=1)
            yerr = None if math.isnan(reach) else reach
            axis.errorbar(place, mean, yerr=yerr, fmt="o", color="C0", capsize=4, zorder=2)
        axis.set(xlabel=what.swept, ylabel=label, xticks=places)
        axis.set_xticklabels(labels)
        axis.grid(visible=True, alpha=0.3)
    if what.safety_m is not None:
        axes[2].axhline(what.safety_m, color="C3", linestyle="--", label="safe")
        axes[2].legend()
    figure.suptitle(what.title, wrap=True, parse_math=False)
    keep_figure(path, figure)
