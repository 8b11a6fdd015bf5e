"""``koord verify --export``: the question itself, in a file for other tools."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from koord.api.export import FORMATS, NAME, Wanted, exported
from koord.api.results import ArgumentError
from koord.api.robots import system_of
from koord.cli.diagnostics import DiagnosticReport, report_error
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import ReadOptions, load_programs
from koord.cli.progress import LiveLine
from koord.syntax.diagnostics import KoordError


def add_export(parser: argparse.ArgumentParser) -> None:
    """Add the flags."""
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
    """Write the claims about one program as a problem."""
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
    """The name of a module in that file; None: no file says."""
    if output == DASH:
        return None
    path = Path(output)
    if not NAME.fullmatch(path.stem) or path.suffix != ".tla":
        raise argparse.ArgumentTypeError(
            f"--export tla: a module has the name of its file, and {path.name!r} is none; "
            "write letters, digits and _, and .tla"
        )
    return path.stem
