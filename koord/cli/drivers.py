"""``koord drivers``: what drives and locates vehicles, plug-ins, and what is missing for them."""

from __future__ import annotations

import argparse

from koord.api.drivers import (
    drivers_json,
    installed_drivers,
    installed_localisers,
    installed_plug_ins,
)
from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.terminal import visible


def configure(parser: argparse.ArgumentParser) -> None:
    add_json(parser, "drivers, localisers and plug-ins")
    parser.epilog = "exit code: 0"


def main(arguments: argparse.Namespace) -> int:
    found = {
        "driver": installed_drivers(),
        "localiser": installed_localisers(),
        **installed_plug_ins(),
    }
    if arguments.json:
        print(drivers_json(found))
        return Exit.OK
    kinds = {noun: entries for noun, entries in found.items() if entries}
    widest = max(map(len, kinds))
    width = max(len(one.name) for entries in kinds.values() for one in entries)
    for noun, entries in kinds.items():
        for one in entries:
            name = f"{noun:<{widest}}  {one.name:<{width}}"
            print(visible(f"{name}  {one.package}  {one.missing or _options(one.options)}"))
    return Exit.OK


def _options(names: tuple[str, ...]) -> str:
    return f"options: {', '.join(names)}" if names else "no options"
