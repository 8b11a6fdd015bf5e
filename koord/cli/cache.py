"""``koord cache``: where verdicts and machine code are kept, and how to be rid of them."""

from __future__ import annotations

import argparse
import json

from koord.api.cache import VARIABLE, Cache, kept_code, usual_folder
from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.terminal import visible


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--clear",
        action="store_true",
        help="remove all kept verdicts and machine code; other files stay",
    )
    add_json(parser, "place, number and size")
    parser.epilog = (
        "`koord verify --cache` keeps verdicts there, and shows those again of which nothing has\n"
        "changed. Simulations keep their machine code there, so that it is made once.\n"
        f"{VARIABLE} names another folder; with {VARIABLE}=off no machine code is kept.\n\n"
        "exit code: 0"
    )


def main(arguments: argparse.Namespace) -> int:
    folder = usual_folder()
    cache = Cache(folder)
    code = kept_code(clear=arguments.clear)
    use = cache.clear() if arguments.clear else cache.use()
    if arguments.json:
        print(
            json.dumps(
                {
                    "folder": folder,
                    "entries": use.entries,
                    "bytes": use.size,
                    "cleared": arguments.clear,
                },
                indent=2,
            )
        )
        return Exit.OK
    entries = "entry" if use.entries == 1 else "entries"
    removed = "removed " if arguments.clear else ""
    print(f"{visible(folder)}: {removed}{use.entries:,} {entries}, {use.size / 2**20:.1f} MiB")
    if code.entries:
        files = "file" if code.entries == 1 else "files"
        print(f"machine code: {removed}{code.entries:,} {files}, {code.size / 2**20:.1f} MiB")
    return Exit.OK
