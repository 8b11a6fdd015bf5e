"""``koord schema``: the JSON Schema of what koord reads and writes, for editors and programs."""

from __future__ import annotations

import argparse

from koord.api.documents import DOCUMENTS, schema_text
from koord.cli.exits import Exit


def configure(parser: argparse.ArgumentParser) -> None:
    told = "; ".join(f"{name}: {of}" for name, of in DOCUMENTS.items())
    parser.add_argument(
        "document",
        nargs="?",
        choices=DOCUMENTS,
        default="configuration",
        metavar="DOCUMENT",
        help=f"whose schema it is (configuration). {told}",
    )
    parser.epilog = "exit code: 0"


def main(arguments: argparse.Namespace) -> int:
    print(schema_text(arguments.document), end="")
    return Exit.OK
