"""The JSON Schemas of what koord reads and writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from koord.api.results import ArgumentError

#: What has a schema, and of what it is one. That of configurations is made of the fields read.
DOCUMENTS: Mapping[str, str] = {
    "configuration": "configuration files, for editors",
    "verdicts": "what `koord verify --json` prints",
    "diagnostics": "what `--json` prints of any command when its input has mistakes",
    "trace": "traces, as `--trace FILE` and `koord run --json` write them",
    "certificate": "certificates, as `koord verify --certificate` writes them",
    "recheck": "what `koord recheck --json` prints",
    "replay": "what `koord replay --json` prints",
}


def schema_text(document: str) -> str:
    """The text of the JSON Schema of a document. Raises ArgumentError where there is none."""
    if document not in DOCUMENTS:
        known = ", ".join(DOCUMENTS)
        raise ArgumentError("document", f"there is no schema of {document!r}; there are {known}")
    if document == "configuration":
        from koord.runtime.configuration.forms import json_schema

        return json.dumps(json_schema(), indent=2, sort_keys=True) + "\n"
    name = f"schemas/{document}.schema.json"
    return files("koord.api").joinpath(name).read_text(encoding="utf-8")


#: Documents whose schema is made of structs, and published beside this file.
GENERATED = ("diagnostics", "recheck", "replay", "trace")


def generated(document: str) -> dict[str, Any]:
    """The JSON Schema of a document, made of the structs that it is written from."""
    from msgspec.json import schema_components

    from koord.api import forms
    from koord.traces import form

    head: dict[str, str]
    whole: type
    others: dict[str, Any]
    head, whole, others = {
        "diagnostics": ({"title": "Diagnostics of koord"}, forms.Diagnostics, {}),
        "recheck": (
            {"title": "Verdicts of koord on a certificate"},
            forms.Recheck,
            forms.VALUES,
        ),
        "replay": ({"title": "Verdicts of koord on a trace"}, forms.Replay, forms.VALUES),
        "trace": (
            {"$id": "koord-trace-3", "title": "koord trace, versions 1 to 3"},
            form.File,
            form.VALUES,
        ),
    }[document]
    (top,), found = schema_components([whole], ref_template="#/$defs/{name}")
    for one in found.values():
        del one["title"]  # of the struct
        if "description" in one:
            one["description"] = " ".join(one["description"].split())
    own = found.pop(top["$ref"].rpartition("/")[2])
    draft = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": draft, **head, **own, "$defs": {**others, **found}}


def schema(document: str = "configuration") -> dict[str, Any]:
    """The JSON Schema of what koord reads and writes.

    ``document`` is ``"configuration"``, ``"verdicts"``, ``"diagnostics"``, ``"trace"``,
    ``"certificate"``, ``"recheck"`` or ``"replay"``. Raises :class:`koord.ArgumentError` for
    another one.

    >>> koord.schema("verdicts")["title"]
    """
    found: dict[str, Any] = json.loads(schema_text(document))
    return found
