"""Campaigns: many simulated runs with different seeds; metrics with confidence intervals."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from itertools import takewhile
from os import PathLike
from pathlib import PurePath

from msgspec import Struct, to_builtins
from msgspec.structs import replace

from koord.api.campaign_course import Course
from koord.api.campaign_figures import (
    ALPHA,
    Interval,
    Metric,
    Until,
    alpha_of,
    interval,
    looks,
    mean_words,
    settled,
    until_of,
)
from koord.api.campaign_runs import Order, Row, RunFile
from koord.api.campaign_workers import rows_of
from koord.api.files import check_writable, file_name, same_file
from koord.api.fitting import Configurable, FitRequest, fit, fit_request, seeded
from koord.api.pictures import check_drawable
from koord.api.programs import Loadable, Value, exact
from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.results import ArgumentError, Result, html_table
from koord.api.robots import MOST_ROBOTS, Seconds
from koord.api.sim_setup import check_can_begin
from koord.runtime.motion.libraries import require
from koord.syntax.literals import ParamValue, literal
from koord.version import __version__

#: So many runs of a value are made at most where nobody says how many.
MOST_RUNS = 1000


class CampaignRequest(Struct, frozen=True):
    """The request for a campaign: its runs, how to make them, and the files to keep."""

    runs: int = 1  #: of each value; with ``until`` the most
    until: Until | None = None  #: ends the runs of a value sooner
    jobs: int = 1  #: at a time, in processes
    cluster: str | None = None  #: the address of a Dask scheduler
    swept: str | None = None  #: the param that has one value after the other; or ``robots``
    values: tuple[ParamValue, ...] = ()
    rounds: int | None = None
    duration_s: float | None = None
    check_summaries: bool = False
    kernels: bool = True
    csv: str | None = None
    parquet: str | None = None
    resume: bool = False
    plot: str | None = None

    def check(self) -> None:
        """Check that the campaign can be made, before long work is done.

        Raises KoordError, and ArgumentError.
        """
        if self.cluster is not None:
            require(("distributed",), "cluster")
        if self.parquet is not None:
            require(("pyarrow",), "parquet")
        files = [path for path in (self.csv, self.parquet) if path is not None]
        if self.resume and not files:
            raise ArgumentError("resume", "goes on with the runs in a file: name it with csv")
        for path in files:
            check_writable(path)
        if self.csv is not None and self.parquet is not None and same_file(*files):
            raise ArgumentError("parquet", "is the file of the lines: name another one")
        if self.plot is not None:
            check_drawable(self.plot)
            check_writable(self.plot)


class Campaign(Result, frozen=True, kw_only=True):
    """The results of a campaign's runs, in the order of the values and seeds."""

    program: str
    swept: str  #: what differs between groups of runs
    runs: tuple[Row, ...]
    interrupted: bool
    until: Until | None = None

    @property
    def ok(self) -> bool:
        """True if all runs were made, and none broke a claim or got stuck."""
        return not self.interrupted and not any(row.is_bad or row.stuck for row in self.runs)

    def groups(self) -> dict[str, tuple[Row, ...]]:
        """The runs of each value that was swept; of each number of robots if none was."""
        found: dict[str, list[Row]] = {}
        for row in self.runs:
            found.setdefault(row.swept or str(row.robots), []).append(row)
        return {value: tuple(rows) for value, rows in found.items()}

    def alpha(self, group: Sequence[Row]) -> float:
        """With which probability an interval of a group of runs may be wrong.

        Where it was looked at more than once, each look has a part of what all together have.
        """
        if self.until is None:
            return ALPHA
        enough = settled(group, self.until)
        last = sum(1 for _ in takewhile(lambda runs: runs < len(group), looks())) + 1
        return alpha_of(last if enough is None else enough[1])

    def precise(self) -> dict[str, Interval]:
        """The interval of what the campaign was to be precise in, of each value that has one."""
        found = dict[str, Interval]()
        for value, group in self.groups().items():
            metric = Metric.TIME if self.until is None else self.until.metric
            numbers = [number for row in group if (number := metric.of(row)) is not None]
            if len(numbers) > 1:
                found[value] = interval(metric, numbers, self.alpha(group))
        return found

    def common(self) -> str:
        """The settings that are the same for all runs: δ, and others that differ from the text."""
        values = {row.values for row in self.runs}
        return f", {values.pop()}" if len(values) == 1 else ""

    def to_dict(self) -> dict[str, object]:
        """The results as plain data, as ``koord sim --runs --json`` prints them."""
        runs = [to_builtins(row) for row in self.runs]
        document: dict[str, object] = {"format": "koord-campaign", "version": 1, "runs": runs}
        if self.until is not None:
            document["until"] = to_builtins(self.until)
            document["intervals"] = to_builtins(self.precise())
        return document

    def __repr__(self) -> str:
        bad = sum(row.is_bad for row in self.runs)
        return f"<Campaign {self.program}: {len(self.runs)} runs{self.common()}, {bad} broken>"

    def _repr_html_(self) -> str:
        columns = (self.swept, "runs", "time s", "distance m", "waited s", "broken")
        rows = [
            (
                value,
                len(group),
                mean_words([time for row in group if (time := row.taken_s) is not None]),
                mean_words([row.distance_m for row in group]),
                mean_words([row.waited_s for row in group]),
                sum(row.is_bad for row in group),
            )
            for value, group in self.groups().items()
        ]
        return html_table(f"{self.program}: {len(self.runs)} runs{self.common()}", columns, rows)


class CampaignBegun(Progress, frozen=True, kw_only=True):
    """Progress: a campaign begins; ``known`` of its ``runs`` are done already."""

    known: int
    runs: int


class RunOver(Progress, frozen=True, kw_only=True):
    """Progress: a run is over; ``done`` of ``runs`` are."""

    row: Row
    done: int
    runs: int


def campaign(
    program: Loadable,
    config: Configurable = None,
    *,
    runs: int = 1,
    sweep: Mapping[str, Iterable[Value]] | None = None,
    until: Mapping[str, float] | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    params: Mapping[str, Value] | None = None,
    robots: int | None = None,
    seed: int | None = None,
    delta_s: Seconds = None,
    rounds: int | None = None,
    duration_s: float | None = None,
    check_summaries: bool = False,
    kernels: bool = True,
    csv: str | PathLike[str] | None = None,
    parquet: str | PathLike[str] | None = None,
    resume: bool = False,
    plot: str | PathLike[str] | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Campaign:
    """Simulate a program many times, with seeds that follow ``seed``.

    ``sweep`` names one param, or ``robots``, and its values: there are so many ``runs`` for each.
    ``until`` names a figure (``time``, ``distance``, ``waited``, or ``broken``: the rate of runs in
    which a claim was), and how far its interval of 95 % may reach to each side: the runs of a value
    end when it does not reach further, and ``runs`` are the most. Such intervals hold although they
    were looked at before. ``jobs`` are made at a time, in processes of this machine; or as many as
    the Dask ``cluster`` at this address has workers. A line for each run is written to the file
    ``csv`` as it ends, and all are to the file ``parquet`` every few seconds (a table for data
    frames; needs ``koord[parquet]``); from either ``resume`` goes on. ``plot`` is the file of a
    picture. The other arguments are those of :func:`koord.simulate`. ``progress`` hears
    :class:`RunOver`.

    Raises :class:`koord.KoordError` for what is wrong with the input.

    >>> koord.campaign(program, runs=10, sweep={"robots": range(2, 9)}, jobs=2)
    """
    if sweep is not None and len(sweep) != 1:
        raise ArgumentError("sweep", "name one param, or `robots`, with its values")
    name, values = next(iter(sweep.items())) if sweep is not None else (None, ())
    request = CampaignRequest(
        runs=runs,
        until=None if until is None else until_of(until),
        jobs=jobs,
        cluster=cluster,
        swept=name,
        values=tuple(exact(value) for value in values),
        rounds=rounds,
        duration_s=duration_s,
        check_summaries=check_summaries,
        kernels=kernels,
        csv=file_name(csv),
        parquet=file_name(parquet),
        resume=resume,
        plot=file_name(plot),
    )
    request.check()
    wanted = seeded(fit_request(program, config, params, robots, seed, delta_s))
    return make_campaign(wanted, request, progress, cancellation)


def make_campaign(
    wanted: FitRequest,
    request: CampaignRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Campaign:
    """As :func:`campaign`, for a checked request with a seed. Raises KoordError."""
    tell, is_cancelled = heard_by(progress), asker(cancellation)
    orders = list(_orders(wanted, request))
    course = Course(orders, request.until)
    with ExitStack() as stack:
        files = [stack.enter_context(file) for file in _files(wanted, request)]
        for file in files:
            file.begin(course.numbers, course.is_whole)
            for row in file.rows:
                course.add(row)
        for file in files:  # what one of them has is known
            file.rows = tuple(course.rows())
        known, most = course.made, len(orders)
        of = f"of {most} runs" if request.until is None else f"of at most {most} runs"
        tell(CampaignBegun(f"{known} {of} are there already", known=known, runs=most))
        _check_sweep(course.missing())
        left = len(course.missing())
        made = rows_of(course.wanted(), request.jobs, request.cluster, is_cancelled, left)
        tell(Progress(f"{known} {of}"))
        for row in stack.enter_context(closing(made)):
            course.add(row)
            for file in files:
                file.add(row)
            done = course.made
            tell(RunOver(f"{done} {of}", row=row, done=done, runs=most))
            if course.is_over:
                break
        rows = course.rows()
        for file in files if course.is_over else ():
            file.finish(rows)
    found = Campaign(
        program=wanted.source.name,
        swept=request.swept or "robots",
        runs=tuple(rows),
        interrupted=is_cancelled() and not course.is_over,
        until=request.until,
    )
    if request.plot is not None and rows:
        from koord.api.campaign_pictures import CampaignFigure, draw_campaign

        draw_campaign(
            request.plot,
            CampaignFigure(
                PurePath(found.program).name + found.common(), found.swept, found.groups()
            ),
        )
    return found


def _files(wanted: FitRequest, request: CampaignRequest) -> Iterator[RunFile]:
    """Yield the files of a campaign's runs."""
    campaign, resumes = _identity(wanted, request), request.resume
    if request.csv is not None:
        yield RunFile(request.csv, campaign, resumes=resumes)
    if request.parquet is not None:
        from koord.api.campaign_parquet import ParquetFile

        yield ParquetFile(request.parquet, campaign, resumes=resumes)


def _check_sweep(orders: Sequence[Order]) -> None:
    """Check that a run can begin with each of the swept values, before any does.

    Raises KoordError.
    """
    first_of = {order.swept: order for order in reversed(orders)}
    if len(first_of) > 1:
        for order in first_of.values():
            check_can_begin(fit(order.request))


def _identity(wanted: FitRequest, request: CampaignRequest) -> str:
    """A digest of a campaign: runs with equal digest, seed and swept value are equal."""
    configuration = wanted.configuration
    said = (
        __version__,
        wanted.source.text,
        [source.text for source in wanted.properties],
        None
        if configuration is None
        else "\n---\n".join(one.text for one in configuration.document.sources),
        sorted((name, literal(value)) for name, value in wanted.params.items()),
        str(wanted.delta_s),
        wanted.seed,
        wanted.robots,
        request.rounds,
        request.duration_s,
        request.check_summaries,
        request.swept,
    )
    return hashlib.sha256(repr(said).encode()).hexdigest()[:16]


def _orders(wanted: FitRequest, request: CampaignRequest) -> Iterator[Order]:
    assert wanted.seed is not None
    for value in request.values if request.swept is not None else (None,):
        given = wanted
        if value is None:
            pass
        elif request.swept == "robots":
            given = replace(wanted, robots=_robots(value))
        else:
            given = replace(wanted, params={**wanted.params, request.swept: value})
        for number in range(request.runs):
            yield Order(
                replace(given, seed=wanted.seed + number),
                request.rounds,
                request.duration_s,
                request.check_summaries,
                "" if value is None else literal(value),
                request.kernels,
            )


def _robots(value: ParamValue) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MOST_ROBOTS:
        story = f"robots must be from 1 to {MOST_ROBOTS}, not {literal(value)}"
        raise ArgumentError("sweep", story)
    return value
