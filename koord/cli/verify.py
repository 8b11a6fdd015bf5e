"""``koord verify FILE…``: a verdict on every property of a program."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from koord.cli.arguments import (
    Fleet,
    add_bounds,
    add_files,
    add_json,
    add_settings,
    add_trace,
    check_files,
    jobs,
    seconds,
    violations,
)
from koord.cli.diagnostics import Report, report_error
from koord.cli.exits import Exit, gravest
from koord.cli.exporting import add_export, export
from koord.cli.files import DASH, check_writable, write_atomically
from koord.cli.inputs import LoadedProgram, Reading, load_programs
from koord.cli.progress import Interruption, LiveLine
from koord.cli.systems import system_of
from koord.cli.terminal import style_of
from koord.cli.watching import watched
from koord.semantics.configurations import System
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:
    from koord.verify.instants import Shadowed
    from koord.verify.resting import Resting
    from koord.verify.verdicts import Bounds, Verdict
    from koord.verify.verdicts import Report as Verification


#: Changes when readers of what ``--json`` prints have to change.
JSON_VERSION = 1


class Engine(Enum):
    """How a verdict is found."""

    AUTO = "auto"  #: induction, then whichever of the others fits the program
    ABC = "abc"  #: the same as bits, but that abc looks for proofs, if it is installed
    BITS = "bits"  #: finite instances bit by bit: SAT, IC3
    BMC = "bmc"  #: bounded model checking, round by round
    SPACER = "spacer"  #: constrained Horn clauses: reals and integers, all rounds
    SEARCH = "search"  #: all configurations one by one
    INDUCTION = "induction"  #: for all rounds at once


@dataclass(frozen=True, slots=True)
class Request:
    """What is to be verified of each program, and within which limits."""

    fleets: tuple[Fleet, ...]  #: several make a sweep
    rounds: int
    delta_s: Fraction
    engine: Engine
    properties: tuple[str, ...]  #: their names; none means all
    timeout_s: float | None
    claim_s: float | None  #: the time for each property
    jobs: int
    violations: int  #: how many different ones of each claim
    seed: int
    trace: str | None  #: the file for the trace of a violation
    certificate: str | None  #: the file for what a proof consists of
    plot: str | None  #: the file for a picture of a sweep
    found: str | None  #: the file for invariants that were found
    rests_on: bool  #: find out what the proofs need
    instants: bool  #: ask of the time between the ends of rounds too
    explain: bool  #: show the steps that break claims which are not inductive
    as_json: bool


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser)
    add_bounds(parser, several=True)
    parser.add_argument(
        "--engine",
        choices=[engine.value for engine in Engine],
        default=Engine.AUTO.value,
        help="how the verdict is found (auto)",
    )
    parser.add_argument(
        "--property",
        dest="names",
        metavar="NAME",
        action="append",
        default=[],
        help="verify this property only; may be given several times",
    )
    parser.add_argument(
        "--timeout", metavar="SECONDS", type=seconds, help="give up after this time (never)"
    )
    parser.add_argument(
        "--property-timeout",
        dest="claim_s",
        metavar="SECONDS",
        type=seconds,
        help="give up each property after this time, and go on with the others (never)",
    )
    parser.add_argument(
        "--jobs",
        metavar="N",
        type=jobs,
        default=os.cpu_count() or 1,
        help="how many properties that take long are looked at at a time, with "
        "--property-timeout (as many as there are cores)",
    )
    parser.add_argument(
        "--instants",
        action="store_true",
        help="verify invariants at every instant between the ends of rounds too",
    )
    parser.add_argument(
        "--explain",
        action="store_true",
        help="show why claims that stay unknown could not be proved by induction",
    )
    parser.add_argument(
        "--rests-on",
        action="store_true",
        help="find out which assumptions, contracts and summaries the proofs need",
    )
    parser.add_argument(
        "--max-violations",
        dest="violations",
        metavar="K",
        type=violations,
        default=1,
        help="look for K different ways to break each claim that is violated (1)",
    )
    add_settings(parser)
    add_trace(parser, "the trace of a violation")
    parser.add_argument(
        "--certificate",
        metavar="FILE",
        help="write to FILE what the proofs consist of, for `koord recheck`",
    )
    parser.add_argument(
        "--plot", metavar="FILE", help="draw time against robots, for --robots 2..10 (.svg, .png)"
    )
    parser.add_argument(
        "--watch", action="store_true", help="verify again each time a file is saved"
    )
    parser.add_argument(
        "--save-invariants",
        dest="found",
        metavar="FILE",
        help="write the invariants that were found to FILE, for --with",
    )
    add_export(parser)
    add_json(parser, "the verdict")
    parser.epilog = (
        "exit codes: 0 holds, 1 violated, 2 errors in the input, 3 unknown, 4 holds, but vacuously"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files([*arguments.files, *arguments.properties])
    if arguments.export is not None:
        return export(arguments)
    request = _request(arguments)
    if request.trace is not None:
        if len(arguments.files) > 1:
            raise argparse.ArgumentTypeError("--trace takes one program at a time")
        if len(request.fleets) > 1:
            raise argparse.ArgumentTypeError("--trace takes one number of robots at a time")
        check_writable(request.trace)
    if request.certificate is not None:
        if len(arguments.files) > 1 or len(request.fleets) > 1 or request.fleets[0].any_number:
            raise argparse.ArgumentTypeError(
                "--certificate takes one program and one number of robots"
            )
        check_writable(request.certificate)
    if request.plot is not None:
        _check_plot(arguments.files, request)
    if request.found is not None:
        if len(arguments.files) > 1 or len(request.fleets) > 1:
            raise argparse.ArgumentTypeError("--save-invariants takes one program at a time")
        check_writable(request.found)
    if request.rests_on and len(request.fleets) > 1:
        raise argparse.ArgumentTypeError("--rests-on takes one number of robots at a time")
    if request.claim_s is not None and request.instants:
        raise argparse.ArgumentTypeError("--property-timeout and --instants do not go together")
    if request.fleets[0].any_number and request.engine is not Engine.AUTO:
        raise argparse.ArgumentTypeError(
            "--robots any has an engine of its own: leave --engine out"
        )
    if request.engine is Engine.ABC:
        _check_abc()
    if not arguments.watch:
        return _once(arguments, request)
    paths = [*arguments.files, *arguments.properties]
    if DASH in paths:
        raise argparse.ArgumentTypeError("--watch needs files; standard input cannot change")
    return watched(paths, lambda: _once(arguments, request))


def _once(arguments: argparse.Namespace, request: Request) -> int:
    """Read the programs and verify them."""
    report = Report()
    programs = load_programs(arguments.files, Reading.of(arguments), report)
    if report.errors and request.as_json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    try:
        told: list[dict[str, object]] = []
        verified = _verify if len(request.fleets) == 1 else _sweep
        code = gravest([verified(program, request, told) for program in programs])
        if request.as_json:
            print(json.dumps({"version": JSON_VERSION, "reports": told}, indent=2))
        return code
    except KoordError as error:  # of the program, met on the way
        report_error(error, as_json=request.as_json, sources=report.sources.values())
        return Exit.BAD_INPUT


def _request(arguments: argparse.Namespace) -> Request:
    return Request(
        fleets=arguments.robots,
        rounds=arguments.rounds,
        delta_s=arguments.delta,
        engine=Engine(arguments.engine),
        properties=tuple(arguments.names),
        timeout_s=arguments.timeout,
        claim_s=arguments.claim_s,
        jobs=arguments.jobs,
        violations=arguments.violations,
        seed=arguments.seed,
        trace=arguments.trace,
        certificate=arguments.certificate,
        plot=arguments.plot,
        found=arguments.found,
        rests_on=arguments.rests_on,
        instants=arguments.instants,
        explain=arguments.explain,
        as_json=arguments.json,
    )


def _check_abc() -> None:
    from koord.verify.bits.abc import installed

    if installed() is None:
        raise argparse.ArgumentTypeError(
            "--engine abc: there is no abc here (Debian: apt-get install berkeley-abc);"
            " --engine bits needs none"
        )


def _check_plot(files: Sequence[str], request: Request) -> None:
    from koord.cli.sweeps import check_drawable

    assert request.plot is not None
    if len(files) > 1 or len(request.fleets) == 1:
        raise argparse.ArgumentTypeError("--plot takes one program and a sweep: --robots 2..10")
    check_drawable(request.plot)
    check_writable(request.plot)


def _verify(program: LoadedProgram, request: Request, told: list[dict[str, object]]) -> Exit:
    # Z3 is loaded here and not before, so that the other commands start without it.
    from koord.cli import verdicts

    (fleet,) = request.fleets
    system = system_of(program.program, fleet, request.delta_s)
    asked = _asked(system, request, every_n=fleet.any_number)
    bounds, report = asked.bounds, asked.report
    found = _resting(system, bounds, asked.at_ends, request) if request.rests_on else None
    if request.as_json:
        told.append(verdicts.as_json(program.source.name, system, bounds, report))
        if found is not None:
            from koord.cli import premises

            told[-1]["rests_on"] = premises.as_json(found)
    else:
        style = style_of(sys.stdout)
        for text in verdicts.lines(program.source.name, system, report, style):
            print(text)
        for verdict in report.verdicts:
            if verdict.counterexample is not None:
                from koord.cli import counterexamples

                print()
                for text in counterexamples.lines(
                    program, asked.system_of(verdict), verdict, style
                ):
                    print(text)
            elif request.explain and verdict.step is not None:
                from koord.cli import steps

                print()
                for text in steps.lines(system, verdict, style):
                    print(text)
        if found is not None:
            from koord.cli import premises

            print()
            for text in premises.lines(program, found, style):
                print(text)
        print()
        print(verdicts.summary(system, bounds, report, style))
    if request.trace is not None:
        _keep(program, asked, request.trace)
    if request.found is not None:
        _save(program, system, asked.at_ends, request.found)
    if request.certificate is not None and not report.interrupted:
        from koord.cli.certifying import certify

        certify(program, system, asked.at_ends, request.certificate, request.timeout_s)
    return _exit(report)


def _sweep(program: LoadedProgram, request: Request, told: list[dict[str, object]]) -> Exit:
    """One number of robots after the other; Ctrl-C ends it with those that are done."""
    from koord.cli import sweeps, verdicts

    style = style_of(sys.stdout)
    name = program.source.name
    points: list[sweeps.Point] = []
    if not request.as_json:
        print("\n".join(sweeps.heading(name, style)))
    for fleet in request.fleets:
        system = system_of(program.program, fleet, request.delta_s)
        asked = _asked(system, request)
        bounds, report = asked.bounds, asked.report
        points.append(sweeps.Point(system, report))
        told.append(verdicts.as_json(name, system, bounds, report))
        if not request.as_json:
            print(sweeps.row(points[-1], style), flush=True)
        if report.interrupted:
            break
    if request.plot is not None:
        sweeps.draw(request.plot, name, points)
    return gravest(_exit(point.report) for point in points)


@dataclass(frozen=True, slots=True)
class Asked:
    """What was found out about a system; ``shadows`` is set if instants were asked for too."""

    system: System
    bounds: Bounds
    at_ends: Verification
    between: Verification | None = None
    shadows: Shadowed | None = None

    @property
    def report(self) -> Verification:
        """Everything."""
        if self.between is None:
            return self.at_ends
        return replace(
            self.at_ends,
            verdicts=self.at_ends.verdicts + self.between.verdicts,
            seconds=self.at_ends.seconds + self.between.seconds,
            interrupted=self.at_ends.interrupted or self.between.interrupted,
        )

    def system_of(self, verdict: Verdict) -> System:
        """The system whose run a counterexample is."""
        if self.shadows is None or verdict.claim.name not in self.shadows.names:
            return self.system
        return self.shadows.system


def _asked(system: System, request: Request, *, every_n: bool = False) -> Asked:
    """The verdicts on one system, with a live line while they are looked for.

    With ``every_n`` they are for every number of robots, and the system is an example of them.
    """
    from koord.verify.claims import claims_of, liveness_of
    from koord.verify.portfolio import Choice, verify
    from koord.verify.solving import Deadline
    from koord.verify.verdicts import Bounds, Report

    known = [claim.name for claim in (*claims_of(system), *liveness_of(system))]
    deadline, shadows = Deadline.after(request.timeout_s), None
    if request.instants:
        from koord.verify import instants

        shadows = instants.shadowed(system, deadline, request.seed)
        between = [*shadows.names, *(claim.name for claim, _ in shadows.unsaid)]
        if not between:
            why = "no invariant reads a sensor, so none can break between rounds"
            print(f"koord verify: {why}", file=sys.stderr)
    else:
        between = []
    _check_names(request.properties, [*known, *between])
    choice = Choice.EVERY_N if every_n else Choice(request.engine.value)
    bounds = Bounds(request.rounds, request.timeout_s, request.violations, request.claim_s)
    if request.claim_s is not None:
        from koord.verify.apart import verify_apart

        verify = partial(verify_apart, jobs=request.jobs)
    own = [name for name in request.properties if name in known]
    with Interruption() as interruption, LiveLine(sys.stderr) as line:
        report = Report((), (), 0.0)
        if own or not request.properties:
            report = verify(
                system,
                bounds,
                choice,
                names=own,
                seed=request.seed,
                progress=line.show,
                interrupted=lambda: interruption.requested,
            )
        if shadows is None or report.interrupted:
            return Asked(system, bounds, report)
        left = bounds if request.timeout_s is None else replace(bounds, timeout_s=deadline.left_s())
        found = instants.verified(
            shadows,
            left,
            choice,
            wanted=lambda name: not request.properties or name in request.properties,
            seed=request.seed,
            progress=line.show,
            interrupted=lambda: interruption.requested,
        )
    return Asked(system, bounds, report, found, shadows)


def _resting(
    system: System, bounds: Bounds, report: Verification, request: Request
) -> Resting | None:
    """What the proofs rest on; None where Ctrl-C ended the search for proofs or for this."""
    from koord.verify.resting import resting

    if report.interrupted:
        return None
    try:
        with LiveLine(sys.stderr) as line:
            return resting(system, report.verdicts, bounds, seed=request.seed, progress=line.show)
    except KeyboardInterrupt:
        return None


def _exit(report: Verification) -> Exit:
    from koord.verify.verdicts import Outcome

    if report.interrupted:
        return Exit.INTERRUPTED
    codes = {
        Outcome.HOLDS: Exit.VACUOUS if report.is_vacuous else Exit.OK,
        Outcome.VIOLATED: Exit.VIOLATED,
        Outcome.UNKNOWN: Exit.UNKNOWN,
    }
    return codes[report.outcome]


def _keep(program: LoadedProgram, asked: Asked, path: str) -> None:
    """Write the trace of the first violation, the shortest of several; say so if there is none."""
    from koord.cli import counterexamples
    from koord.cli.traces import write_trace

    broken = [v for v in asked.report.verdicts if v.counterexample is not None]
    if not broken:
        print("koord verify: no claim is violated, so there is no trace to write", file=sys.stderr)
        return
    shortest = min(broken, key=_length)
    if asked.system_of(shortest) is asked.system:
        write_trace(path, counterexamples.trace_of(program, asked.system, shortest))
        return
    # Traces have the ends of rounds: this one has the run in which it happens in between.
    assert asked.shadows is not None
    assert shortest.counterexample is not None
    recording = asked.shadows.unshadowed(shortest.counterexample.recording)
    write_trace(path, counterexamples.trace_of_run(program, asked.system, recording))


def _save(program: LoadedProgram, system: System, report: Verification, path: str) -> None:
    """Write the invariants that were found; say so if there are none."""
    from koord.cli import verdicts

    if not report.found:
        print("koord verify: no invariant was found that a proof rests on", file=sys.stderr)
        return
    text = verdicts.invariants(program.source.name, system, report)
    write_atomically(path, text.encode("utf-8"))


def _length(verdict: Verdict) -> int:
    assert verdict.counterexample is not None
    return verdict.counterexample.round


def _check_names(wanted: Sequence[str], known: Sequence[str]) -> None:
    """A misspelt name must not pass for a verdict. Raises ArgumentTypeError."""
    for word in wanted:
        if word not in known:
            listed = ", ".join(known)
            raise argparse.ArgumentTypeError(
                f"--property: there is no {word!r}; there are {listed}"
            )
