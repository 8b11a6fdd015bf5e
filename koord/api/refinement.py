"""Refinement: are runs of compiled programs runs of the semantics?"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from itertools import cycle, islice
from os import PathLike
from pathlib import Path
from random import Random
from typing import Literal, TypeAlias

from msgspec import Struct, to_builtins
from msgspec.structs import replace

from koord.api.files import check_writable, file_name
from koord.api.programs import Loadable, Program, program_of
from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.refused_run import RefusedRun
from koord.api.results import ArgumentError, Result, html_table
from koord.api.robots import AS_STATED, FleetSize, Seconds, delta_of, system_of
from koord.api.traces import sources_of
from koord.refinement.cases import (
    TRIES,
    Case,
    Tried,
    all_generated,
    ever_smaller,
    generated,
    of_program,
    tried,
)
from koord.refinement.cases import Target as Target
from koord.refinement.running import Compiled, ready
from koord.runtime.chaos.network import CALM, CHAOS, LOSS, Faults
from koord.runtime.columns.counts import Counts
from koord.syntax import core
from koord.syntax.literals import literal, number
from koord.syntax.source import Source, counted
from koord.syntax.system import System

#: What happens to messages; chaos: robots crash and come back besides.
Network: TypeAlias = Literal["none", "loss", "chaos"]
NETWORKS: dict[Network, Faults] = {"none": CALM, "loss": LOSS, "chaos": CHAOS}

#: So many robots, in turn.
_ROBOTS = (1, 2, 3, 4)

#: Of so many runs on the engine, one more on each of the others: they take longer. Machine code is
#: not everywhere, so kernels are asked for.
_SHARES = {Target.ENGINE: 1, Target.NETWORK: 10, Target.UDP: 50}

#: Processes do not do the same thing twice, so that making a run smaller is soon a matter of luck.
_TRIES_OVER_UDP = 10


class RefineRequest(Struct, frozen=True):
    """The request for refinement: runs to make of programs, or of generated ones.

    ``target`` None: on all of them but kernels, on those that take long the fewer. ``case`` is the
    seed of the one generated program that is to be run. ``save`` is the folder for a run that is
    refused.
    """

    runs: int = 100
    target: Target | None = None
    rounds: int = 8
    delta_s: Fraction | None = None
    faults: Network = "none"
    seed: int = 0
    case: int | None = None
    save: str | None = None

    @property
    def targets(self) -> tuple[Target, ...]:
        """The targets on which programs run; a kept generated case runs on the engine only."""
        if self.target is not None:
            return (self.target,)
        return (Target.ENGINE,) if self.case is not None else tuple(_SHARES)

    def check(self) -> None:
        """Check that a refused run can be saved. Raises KoordError."""
        if self.save is not None:
            check_writable(str(Path(self.save) / "refinement"))


class TargetRuns(Struct, frozen=True, rename="camel"):
    """The totals of runs on a target. Runs that gave up found no values that the program allows."""

    target: Target
    runs: int = 0
    rounds: int = 0
    steps: int = 0
    skips: int = 0
    faults: int = 0
    gave_up: int = 0
    turns_by_code: int = 0  #: turns that machine code made; of ``kernels`` only
    turns_by_robots: int = 0  #: and compiled robots, as it was in doubt or there was none

    def plus(self, one: Tried) -> TargetRuns:
        """The totals with one more run."""
        if one.judged is None or one.ran is None:
            return replace(self, runs=self.runs + 1)
        rounds = one.ran.trace.recording.rounds
        counts = Counts() if one.ran.counts is None else one.ran.counts
        return TargetRuns(
            self.target,
            self.runs + 1,
            self.rounds + len(rounds),
            self.steps + one.judged.steps,
            self.skips + sum(event is None for round_ in rounds for event in round_.events),
            self.faults + (one.ran.fault_place is not None),
            self.gave_up + (one.ran.gave_up is not None),
            self.turns_by_code + counts.by_code,
            self.turns_by_robots + counts.in_doubt + counts.by_robots,
        )


class Refinement(Result, frozen=True):
    """The result of refinement."""

    programs: tuple[str, ...]  #: those that were run, with δ and each value that is not the text's
    targets: tuple[TargetRuns, ...]
    failure: RefusedRun | None  #: the first run that is refused, made as small as could be found
    interrupted: bool

    @property
    def ok(self) -> bool:
        """True if all runs were made, and none was refused."""
        return self.failure is None and not self.interrupted

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord check-refinement --json`` prints it."""
        return {
            "format": "koord-refinement",
            "version": 1,
            "targets": to_builtins(self.targets),
            "failure": None if self.failure is None else self.failure.to_dict(),
            "programs": list(self.programs),
        }

    def __repr__(self) -> str:
        runs = ", ".join(f"{one.target.value}: {one.runs} runs" for one in self.targets if one.runs)
        if self.failure is None:
            return f"<Refinement {runs}: no violation>"
        return "\n".join([f"<Refinement {runs}: refused>", *self.failure.lines()])

    def _repr_html_(self) -> str:
        rows = [(one.target.value, one.runs, one.rounds, one.steps) for one in self.targets]
        said = "no violation" if self.failure is None else next(self.failure.lines())
        return html_table(said, ("target", "runs", "rounds", "steps"), rows)


class RunJudged(Progress, frozen=True, kw_only=True):
    """Progress: one more run was made and judged."""

    runs: TargetRuns


class RunRefused(Progress, frozen=True, kw_only=True):
    """Progress: a run was refused; it is kept, and smaller ones are searched for."""

    refused: RefusedRun


def refine(
    programs: Loadable | Iterable[Loadable] = (),
    *,
    runs: int = 100,
    target: Target | Literal["engine", "kernels", "network", "udp"] | None = None,
    rounds: int = 8,
    delta_s: Seconds = None,
    faults: Network = "none",
    seed: int = 0,
    case: int | None = None,
    save: str | PathLike[str] | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Refinement:
    """Run compiled programs, and judge each run by the reference semantics.

    ``programs`` are one program or several; without any, programs are generated, or the one of the
    seed ``case``. There are ``runs`` of each with up to so many ``rounds`` of ``delta_s`` seconds:
    on the ``target`` ``"engine"`` (one process), ``"kernels"`` (the same by machine code),
    ``"network"`` (a simulated network) or ``"udp"`` (processes), or without one on all but kernels,
    a tenth and a fiftieth as often on the latter. ``faults``
    happen to messages. The first run that is refused ends it; it is made smaller, and kept in the
    folder ``save``. ``progress`` hears :class:`RunJudged` and :class:`RunRefused`.

    Raises :class:`koord.KoordError` for what is wrong with the input.

    >>> koord.refine(program, runs=20, target="engine").ok
    True
    """
    several: tuple[Loadable, ...]
    if isinstance(programs, Program | Source | str | PathLike):
        several = (programs,)
    else:
        several = tuple(programs)
    if case is not None and several:
        raise ArgumentError("case", "is of a generated program: leave programs out")
    if faults not in NETWORKS:
        raise ArgumentError("faults", f"{faults!r} is none of {', '.join(NETWORKS)}")
    where = target if target is None or isinstance(target, Target) else _target(target)
    request = RefineRequest(
        runs=runs,
        target=where,
        rounds=rounds,
        delta_s=delta_of(delta_s),
        faults=faults,
        seed=seed,
        case=case,
        save=file_name(save),
    )
    loaded = tuple(program_of(one) for one in several)
    return refine_loaded(loaded, request, progress, cancellation)


def refine_loaded(
    programs: tuple[Program, ...],
    request: RefineRequest,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Refinement:
    """As :func:`refine`, for loaded programs. Raises KoordError."""
    request.check()
    tell, is_cancelled = heard_by(progress), asker(cancellation)
    everything = {target: TargetRuns(target) for target in request.targets}
    failure: RefusedRun | None = None
    for one in _all(request, programs):
        target = one.outcome.case.target
        totals = everything[target] = everything[target].plus(one.outcome)
        tell(RunJudged(f"{target.value}: {counted(totals.runs, 'run')}", runs=totals))
        if one.outcome.failed:
            failure = RefusedRun(one.outcome, _again(request, one)).kept(request.save)
            tell(RunRefused("looking for smaller runs that are refused", refused=failure))
            failure = _made_smaller(failure, one, request.save, is_cancelled)
        if failure is not None or is_cancelled():
            break
    about = tuple(about_of(program, request) for program in programs)
    return Refinement(about, tuple(everything.values()), failure, is_cancelled())


def about_of(program: Program, request: RefineRequest) -> str:
    """A program with its robots, δ, and each value that is not the text's."""
    problem = program.problem(None, request.delta_s)
    return f"{problem.name}: {', '.join(problem.values)}"


def _target(name: str) -> Target:
    known = [target.value for target in Target]
    if name not in known:
        raise ArgumentError("target", f"{name!r} is none of {', '.join(known)}")
    return Target(name)


# --- runs ---------------------------------------------------------------------------------------


class _Run(Struct, frozen=True):
    """A run with its result, its number, and the compiled program."""

    outcome: Tried
    number: int
    program: Program | None = None  #: None: a generated one
    made: Compiled | None = None


def _all(request: RefineRequest, programs: tuple[Program, ...]) -> Iterator[_Run]:
    """Yield every run, as it is made."""
    faults, most, targets = NETWORKS[request.faults], request.rounds, request.targets
    if request.case is not None:
        yield _Run(tried(generated(request.case, most, targets[0], faults)), 1)
        return
    for target in targets:
        runs = request.runs if len(targets) == 1 else -(-request.runs // _SHARES[target])
        if not programs:
            cases = all_generated(Random(request.seed), most, target, faults)
            for case in islice(cases, runs):
                yield _Run(tried(case), 1)
        for program in programs:
            made = ready(program.core)
            systems = _systems(program.core, request.delta_s)
            seeds = Random(request.seed)
            cases = of_program(sources_of(program), systems, most, seeds, target, faults)
            for count, case in enumerate(islice(cases, runs), start=1):
                yield _Run(tried(case, made), count, program, made)


def _systems(program: core.Program, delta_s: Fraction | None) -> Iterator[System]:
    """Yield systems: the program with its stated robots, or with one number after the other."""
    stated = program.instance
    fleets = [AS_STATED] if stated.kinds else [FleetSize(total) for total in _ROBOTS]
    return (system_of(program, fleet, delta_s) for fleet in cycle(fleets))


def _made_smaller(
    found: RefusedRun, of: _Run, save: str | None, is_cancelled: Callable[[], bool]
) -> RefusedRun:
    """A smaller run that fails as well, searched for until cancelled.

    Of a program that was compiled once for all runs, the program stays as it is.
    """

    def attempt(case: Case) -> Tried:
        if is_cancelled():
            raise KeyboardInterrupt
        return tried(case, of.made)

    tries = _TRIES_OVER_UDP if found.case.target is Target.UDP else TRIES
    try:
        for outcome in ever_smaller(found.outcome, attempt, programs=of.made is None, tries=tries):
            found = found.smaller(outcome).kept(save)
    except KeyboardInterrupt:
        if not is_cancelled():
            raise
    return found


def _again(request: RefineRequest, one: _Run) -> str:
    """The command that repeats a run: the last of a number, on one target."""
    case = one.outcome.case
    words = ["koord", "check-refinement"]
    if one.program is None:
        words += ["--case", str(case.seed)]
    else:
        name = one.program.name
        words += [name if Path(name).is_file() else "-"]
        words += ["--runs", str(one.number), "--seed", str(request.seed)]
    words += ["--target", case.target.value, "--rounds", str(request.rounds)]
    if request.faults != "none":
        words += ["--faults", request.faults]
    if one.program is not None:
        if request.delta_s is not None:
            words += ["--delta", number(request.delta_s)]
        for param, value in one.program.settings.params.items():
            words += ["--set", f"{param}={literal(value)}"]
        for source in one.program.properties:
            words += ["--with", source.name]
    return shlex.join(words)
