"""The JSON that commands print and write is what `koord schema` says of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from koord.api.documents import schema
from koord.cli.exits import Exit
from tests.golden.scenarios import Command

#: The schemas of what commands print with `--json`, and of files by the format that they name.
PRINTED = {
    "check": "diagnostics",
    "recheck": "recheck",
    "replay": "replay",
    "run": "trace",
    "verify": "verdicts",
}
WRITTEN = {"koord certificate": "certificate", "koord trace": "trace"}


def described(command: Command, printed: str, code: int) -> Iterator[tuple[str, Any]]:
    """The documents that a command made, each behind the name of its schema."""
    if "--json" in command.words and printed.startswith("{"):
        name = PRINTED.get(command.words[0])
        if code == Exit.BAD_INPUT:
            name = "diagnostics"
        if name is not None:
            yield name, json.loads(printed)
    for file in map(Path, command.writes):
        if file.suffix == ".json" and file.exists():
            document = json.loads(file.read_text(encoding="utf-8"))
            if document.get("format") in WRITTEN:
                yield WRITTEN[document["format"]], document


@cache
def _validator(name: str) -> Draft202012Validator:
    return Draft202012Validator(schema(name))


def mistakes(name: str, document: object) -> Iterator[str]:
    """Yield what a schema does not say of a document."""
    for error in _validator(name).iter_errors(document):
        yield f"{name}: {error.json_path}: {error.message[:200]}"
