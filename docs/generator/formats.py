"""The pages of what koord writes for other programs, from JSON Schemas."""

from __future__ import annotations

import json

from docs.generator.markdown import plain, table
from docs.generator.schemas import sections
from koord.api.documents import DOCUMENTS, schema_text

FOLDER = "reference/formats"

#: What is told of a format besides its schema.
MORE = {
    "trace": "What the parts of a trace mean is in the [chapter on recordings]"
    "(../../specs/semantics/07-recordings.md). `koord replay` reads traces; files whose names end "
    "in `.itf.json` have the form [ITF](https://apalache-mc.org/docs/adr/015adr-trace.html), "
    "which tools for TLA+ show.",
    "part": "`koord merge` makes a trace of the parts of all robots.",
    "certificate": "What a certificate says and how it is rechecked is in the "
    "[specification of certificates](../../specs/certificates/README.md). `koord recheck` reads "
    "certificates.",
}


def documents() -> list[str]:
    """The documents that have a page here; configurations have one of their own."""
    return [name for name in DOCUMENTS if name != "configuration"]


def pages() -> dict[str, str]:
    """A page of each document, and one that lists them."""
    made = {f"{FOLDER}/{name}.md": _page(name) for name in documents()}
    rows = [(f"[{name}]({name}.md)", plain(DOCUMENTS[name])) for name in documents()]
    made[f"{FOLDER}/index.md"] = (
        "# Formats\n\nGenerated from the JSON Schemas, which `koord schema` prints.\n\n"
        + table(("document", "what it is"), rows)
    )
    return made


def _page(name: str) -> str:
    schema = json.loads(schema_text(name))
    text = f"# {name.capitalize()}\n\n{plain(DOCUMENTS[name]).capitalize()}. "
    text += f"`koord schema {name}` prints the schema.\n"
    if "description" in schema:
        text += f"\n{plain(schema['description'])}\n"
    if name in MORE:
        text += f"\n{MORE[name]}\n"
    return text + sections(schema)
