"""``koord new NAME``: a folder with a program and all that belongs to it, to begin from."""

from __future__ import annotations

import argparse
from argparse import ArgumentTypeError

from koord.api.new import new
from koord.api.results import ArgumentError
from koord.cli.exits import Exit
from koord.cli.terminal import visible


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name",
        metavar="NAME",
        help="the folder to make; its last part is the name of the program: a to z, 0 to 9, _",
    )
    parser.epilog = (
        "What is made passes `koord check`, `koord verify`, `koord sim` and `pytest` as it is.\n\n"
        "exit codes: 0 made, 2 the name is none, or something is there already"
    )


def main(arguments: argparse.Namespace) -> int:
    try:
        made = new(arguments.name)
    except ArgumentError as error:
        raise ArgumentTypeError(error.message) from None
    folder, name = visible(made.folder), made.name
    print(f"{folder}: {', '.join(made.files)}")
    print("next:")
    print(f"  cd {folder}")
    print(f"  koord verify {name}.krd --with properties.krd")
    print(f"  koord sim {name}.krd")
    print("  pytest")
    return Exit.OK
