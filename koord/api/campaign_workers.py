"""The workers of a campaign: processes of this machine, or those of a Dask cluster.

They make runs, or whatever else takes long and hangs on nothing but its order. Runs are handed out
in batches, so that handing out costs little beside short runs, and only as many as are soon begun.
Whichever worker makes a run, and whatever it has made before, the row is the same. Workers may die:
what they were at is made by others.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from itertools import chain, islice
from multiprocessing import Pipe, get_context, util
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from queue import Empty, SimpleQueue
from typing import Any, Protocol, TypeAlias, TypeVar

from msgspec import Struct

from koord.api.dask_cluster import connected, unwanted
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal

#: A batch is to take so long, in seconds: much longer than handing it out.
_BATCH_S = 0.2

#: So many batches of each worker are handed out: one that it is at, and one that is next.
_AHEAD = 2

#: How often it is looked whether the campaign is to end, in seconds.
_LOOK_S = 0.25

#: For so long a scheduler may say nothing when it is asked whether it is there, in seconds.
_ANSWERS_S = 5.0

#: A run by which workers end is given to another so often.
_MOST_TRIES = 3

#: What is wrong with an order.
Refusal: TypeAlias = tuple[Diagnostic, ...]

R_co = TypeVar("R_co", covariant=True)


class Order(Protocol[R_co]):
    """Something to make, which other processes can be sent."""

    @property
    def key(self) -> tuple[str, int]:
        """What no other order of a campaign has."""
        ...

    @property
    def words(self) -> str:
        """It in words, after "whoever makes"."""
        ...

    def prepare(self) -> None:
        """Make in this process what it, and those like it, need. Raises KoordError."""
        ...

    def make(self, is_enough: Callable[[], bool]) -> R_co | None:
        """Make it; None if it was cancelled. Raises KoordError."""
        ...


#: What came of an order: what was made, a refusal, or None if it was cancelled.
Outcome: TypeAlias = Any


class Made(Struct, frozen=True):
    """What a worker made of a batch, and the seconds that it took."""

    outcomes: tuple[Outcome, ...]
    took_s: float


class LostError(Exception):
    """Raised where the workers ended that a batch was given to."""


class Team(ABC):
    """Workers that make batches of runs."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many batches can be made at a time."""

    @abstractmethod
    def submit(self, orders: Sequence[Order[Any]]) -> Any:
        """Hand out a batch: a future, which has ``add_done_callback``."""

    @abstractmethod
    def made(self, future: Any) -> Made:
        """What came of a future that is done. Raises LostError, and KoordError."""

    @abstractmethod
    def close(self, unfinished: Sequence[Any]) -> None:
        """End the workers, or what they are at for nobody."""


def rows_of(
    orders: Iterable[Order[R_co]],
    jobs: int,
    cluster: str | None,
    is_enough: Callable[[], bool],
    most: int | None = None,
) -> Generator[R_co, None, None]:
    """Yield the rows of runs as they finish, with a number of workers, or a cluster's.

    Workers begin at once, before somebody asks for the first row. Orders are asked for when workers
    are free: what comes may hang on the rows before. ``most`` is how many there are at most (as
    many as there are). Raises KoordError.
    """
    if most is None:
        orders = list(orders)
        most = len(orders)
    outcomes: Generator[Outcome, None, None]
    if cluster is not None:
        outcomes = _by_team(iter(orders), _Cluster(cluster), is_enough, most)
    elif jobs > 1 and most > 1:
        left = iter(orders)
        first = next(left)
        team = _Processes(min(jobs, most), first.prepare)
        outcomes = _by_team(chain([first], left), team, is_enough, most)
    else:
        outcomes = (order.make(is_enough) for order in orders)
    return _rows(outcomes)


def _rows(outcomes: Generator[Outcome, None, None]) -> Generator[Any, None, None]:
    """Yield what was made, until something was cancelled. Raises KoordError."""
    with closing(outcomes):
        for outcome in outcomes:
            if isinstance(outcome, tuple):
                raise KoordError(outcome)
            if outcome is None:
                return
            yield outcome


def _by_team(
    orders: Iterator[Order[Any]], team: Team, is_enough: Callable[[], bool], most: int
) -> Generator[Outcome, None, None]:
    """Have runs made by a team; those whose worker ended again. Raises KoordError."""
    again, waiting = deque[Order[Any]](), dict[Any, list[Order[Any]]]()
    done: SimpleQueue[Any] = SimpleQueue()
    tries: Counter[tuple[str, int]] = Counter()
    size, alone = 1, False
    try:
        while True:
            ahead = _AHEAD * team.workers
            while len(waiting) < ahead and not alone:
                if again and waiting:  # what a worker ended at is made alone: so it shows which
                    break
                fair = -(-most // ahead)  # at the end none has all that is left
                alone = bool(again)
                batch = [again.popleft()] if again else [*islice(orders, max(1, min(size, fair)))]
                if not batch:
                    break
                most -= 0 if alone else len(batch)
                future = team.submit(batch)
                waiting[future] = batch
                future.add_done_callback(done.put)
            if not waiting:
                return
            try:
                future = done.get(timeout=_LOOK_S)
            except Empty:
                if is_enough():
                    return
                continue
            batch, alone = waiting.pop(future), False
            try:
                made = team.made(future)
            except LostError as error:
                _count(batch, tries, str(error))
                again.extend(batch)
                continue
            yield from made.outcomes
            each_s = made.took_s / len(batch)
            size = max(1, min(2 * size, int(_BATCH_S / max(each_s, 1e-6))))
            if is_enough():
                return
    finally:
        team.close(list(waiting))


def _count(batch: Sequence[Order[Any]], tries: Counter[tuple[str, int]], why: str) -> None:
    """Note that workers ended at a batch. Raises KoordError if one run did it again and again."""
    tries.update(order.key for order in batch)
    often = [order for order in batch if tries[order.key] >= _MOST_TRIES]
    if often and len(batch) == 1:
        story = f"whoever makes {often[0].words} ends: {why}"
        raise refusal("K948", "<campaign>", story, "go on without it, or with more memory")


# --- what workers do ------------------------------------------------------------------------------


def _made(orders: Sequence[Order[Any]], is_enough: Callable[[], bool] = lambda: False) -> Made:
    """Make a batch of runs, until one is cancelled or refused.

    Diagnostics are returned as data, which other processes can send.
    """
    began, outcomes = time.perf_counter(), list[Outcome]()
    for order in orders:
        try:
            outcome: Outcome = order.make(is_enough)
        except KoordError as error:
            outcome = error.diagnostics
        outcomes.append(outcome)
        if outcome is None or isinstance(outcome, tuple):
            break
    return Made(tuple(outcomes), time.perf_counter() - began)


def _on_worker(orders: Sequence[Order[Any]]) -> Made:
    """As :func:`_made`, on a Dask worker, until nobody waits for the runs any more."""
    return _made(orders, unwanted())


# --- processes of this machine --------------------------------------------------------------------


class _Processes(Team):
    """Processes that are forked where that is safe, after what runs need was loaded and compiled.

    Else they are fresh interpreters, which each load and compile it: a process with several threads
    leaves what these were at as it is to whom it forks, locks among it.
    """

    def __init__(self, count: int, prepare: Callable[[], None]) -> None:
        """Make processes; ``prepare`` loads and compiles."""
        self._count, self._is_forked = count, _can_fork()
        if self._is_forked:
            with suppress(KoordError):  # whoever makes the run tells it
                prepare()
            self._is_forked = _can_fork()  # still
        self._line, self._ours = Pipe(duplex=False)
        self._pool = self._new()

    @property
    def workers(self) -> int:
        return self._count

    def submit(self, orders: Sequence[Order[Any]]) -> Any:
        try:
            return self._pool.submit(_made, orders)
        except BrokenProcessPool:  # one has ended: so have the others
            self._pool.shutdown(wait=True)
            self._pool = self._new()
            return self._pool.submit(_made, orders)

    def made(self, future: Any) -> Made:
        try:
            made: Made = future.result()
        except BrokenProcessPool:
            raise LostError("its process ended each time, maybe for want of memory") from None
        return made

    def close(self, unfinished: Sequence[Any]) -> None:
        # Nobody waits for what they are at. They end when they hear that our end is closed.
        self._pool.shutdown(wait=not unfinished, cancel_futures=True)
        self._ours.close()
        self._line.close()

    def _new(self) -> ProcessPoolExecutor:
        """A pool whose processes have begun where they are forked: there is no thread yet."""
        forked = self._is_forked and _can_fork()
        context: BaseContext = get_context("fork") if forked else get_context("spawn")
        ours = self._ours if forked else None
        pool = ProcessPoolExecutor(
            self._count, context, initializer=_begin_worker, initargs=(self._line, ours)
        )
        if forked:
            gc.freeze()  # whom it forks does not look through what it has, which would copy it
            try:
                pool.submit(_nothing)
            finally:
                gc.unfreeze()
        return pool


def _can_fork() -> bool:
    """Return whether this process may be forked: on Linux, from the only thread of Python.

    Other threads are of libraries that workers do not use (pyarrow), or that stop and begin anew
    around a fork by themselves (OpenBLAS).
    """
    return sys.platform == "linux" and threading.active_count() == 1


def _nothing() -> None:
    """Do nothing: with the first order a pool forks its processes."""


def _begin_worker(line: Connection, other: Connection | None) -> None:
    """Set up a worker: it ignores Ctrl-C, and ends with the process that made it.

    ``other`` is the end of the line that the process has that forked this one: it is to be alone.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if other is not None:
        other.close()
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)  # what is to happen is who asks' matter
    # To free all that it has would take longer than to load it; who asks waits for that.
    util.Finalize(None, os._exit, args=(0,), exitpriority=0)

    def end() -> None:
        line.poll(None)
        signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=end, name="line to who asks", daemon=True).start()


# --- a cluster ------------------------------------------------------------------------------------


class _Cluster(Team):
    """The workers of a Dask cluster, which may come and go."""

    def __init__(self, address: str) -> None:
        """Connect to the scheduler at an address. Raises KoordError."""
        self._client, self._address = connected(address), address
        self._workers, self._looked_s = 1, -1.0

    @property
    def workers(self) -> int:
        now_s = time.monotonic()
        if now_s - self._looked_s > 1.0:
            self._looked_s = now_s
            with self._reached():
                found = self._client.nthreads()
            self._workers = max(1, sum(found.values()))
        return self._workers

    def submit(self, orders: Sequence[Order[Any]]) -> Any:
        with self._reached():
            return self._client.submit(_on_worker, orders, pure=False, retries=0)

    def made(self, future: Any) -> Made:
        try:
            if future.status in ("cancelled", "lost"):
                raise CancelledError
            error = future.exception()
            made: Made | None = future.result() if error is None else None
        except (CancelledError, OSError):  # a connection that ends is one of the latter
            if self._is_there():
                raise LostError("what a worker of the cluster had made was lost with it") from None
            raise self._gone() from None
        if type(error).__name__ == "KilledWorker":
            raise LostError(f"so did each of {error.allowed_failures + 1} workers of the cluster")
        if made is None:
            raise error
        return made

    def close(self, unfinished: Sequence[Any]) -> None:
        with suppress(OSError):  # it may be gone
            if unfinished:
                self._client.cancel(unfinished)
            self._client.close()

    @contextmanager
    def _reached(self) -> Iterator[None]:
        """Within the context, a scheduler that goes away is told. Raises KoordError."""
        try:
            yield
        except OSError:
            raise self._gone() from None

    def _is_there(self) -> bool:
        """Return whether the scheduler answers: else it was a worker that went away."""
        try:
            self._client.sync(self._client.scheduler.identity, callback_timeout=_ANSWERS_S)
        except OSError:  # a timeout is one, too
            return False
        return True

    def _gone(self) -> KoordError:
        story = f"there is no Dask scheduler at {self._address} any more"
        hint = "the runs that were made are kept with `csv=`: go on with `resume=`"
        return refusal("K935", "<cluster>", story, hint)
