"""``koord config check FILE…``: is this a configuration that robots can be run with?

``koord config key [FILE]``: a new key for robots to share.

``koord config world FILE``: what stands in a world of Gazebo, as the file of a site.
"""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError

from koord.api.configurations import (
    ConfigurationReport,
    check_configuration,
    new_key,
    world_of_gazebo,
    write_key,
)
from koord.cli.arguments import add_json, add_site, check_files
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.files import DASH, read_program
from koord.cli.terminal import visible
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "action",
        choices=["check", "key", "world"],
        help="check: check the files; key: print a new key for robots, or write it to a new FILE "
        "that you alone can read; world: print what stands in a world of Gazebo (.world, .sdf), "
        "for the file of a site",
    )
    parser.add_argument(
        "files", metavar="FILE", nargs="*", help="a configuration (.yaml); - is standard input"
    )
    parser.add_argument(
        "--program",
        metavar="PROGRAM",
        help="the program that is to be run with them; else the one beside a file, if there is one "
        "of its name",
    )
    add_site(parser)
    parser.add_argument(
        "--scene",
        metavar="FILE",
        help="where robots begin, as a scene of the published simulator says (.yml)",
    )
    add_json(parser, "the diagnostics")
    parser.epilog = "exit codes: 0 no errors, 2 errors"


def main(arguments: argparse.Namespace) -> int:
    if arguments.action == "world":
        return _world(arguments)
    return _key(arguments) if arguments.action == "key" else _check(arguments)


def _check_is_plain(arguments: argparse.Namespace) -> None:
    """Check that there are no flags of ``config check``. Raises ArgumentTypeError."""
    given = (arguments.program, arguments.site, arguments.scene)
    if any(one is not None for one in given) or arguments.json:
        raise ArgumentTypeError("--program, --site, --scene and --json are for config check")


def _world(arguments: argparse.Namespace) -> int:
    """Print the obstacles of a world. Raises KoordError."""
    _check_is_plain(arguments)
    if len(arguments.files) != 1:
        raise ArgumentTypeError("config world reads one file")
    report = DiagnosticReport()
    path = arguments.files[0]
    report.add((), read_program(path).source)
    try:
        found = world_of_gazebo(_text(path))
    except KoordError as error:
        report.add(error.diagnostics)
    else:
        report.add(found.warnings, *found.sources)
        sys.stdout.write(found.text)
    report.print(sys.stderr, as_json=False)
    return Exit.BAD_INPUT if report.errors else Exit.OK


def _key(arguments: argparse.Namespace) -> int:
    """Print a new key, or write it to a file. Raises KoordError."""
    _check_is_plain(arguments)
    if len(arguments.files) > 1:
        raise ArgumentTypeError("config key writes one file")
    path = arguments.files[0] if arguments.files else DASH
    if path == DASH:
        print(new_key())
        return Exit.OK
    write_key(path)
    print(f"{visible(path)}: a new key; network: {{key_file: {visible(path)}}} names it")
    return Exit.OK


def _check(arguments: argparse.Namespace) -> int:
    if not arguments.files:
        raise ArgumentTypeError("say which files to check")
    check_files(arguments.files)
    report = DiagnosticReport()
    for path in arguments.files:
        before = report.errors
        found = check(path, arguments.program, arguments.site, report, scene=arguments.scene)
        if found is not None and report.errors == before and not arguments.json:
            suits = "" if found.program is None else f", suits {visible(found.program)}"
            print(f"{visible(found.name)}: {found.summary()}{suits}")
    report.print(sys.stdout, as_json=arguments.json)
    return Exit.BAD_INPUT if report.errors else Exit.OK


def check(
    path: str,
    program: str | None,
    site: str | None,
    report: DiagnosticReport,
    *,
    scene: str | None = None,
) -> ConfigurationReport | None:
    """Check a configuration, and a program with it; diagnostics go to the report."""
    try:
        found = check_configuration(
            _text(path), *(None if one is None else _text(one) for one in (program, site, scene))
        )
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    report.add((), *found.sources)
    report.add(found.diagnostics)
    return found


def _text(path: str) -> str | Source:
    """A file for the API, or the text of standard input. Raises KoordError."""
    return read_program(path).source if path == DASH else path
