"""Rare violations: how often runs break a claim, by splitting, with a confidence interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing

from msgspec import Struct, to_builtins

from koord.api.campaign_figures import Interval
from koord.api.campaign_runs import reseeding
from koord.api.campaign_workers import rows_of
from koord.api.fitting import Configurable, FitRequest, fit_request, seeded
from koord.api.programs import Loadable, Value
from koord.api.progress import Cancellation, CancelledError, Listener, Progress, asker, heard_by
from koord.api.results import ArgumentError, Result, html_table
from koord.api.robots import Seconds
from koord.api.sim_setup import begin
from koord.api.splitting_method import Repetition, estimate, split
from koord.api.splitting_runs import SplitRuns, target_of
from koord.syntax.diagnostics import refusal

#: So many particles, and repetitions, there are where nobody says how many.
PARTICLES, REPETITIONS = 100, 20

#: What was never otherwise in so many runs is taken to be always so.
_SURELY = 100

_CURE = (
    "say in the configuration what disturbs robots (`noise`, `wind`), or let the program `choose`; "
    "where only places of robots or tasks hang on the seed, count violations with `runs=` alone"
)


class SplittingRequest(Struct, frozen=True):
    """The request for the rate of a claim's violations: ``runs`` repetitions of splitting."""

    claim: str
    level: str | None = None
    particles: int = PARTICLES
    runs: int = REPETITIONS
    jobs: int = 1
    rounds: int | None = None
    duration_s: float | None = None
    kernels: bool = True

    def check(self) -> None:
        """Check that there can be an interval. Raises ArgumentError."""
        if self.particles < 2:
            raise ArgumentError("particles", "of one run there is none that another could replace")
        if self.runs < 2:
            raise ArgumentError("runs", "an interval needs two repetitions, and better twenty")


class Part(Struct, frozen=True):
    """A repetition that was made, and what was seen of chance in it.

    ``ends`` is how many different ends runs had that nothing was replaced in, and ``equal`` of the
    ``branches`` ended as the run that they branched off.
    """

    number: int
    found: Repetition
    ends: int
    branches: int
    equal: int


class Order(Struct, frozen=True):
    """A repetition to make."""

    wanted: FitRequest
    request: SplittingRequest
    number: int

    @property
    def key(self) -> tuple[str, int]:
        """The key of a repetition."""
        return "", self.number

    @property
    def words(self) -> str:
        """The repetition in words."""
        return f"repetition {self.number}"

    def prepare(self) -> None:
        """Compile what runs need, and load it. Raises KoordError."""
        assert self.wanted.seed is not None
        begin(*reseeding(self.wanted).run(self.wanted.seed), kernels=self.request.kernels)

    def make(self, is_enough: Callable[[], bool]) -> Part | None:
        """Make it; None if it was cancelled. Raises KoordError."""
        wanted, request = self.wanted, self.request
        assert wanted.seed is not None
        common = reseeding(wanted)
        target = target_of(wanted, common.first, request.claim, request.level)
        runs = SplitRuns(
            common, target, request.rounds, request.duration_s, request.kernels, is_enough
        )
        try:
            made = split(runs, request.particles, wanted.seed, self.number)
        except CancelledError:
            return None
        return Part(self.number, made, len(runs.ends), runs.branches, runs.equal)


class RepetitionOver(Progress, frozen=True, kw_only=True):
    """Progress: a repetition is over; ``done`` of ``repetitions`` are."""

    done: int
    repetitions: int


class Splitting(Result, frozen=True, kw_only=True):
    """How often runs break a claim. ``interval`` is of 95 %; None if it was interrupted."""

    program: str
    claim: str
    particles: int
    seed: int
    repetitions: tuple[Repetition, ...]
    interval: Interval | None
    interrupted: bool

    @property
    def found(self) -> int:
        """How many repetitions found violations."""
        return sum(one.rate > 0 for one in self.repetitions)

    @property
    def runs(self) -> int:
        """How many runs were made, also in part."""
        return sum(one.runs for one in self.repetitions)

    @property
    def highest(self) -> float | None:
        """The highest level of the runs that broke nothing; None if there was none."""
        highest = max((one.highest for one in self.repetitions), default=-math.inf)
        return None if math.isinf(highest) else highest

    @property
    def ok(self) -> bool:
        """True if all repetitions were made, and none found a violation."""
        return not self.interrupted and not self.found

    def to_dict(self) -> dict[str, object]:
        """The results as plain data; the schema is ``splitting``."""
        from koord.api import forms

        interval = self.interval
        made = forms.Splitting(
            1,
            self.program,
            self.claim,
            self.particles,
            self.seed,
            self.interrupted,
            None if interval is None else interval.mean,
            None if interval is None else interval.low,
            None if interval is None else interval.high,
            self.found,
            self.runs,
            self.highest,
            [
                forms.SplittingRepetition(one.rate, one.broken_at_first, one.runs, one.steps)
                for one in self.repetitions
            ],
        )
        found: dict[str, object] = to_builtins(made)
        return found

    def __repr__(self) -> str:
        return f"<Splitting {self.program}: {self.words()}>"

    def words(self) -> str:
        """What came of it, in a sentence."""
        if self.interval is None:
            return f"{self.claim}: interrupted after {len(self.repetitions)} repetitions"
        mean, low, high = self.interval.mean, self.interval.low, self.interval.high
        if not self.found:
            return f"no run breaks {self.claim}: in at most {high:.2g} of runs it is broken"
        return f"{mean:.3g} of runs break {self.claim} ({low:.2g}–{high:.2g})"

    def _repr_html_(self) -> str:
        columns = ("repetition", "rate", "runs", "steps")
        rows = [
            (number, f"{one.rate:.3g}", one.runs, one.steps)
            for number, one in enumerate(self.repetitions)
        ]
        return html_table(f"{self.program}: {self.words()}", columns, rows)


def splitting(
    program: Loadable,
    config: Configurable = None,
    *,
    claim: str,
    level: str | None = None,
    particles: int = PARTICLES,
    runs: int = REPETITIONS,
    jobs: int = 1,
    params: Mapping[str, Value] | None = None,
    robots: int | None = None,
    seed: int | None = None,
    delta_s: Seconds = None,
    rounds: int | None = None,
    duration_s: float | None = None,
    kernels: bool = True,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Splitting:
    """Estimate in which share of runs a ``claim`` is broken, however rare that is.

    ``claim`` is the name of an invariant or contract, ``separation`` (robots keep the distance that
    is safe) or ``fault``. ``level`` is a number, in Koord, that goes up as a run comes closer to
    breaking it, of all robots that it may be about the greatest; or a comparison, of which it is
    by how much it does not hold. For invariants that compare numbers, and separation, it may be
    left out. Runs that are at the lowest level are replaced by such as branch off the others, until
    all break the claim (:mod:`koord.api.splitting_method`). This is repeated ``runs`` times, with
    so many ``particles`` each, and the interval of 95 % is that of the repetitions' mean, which is
    the rate that :func:`koord.campaign` counts, without bias. A better level, more particles and
    more repetitions make it narrower. The other arguments are those of :func:`koord.campaign`.
    ``progress`` hears :class:`RepetitionOver`.

    Raises :class:`koord.KoordError` for what is wrong with the input, and where nothing in runs is
    left to chance.

    >>> koord.splitting(program, claim="separation", runs=20, particles=100).interval
    """
    request = SplittingRequest(claim, level, particles, runs, jobs, rounds, duration_s, kernels)
    request.check()
    wanted = seeded(fit_request(program, config, params, robots, seed, delta_s))
    return make_splitting(wanted, request, progress, cancellation)


def make_splitting(
    wanted: FitRequest,
    request: SplittingRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Splitting:
    """As :func:`splitting`, for a checked request with a seed. Raises KoordError."""
    tell, is_cancelled = heard_by(progress), asker(cancellation)
    assert wanted.seed is not None
    common = reseeding(wanted)
    if any(robot.model.modules for robot in common.first.scene.robots):
        story = "plug-ins serve modules of the robots, and what they draw cannot be drawn anew"
        raise refusal("K955", "<splitting>", story, "count violations with `runs=` alone")
    target = target_of(wanted, common.first, request.claim, request.level)
    orders = [Order(wanted, request, number) for number in range(request.runs)]
    found = dict[int, Part]()
    with closing(rows_of(orders, request.jobs, None, is_cancelled)) as made:
        for part in made:
            found[part.number] = part
            done = len(found)
            _check_chance([*found.values()], request, is_over=done == request.runs)
            words = f"{done} of {request.runs} repetitions"
            tell(RepetitionOver(words, done=done, repetitions=request.runs))
    repetitions = tuple(found[number].found for number in sorted(found))
    is_whole = len(repetitions) == request.runs
    return Splitting(
        program=wanted.source.name,
        claim=target.broken,
        particles=request.particles,
        seed=wanted.seed,
        repetitions=repetitions,
        interval=estimate(repetitions, request.particles) if is_whole else None,
        interrupted=not is_whole,
    )


def _check_chance(parts: Sequence[Part], request: SplittingRequest, *, is_over: bool) -> None:
    """Check that something in runs is left to chance, as soon as it shows. Raises KoordError."""
    branches, runs = sum(part.branches for part in parts), request.particles * len(parts)
    if branches:
        is_by_chance = branches > sum(part.equal for part in parts)
        what = f"{branches} runs were to go on by new chance, and all ended as they had before"
    else:
        is_by_chance = any(part.ends > 1 for part in parts)
        what = f"{runs} runs with different seeds are equal"
    if not is_by_chance and (is_over or (branches or runs) >= _SURELY):
        story = f"nothing that happens in runs is left to chance: {what}"
        raise refusal("K955", "<splitting>", story, _CURE)
