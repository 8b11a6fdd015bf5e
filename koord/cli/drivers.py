"""``koord drivers``: what drives and locates vehicles, and what is missing for it."""

from __future__ import annotations

import argparse

from koord.api.drivers import (
    drivers_json,
    installed_drivers,
    installed_localisers,
)
from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.terminal import visible


def configure(parser: argparse.ArgumentParser) -> None:
    add_json(parser, "drivers and localisers")
    parser.epilog = "exit code: 0"


def main(arguments: argparse.Namespace) -> int:
    drivers, localisers = installed_drivers(), installed_localisers()
    if arguments.json:
        print(drivers_json(drivers, localisers))
        return Exit.OK
    width = max((len(one.name) for one in (*drivers, *localisers)), default=0)
    for noun, found in (("driver", drivers), ("localiser", localisers)):
        for one in found:
            name = f"{noun:<9}  {one.name:<{width}}"
            print(visible(f"{name}  {one.package}  {one.missing or _options(one.options)}"))
    return Exit.OK


def _options(names: tuple[str, ...]) -> str:
    return f"options: {', '.join(names)}" if names else "no options"
