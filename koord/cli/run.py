"""``koord run FILE``: run a program by the rules of the semantics, and show each round."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction

from koord.cli.arguments import Fleet, add_bounds, add_files, add_settings, add_trace, check_files
from koord.cli.diagnostics import Report, report_error
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import LoadedProgram, Reading, load_programs
from koord.syntax.diagnostics import KoordError


class Policy(Enum):
    """Which of the allowed steps is taken."""

    FIRST = "first"  #: the first enabled event in the order of the program, as robots do
    RANDOM = "random"  #: any allowed step, by the seed


@dataclass(frozen=True, slots=True)
class Request:
    """How a program is to be run."""

    fleet: Fleet
    rounds: int
    delta_s: Fraction
    policy: Policy
    seed: int
    interactive: bool
    trace: str | None


def configure(parser: argparse.ArgumentParser) -> None:
    add_files(parser, several=False)
    add_bounds(parser)
    parser.add_argument(
        "--policy",
        choices=[policy.value for policy in Policy],
        default=Policy.FIRST.value,
        help="which of the allowed steps is taken (first)",
    )
    parser.add_argument(
        "--interactive", action="store_true", help="ask which robot and event is next"
    )
    add_settings(parser)
    add_trace(parser, "the run")
    parser.epilog = "exit codes: 0 done, 1 a fault or a violation was met, 2 errors in the input"


def main(arguments: argparse.Namespace) -> int:
    check_files([arguments.file, *arguments.properties])
    request = Request(
        fleet=arguments.robots,
        rounds=arguments.rounds,
        delta_s=arguments.delta,
        policy=Policy(arguments.policy),
        seed=arguments.seed,
        interactive=arguments.interactive,
        trace=arguments.trace,
    )
    if request.interactive and DASH in (arguments.file, *arguments.properties):
        raise argparse.ArgumentTypeError("--interactive reads standard input, and so does -")
    if request.trace is not None:
        check_writable(request.trace)
    report = Report()
    programs = load_programs([arguments.file], Reading.of(arguments), report)
    report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    try:
        return _run(programs[0], request)
    except KoordError as error:  # of the program, met on the way
        report_error(error, as_json=False, sources=report.sources.values())
        return Exit.BAD_INPUT


def _run(program: LoadedProgram, request: Request) -> Exit:
    # >>> The machine's place: koord.semantics on (program.program, request), each round as a table
    # on standard output, the trace to request.trace with files.write_atomically.
    print(f"koord run: {program.source.name}: not available in this version", file=sys.stderr)
    return Exit.BAD_INPUT
