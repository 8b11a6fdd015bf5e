"""The runs of a campaign: one after the other, in processes, or on a cluster."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import closing
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeAlias

from msgspec import Struct

from koord.api.campaign_file import Row
from koord.api.fitting import FitRequest, fit
from koord.api.sim_setup import check_begun, limit_s, simulation
from koord.sim.running import Simulation, run
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal

#: What is wrong with an order.
Refusal: TypeAlias = tuple[Diagnostic, ...]

#: A scheduler that does not answer for so long is not there.
_CONNECT_S = 10


class Order(Struct, frozen=True):
    """A run that is to be made. ``swept`` is the value of what is swept."""

    request: FitRequest
    rounds: int | None
    duration_s: float | None
    check_summaries: bool
    swept: str

    @property
    def key(self) -> tuple[str, int]:
        """What tells the runs of a campaign apart."""
        assert self.request.seed is not None
        return self.swept, self.request.seed


def rows_of(
    orders: Sequence[Order], jobs: int, cluster: str | None, is_enough: Callable[[], bool]
) -> Generator[Row, None, None]:
    """The rows of runs as they come: so many at a time, or as many as a cluster has workers.

    Raises KoordError.
    """
    outcomes: Generator[Row | Refusal | None, None, None]
    if cluster is not None:
        outcomes = _on_cluster(orders, cluster, is_enough)
    elif jobs > 1 and len(orders) > 1:
        outcomes = _in_processes(orders, jobs, is_enough)
    else:
        outcomes = (row_of(order, is_enough) for order in orders)
    with closing(outcomes):
        for outcome in outcomes:
            if isinstance(outcome, tuple):
                raise KoordError(outcome)
            if outcome is None:
                return
            yield outcome


def _in_processes(
    orders: Sequence[Order], jobs: int, is_enough: Callable[[], bool]
) -> Generator[Row | Refusal | None, None, None]:
    """So many runs at a time on this machine."""
    # A fresh interpreter for each worker: libraries with threads do not survive a fork.
    context = get_context("spawn")
    line, ours = context.Pipe(duplex=False)
    with ours, line:  # workers end when they hear that our end is closed
        pool = ProcessPoolExecutor(
            min(jobs, len(orders)), context, initializer=_begin_worker, initargs=(line,)
        )
        waiting = {pool.submit(_tried, order) for order in orders}
        try:
            while waiting:
                done, waiting = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                if is_enough():
                    return
        finally:
            # Nobody waits for what they are at.
            pool.shutdown(wait=not waiting, cancel_futures=True)


def _begin_worker(line: Connection) -> None:
    """Ctrl-C is for the process that asks, and no worker outlives it, or its interest."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end() -> None:
        line.poll(None)
        signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=end, name="line to who asks", daemon=True).start()


def _on_cluster(
    orders: Sequence[Order], address: str, is_enough: Callable[[], bool]
) -> Generator[Row | Refusal | None, None, None]:
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
    fitted = fit(order.request)
    made = simulation(fitted, Simulation, keep_going=True, check_summaries=order.check_summaries)
    began = time.perf_counter()
    made.begin()
    check_begun(fitted, made)
    for _ in run(made, limit_s(fitted, order.rounds, order.duration_s)):
        if is_enough():
            return None
    wall_s = time.perf_counter() - began
    figures = made.figures()
    robots = figures.robots
    assert made.ending is not None
    return Row(
        order.swept,
        len(robots),
        ", ".join(fitted.problem.values),
        fitted.scene.seed,
        made.ending.name.lower(),
        figures.time_s,
        len(figures.tasks),
        figures.tasks_done,
        figures.tasks_s,
        figures.distance_m,
        None if figures.nearest is None else figures.nearest.distance_m,
        fitted.scene.safety_m,
        sum(robot.waited_s for robot in robots),
        sum(robot.events for robot in robots),
        sum(robot.skips for robot in robots),
        sum(robot.blocked for robot in robots),
        figures.messages,
        len(made.broken),
        len(made.standing),
        figures.digest,
        wall_s,
    )
