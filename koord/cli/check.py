"""``koord check FILE…``: parse and elaborate, and show every mistake of every file."""

from __future__ import annotations

import argparse
import sys

from koord.cli.arguments import add_files, add_json, add_sarif, add_settings, check_files
from koord.cli.diagnostics import DiagnosticReport, summary
from koord.cli.exits import Exit
from koord.cli.files import check_writable
from koord.cli.inputs import ReadOptions, check_file
from koord.syntax.source import counted


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser)
    add_settings(parser)
    parser.add_argument("--strict", action="store_true", help="make warnings errors")
    add_sarif(parser, "the diagnostics")
    add_json(parser, "the diagnostics")
    parser.epilog = "exit codes: 0 no errors (warnings do not count), 2 errors"


def main(arguments: argparse.Namespace) -> int:
    read = [*arguments.files, *arguments.properties]
    check_files(read)
    if arguments.sarif is not None:
        check_writable(arguments.sarif, read)
    report = DiagnosticReport(strict=arguments.strict)
    reading = ReadOptions.of(arguments)
    for path in arguments.files:
        check_file(path, reading, report)
    if arguments.sarif is not None:
        from koord.cli.sarif import write_sarif

        write_sarif(arguments.sarif, report.diagnostics)
    report.print(sys.stdout, as_json=arguments.json)
    if not report.diagnostics and not arguments.json:
        print(f"{counted(len(arguments.files), 'file')} checked: {summary(0, 0)}")
    return Exit.BAD_INPUT if report.errors else Exit.OK
