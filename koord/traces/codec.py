"""The one codec of traces: JSON, versioned, exact in both directions. [TRACE]

``koord schema trace`` describes the documents. Whatever is read is checked: decoding
raises KoordError, with the JSON path of what is wrong, and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.diagnostics import KoordError, Severity, refusal
from koord.syntax.source import Source, visible
from koord.syntax.system import System
from koord.traces.decode_runs import decode_run
from koord.traces.encode_runs import encode_run
from koord.traces.json_reader import Reader, parse
from koord.traces.trace import Numbers, Sources, Trace, digest
from koord.traces.value_codec import Json, decode_fraction, encode_fraction

if TYPE_CHECKING:
    from koord.syntax.elaboration.settings import ParamValue

FORMAT = "koord trace"

#: Raised with every change that an older reader would misunderstand.
VERSION = 3

#: What has nothing new in it is written as older readers know it: 2 is a run that repeats itself,
#: 3 one with slack.
_PLAIN, _LOOP = 1, 2

Load: TypeAlias = Callable[[Sources], core.Program]

#: No value that a command line can give is nested deeper.
_DEEPEST_PARAM = 20

_FIELDS = (
    "format",
    "version",
    "program",
    "properties",
    "params",
    "tasks",
    "robots",
    "delta",
    "numbers",
    "run",
)


# --- encoding -----------------------------------------------------------------------------------


def encode(trace: Trace) -> bytes:
    """A trace as a JSON document in UTF-8, one round a line."""
    return render(to_json(trace))


def to_json(trace: Trace) -> dict[str, Json]:
    """A trace as a JSON object."""
    return {**head_of(trace), "run": encode_run(trace)}


def head_of(trace: Trace) -> dict[str, Json]:
    """All of a trace but its run."""
    sources = trace.sources
    tasks = sources.tasks
    return {
        "format": FORMAT,
        "version": _version(trace),
        "program": _encode_text(sources.program),
        "properties": [_encode_text(source) for source in sources.properties],
        "params": {name: _encode_param(value) for name, value in sources.params},
        "tasks": None
        if tasks is None
        else [[encode_fraction(coordinate) for coordinate in task] for task in tasks],
        "robots": list(trace.system.kinds),
        "delta": encode_fraction(trace.system.delta_s),
        "numbers": trace.numbers.value,
        **({"slack": encode_fraction(trace.slack)} if trace.slack else {}),
    }


def _version(trace: Trace) -> int:
    if trace.slack:
        return VERSION
    return _PLAIN if trace.recording.loop is None else _LOOP


def render(document: dict[str, Json]) -> bytes:
    """A document as text: its fields one a line, and a run's rounds one a line."""
    lines = []
    for name, value in document.items():
        if name == "run" and isinstance(value, dict):
            lines.append(f'"run": {_rendered_run(value)}')
        else:
            lines.append(f"{json.dumps(name)}: {json.dumps(value)}")
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode("utf-8")


def _rendered_run(run: dict[str, Json]) -> str:
    parts = []
    for name, value in run.items():
        if name == "rounds" and isinstance(value, list) and value:
            rounds = ",\n".join(map(rendered_round, value))
            parts.append(f'"rounds": [\n{rounds}\n ]')
        else:
            parts.append(f"{json.dumps(name)}: {json.dumps(value)}")
    return "{\n " + ",\n ".join(parts) + "\n}"


def rendered_round(round_: Json) -> str:
    """A round as the line of text that it is."""
    return f"  {json.dumps(round_)}"


def _encode_text(source: Source) -> Json:
    return {"name": source.name, "sha256": digest(source), "text": source.text}


def _encode_param(value: object) -> Json:
    match value:
        case bool() | str():
            return value
        case int() | Fraction():
            kind = "int" if isinstance(value, int) else "float"
            return {kind: encode_fraction(value)}
        case tuple():
            return [_encode_param(item) for item in value]
        case _:
            raise AssertionError(f"{value!r} is no value of a param")


# --- decoding -----------------------------------------------------------------------------------


class Header(Struct, frozen=True):
    """What a trace says before its run: enough to get the program that the run is typed by."""

    sources: Sources
    kinds: tuple[int, ...]
    delta_s: Fraction
    numbers: Numbers
    slack: Fraction
    run: Reader


def decode(raw: bytes, name: str, load: Load | None = None) -> Trace:
    """The trace in a document. ``name`` is the file's, for messages.

    ``load`` gives the program for the texts that the trace holds, in place of parsing these.
    Raises KoordError.
    """
    return decode_document(parse(raw, name), load)


def decode_document(document: Reader, load: Load | None = None) -> Trace:
    """The trace in a JSON document that was parsed already. Raises KoordError."""
    header = decode_header(document)
    program = (load if load is not None else load_embedded)(header.sources)
    system = System(program, header.kinds, header.delta_s)
    known = len(program.agents)
    if any(kind >= known for kind in header.kinds):
        raise document.refuse(
            f"the robots are of {max(header.kinds) + 1} kinds, but the program has {known}", "K914"
        )
    trace = decode_run(header.run, header.sources, system, header.numbers)
    return replace(trace, slack=header.slack)


def decode_header(document: Reader) -> Header:
    """All of a trace but its run. Raises KoordError."""
    _check_format(document)
    parts = document.fields(_FIELDS, ("slack",))
    properties = tuple(_decode_text(item) for item in parts["properties"].items())
    params = tuple((name, _decode_param(part)) for name, part in parts["params"].entries())
    sources = Sources(_decode_text(parts["program"]), properties, params, _tasks(parts["tasks"]))
    kinds = tuple(item.integer(0, 1000) for item in parts["robots"].items())
    if not kinds:
        raise parts["robots"].refuse("there should be at least one robot")
    delta_s = decode_fraction(parts["delta"])
    if delta_s <= 0:
        raise parts["delta"].refuse("the length of a round should be more than 0 seconds")
    slack = decode_fraction(parts["slack"]) if "slack" in parts else Fraction(0)
    if slack < 0:
        raise parts["slack"].refuse("the slack should be at least 0")
    numbers = parts["numbers"].member(Numbers)
    return Header(sources, kinds, delta_s, numbers, slack, parts["run"])


def _check_format(document: Reader) -> None:
    value = document.value
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        raise refusal(
            "K911",
            document.file,
            "this is no trace of koord, though it is JSON",
            "name a file that `koord run --trace` or `koord verify --trace` wrote",
        )
    version = value.get("version")
    if version in (_PLAIN, _LOOP, VERSION) and not isinstance(version, bool):
        return
    if isinstance(version, int) and not isinstance(version, bool) and version > VERSION:
        raise refusal(
            "K912",
            document.file,
            f"the trace has version {version}; this koord reads version {VERSION}",
            "use the koord that wrote it, or a newer one",
        )
    raise document.refuse("there is no version that was ever written in the field 'version'")


def _decode_text(reader: Reader) -> Source:
    parts = reader.fields(("name", "sha256", "text"))
    source = Source(visible(parts["name"].text()), parts["text"].text())
    if digest(source) != parts["sha256"].text():
        raise parts["text"].refuse(
            "the text is not the one that the trace was made with (sha256 differs)",
            "K915",
            "undo the change, or name the program behind --program",
        )
    return source


def _decode_param(reader: Reader, depth: int = 0) -> ParamValue:
    value = reader.value
    if isinstance(value, bool | str):
        return value
    if isinstance(value, list):
        if depth == _DEEPEST_PARAM:
            raise reader.refuse("the value is nested too deeply")
        return tuple(_decode_param(item, depth + 1) for item in reader.items())
    parts = reader.fields((), ("int", "float"))
    if len(parts) != 1:
        raise reader.refuse('there should be {"int": "3"} or {"float": "3/4"} here')
    ((kind, part),) = parts.items()
    number = decode_fraction(part)
    if kind == "float":
        return number
    if number.denominator != 1:
        raise part.refuse("this is no integer")
    return number.numerator


def _tasks(reader: Reader) -> tuple[tuple[Fraction, Fraction, Fraction], ...] | None:
    if reader.value is None:
        return None
    tasks = []
    for task in reader.items():
        x, y, z = (decode_fraction(coordinate) for coordinate in task.items(3))
        tasks.append((x, y, z))
    return tuple(tasks)


def load_embedded(sources: Sources) -> core.Program:
    """The program of the texts that a trace holds. Raises KoordError."""
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
                "the language may have changed since; name a working program behind --program",
            ).diagnostics,
            *errors,
        )
    )
