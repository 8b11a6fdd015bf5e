"""``koord schema``: the JSON Schema of configuration files, for editors."""

from __future__ import annotations

import argparse
import json

from koord.cli.exits import Exit
from koord.runtime.configuration.forms import json_schema


def configure(parser: argparse.ArgumentParser) -> None:
    parser.epilog = "exit code: 0"


def main(arguments: argparse.Namespace) -> int:
    print(json.dumps(json_schema(), indent=2, sort_keys=True))
    return Exit.OK
