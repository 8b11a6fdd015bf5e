"""The fields of configurations, for editors: what one means, and which could stand at a place."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from msgspec import Struct

from koord.api.configuration_texts import is_configuration, outermost_fields
from koord.api.field_comments import field_comments
from koord.runtime.configuration import forms
from koord.runtime.configuration.reading import read_any
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source, Span

Schema = Mapping[str, Any]

#: What stands before the cursor where the name of a field is written, in a line of its own.
_BEFORE = re.compile(r"((?: |- )*)(\w*)")

#: A line that begins with the name of a field; dashes of lists indent as spaces do.
_NAMED = re.compile(r"((?: |- )*)([\"']?)([\w.-]+)\2[ \t]*:(?:\s|$)")


class ConfigurationField(Struct, frozen=True):
    """A field of a form: the type of its value in words, its default, and what it means."""

    name: str
    type: str
    story: str
    default: str = ""  #: as YAML; empty: it says nothing
    has_fields: bool = False

    @property
    def markdown(self) -> str:
        """All of it."""
        usual = f", by default `{self.default}`" if self.default else ""
        return f"`{self.name}`: {self.type}{usual}" + (f"\n\n{self.story}" if self.story else "")


class FieldCompletions(Struct, frozen=True):
    """The fields that could stand at a place, and the word that they replace."""

    span: Span
    fields: tuple[ConfigurationField, ...]


def field_at(source: Source, line: int, column: int) -> tuple[Span, ConfigurationField] | None:
    """The field whose name is at a place; None if there is none, or the text is not YAML."""
    if not is_configuration(source.text):
        return None
    try:
        document = read_any(source)
    except KoordError:
        return None
    for path, span in document.names.items():
        if span.line == line and span.column <= column <= span.end_column:
            *above, name = path
            words = [word for word in above if isinstance(word, str)]
            found = [one for one in _fields(words) if one.name == name]
            return (span, found[0]) if found else None
    return None


def fields_for(source: Source, line: int, column: int) -> FieldCompletions | None:
    """The fields that could be written at a place; None where no name of a field can stand.

    The lines above say what the place is in. Outermost fields that are given are not offered.
    """
    lines = source.text.split("\n")
    before = _BEFORE.fullmatch(source.line_text(line)[: column - 1])
    if before is None or not is_configuration(source.text):
        return None
    start = len(before[1])
    path = _around(lines[: line - 1], start)
    others = lines[: line - 1] + lines[line:]
    given = set[str]() if path else outermost_fields("\n".join(others))
    fields = tuple(one for one in _fields(path) if one.name not in given)
    return FieldCompletions(Span(source.name, line, start + 1, line, column), fields)


def _around(lines: Sequence[str], indent: int) -> list[str]:
    """The names of the fields around a place with this indent, behind these lines."""
    path: list[str] = []
    for line in reversed(lines):
        found = _NAMED.match(line)
        if found is not None and len(found[1]) < indent:
            indent = len(found[1])
            path.insert(0, found[3])
    return path


# --- forms ----------------------------------------------------------------------------------------


@cache
def _schema() -> Schema:
    return forms.json_schema()


def _fields(path: Iterable[str]) -> list[ConfigurationField]:
    """The fields of what stands at a path of names."""
    here = list(_objects(_schema()))
    for name in path:
        values = [value for one in here if (value := _value(one, name)) is not None]
        here = [one for value in values for one in _objects(value)]
    found: dict[str, ConfigurationField] = {}
    for one in here:
        form = getattr(forms, one.get("title", ""), None)
        comments = field_comments(form) if inspect.isclass(form) else {}
        for name, value in one.get("properties", {}).items():
            found.setdefault(name, _field(name, value, comments.get(name, "")))
    return list(found.values())


def _value(schema: Schema, name: str) -> Schema | None:
    """The schema of a field of an object."""
    found = schema.get("properties", {}).get(name, schema.get("additionalProperties"))
    return found if isinstance(found, Mapping) else None


def _objects(schema: Schema) -> Iterator[Schema]:
    """The objects that a value may be, or have in a list."""
    if "$ref" in schema:
        yield from _objects(_schema()["$defs"][schema["$ref"].rpartition("/")[2]])
    for one in schema.get("anyOf", ()):
        yield from _objects(one)
    if isinstance(schema.get("items"), Mapping):
        yield from _objects(schema["items"])
    if "properties" in schema or isinstance(schema.get("additionalProperties"), Mapping):
        yield schema


def _field(name: str, schema: Schema, comment: str) -> ConfigurationField:
    inner = list(_objects(schema))
    described = (one["description"] for one in inner if "description" in one)
    told = [comment, *map(inspect.cleandoc, described)]
    default = schema.get("default")
    shown = "" if default is None or default in ({}, []) else json.dumps(default)
    story = "\n\n".join(dict.fromkeys(filter(None, told)))
    return ConfigurationField(name, _type(schema), story, "" if inner else shown, bool(inner))


def _type(schema: Schema) -> str:
    """The type of a value, in words."""
    if "$ref" in schema:
        return _type(_schema()["$defs"][schema["$ref"].rpartition("/")[2]])
    if "anyOf" in schema:
        given = (_type(one) for one in schema["anyOf"] if one.get("type") != "null")
        return " or ".join(dict.fromkeys(given))
    if "enum" in schema:
        return ", ".join(f"`{one}`" for one in schema["enum"])
    kinds = {"array": "list", "object": "fields", "string": "text", "boolean": "true or false"}
    word = str(schema.get("type", "anything"))
    bounds = [
        f"{sign} {schema[of]:g}"
        for of, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", ">"),
            ("maximum", "≤"),
        )
        if of in schema
    ]
    return " ".join([kinds.get(word, word), ", ".join(bounds)]).strip()
