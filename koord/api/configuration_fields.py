"""The fields of configurations, for editors: what one means, and what could stand at a place."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.api.configuration_cursor import cursor_at
from koord.api.configuration_forms import definition, forms_at, mappings
from koord.api.configuration_values import Asked, ConfigurationValue, declared, values_at
from koord.api.editing import SymbolKind
from koord.api.field_comments import field_comments
from koord.api.schema_words import Schema, type_in_words
from koord.runtime.configuration import forms
from koord.runtime.configuration.reading import read_any
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source, Span


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


class ConfigurationCompletions(Struct, frozen=True):
    """The fields, or the values, that could stand at a place, and the word that they replace.

    Where ``is_named`` a colon follows already.
    """

    span: Span
    fields: tuple[ConfigurationField, ...] = ()
    values: tuple[ConfigurationValue, ...] = ()
    is_named: bool = False


def field_at(source: Source, line: int, column: int) -> tuple[Span, ConfigurationField] | None:
    """The field whose name is at a place; None if there is none, or the text is not YAML.

    The text is a configuration (:func:`~koord.api.configuration_texts.configuration_text`).
    """
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


def completions_at(
    source: Source, line: int, column: int, program: Source | None = None
) -> ConfigurationCompletions | None:
    """The fields or values that could be written at a place; None where none are known.

    The text is a configuration, whose program says which params, modules and kinds of robot there
    are. Fields that stand there are not offered again.
    """
    cursor = cursor_at(source, line, column)
    if cursor is None:
        return None
    if cursor.is_name:
        known = [*_fields(cursor.path), *_of_program(cursor.path, program)]
        fields = tuple(one for one in known if one.name not in cursor.beside)
        if known:
            return ConfigurationCompletions(cursor.span, fields, is_named=cursor.is_named)
    values = values_at(Asked(cursor, source, program))
    return ConfigurationCompletions(cursor.span, values=values) if values else None


def _of_program(path: tuple[str, ...], program: Source | None) -> Iterator[ConfigurationField]:
    """The fields whose names are those of a program's params and modules."""
    kind = None
    if path == ("params",):
        kind = SymbolKind.PARAM
    elif path[-1:] == ("modules",):
        kind = SymbolKind.MODULE
    for one in () if kind is None else declared(program, kind):
        yield ConfigurationField(one.name, f"{one.kind.value} of the program", one.story)


# --- forms ----------------------------------------------------------------------------------------


def _fields(path: Iterable[str]) -> list[ConfigurationField]:
    """The fields of what stands at a path of names."""
    found: dict[str, ConfigurationField] = {}
    for one in forms_at(path):
        form = getattr(forms, one.get("title", ""), None)
        comments = field_comments(form) if inspect.isclass(form) else {}
        for name, value in one.get("properties", {}).items():
            found.setdefault(name, _field(name, value, comments.get(name, "")))
    return list(found.values())


def _field(name: str, schema: Schema, comment: str) -> ConfigurationField:
    inner = list(mappings(schema))
    described = (one["description"] for one in inner if "description" in one)
    told = [comment, *map(inspect.cleandoc, described)]
    default = schema.get("default")
    shown = "" if default is None or default in ({}, []) else json.dumps(default)
    story = "\n\n".join(dict.fromkeys(filter(None, told)))
    return ConfigurationField(name, _type(schema), story, "" if inner else shown, bool(inner))


def _type(schema: Schema) -> str:
    """The type of a value in words; enumerations are told by their values."""

    def named(name: str) -> str:
        found = definition(name)
        return _type(found) if "enum" in found else name

    return type_in_words(schema, named, lambda value: f"`{value}`")
