"""Traces as files: JSON, versioned, exact in both directions. [TRACE]

:mod:`koord.traces.form` has the form. Whatever is read is checked: decoding raises KoordError, with
the JSON path of what is wrong, and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from itertools import starmap
from typing import Any, Protocol, TypeAlias

from msgspec import UNSET, Struct, UnsetType, to_builtins
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.diagnostics import KoordError, Severity, refusal
from koord.syntax.forms import Natural
from koord.syntax.source import Source, visible
from koord.syntax.system import System
from koord.traces import form
from koord.traces.form import FORMAT, LOOP, PLAIN, SLACK, VERSION
from koord.traces.json_reader import FormError, JsonNode, parse
from koord.traces.run_codec import decode_run, encode_run
from koord.traces.trace import Sources, Trace, digest
from koord.traces.value_codec import (
    Json,
    decode_fraction,
    decode_param,
    encode_fraction,
    encode_param,
)

Load: TypeAlias = Callable[[Sources], core.Program]


# --- encoding -----------------------------------------------------------------------------------


def encode(trace: Trace, *, with_rounds: bool = True) -> bytes:
    """Encode a trace as JSON in UTF-8, one round per line; optionally without its rounds."""
    run = encode_run(trace, with_rounds=with_rounds)
    whole = replace(trace, later=())
    lines = []
    for name, value in to_json(whole, run=replace(run, rounds=[])).items():
        text = _rendered_run(value, run.rounds) if name == "run" else json.dumps(value)
        lines.append(f"{json.dumps(name)}: {text}")
    if trace.later:
        lines[1] = f'"version": {VERSION}'
        parts = ",\n".join(rendered_part(part, with_rounds=with_rounds) for part in trace.later)
        lines.append(f'"later": [\n{parts}\n]')
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode("utf-8")


def rendered_part(part: Trace, *, with_rounds: bool = True) -> str:
    """Encode a later part of a run as text; optionally without its rounds."""
    run = encode_run(part, with_rounds=with_rounds)
    found: dict[str, Any] = to_builtins(_encode_later(part, replace(run, rounds=[])))
    text = _rendered_run(found.pop("run"), run.rounds)
    return f'{json.dumps(found)[:-1]}, "run": {text}}}'


def _encode_later(part: Trace, run: form.Run) -> form.Later:
    subject = encode_subject(part.sources, part.system)
    names = ("program", "properties", "params", "tasks")
    return form.Later(**{name: subject[name] for name in names}, run=run)


def _rendered_run(run: Any, rounds: list[form.Round]) -> str:
    parts = []
    for name, value in run.items():
        if name == "rounds" and rounds:
            parts.append(f'"rounds": [\n{rendered_rounds(rounds)}\n ]')
        else:
            parts.append(f"{json.dumps(name)}: {json.dumps(value)}")
    return "{\n " + ",\n ".join(parts) + "\n}"


def rendered_rounds(rounds: Iterable[form.Round]) -> str:
    """Encode rounds as lines of text."""
    return ",\n".join(f"  {json.dumps(to_builtins(one))}" for one in rounds)


def to_json(trace: Trace, run: form.Run | None = None) -> dict[str, Json]:
    """A trace as a JSON object; with another encoding of its ``run``, if that is given."""
    file = form.File(
        format=FORMAT,
        version=_version(trace),
        **encode_subject(trace.sources, trace.system),
        numbers=trace.numbers,
        slack=encode_fraction(trace.slack) if trace.slack else UNSET,
        run=encode_run(trace) if run is None else run,
        later=[_encode_later(part, encode_run(part)) for part in trace.later] or UNSET,
    )
    found: dict[str, Json] = to_builtins(file)
    return found


def encode_subject(sources: Sources, system: System) -> dict[str, Any]:
    """Encode what a file is about, as fields of its form."""
    tasks = sources.tasks
    return {
        "program": _encode_text(sources.program),
        "properties": list(map(_encode_text, sources.properties)),
        "params": {name: encode_param(value) for name, value in sources.params},
        "tasks": None if tasks is None else [_encode_task(*task) for task in tasks],
        "robots": list(system.kinds),
        "delta": encode_fraction(system.delta_s),
    }


def _version(trace: Trace) -> form.Version:
    if trace.later:
        return VERSION
    if trace.slack:
        return SLACK
    return PLAIN if trace.recording.loop is None else LOOP


def _encode_text(source: Source) -> form.Text:
    return form.Text(source.name, digest(source), source.text)


def _encode_task(x: Fraction, y: Fraction, z: Fraction) -> tuple[str, str, str]:
    return encode_fraction(x), encode_fraction(y), encode_fraction(z)


# --- decoding -----------------------------------------------------------------------------------


def decode(raw: bytes, name: str, load: Load | None = None) -> Trace:
    """Decode a trace. ``name`` is the file's, for messages. Raises KoordError.

    ``load`` gives the program for the texts that the trace holds, in place of parsing these.
    Raises KoordError.
    """
    return decode_document(parse(raw, name), name, load)


def decode_document(document: object, name: str, load: Load | None = None, at: str = "$") -> Trace:
    """Decode a trace from a parsed JSON document, which stands at the path ``at`` of a file.

    Raises KoordError.
    """
    file = None
    try:
        _check_format(document, name)
        file = JsonNode(document).form(form.File)
        subject = decode_subject(file, load if load is not None else load_embedded)
        trace = decode_run(file.run, subject.sources, subject.system, file.numbers)
        later = () if file.later is UNSET else tuple(_decode_later(file, load or load_embedded))
    except FormError as error:
        raise error.refusal(name, at, file) from None
    return replace(trace, slack=subject.slack, later=later)


def _decode_later(file: form.File, load: Load) -> Iterator[Trace]:
    """Decode the parts of a run after each change of its program. Raises FormError, KoordError."""
    assert not isinstance(file.later, UnsetType)
    for part in file.later:
        of = replace(
            file,
            program=part.program,
            properties=part.properties,
            params=part.params,
            tasks=part.tasks,
        )
        subject = decode_subject(of, load)
        trace = decode_run(part.run, subject.sources, subject.system, file.numbers)
        yield replace(trace, slack=subject.slack)


class Headed(Protocol):
    """A form with the fields that say what program was run, by whom, and how long a round took."""

    program: form.Text
    properties: list[form.Text]
    params: dict[str, form.Param]
    tasks: list[tuple[form.Rational, form.Rational, form.Rational]] | None
    robots: list[Natural]
    delta: form.Rational
    slack: form.Rational


class Subject(Struct, frozen=True):
    """The subject of a file: the texts and settings, the system made of them, and the slack."""

    sources: Sources
    system: System
    slack: Fraction


def decode_subject(file: Headed, load: Load) -> Subject:
    """Decode what a file is about, and load its program. Raises FormError and KoordError."""
    sources = Sources(
        _decode_text(file.program),
        tuple(map(_decode_text, file.properties)),
        tuple(
            (name, decode_param(value))
            for name, value in JsonNode(file.params, ".params").entries()
        ),
        None if file.tasks is None else tuple(starmap(_decode_task, enumerate(file.tasks))),
    )
    delta_s = decode_fraction(JsonNode(file.delta, ".delta"))
    if delta_s <= 0:
        raise FormError("the length of a round should be more than 0 seconds", ".delta")
    slack = Fraction(0)
    if file.slack is not UNSET:
        slack = decode_fraction(JsonNode(file.slack, ".slack"))
    if slack < 0:
        raise FormError("the slack should be at least 0", ".slack")
    program = load(sources)
    known = len(program.agents)
    if any(kind >= known for kind in file.robots):
        reason = f"the robots are of {max(file.robots) + 1} kinds, but the program has {known}"
        raise FormError(reason, "", "K914")
    return Subject(sources, System(program, tuple(file.robots), delta_s), slack)


def _decode_task(number: int, task: tuple[object, ...]) -> tuple[Fraction, Fraction, Fraction]:
    x, y, z = map(decode_fraction, JsonNode(list(task), f".tasks[{number}]").items())
    return x, y, z


def _check_format(document: object, name: str) -> None:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise refusal(
            "K911",
            name,
            "this is no trace of koord, though it is JSON",
            "name a file that `koord run --trace` or `koord verify --trace` wrote",
        )
    version = document.get("version")
    if version in (PLAIN, LOOP, SLACK, VERSION) and not isinstance(version, bool):
        return
    if isinstance(version, int) and not isinstance(version, bool) and version > VERSION:
        raise refusal(
            "K912",
            name,
            f"the trace has version {version}; this koord reads version {VERSION}",
            "use the koord that wrote it, or a newer one",
        )
    raise FormError("there is no version that was ever written in the field 'version'", "")


def _decode_text(part: form.Text) -> Source:
    source = Source(visible(part.name), part.text)
    if digest(source) != part.sha256:
        reason = "the text is not the one that the trace was made with (sha256 differs)"
        raise FormError(reason, ".text", "K915", part)
    return source


def load_embedded(sources: Sources) -> core.Program:
    """Load the program whose texts a trace holds. Raises KoordError."""
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load

    settings = Settings(dict(sources.params), sources.tasks)
    elaborated = load(sources.program, settings, sources.properties)
    if elaborated.program is not None:
        return elaborated.program
    errors = tuple(d for d in elaborated.diagnostics if d.severity is Severity.ERROR)
    raise KoordError(
        (
            *refusal(
                "K916",
                sources.program.name,
                "the program in the trace has errors",
                "the language may have changed since; name a working program behind `program=`",
            ).diagnostics,
            *errors,
        )
    )
