"""``koord replay trace.json``: check a trace rule by rule, and name the first illegal step."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.files import read_bytes


@dataclass(frozen=True, slots=True)
class Request:
    """Which trace is to be checked, and how the answer is shown."""

    name: str
    raw: bytes
    as_json: bool


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "trace", metavar="TRACE", help="a trace that koord wrote; - is standard input"
    )
    add_json(parser, "the answer")
    parser.epilog = "exit codes: 0 every step is legal, 1 a step is not, 2 errors in the input"


def main(arguments: argparse.Namespace) -> int:
    raw = read_bytes(arguments.trace)
    return _replay(Request(arguments.trace, raw, arguments.json))


def _replay(request: Request) -> Exit:
    # >>> The replay's place: koord.semantics decodes request.raw (a damaged trace is a KoordError)
    # and replays it; the first illegal step is named on standard output.
    print(f"koord replay: {request.name}: not available in this version", file=sys.stderr)
    return Exit.BAD_INPUT
