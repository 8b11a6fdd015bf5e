"""``koord verify FILE…``: a verdict on every property; ``--export`` and ``--watch`` besides."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import TYPE_CHECKING

from msgspec.structs import replace

from koord.api.export import FORMATS, NAME, Wanted, exported
from koord.api.programs import Program
from koord.api.progress import cores
from koord.api.results import ArgumentError
from koord.api.robots import system_of
from koord.api.verify import Engine, Options, Question, engine_of, helped, verify_each
from koord.cli.arguments import (
    add_bounds,
    add_files,
    add_html,
    add_json,
    add_sarif,
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
from koord.cli.watching import watched
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:
    from koord.api.cache import Cache
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
    from pathlib import Path

    path = Path(output)
    if not NAME.fullmatch(path.stem) or path.suffix != ".tla":
        raise argparse.ArgumentTypeError(
            f"--export tla: a module has the name of its file, and {path.name!r} is none; "
            "write letters, digits and _, and .tla"
        )
    return path.stem


def add_question(parser: argparse.ArgumentParser) -> None:
    """Add the flags that say what is asked, and for how long."""
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
        "--cluster",
        metavar="ADDRESS",
        help="let workers of a Dask cluster, as tcp://host:8786, look at what can be sent to them; "
        "verdicts are the same (koord[cluster])",
    )
    parser.add_argument(
        "--instants",
        action="store_true",
        help="verify invariants at every instant between the ends of rounds too",
    )


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser)
    add_question(parser)
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
        "--wcet",
        action="store_true",
        help="tell the worst-case execution time of each event: the most steps that it takes, by "
        "which branches, and the time of its turns that were measured on this machine",
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
    add_html(parser, "verdicts, what they rest on, and each counterexample turn by turn")
    parser.add_argument(
        "--certificate",
        metavar="FILE",
        help="write to FILE what the proofs consist of, for `koord recheck`",
    )
    parser.add_argument(
        "--plot", metavar="FILE", help="draw time against robots, for --robots 2..10 (.svg, .png)"
    )
    parser.add_argument(
        "--watch",
        action="store_true",
        help="verify again each time a file is saved, what the change touches",
    )
    parser.add_argument(
        "--cache",
        action="store_true",
        help="show verdicts again of which nothing has changed, and keep new ones (`koord cache`)",
    )
    parser.add_argument(
        "--save-invariants",
        dest="found",
        metavar="FILE",
        help="write the invariants that were found to FILE, for --with",
    )
    add_export(parser)
    add_sarif(parser, "what is violated, unknown or vacuous")
    add_json(parser, "the verdict")
    parser.epilog = (
        "exit codes: 0 holds, 1 violated, 2 errors in the input, 3 unknown, 4 holds, but vacuously"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files([*arguments.files, *arguments.properties])
    if arguments.export is not None:
        return export(arguments)
    _check_flags(arguments)
    cache = _cache(arguments)
    if not arguments.watch:
        return _once(arguments, cache)
    paths = [*arguments.files, *arguments.properties]
    if DASH in paths:
        raise argparse.ArgumentTypeError("--watch needs files; standard input cannot change")
    return watched(paths, lambda: _once(arguments, cache))


def _cache(arguments: argparse.Namespace) -> Cache | None:
    """Where verdicts are kept: in memory while files are watched, in a folder if that is wanted.

    A certificate is about all claims together, and what is known of some is no part of it.
    """
    if arguments.certificate is not None or not (arguments.cache or arguments.watch):
        return None
    from koord.api.cache import Cache, usual_folder

    return Cache(usual_folder() if arguments.cache else None, note=_note)


def _check_flags(arguments: argparse.Namespace) -> None:
    """Raises ArgumentTypeError before any work is done if flags do not go together."""
    fleets, is_one = arguments.robots, len(arguments.files) == 1
    if arguments.output != DASH:
        raise argparse.ArgumentTypeError("-o says where --export writes to: add --export")
    read = (*arguments.files, *arguments.properties)
    if arguments.trace is not None:
        if not is_one:
            raise argparse.ArgumentTypeError("--trace takes one program at a time")
        if len(fleets) > 1:
            raise argparse.ArgumentTypeError("--trace takes one number of robots at a time")
        check_writable(arguments.trace, read)
    if arguments.html is not None:
        check_writable(arguments.html, read)
    if arguments.certificate is not None:
        if not is_one or len(fleets) > 1 or fleets[0].any_number:
            raise argparse.ArgumentTypeError(
                "--certificate takes one program and one number of robots"
            )
        check_writable(arguments.certificate, read)
    if arguments.plot is not None:
        from koord.api.pictures import check_drawable

        if not is_one or len(fleets) == 1:
            raise argparse.ArgumentTypeError("--plot takes one program and a sweep: --robots 2..10")
        check_drawable(arguments.plot)
        check_writable(arguments.plot, read)
    if arguments.sarif is not None:
        check_writable(arguments.sarif, read)
    if arguments.found is not None:
        if not is_one or len(fleets) > 1:
            raise argparse.ArgumentTypeError("--save-invariants takes one program at a time")
        check_writable(arguments.found, read)
    if arguments.rests_on and len(fleets) > 1:
        raise argparse.ArgumentTypeError("--rests-on takes one number of robots at a time")
    if arguments.wcet and (not is_one or len(fleets) > 1 or fleets[0].any_number):
        raise argparse.ArgumentTypeError("--wcet takes one program and one number of robots")
    try:
        engine_of(arguments.engine, every_n=fleets[0].any_number)
    except ArgumentError as error:
        raise argparse.ArgumentTypeError(_in_flags(error)) from None


def _in_flags(error: ArgumentError) -> str:
    """What is wrong with the engine, in the words of the command line."""
    if error.argument == "robots":
        return "--robots any has an engine of its own: leave --engine out"
    cure = error.message.replace("`engine='bits'`", "--engine bits")
    return f"--{error.argument} {cure}"


def options_of(arguments: argparse.Namespace, cache: Cache | None) -> Options:
    """How verdicts are looked for from now on, by the flags of :func:`add_question`."""
    limit_s = arguments.timeout
    return Options(
        rounds=arguments.rounds,
        engine=Engine(arguments.engine),
        properties=tuple(arguments.names),
        ends_at=None if limit_s is None else time.monotonic() + limit_s,
        property_timeout_s=arguments.claim_s,
        jobs=arguments.jobs,
        seed=arguments.seed,
        instants=arguments.instants,
        cache=cache,
    )


def _once(arguments: argparse.Namespace, cache: Cache | None) -> int:
    """Read the programs and verify them."""
    report = DiagnosticReport()
    options = replace(
        options_of(arguments, cache),
        max_violations=arguments.violations,
        rests_on=arguments.rests_on,
        wcet=arguments.wcet,
    )
    try:
        with time_limit(options.left_s):
            programs = load_programs(arguments.files, ReadOptions.of(arguments), report)
    except TimeUpError:
        print("koord verify: timeout before all programs were read", file=sys.stderr)
        return Exit.UNKNOWN
    if report.errors and arguments.json:
        report.print(sys.stdout, as_json=True)
    else:
        report.print(sys.stderr, as_json=False)
    reports: list[VerifyReport] = []
    if report.errors:
        _write_sarif(arguments, report, reports)
        return Exit.BAD_INPUT
    try:
        told: list[Report] = []
        with _helped(options, arguments.cluster) as options:
            code = _verified(programs, arguments, options, told, reports)
        _write_sarif(arguments, report, reports)
        if arguments.json:
            import json

            from koord.api.verdict_documents import reports_dict

            print(json.dumps(reports_dict(told), indent=2))
        return code
    except ArgumentError:
        raise
    except KoordError as error:  # of the program, met on the way
        report_error(error, as_json=arguments.json, sources=report.sources.values())
        return Exit.BAD_INPUT


def _write_sarif(
    arguments: argparse.Namespace, found: DiagnosticReport, reports: Sequence[VerifyReport]
) -> None:
    if arguments.sarif is not None:
        from koord.cli.sarif import write_sarif

        write_sarif(arguments.sarif, found.diagnostics, reports)


def _verified(
    programs: Sequence[Program],
    arguments: argparse.Namespace,
    options: Options,
    told: list[Report],
    reports: list[VerifyReport],
) -> Exit:
    """Verify programs, and show the results of each as soon as they are known.

    They are added to ``told`` where JSON is wanted, and all to ``reports``.
    """
    from koord.cli.verified import show_page, tell, tell_sweep

    fleets = arguments.robots
    questions = [
        Question(
            program,
            system_of(program.core, fleet, arguments.delta),
            every_n=fleets[0].any_number,
        )
        for program in programs
        for fleet in fleets
    ]
    answers = _noted(_answers(questions, options), reports)
    codes: list[Exit] = []
    for program in programs:
        if Exit.INTERRUPTED in codes:
            break
        found = islice(answers, len(fleets))
        if len(fleets) > 1:
            codes.append(tell_sweep(program, found, arguments, told))
        else:
            codes += [tell(report, arguments, told) for report in found]
    if len(codes) < len(programs):
        codes.append(Exit.INTERRUPTED)
    if arguments.html is not None and reports:
        show_page(reports, arguments.html)
    return gravest(codes)


def _noted(answers: Iterable[VerifyReport], answered: list[VerifyReport]) -> Iterator[VerifyReport]:
    """The reports, each of which is added to those that are ``answered``."""
    for report in answers:
        answered.append(report)
        yield report


def _answers(questions: Sequence[Question], options: Options) -> Iterator[VerifyReport]:
    """The reports, in order, with a live line while they are computed."""
    shown = [LiveLine(None)]
    with Interruption() as interruption:
        answers = verify_each(
            questions,
            options,
            lambda text: shown[0].show(text),
            lambda: interruption.requested,
        )
        while True:
            with LiveLine(sys.stderr) as shown[0]:
                report = next(answers, None)
            if report is None:
                return
            yield report


@contextmanager
def _helped(options: Options, address: str | None) -> Iterator[Options]:
    """Within the context, options by which the cluster at an address helps, if there is one."""
    with ExitStack() as stack:
        with LiveLine(sys.stderr) as line, Interruption() as interruption:
            helping = helped(options, address, line.show, lambda: interruption.requested)
            options, cluster = stack.enter_context(helping)
        if cluster is not None and not cluster.workers:
            _note("the cluster has no workers yet; questions wait for one (`dask worker`)")
        yield options
    if cluster is not None and cluster.died:
        workers = "a worker" if cluster.died == 1 else f"{cluster.died} workers"
        _note(f"{workers} of the cluster ended at a question, which was asked again")


def _note(text: str) -> None:
    print(f"koord verify: {text}", file=sys.stderr)
