"""``koord config check FILE…``: is this a configuration that robots can be run with?"""

from __future__ import annotations

import argparse
import sys

from koord.cli.arguments import add_json, check_files
from koord.cli.diagnostics import Report
from koord.cli.exits import Exit
from koord.cli.files import read_program
from koord.runtime.configuration.checking import load
from koord.runtime.configuration.model import Configuration
from koord.syntax.diagnostics import KoordError


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["check"], help="what to do with the files")
    parser.add_argument(
        "files", metavar="FILE", nargs="+", help="a configuration (.yaml); - is standard input"
    )
    add_json(parser, "the diagnostics")
    parser.epilog = "exit codes: 0 no errors, 2 errors"


def main(arguments: argparse.Namespace) -> int:
    check_files(arguments.files)
    report = Report()
    for path in arguments.files:
        configuration = read_configuration(path, report)
        if configuration is not None and not arguments.json:
            print(f"{configuration.name}: {story(configuration)}")
    report.print(sys.stdout, as_json=arguments.json)
    return Exit.BAD_INPUT if report.errors else Exit.OK


def read_configuration(path: str, report: Report) -> Configuration | None:
    """The configuration in a file; what is wrong goes to the report."""
    try:
        source = read_program(path).source
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    try:
        return load(source)
    except KoordError as error:
        report.add(error.diagnostics, source)
        return None


def story(configuration: Configuration) -> str:
    """A configuration in a line."""
    robots = configuration.robots
    vehicles = sorted({robot.vehicle.type.value for robot in robots})
    count = f"{len(robots)} {'robot' if len(robots) == 1 else 'robots'} ({', '.join(vehicles)})"
    talk = configuration.talk
    shared = f" to {talk.shared}" if talk.shared is not None else ""
    length = configuration.delta_s
    rounds = "as long as the program states" if length is None else f"of {length:g} s"
    return f"{count}, {talk.carrier.value}{shared}, rounds {rounds}"
