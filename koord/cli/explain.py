"""``koord explain K204``: the long story of a diagnostic, with an example and its cure."""

from __future__ import annotations

import argparse
import sys
from difflib import get_close_matches

from koord.cli.arguments import ArgumentTypeError
from koord.cli.exits import Exit
from koord.cli.terminal import Paint, Style, style_of
from koord.syntax.catalogue import CATALOGUE, Entry


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "code", metavar="CODE", nargs="?", help="a code such as K204; none lists them all"
    )


def main(arguments: argparse.Namespace) -> int:
    style = style_of(sys.stdout)
    if arguments.code is None:
        for entry in CATALOGUE.values():
            print(
                f"{style.paint(entry.code, Paint.BOLD)}  {entry.severity.value:<7}  {entry.title}"
            )
        return Exit.OK
    wanted = arguments.code.upper()
    if wanted not in CATALOGUE:
        raise ArgumentTypeError(_unknown(arguments.code))
    print(_story(CATALOGUE[wanted], style))
    return Exit.OK
