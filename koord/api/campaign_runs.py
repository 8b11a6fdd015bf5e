"""The runs of a campaign, and their file.

A campaign that was ended, however that was, can be resumed: what stands in its file is
not done again. The first column says which campaign a line is of: none gets lines of another.
"""

from __future__ import annotations

import csv
import errno
import io
import os
import sys
import threading
import time
from collections.abc import Callable, Collection, Sequence
from typing import BinaryIO, get_type_hints

import msgspec
from msgspec import Struct
from msgspec.structs import astuple, replace

from koord.api.files import read_written, write_atomically
from koord.api.fitting import FitRequest
from koord.api.reseeding import Reseeding
from koord.api.sim_setup import begin, check_begun, limit_s, simulation
from koord.sim.running import Simulation, run
from koord.sim.traffic import TrafficMeter
from koord.syntax.diagnostics import refusal

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
    packets_sent: int  #: datagrams of all robots, one to all counted once
    packets_received: int
    bytes_sent: int  #: without the headers of the network
    bytes_received: int
    broken: int
    stuck: int  #: robots that stand still at the end and should go
    digest: str
    wall_s: float
    cpu_s: float  #: of the thread that made it
    memory_mib: float  #: the most that its process has had until then
    threads: int  #: of its process at the end

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
#: The columns of files; the first says which campaign a line is of.
COLUMNS = ["campaign", *Row.__struct_fields__]


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

    def begin(
        self, wanted: Collection[tuple[str, int]], is_whole: Callable[[Sequence[Row]], bool]
    ) -> None:
        """Read the finished runs among the wanted ones. Writes nothing yet.

        ``is_whole`` says of runs whether the campaign is over with them. Raises KoordError.
        """
        there = self._there()
        self.rows = tuple(row for row in there or () if row.key in wanted)
        if self._resumes and there is None:
            hint = "leave out `resume=`, or name another file"
            raise refusal("K937", self._path, "its runs are not of this campaign", hint)
        if not self._resumes and self.rows and not is_whole(self.rows):
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
            line = _lines([self._cells(row)])
            written = self._file.write(line)
            if written != len(line):  # no line stands there in part
                os.ftruncate(self._file.fileno(), os.fstat(self._file.fileno()).st_size - written)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
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
        if text and lines.fieldnames != COLUMNS:
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
        return _lines([COLUMNS, *map(self._cells, rows)])

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


class Order(Struct, frozen=True):
    """A run to make. ``swept`` is the value of the swept parameter."""

    request: FitRequest
    rounds: int | None
    duration_s: float | None
    check_summaries: bool
    swept: str
    kernels: bool = True

    @property
    def key(self) -> tuple[str, int]:
        """The key of a run in its campaign."""
        assert self.request.seed is not None
        return self.swept, self.request.seed

    @property
    def words(self) -> str:
        """The run in words."""
        return f"the run with seed {self.request.seed}{self.swept and f', {self.swept}'}"

    def prepare(self) -> None:
        """Compile what it needs, and load what runs like it do. Raises KoordError."""
        assert self.request.seed is not None
        begin(*reseeding(self.request).run(self.request.seed), kernels=self.kernels)

    def make(self, is_enough: Callable[[], bool]) -> Row | None:
        """As :func:`row_of`. Raises KoordError."""
        return row_of(self, is_enough)


#: What the last runs of each thread had in common. Runs of a campaign have one request for each
#: swept value, and come in turn.
_KNOWN = threading.local()


def reseeding(request: FitRequest) -> Reseeding:
    """What runs of a request have in common with others of its kind. Raises KoordError."""
    common = replace(request, seed=None)
    known: tuple[FitRequest, Reseeding] | None = getattr(_KNOWN, "last", None)
    if known is None or known[0] != common:
        known = _KNOWN.last = (common, Reseeding(request))
    return known[1]


def row_of(order: Order, is_enough: Callable[[], bool] = lambda: False) -> Row | None:
    """Make a run; None if it was cancelled before its end. Raises KoordError."""
    assert order.request.seed is not None
    fitted, built = reseeding(order.request).run(order.request.seed)
    made = simulation(
        fitted,
        Simulation,
        keep_going=True,
        check_summaries=order.check_summaries,
        built=built,
        kernels=order.kernels,
    )
    began, begun_s = time.perf_counter(), time.thread_time()
    meter = TrafficMeter(len(fitted.scene.robots))
    begun = made.begin()
    meter.note(begun, made.engine.proposals_of(begun))
    check_begun(fitted, made)
    for decision in run(made, limit_s(fitted, order.rounds, order.duration_s)):
        meter.note(decision, made.engine.proposals_of(decision))
        if is_enough():
            return None
    wall_s, cpu_s = time.perf_counter() - began, time.thread_time() - begun_s
    figures = made.figures()
    robots, sent = figures.robots, meter.traffic
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
        sent.packets_sent,
        sent.packets_received,
        sent.bytes_sent,
        sent.bytes_received,
        len(made.broken),
        len(made.standing),
        figures.digest,
        wall_s,
        cpu_s,
        _memory_mib(),
        _threads(),
    )


def _memory_mib() -> float:
    """The most memory that this process has had, in MiB; 0: nobody knows."""
    try:
        import resource
    except ImportError:  # it is of POSIX
        return 0.0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


def _threads() -> int:
    """The number of threads of this process, those of libraries too where that is known."""
    try:
        return len(os.listdir("/proc/self/task"))
    except OSError:
        return threading.active_count()
