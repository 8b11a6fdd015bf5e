"""Formatting of programs, stories of diagnostics, and JSON Schemas of koord's files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.resources import files
from typing import Any

from koord.api.programs import Text, source_of
from koord.api.results import ArgumentError
from koord.syntax.catalogue import Story, entries
from koord.syntax.diagnostics import KoordError
from koord.syntax.printing.program import format_source


def format(text: Text) -> str:
    r"""Format the text of a program, as ``koord fmt`` does; comments stay.

    Raises :class:`koord.KoordError` for errors of syntax.

    >>> koord.format(koord.Source("a.krd", "local:\n int x=0\n"))
    'local:\n    int x = 0\n'
    """
    formatted = format_source(source_of(text))
    if formatted.diagnostics:
        raise KoordError(formatted.diagnostics)
    return formatted.text


def explain(code: str) -> Story:
    """The story of a diagnostic: title, text, a program that yields it and one that does not.

    Raises :class:`koord.ArgumentError` if there is no such code.

    >>> koord.explain("K201").title
    """
    wanted = code.strip().upper()
    if wanted in entries():
        return entries()[wanted]
    near = get_close_matches(wanted, entries(), n=3)
    cure = f"; there are {', '.join(near)}" if near else "; `koord explain` lists all codes"
    raise ArgumentError("code", f"there is no code {code!r}{cure}")


def codes() -> Mapping[str, Story]:
    """Every code of a diagnostic, in order, with its story."""
    return entries()


#: What has a schema, and of what it is one. That of configurations is made of the fields read.
DOCUMENTS: Mapping[str, str] = {
    "configuration": "configuration files, for editors",
    "verdicts": "what `koord verify --json` prints",
    "diagnostics": "what `--json` prints of any command when its input has mistakes",
    "migration": "what `koord migrate --json` prints",
    "trace": "traces, as `--trace FILE` and `koord run --json` write them",
    "part": "lines of parts, as `koord deploy --pid I --trace FILE` writes them",
    "certificate": "certificates, as `koord verify --certificate` writes them",
    "recheck": "what `koord recheck --json` prints",
    "replay": "what `koord replay --json` prints",
    "merged": "what `koord merge --json` prints",
    "conformance": "what `koord conform --json` prints",
    "splitting": "what `koord sim --splitting CLAIM --json` prints",
    "story": "stories of runs, as pages of `--html` hold them (`koord.story`)",
    "doctor": "what `koord doctor --json` prints",
    "sarif": "what `--sarif FILE` writes: a part of SARIF 2.1.0",
    "simulated": "what `koord sim --json` prints of a run",
    "campaign": "what it prints of several (`--runs`, `--sweep`, `--until`)",
    "deployed": "what `koord deploy --json` prints",
    "refinement": "what `koord check-refinement --json` prints",
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
GENERATED = (
    "campaign",
    "certificate",
    "conformance",
    "deployed",
    "diagnostics",
    "doctor",
    "merged",
    "migration",
    "part",
    "recheck",
    "refinement",
    "replay",
    "sarif",
    "simulated",
    "splitting",
    "story",
    "trace",
    "verdicts",
)


def generated(document: str) -> dict[str, Any]:
    """Generate the JSON Schema of a document from the structs that it is written from."""
    from msgspec.json import schema_components

    from koord.api import forms, run_forms, sarif_forms, verdict_forms
    from koord.refinement import part_form
    from koord.syntax.forms import VALUES
    from koord.traces import form, story_form
    from koord.verify.certificate_form import CertificateForm

    head: dict[str, str]
    whole: Any
    others: dict[str, Any]
    head, whole, others = {
        "campaign": ({"title": "Runs in a simulated world"}, run_forms.CampaignRuns, {}),
        "certificate": ({"title": "Koord certificate"}, CertificateForm, VALUES),
        "conformance": ({"title": "Findings of koord on a driver"}, forms.Conformed, {}),
        "diagnostics": ({"title": "Diagnostics of koord"}, forms.Diagnostics, {}),
        "merged": ({"title": "Verdicts of koord on a deployed run"}, forms.Merged, VALUES),
        "doctor": ({"title": "What koord can use here"}, forms.Doctor, {}),
        "migration": ({"title": "Programs in today's forms"}, forms.Migrated, {}),
        "part": (
            {"$id": "koord-part-1", "title": "A line of a part of a deployed run"},
            part_form.AnyLine,
            form.VALUES,
        ),
        "recheck": (
            {"title": "Verdicts of koord on a certificate"},
            forms.Recheck,
            VALUES,
        ),
        "replay": ({"title": "Verdicts of koord on a trace"}, forms.Replay, VALUES),
        "simulated": ({"title": "A run in a simulated world"}, run_forms.SimulatedRun, VALUES),
        "deployed": ({"title": "A run on robots"}, run_forms.DeployedRun, VALUES),
        "refinement": (
            {"title": "Findings of koord on compiled programs"},
            run_forms.RefinementAnswer,
            VALUES,
        ),
        "sarif": ({"title": "What koord writes of SARIF 2.1.0"}, sarif_forms.Log, {}),
        "splitting": ({"title": "Rates of violations by splitting"}, forms.Splitting, {}),
        "story": (
            {"$id": "koord-story-1", "title": "A run as people look at it"},
            story_form.Story,
            {},
        ),
        "trace": (
            {"$id": "koord-trace-3", "title": "koord trace, versions 1 to 3"},
            form.File,
            form.VALUES,
        ),
        "verdicts": ({"title": "Verdicts of koord"}, verdict_forms.Verdicts, VALUES),
    }[document]
    (top,), found = schema_components([whole], ref_template="#/$defs/{name}")
    for one in found.values():
        del one["title"]  # of the struct
        if "enum" in one:
            one.pop("description", None)  # of the enumeration, for who reads the code
        if "description" in one:
            one["description"] = " ".join(one["description"].split())
    own = found.pop(top["$ref"].rpartition("/")[2]) if "$ref" in top else {"anyOf": top["anyOf"]}
    draft = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": draft, **head, **own, "$defs": {**others, **found}}


def schema(document: str = "configuration") -> dict[str, Any]:
    """The JSON Schema of what koord reads and writes.

    ``document`` is ``"configuration"``, ``"verdicts"``, ``"diagnostics"``, ``"migration"``,
    ``"trace"``, ``"part"``, ``"certificate"``, ``"recheck"``, ``"replay"``, ``"merged"``,
    ``"conformance"``, ``"splitting"``, ``"story"``, ``"doctor"``, ``"sarif"``,
    ``"simulated"``, ``"campaign"``, ``"deployed"`` or ``"refinement"``.

    Raises :class:`koord.ArgumentError` for another one.

    >>> koord.schema("verdicts")["title"]
    """
    found: dict[str, Any] = json.loads(schema_text(document))
    return found
