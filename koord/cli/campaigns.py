"""``koord sim --runs K``: many runs with seeds of their own, as a table, as CSV, as a picture."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import signal
import sys
import threading
import time
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack
from multiprocessing import active_children, get_context, parent_process
from statistics import fmean, stdev
from typing import Any, TypeAlias

from msgspec import Struct, to_builtins
from msgspec.structs import replace

from koord import __version__
from koord.cli.campaign_files import Row, RunFile
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.files import check_writable
from koord.cli.fitting import Asked
from koord.cli.progress import Interruption, LiveLine
from koord.cli.sweeps import check_drawable, keep_figure
from koord.cli.terminal import Paint, style_of, visible
from koord.runtime.motion.libraries import require
from koord.sim.running import Ending, run, still_words
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal
from koord.syntax.literals import ParamValue, literal

#: What is wrong with an order.
Refusal: TypeAlias = tuple[Diagnostic, ...]

#: A scheduler that does not answer for so long is not there.
_CONNECT_S = 10

#: How sure an interval is to have the mean in it.
_CONFIDENCE = 0.95


class Order(Struct, frozen=True):
    """A run that is to be made. ``swept`` is the value of what is swept."""

    asked: Asked
    robots: int | None
    seed: int
    rounds: int | None
    time_s: float | None
    summaries: bool
    swept: str


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
        interruption = stack.enter_context(Interruption())
        line = stack.enter_context(LiveLine(sys.stderr))
        line.show(f"{len(rows)} of {len(orders)} runs")
        for row in _rows(left, arguments, lambda: interruption.requested):
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
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ArgumentTypeError(f"--sweep: {literal(value)} is no number of robots")
    return value


def _rows(
    orders: Sequence[Order], arguments: argparse.Namespace, is_enough: Callable[[], bool]
) -> Iterator[Row]:
    """The rows of runs as they come. Raises KoordError."""
    if arguments.cluster is not None:
        outcomes = _on_cluster(orders, arguments.cluster, is_enough)
    elif arguments.jobs > 1 and len(orders) > 1:
        outcomes = _in_processes(orders, arguments.jobs, is_enough)
    else:
        outcomes = (row_of(order, is_enough) for order in orders)
    for outcome in outcomes:
        if isinstance(outcome, tuple):
            raise KoordError(outcome)
        if outcome is None:
            return
        yield outcome


def _in_processes(
    orders: Sequence[Order], jobs: int, is_enough: Callable[[], bool]
) -> Iterator[Row | Refusal | None]:
    """So many runs at a time on this machine."""
    # A fresh interpreter for each worker: libraries with threads do not survive a fork.
    context = get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(orders)), context, initializer=_begin_worker) as pool:
        waiting: set[Future[Row | Refusal | None]] = {
            pool.submit(_tried, order) for order in orders
        }
        while waiting:
            done, waiting = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
            if is_enough():
                pool.shutdown(wait=False, cancel_futures=True)
                for child in active_children():  # nobody waits for what they are at
                    child.terminate()
                return


def _begin_worker() -> None:
    """Ctrl-C is for the process that asks, and no worker outlives it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None

    def outlived() -> None:
        parent.join()
        os._exit(Exit.TERMINATED)

    threading.Thread(target=outlived, name="parent", daemon=True).start()


def _on_cluster(
    orders: Sequence[Order], address: str, is_enough: Callable[[], bool]
) -> Iterator[Row | Refusal | None]:
    """As many runs at a time as a Dask cluster has workers. Raises KoordError."""
    import distributed

    engine: Any = distributed  # it says nothing of its types
    try:
        client = engine.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        story = f"there is no Dask scheduler at {address}: {error}"
        raise refusal("K935", "--cluster", story, "start one with: dask scheduler") from None
    with client:
        futures = client.map(_on_worker, orders, pure=False, retries=0)
        for future in engine.as_completed(futures):
            yield future.result()
            if is_enough():
                client.cancel(futures)
                return


def _on_worker(order: Order) -> Row | Refusal | None:
    """As :func:`_tried`, on a Dask worker.

    When who asks has ended, however that was, the scheduler takes the run from the worker; but the
    worker does not end what goes on in its thread. So the run looks itself.
    """
    from distributed import worker

    engine: Any = worker  # it says nothing of its types
    tasks, key = engine.get_worker().state.tasks, engine.thread_state.key

    def is_unwanted() -> bool:
        task = tasks.get(key)
        return task is None or task.state != "executing"

    return _tried(order, is_unwanted)


def _tried(order: Order, is_enough: Callable[[], bool] = lambda: False) -> Row | Refusal | None:
    """As :func:`row_of`; what is wrong is told as data, which comes back from other processes."""
    try:
        return row_of(order, is_enough)
    except KoordError as error:
        return error.diagnostics


def row_of(order: Order, is_enough: Callable[[], bool] = lambda: False) -> Row | None:
    """Make a run; None if it was enough before its end. Raises KoordError."""
    report = Report()
    job = order.asked.job(report, order.robots, order.seed)
    if job is None:
        raise KoordError(tuple(report.diagnostics))
    simulation = job.simulation(keep_going=True, summaries=order.summaries)
    began = time.perf_counter()
    simulation.begin()
    job.check_start(simulation)
    for _ in run(simulation, job.limit_s(order.rounds, order.time_s)):
        if is_enough():
            return None
    wall_s = time.perf_counter() - began
    figures, robots = simulation.figures(), simulation.figures().robots
    assert simulation.ending is not None
    return Row(
        order.swept,
        len(robots),
        ", ".join(job.problem.values),
        order.seed,
        simulation.ending.name.lower(),
        figures.time_s,
        len(figures.tasks),
        figures.tasks_done,
        figures.tasks_s,
        figures.distance_m,
        None if figures.nearest is None else figures.nearest.distance_m,
        job.scene.safety_m,
        sum(robot.waited_s for robot in robots),
        sum(robot.events for robot in robots),
        sum(robot.skips for robot in robots),
        sum(robot.blocked for robot in robots),
        figures.messages,
        len(simulation.broken),
        len(simulation.standing),
        figures.digest,
        wall_s,
    )


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
