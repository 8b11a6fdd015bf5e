"""``koord merge PART… -o FILE``: what the robots of a deployed run have told, as one trace."""

from __future__ import annotations

import argparse
import sys

from koord.api.merge import Merged, merge
from koord.cli.arguments import add_json, check_files
from koord.cli.diagnostics import report_error
from koord.cli.exits import Exit
from koord.cli.files import check_writable
from koord.cli.merged import merge_lines, refusal_code
from koord.cli.progress import LiveLine
from koord.syntax.diagnostics import KoordError


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "parts",
        metavar="PART",
        nargs="+",
        help="parts of robots (`koord deploy --pid I --trace PART`), or recordings (--record)",
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="the trace, for `koord replay`"
    )
    add_json(parser, "what was merged")
    parser.epilog = (
        "exit codes: 0 the whole run was merged and is legal, 1 a step is not, a property is "
        "broken, or two robots acted on different decisions, 2 parts that are damaged, of "
        "different runs or too few, 3 merged without the parts of some robots, or not to the end"
    )


def main(arguments: argparse.Namespace) -> int:
    check_files(arguments.parts)
    check_writable(arguments.output, arguments.parts)
    try:
        with LiveLine(sys.stderr) as live:
            merged = merge(arguments.parts, progress=lambda told: live.show(told.message))
    except KoordError as error:
        report_error(error, as_json=arguments.json)
        return refusal_code(error.diagnostics)
    merged.trace.save(arguments.output)
    if arguments.json:
        print(merged.to_json())
    else:
        for line in merge_lines(arguments.output, merged):
            print(line)
    return _code(merged)


def _code(merged: Merged) -> int:
    if merged.is_wrong:
        return Exit.VIOLATED
    return Exit.OK if merged.is_whole else Exit.UNKNOWN
