"""The runs of a campaign, one after the other, in processes or on a cluster; and their file.

A campaign that was ended, however that was, can be resumed: what stands in its file is
not done again. The first column says which campaign a line is of: none gets lines of another.
"""

from __future__ import annotations

import csv
import io
import os
import signal
import threading
import time
from collections.abc import Callable, Collection, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import closing
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import BinaryIO, TypeAlias, get_type_hints

import msgspec
from msgspec import Struct
from msgspec.structs import astuple, replace

from koord.api.dask_cluster import connected, engine, unwanted
from koord.api.files import read_written, write_atomically
from koord.api.fitting import FitRequest
from koord.api.reseeding import Reseeding
from koord.api.sim_setup import check_begun, limit_s, simulation
from koord.sim.running import Simulation, run
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal

_FAULT = "fault"


class Row(Struct, frozen=True):
    """The result of a run: a line of the CSV file."""

    swept: str
    robots: int
    values: str  #: δ, and each value that is not the text's
    seed: int
    ending: str
    time_s: float
    tasks: int
    tasks_done: int
    tasks_s: float | None
    distance_m: float
    separation_m: float | None
    safety_m: float
    waited_s: float
    events: int
    skips: int
    blocked: int
    messages: int
    broken: int
    stuck: int  #: robots that stand still at the end and should go
    digest: str
    wall_s: float

    @property
    def key(self) -> tuple[str, int]:
        """The key of a run in its campaign."""
        return self.swept, self.seed

    @property
    def taken_s(self) -> float | None:
        """The time of the last task's visit, or None; without tasks, of the run's end."""
        return self.tasks_s if self.tasks else self.time_s

    @property
    def is_done(self) -> bool:
        """True if all tasks were visited, and no fault ended the run."""
        return self.tasks_done == self.tasks and self.ending != _FAULT

    @property
    def is_bad(self) -> bool:
        """True if a claim was broken, or a fault ended the run."""
        return self.broken > 0 or self.ending == _FAULT


_HINTS = get_type_hints(Row)
_COLUMNS = ["campaign", *Row.__struct_fields__]


class RunFile:
    """The CSV file of a campaign, which is readable after each line."""

    def __init__(self, path: str, campaign: str, *, resumes: bool) -> None:
        self.rows: tuple[Row, ...] = ()  #: of runs that were made before
        self._path, self._campaign, self._resumes = path, campaign, resumes
        self._file: BinaryIO | None = None

    def __enter__(self) -> RunFile:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def begin(self, wanted: Collection[tuple[str, int]]) -> None:
        """Read the finished runs among the wanted ones. Writes nothing yet. Raises KoordError."""
        there = self._there()
        self.rows = tuple(row for row in there or () if row.key in wanted)
        if self._resumes and there is None:
            hint = "leave out `resume=`, or name another file"
            raise refusal("K937", self._path, "its runs are not of this campaign", hint)
        if not self._resumes and 0 < len(self.rows) < len(wanted):
            story = f"it has {len(self.rows)} of the {len(wanted)} runs of this campaign"
            hint = "go on with `resume=`, or remove the file"
            raise refusal("K937", self._path, story, hint)
        if not self._resumes:
            self.rows = ()

    def add(self, row: Row) -> None:
        """Write the line of a run at once, and as a whole. Raises KoordError."""
        if self._file is None:
            write_atomically(self._path, self._written(self.rows))
        try:
            if self._file is None:
                self._file = open(self._path, "ab", buffering=0)  # noqa: SIM115
            self._file.write(_lines([self._cells(row)]))
        except OSError as error:
            raise refusal("K903", self._path, f"cannot be written: {error.strerror}") from None

    def finish(self, rows: Sequence[Row]) -> None:
        """Sort the lines when all runs are there. Raises KoordError."""
        if os.path.isfile(self._path):
            write_atomically(self._path, self._written(rows))

    # --- inside ---------------------------------------------------------------------------------

    def _there(self) -> list[Row] | None:
        """The runs in the file; None if it is not of this campaign."""
        if not os.path.isfile(self._path):
            return []
        text = read_written(self._path).decode("utf-8", "replace")
        whole = text[: text.rfind("\n") + 1]  # the last line may have been cut off
        lines = csv.DictReader(io.StringIO(whole))
        if text and lines.fieldnames != _COLUMNS:
            return None
        rows = []
        for cells in lines:
            campaign = cells.pop("campaign", None)
            if campaign != self._campaign:
                return None
            try:
                rows.append(_row(cells))
            except msgspec.ValidationError:
                return None
        return rows

    def _written(self, rows: Sequence[Row]) -> bytes:
        return _lines([_COLUMNS, *map(self._cells, rows)])

    def _cells(self, row: Row) -> list[object]:
        return [self._campaign, *astuple(row)]


def _lines(lines: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue().encode("utf-8")


def _row(cells: dict[str, str]) -> Row:
    """Parse a line. Raises ValidationError."""
    given = {
        name: None if cell == "" and _HINTS.get(name) is not str else cell
        for name, cell in cells.items()
    }
    return msgspec.convert(given, Row, strict=False)


#: What is wrong with an order.
Refusal: TypeAlias = tuple[Diagnostic, ...]


class Order(Struct, frozen=True):
    """A run to make. ``swept`` is the value of the swept parameter."""

    request: FitRequest
    rounds: int | None
    duration_s: float | None
    check_summaries: bool
    swept: str

    @property
    def key(self) -> tuple[str, int]:
        """The key of a run in its campaign."""
        assert self.request.seed is not None
        return self.swept, self.request.seed


def rows_of(
    orders: Sequence[Order], jobs: int, cluster: str | None, is_enough: Callable[[], bool]
) -> Generator[Row, None, None]:
    """Yield the rows of runs as they finish, with a number of workers, or a cluster's.

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
    """Make runs in processes of this machine, some at a time."""
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
    """Set up a worker: it ignores Ctrl-C, and ends with the process that made it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end() -> None:
        line.poll(None)
        signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=end, name="line to who asks", daemon=True).start()


def _on_cluster(
    orders: Sequence[Order], address: str, is_enough: Callable[[], bool]
) -> Generator[Row | Refusal | None, None, None]:
    """Make runs on the workers of a Dask cluster. Raises KoordError."""
    with connected(address) as client:
        futures = client.map(_on_worker, orders, pure=False, retries=0)
        for future in engine().as_completed(futures):
            yield future.result()
            if is_enough():
                client.cancel(futures)
                return


def _on_worker(order: Order) -> Row | Refusal | None:
    """As :func:`_tried`, on a Dask worker, until nobody waits for the run any more."""
    return _tried(order, unwanted())


def _tried(order: Order, is_enough: Callable[[], bool] = lambda: False) -> Row | Refusal | None:
    """As :func:`row_of`; diagnostics are returned as data, which other processes can send."""
    try:
        return row_of(order, is_enough)
    except KoordError as error:
        return error.diagnostics


#: What the last runs of each thread had in common. Runs of a campaign have one request for each
#: swept value, and come in turn.
_KNOWN = threading.local()


def _reseeding(request: FitRequest) -> Reseeding:
    """What runs of a request have in common with others of its kind. Raises KoordError."""
    common = replace(request, seed=None)
    known: tuple[FitRequest, Reseeding] | None = getattr(_KNOWN, "last", None)
    if known is None or known[0] != common:
        known = _KNOWN.last = (common, Reseeding(request))
    return known[1]


def row_of(order: Order, is_enough: Callable[[], bool] = lambda: False) -> Row | None:
    """Make a run; None if it was cancelled before its end. Raises KoordError."""
    assert order.request.seed is not None
    fitted, built = _reseeding(order.request).run(order.request.seed)
    made = simulation(
        fitted, Simulation, keep_going=True, check_summaries=order.check_summaries, built=built
    )
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
