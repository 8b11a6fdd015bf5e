"""``koord config check FILE…``: is this a configuration that robots can be run with?"""

from __future__ import annotations

import argparse
import sys

from koord.api.configurations import ConfigurationReport, check_configuration
from koord.cli.arguments import add_json, check_files
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.files import DASH, read_program
from koord.cli.terminal import visible
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["check"], help="what to do with the files")
    parser.add_argument(
        "files", metavar="FILE", nargs="+", help="a configuration (.yaml); - is standard input"
    )
    parser.add_argument(
        "--program",
        metavar="PROGRAM",
        help="the program that is to be run with them; else the one beside a file, if there is one "
        "of its name",
    )
    add_json(parser, "the diagnostics")
    parser.epilog = "exit codes: 0 no errors, 2 errors"


def main(arguments: argparse.Namespace) -> int:
    check_files(arguments.files)
    report = DiagnosticReport()
    for path in arguments.files:
        before = report.errors
        found = check(path, arguments.program, report)
        if found is not None and report.errors == before and not arguments.json:
            suits = "" if found.program is None else f", suits {visible(found.program)}"
            print(f"{visible(found.name)}: {found.summary()}{suits}")
    report.print(sys.stdout, as_json=arguments.json)
    return Exit.BAD_INPUT if report.errors else Exit.OK


def check(path: str, program: str | None, report: DiagnosticReport) -> ConfigurationReport | None:
    """Check a configuration, and a program with it; diagnostics go to the report."""
    try:
        found = check_configuration(_text(path), None if program is None else _text(program))
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    report.add((), *found.sources)
    report.add(found.diagnostics)
    return found


def _text(path: str) -> str | Source:
    """A file for the API, or the text of standard input. Raises KoordError."""
    return read_program(path).source if path == DASH else path
