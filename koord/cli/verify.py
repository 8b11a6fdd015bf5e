"""``koord verify FILE…``: a verdict on every property; ``--export`` and ``--watch`` besides."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.api.export import FORMATS, NAME, Wanted, exported
from koord.api.programs import Program
from koord.api.progress import cores
from koord.api.results import ArgumentError
from koord.api.robots import system_of
from koord.api.verify import Engine, Question, verify_each
from koord.cli.arguments import (
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
from koord.cli.diagnostics import DiagnosticReport, report_error
from koord.cli.exits import Exit, gravest
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import ReadOptions, load_programs
from koord.cli.progress import Interruption, LiveLine, TimeUpError, time_limit
from koord.cli.requests import Request, request_of
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:
    from koord.api.verdict_forms import Report
    from koord.api.verify_report import VerifyReport


def add_export(parser: argparse.ArgumentParser) -> None:
    """Add the flags of ``--export``."""
    parser.add_argument(
        "--export",
        choices=FORMATS,
        help="verify nothing: write the claims as a problem for other tools",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        default=DASH,
        help="where --export writes to; a name in .aig makes AIGER binary (-)",
    )


def export(arguments: argparse.Namespace) -> int:
    """Export the claims about one program as a problem."""
    if len(arguments.files) > 1 or len(arguments.robots) > 1 or arguments.robots[0].any_number:
        raise argparse.ArgumentTypeError("--export takes one program and one number of robots")
    output = arguments.output
    if output != DASH:
        check_writable(output, (*arguments.files, *arguments.properties))
    report = DiagnosticReport()
    programs = load_programs(arguments.files, ReadOptions.of(arguments), report)
    report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    (program,) = programs
    wanted = Wanted(
        program,
        system_of(program.core, arguments.robots[0], arguments.delta),
        arguments.export,
        tuple(arguments.names),
        arguments.rounds,
        arguments.timeout,
        _module(output) if arguments.export == "tla" else None,
        output.endswith(".aig"),
    )
    try:
        with LiveLine(sys.stderr) as line:
            made = exported(wanted, line.show, lambda: False)
    except ArgumentError:
        raise
    except KoordError as error:  # of what the other language cannot say
        report_error(error, as_json=False, sources=report.sources.values())
        return Exit.BAD_INPUT
    except TimeoutError as error:
        print(f"koord verify: {error}", file=sys.stderr)
        return Exit.UNKNOWN
    for note in made.notes:
        print(f"koord verify: {note}", file=sys.stderr)
    if output == DASH:
        sys.stdout.write(made.content.decode())
    else:
        made.save(output)
    return Exit.OK


def _module(output: str) -> str | None:
    """The name of a TLA+ module in a file; None without a file."""
    if output == DASH:
        return None
    path = Path(output)
    if not NAME.fullmatch(path.stem) or path.suffix != ".tla":
        raise argparse.ArgumentTypeError(
            f"--export tla: a module has the name of its file, and {path.name!r} is none; "
            "write letters, digits and _, and .tla"
        )
    return path.stem


#: Often enough to answer at once, seldom enough to cost nothing.
POLL_S = 0.25

#: A file's time of change and size; None while it is not there, as between the steps of a save.
Stamp = tuple[int, int] | None


def watched(
    paths: Sequence[str],
    work: Callable[[], int],
    *,
    pause: Callable[[float], None] = time.sleep,
) -> int:
    """Repeat the work after each change of the files, until Ctrl-C; return the last exit code."""
    code = 0
    try:
        while True:
            # Before the work: a change that comes during it counts.
            before = _stamps(paths)
            code = work()
            print("\nwatching; Ctrl-C ends it", file=sys.stderr, flush=True)
            while _stamps(paths) in (before, None):
                pause(POLL_S)
            print(file=sys.stderr)
    except KeyboardInterrupt:
        return code


def _stamps(paths: Sequence[str]) -> list[Stamp] | None:
    """The stamps of all files; None while one is not there."""
    found = [_stamp(path) for path in paths]
    return None if None in found else found


def _stamp(path: str) -> Stamp:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


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
        "--timeout",
        metavar="SECONDS",
        type=seconds,
        help="end after this time, whatever is asked, with what is known by then (never)",
    )
    parser.add_argument(
        "--property-timeout",
        dest="claim_s",
        metavar="SECONDS",
        type=seconds,
        help="give up each property after this time, and go on with the others (never); all that "
        "is done for a property counts, by any engine, and so does what is done for all together",
    )
    parser.add_argument(
        "--jobs",
        metavar="N",
        type=jobs,
        default=cores(),
        help="in how many processes what takes long is looked at: properties one by one, numbers "
        "of robots, programs (as many as there are cores)",
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
    request = request_of(arguments)
    if not arguments.watch:
        return _once(arguments, request)
    paths = [*arguments.files, *arguments.properties]
    if DASH in paths:
        raise argparse.ArgumentTypeError("--watch needs files; standard input cannot change")
    return watched(paths, lambda: _once(arguments, replace(request, asked_at=time.monotonic())))


def _once(arguments: argparse.Namespace, request: Request) -> int:
    """Read the programs and verify them."""
    report = DiagnosticReport()
    try:
        with time_limit(request.left_s()):
            programs = load_programs(arguments.files, ReadOptions.of(arguments), report)
    except TimeUpError:
        print("koord verify: timeout before all programs were read", file=sys.stderr)
        return Exit.UNKNOWN
    if report.errors and request.as_json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    try:
        told: list[Report] = []
        code = _verified(programs, request, told)
        if request.as_json:
            from koord.api.verify_report import reports_dict

            print(json.dumps(reports_dict(told), indent=2))
        return code
    except ArgumentError:
        raise
    except KoordError as error:  # of the program, met on the way
        report_error(error, as_json=request.as_json, sources=report.sources.values())
        return Exit.BAD_INPUT


def _verified(programs: Sequence[Program], request: Request, told: list[Report]) -> Exit:
    """Verify programs, and show the results of each as soon as they are known."""
    from koord.cli.verified import tell, tell_sweep

    questions = [
        Question(
            program,
            system_of(program.core, fleet, request.delta_s),
            every_n=request.fleets[0].any_number,
        )
        for program in programs
        for fleet in request.fleets
    ]
    answers = _answers(questions, request)
    codes: list[Exit] = []
    for program in programs:
        if Exit.INTERRUPTED in codes:
            break
        found = islice(answers, len(request.fleets))
        if len(request.fleets) > 1:
            codes.append(tell_sweep(program, found, request, told))
        else:
            codes += [tell(report, request, told) for report in found]
    if len(codes) < len(programs):
        codes.append(Exit.INTERRUPTED)
    return gravest(codes)


def _answers(questions: Sequence[Question], request: Request) -> Iterator[VerifyReport]:
    """The reports, in order, with a live line while they are computed."""
    shown = [LiveLine(None)]
    with Interruption() as interruption:
        answers = verify_each(
            questions,
            request.options,
            lambda text: shown[0].show(text),
            lambda: interruption.requested,
        )
        while True:
            with LiveLine(sys.stderr) as shown[0]:
                report = next(answers, None)
            if report is None:
                return
            yield report
