"""``koord replay trace.json``: check a trace rule by rule, and name the first illegal step."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

from koord.cli.arguments import add_json, check_files
from koord.cli.exits import Exit
from koord.cli.files import DASH, STDIN_NAME, InputFile, read_bytes, read_program


@dataclass(frozen=True, slots=True)
class Request:
    """Which trace is to be checked, and how the answer is shown."""

    name: str
    raw: bytes
    program: InputFile | None  #: instead of the one that the trace holds
    as_json: bool


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "trace", metavar="TRACE", help="a trace that koord wrote; - is standard input"
    )
    parser.add_argument(
        "--program", metavar="FILE", help="the program to replay it with (the one in the trace)"
    )
    add_json(parser, "the answer")
    parser.epilog = "exit codes: 0 every step is legal, 1 a step is not, 2 errors in the input"


def main(arguments: argparse.Namespace) -> int:
    given = arguments.program
    check_files([arguments.trace, *([given] if given is not None else [])])
    return _replay(
        Request(
            name=STDIN_NAME if arguments.trace == DASH else arguments.trace,
            raw=read_bytes(arguments.trace),
            program=read_program(given) if given is not None else None,
            as_json=arguments.json,
        )
    )


def _replay(request: Request) -> Exit:
    # >>> The replay's place: koord.semantics decodes request.raw (a damaged trace is a KoordError)
    # and replays it; the first illegal step is named on standard output.
    print(f"koord replay: {request.name}: not available in this version", file=sys.stderr)
    return Exit.BAD_INPUT
