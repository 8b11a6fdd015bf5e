"""``koord config check FILE…``: is this a configuration that robots can be run with?"""

from __future__ import annotations

import argparse
import sys

from koord.cli.arguments import add_json, check_files
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.files import read_program
from koord.cli.fitting import Asked, beside, check_alone, check_start, read_configuration
from koord.cli.terminal import visible
from koord.runtime.configuration.model import Configuration
from koord.syntax.diagnostics import KoordError


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
    report = Report()
    for path in arguments.files:
        before = report.errors
        found = check(path, arguments.program, report)
        if found is not None and report.errors == before and not arguments.json:
            configuration, program = found
            suits = "" if program is None else f", suits {visible(program)}"
            print(f"{visible(configuration.name)}: {story(configuration)}{suits}")
    report.print(sys.stdout, as_json=arguments.json)
    return Exit.BAD_INPUT if report.errors else Exit.OK


def check(
    path: str, program: str | None, report: Report
) -> tuple[Configuration, str | None] | None:
    """What a file says, and the program that it was checked with; errors go to the report."""
    configuration = read_configuration(path, report)
    if configuration is None:
        return None
    program = program or beside(path, ".krd")
    try:
        if program is None:
            check_alone(configuration)
            return configuration, None
        source = read_program(program).source
        report.add((), source)
        check_start(Asked(source, configuration, (), {}).fitted(report))
    except KoordError as error:
        report.add(error.diagnostics)
    return configuration, program


def story(configuration: Configuration) -> str:
    """A configuration in a line."""
    robots = configuration.robots
    vehicles = sorted({robot.vehicle.type_name for robot in robots})
    count = f"{len(robots)} {'robot' if len(robots) == 1 else 'robots'} ({', '.join(vehicles)})"
    talk = configuration.talk
    shared = f" to {talk.shared}" if talk.shared is not None else ""
    length = configuration.delta_s
    rounds = "as long as the program states" if length is None else f"of {length:g} s"
    return f"{count}, {talk.carrier.value}{shared}, rounds {rounds}"
