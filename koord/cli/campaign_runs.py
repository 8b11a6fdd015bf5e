"""The runs of a campaign: one after the other, in processes, or on a cluster."""

from __future__ import annotations

import argparse
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import active_children, get_context, parent_process
from typing import Any, TypeAlias

from msgspec import Struct

from koord.cli.campaign_files import Row
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.fitting import Asked
from koord.cli.simulating import Job
from koord.sim.running import run
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal

#: What is wrong with an order.
Refusal: TypeAlias = tuple[Diagnostic, ...]

#: A scheduler that does not answer for so long is not there.
_CONNECT_S = 10


class Order(Struct, frozen=True):
    """A run that is to be made. ``swept`` is the value of what is swept."""

    asked: Asked
    robots: int | None
    seed: int
    rounds: int | None
    time_s: float | None
    summaries: bool
    swept: str


def job_of(order: Order) -> Job:
    """What is to be simulated. Raises KoordError."""
    report = Report()
    job = order.asked.job(report, order.robots, order.seed)
    if job is None:
        raise KoordError(tuple(report.diagnostics))
    return job


def rows_of(
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
    job = job_of(order)
    simulation = job.simulation(keep_going=True, summaries=order.summaries)
    began = time.perf_counter()
    simulation.begin()
    job.check_start(simulation)
    for _ in run(simulation, job.limit_s(order.rounds, order.time_s)):
        if is_enough():
            return None
    wall_s = time.perf_counter() - began
    figures = simulation.figures()
    robots = figures.robots
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
