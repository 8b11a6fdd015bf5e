"""``koord sim --runs K``: many runs with seeds of their own, as a table, as CSV, as a picture."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from statistics import fmean, stdev

from msgspec import to_builtins
from msgspec.structs import replace

from koord.api.files import check_writable
from koord.cli.campaign_files import Row, RunFile
from koord.cli.campaign_runs import Order, job_of, rows_of
from koord.cli.exits import Exit
from koord.cli.fitting import Asked
from koord.cli.progress import Interruption, LiveLine
from koord.cli.sweeps import check_drawable, keep_figure
from koord.cli.terminal import Paint, style_of, visible
from koord.runtime.motion.libraries import require
from koord.sim.running import Ending, still_words
from koord.syntax.core import MOST_ROBOTS
from koord.syntax.literals import ParamValue, literal
from koord.version import __version__

#: How sure an interval is to have the mean in it.
_CONFIDENCE = 0.95


def check_campaign(arguments: argparse.Namespace) -> None:
    """Raises ArgumentTypeError and KoordError before long work is done."""
    if arguments.cluster is not None:
        require(("distributed",), "cluster")
    of_one = ("trace", "record", "processes", "live", "pace")
    given = [f"--{name}" for name in of_one if getattr(arguments, name)]
    if given:
        those = " and ".join(given)
        raise ArgumentTypeError(
            f"{those} {'is' if len(given) == 1 else 'are'} of one run: leave out --runs and --sweep"
        )
    if arguments.resume and arguments.csv is None:
        raise ArgumentTypeError("--resume goes on with the runs in a file: say --csv FILE")
    if arguments.csv is not None:
        check_writable(arguments.csv)
    if arguments.plot is not None:
        check_drawable(arguments.plot)
        check_writable(arguments.plot)


def campaign(arguments: argparse.Namespace, asked: Asked, first_seed: int) -> int:
    """Make the runs, tell of them, and return the exit code. Raises KoordError."""
    orders = list(_orders(arguments, asked, first_seed))
    keys = {(order.swept, order.seed): number for number, order in enumerate(orders)}
    with ExitStack() as stack:
        kept = None
        if arguments.csv is not None:
            name = _identity(arguments, asked, first_seed)
            kept = stack.enter_context(RunFile(arguments.csv, name, resumes=arguments.resume))
            kept.begin(keys)
        rows = [] if kept is None else list(kept.rows)
        known = {row.key for row in rows}
        if known and not arguments.json:
            print(f"{len(known)} of {len(orders)} runs are there already")
        left = [order for order in orders if (order.swept, order.seed) not in known]
        _check_sweep(left)
        interruption = stack.enter_context(Interruption())
        line = stack.enter_context(LiveLine(sys.stderr))
        line.show(f"{len(rows)} of {len(orders)} runs")
        for row in rows_of(left, arguments, lambda: interruption.requested):
            rows.append(row)
            if kept is not None:
                kept.add(row)
            line.show(f"{len(rows)} of {len(orders)} runs")
        rows.sort(key=lambda row: keys[row.key])
        if kept is not None and len(rows) == len(orders):
            kept.finish(rows)
    name = "robots" if arguments.sweep is None else arguments.sweep[0]
    if arguments.plot is not None and rows:
        _draw(arguments.plot, asked.source.name, name, rows)
    if arguments.json:
        document = {
            "format": "koord-campaign",
            "version": 1,
            "runs": [to_builtins(row) for row in rows],
        }
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
    else:
        for text in _table(asked.source.name, name, rows):
            print(text)
    if interruption.requested:
        return Exit.INTERRUPTED
    if any(_is_bad(row) for row in rows):
        return Exit.VIOLATED
    return Exit.STUCK if any(row.stuck for row in rows) else Exit.OK


def _check_sweep(orders: Sequence[Order]) -> None:
    """Whether a run can begin with each of the values that are swept, before any does.

    Raises KoordError.
    """
    first_of = {order.swept: order for order in reversed(orders)}
    if len(first_of) > 1:
        for order in first_of.values():
            job = job_of(order)
            job.check_start(job.begun())


def _identity(arguments: argparse.Namespace, asked: Asked, first_seed: int) -> str:
    """What makes runs with one seed and one swept value the same: the campaign, as a few digits."""
    configuration = asked.configuration
    said = (
        __version__,
        asked.source.text,
        [source.text for source in asked.properties],
        None if configuration is None else configuration.document.source.text,
        sorted((name, literal(value)) for name, value in asked.params.items()),
        str(asked.delta_s),
        first_seed,
        arguments.robots,
        arguments.rounds,
        arguments.time,
        arguments.check_summaries,
        None if arguments.sweep is None else arguments.sweep[0],
    )
    return hashlib.sha256(repr(said).encode()).hexdigest()[:16]


# --- runs -----------------------------------------------------------------------------------------


def _orders(arguments: argparse.Namespace, asked: Asked, first_seed: int) -> Iterator[Order]:
    name: str = "robots"
    values: tuple[ParamValue | None, ...] = (None,)
    if arguments.sweep is not None:
        name, values = arguments.sweep
    for value in values:
        robots, given = arguments.robots, asked
        if value is None:
            pass
        elif name == "robots":
            robots = _robots(value)
        else:
            given = replace(asked, params={**asked.params, name: value})
        for number in range(arguments.runs if arguments.runs is not None else 1):
            seed, swept = first_seed + number, "" if value is None else literal(value)
            yield Order(
                given,
                robots,
                seed,
                arguments.rounds,
                arguments.time,
                arguments.check_summaries,
                swept,
            )


def _robots(value: ParamValue) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MOST_ROBOTS:
        story = f"--sweep: robots must be from 1 to {MOST_ROBOTS}, not {literal(value)}"
        raise ArgumentTypeError(story)
    return value


def _is_bad(row: Row) -> bool:
    return row.broken > 0 or row.ending == Ending.FAULT.name.lower()


# --- what is told ---------------------------------------------------------------------------------


def mean_and_reach(values: Sequence[float]) -> tuple[float, float]:
    """The mean, and how far the interval of confidence reaches to either side (Student's t)."""
    n = len(values)
    if n < 2:
        return fmean(values), math.nan
    from scipy.special import stdtrit

    quantile = float(stdtrit(n - 1, (1 + _CONFIDENCE) / 2))
    return fmean(values), quantile * stdev(values) / math.sqrt(n)


def _told(values: Sequence[float]) -> str:
    if not values:
        return "-"
    mean, reach = mean_and_reach(values)
    return f"{mean:.1f}" if math.isnan(reach) else f"{mean:.1f} ± {reach:.1f}"


def _groups(rows: Sequence[Row]) -> dict[tuple[str, int], list[Row]]:
    found: dict[tuple[str, int], list[Row]] = {}
    for row in rows:
        found.setdefault((row.swept, row.robots), []).append(row)
    return found


def _table(program: str, name: str, rows: Sequence[Row]) -> Iterator[str]:
    """A line for each value that was swept: means, with intervals of 95 %."""
    style = style_of(sys.stdout)
    if not rows:
        yield "no run was done"
        return
    heads = [name, "runs", "done", "time s", "distance m", "waited s", "nearest m", "broken", "×"]
    lines = [heads]
    for (swept, robots), group in _groups(rows).items():
        # A run is as long as its tasks take, where it has any.
        times = [row.tasks_s if row.tasks else row.time_s for row in group]
        near = [row.separation_m for row in group if row.separation_m is not None]
        done = sum(row.tasks_done == row.tasks and row.ending != "fault" for row in group)
        speed = sum(row.time_s for row in group) / max(sum(row.wall_s for row in group), 1e-9)
        lines.append(
            [
                swept or str(robots),
                str(len(group)),
                str(done),
                _told([time for time in times if time is not None]),
                _told([row.distance_m for row in group]),
                _told([row.waited_s for row in group]),
                f"{min(near):.2f}" if near else "-",
                str(sum(map(_is_bad, group))),
                f"{speed:.0f}",
            ]
        )
    widths = [max(len(line[k]) for line in lines) for k in range(len(heads))]
    heading = f"{program}: {len(rows)} runs{_common(rows)}, means with 95 % intervals"
    yield style.paint(visible(heading), Paint.BOLD)
    for line in lines:
        yield "  " + "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
    bad = [row for row in rows if _is_bad(row)]
    for row in [row for row in rows if row.stuck][:10]:
        yield (
            f"{style.paint('stuck', Paint.ERROR)}: {row.robots} robots, seed {row.seed}: "
            f"{still_words(row.stuck)}"
        )
    for row in bad[:10]:
        what = f"{row.broken} claims broken" if row.broken else row.ending
        yield f"{style.paint('broken', Paint.ERROR)}: {row.robots} robots, seed {row.seed}: {what}"


def _common(rows: Sequence[Row]) -> str:
    """δ and what else is not as in the text, where that is the same for all runs."""
    values = {row.values for row in rows}
    return f", {values.pop()}" if len(values) == 1 else ""


def _draw(path: str, program: str, name: str, rows: Sequence[Row]) -> None:
    """Means and intervals of times, distances and separations. Raises KoordError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    axes = figure.subplots(1, 3)
    groups = _groups(rows)
    labels = [swept or str(robots) for swept, robots in groups]
    places = list(range(len(labels)))
    shown: list[tuple[str, Callable[[Row], float | None]]] = [
        ("time in s", lambda row: row.tasks_s if row.tasks else row.time_s),
        ("distance in m", lambda row: row.distance_m),
        ("least separation in m", lambda row: row.separation_m),
    ]
    for axis, (label, value) in zip(axes, shown, strict=True):
        for place, group in zip(places, groups.values(), strict=True):
            values = [number for row in group if (number := value(row)) is not None]
            if not values:
                continue
            mean, reach = mean_and_reach(values)
            axis.plot([place] * len(values), values, ".", color="0.75", zorder=1)
            yerr = None if math.isnan(reach) else reach
            axis.errorbar(place, mean, yerr=yerr, fmt="o", color="C0", capsize=4, zorder=2)
        axis.set(xlabel=name, ylabel=label, xticks=places)
        axis.set_xticklabels(labels)
        axis.grid(visible=True, alpha=0.3)
    safety = {row.safety_m for row in rows}
    if len(safety) == 1:
        axes[2].axhline(*safety, color="C3", linestyle="--", label="safe")
        axes[2].legend()
    figure.suptitle(f"{program}{_common(rows)}", wrap=True, parse_math=False)
    keep_figure(path, figure)
