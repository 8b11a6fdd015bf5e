"""``koord compile FILE``: a program as Python, for robots to run."""

from __future__ import annotations

import argparse
import sys

from koord.api.compile import compile
from koord.cli.arguments import add_files, add_settings, check_files
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import ReadOptions, load_programs


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        default=DASH,
        help="where the Python goes; - is standard output (-)",
    )
    add_settings(parser)
    parser.epilog = "exit codes: 0 done, 2 errors in the input"


def main(arguments: argparse.Namespace) -> int:
    check_files([arguments.file, *arguments.properties])
    if arguments.output != DASH:
        check_writable(arguments.output, (arguments.file, *arguments.properties))
    report = DiagnosticReport()
    programs = load_programs([arguments.file], ReadOptions.of(arguments), report)
    report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    made = compile(programs[0])
    if arguments.output == DASH:
        sys.stdout.write(made.text)
    else:
        made.save(arguments.output)
    return Exit.OK
