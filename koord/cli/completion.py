"""``koord completion SHELL``: a script by which a shell completes commands. Needs ``shtab``."""

from __future__ import annotations

import argparse
from argparse import ArgumentTypeError

from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, DESCRIPTION

#: The shells, and where the script of each goes.
SHELLS = {
    "bash": "~/.local/share/bash-completion/completions/koord",
    "zsh": "a folder of $fpath, as _koord",
    "fish": "~/.config/fish/completions/koord.fish",
}

#: What arguments that are files are called in help.
_FILES = frozenset({"FILE", "CONFIG", "TRACE", "PROGRAM"})


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="the shell that is to read the script")
    places = "".join(f"\n  {shell:<5} {place}" for shell, place in SHELLS.items())
    parser.epilog = f"Shells look for the script in:{places}\n\nexit code: 0"


def main(arguments: argparse.Namespace) -> int:
    try:
        import shtab
    except ImportError:
        cure = "pip install 'koord[completion]'"
        raise ArgumentTypeError(f"scripts of shells need shtab: {cure}") from None
    parser = whole_parser()
    for own in _commands(parser).values():
        for action in own._actions:
            if action.choices is not None:
                action.choices = tuple(action.choices)  # shtab takes a mapping for commands
            elif action.metavar in _FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, arguments.shell))
    return Exit.OK


def whole_parser() -> argparse.ArgumentParser:
    """All commands with their arguments in one parser, as no command needs them."""
    parser = argparse.ArgumentParser("koord", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version="koord")
    commands = parser.add_subparsers(dest="command", parser_class=argparse.ArgumentParser)
    for command in COMMANDS:
        own = commands.add_parser(command.name, help=command.summary, description=command.summary)
        command.load().configure(own)
    return parser


def _commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    (found,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return dict(found.choices)
