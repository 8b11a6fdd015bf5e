"""The forms of configurations as schemas, and the way in them to what stands at a path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache

from koord.api.schema_words import Schema, name_of
from koord.runtime.configuration import forms


@cache
def _schema() -> Schema:
    return forms.json_schema()


def definition(name: str) -> Schema:
    """The schema of a form or an enumeration."""
    found: Schema = _schema()["$defs"][name]
    return found


def forms_at(path: Iterable[str]) -> list[Schema]:
    """The schemas of the mappings that may stand at a path of names of fields."""
    here = list(mappings(_schema()))
    for name in path:
        here = [one for value in values_of(here, name) for one in mappings(value)]
    return here


def values_of(here: Iterable[Schema], name: str) -> list[Schema]:
    """The schemas of a field in mappings."""
    found = (one.get("properties", {}).get(name, one.get("additionalProperties")) for one in here)
    return [one for one in found if isinstance(one, Mapping)]


def mappings(schema: Schema) -> Iterator[Schema]:
    """The mappings that a value may be, or have in a list."""
    if "$ref" in schema:
        yield from mappings(definition(name_of(schema["$ref"])))
    for one in schema.get("anyOf", ()):
        yield from mappings(one)
    if isinstance(schema.get("items"), Mapping):
        yield from mappings(schema["items"])
    if "properties" in schema or isinstance(schema.get("additionalProperties"), Mapping):
        yield schema


def words(schema: Schema) -> Iterator[str]:
    """The words that a value may be, or have in a list: those of enumerations, true and false."""
    if "$ref" in schema:
        yield from words(definition(name_of(schema["$ref"])))
    for one in schema.get("anyOf", ()):
        yield from words(one)
    if isinstance(schema.get("items"), Mapping):
        yield from words(schema["items"])
    if schema.get("type") == "boolean":
        yield from ("true", "false")
    yield from map(str, schema.get("enum", ()))
