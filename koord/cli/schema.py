"""``koord schema``: the JSON Schema of what koord reads and writes, for editors and programs."""

from __future__ import annotations

import argparse
import json
from importlib.resources import files

from koord.cli.exits import Exit

_CONFIGURATION = "configuration"

#: What has a schema. That of configurations is made from the fields that are read.
DOCUMENTS = {
    _CONFIGURATION: "configuration files, for editors",
    "verdicts": "what `koord verify --json` prints",
    "diagnostics": "what `--json` prints of any command when its input has mistakes",
    "trace": "traces, as `--trace FILE` and `koord run --json` write them",
    "certificate": "certificates, as `koord verify --certificate` writes them",
    "recheck": "what `koord recheck --json` prints",
    "replay": "what `koord replay --json` prints",
}


def configure(parser: argparse.ArgumentParser) -> None:
    told = "; ".join(f"{name}: {of}" for name, of in DOCUMENTS.items())
    parser.add_argument(
        "document",
        nargs="?",
        choices=DOCUMENTS,
        default=_CONFIGURATION,
        metavar="DOCUMENT",
        help=f"whose schema it is ({_CONFIGURATION}). {told}",
    )
    parser.epilog = "exit code: 0"


def main(arguments: argparse.Namespace) -> int:
    if arguments.document == _CONFIGURATION:
        from koord.runtime.configuration.forms import json_schema

        print(json.dumps(json_schema(), indent=2, sort_keys=True))
    else:
        name = f"schemas/{arguments.document}.schema.json"
        print(files("koord.cli").joinpath(name).read_text(encoding="utf-8"), end="")
    return Exit.OK
