"""``koord drivers``: what drives vehicles, and what is missing for it."""

from __future__ import annotations

import argparse

from koord.api.drivers import drivers_json, installed_drivers
from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.terminal import visible


def configure(parser: argparse.ArgumentParser) -> None:
    add_json(parser, "the drivers")
    parser.epilog = "exit code: 0"


def main(arguments: argparse.Namespace) -> int:
    found = installed_drivers()
    if arguments.json:
        print(drivers_json(found))
        return Exit.OK
    width = max((len(one.name) for one in found), default=0)
    for one in found:
        print(
            visible(f"{one.name:<{width}}  {one.package}  {one.missing or _options(one.options)}")
        )
    return Exit.OK


def _options(names: tuple[str, ...]) -> str:
    return f"options: {', '.join(names)}" if names else "no options"
