"""The types of JSON Schemas in words, as reference pages and editors tell them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

Schema = Mapping[str, Any]

#: How the object or the enumeration of a name is told of.
Named = Callable[[str], str]

_BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def name_of(reference: str) -> str:
    """The name of a definition that a ``$ref`` leads to."""
    return reference.rpartition("/")[2]


def type_in_words(schema: Schema | bool, named: Named, shown: Callable[[str], str]) -> str:
    """The type of a value; ``shown`` is what becomes of values that it may have.

    >>> type_in_words({"type": "array", "items": {"type": "number", "minimum": 0}}, str, str)
    'list of number ≥ 0'
    """

    def words(inner: Schema | bool) -> str:
        return type_in_words(inner, named, shown)

    if isinstance(schema, bool) or not schema:
        return "anything"
    if "$ref" in schema:
        return named(name_of(schema["$ref"]))
    for word in ("anyOf", "oneOf"):
        if word in schema:
            return " or ".join(dict.fromkeys(map(words, schema[word])))
    if "allOf" in schema:
        return " and ".join(map(words, schema["allOf"]))
    if "const" in schema:
        return shown(json.dumps(schema["const"]))
    if "enum" in schema:
        return ", ".join(shown(json.dumps(one, ensure_ascii=False)) for one in schema["enum"])
    kinds = schema.get("type", "anything")
    if isinstance(kinds, str):
        kinds = [kinds]
    return " or ".join(_one_type(kind, schema, words, shown) for kind in kinds)


def _one_type(
    kind: str,
    schema: Schema,
    words: Callable[[Schema | bool], str],
    shown: Callable[[str], str],
) -> str:
    match kind:
        case "array":
            return _array(schema, words)
        case "object":
            if "properties" in schema:
                fields = (
                    f"{shown(of)}: {words(form)}" for of, form in schema["properties"].items()
                )
                return f"object ({', '.join(fields)})"
            values = schema.get("additionalProperties", True)
            return "object" if isinstance(values, bool) else f"object of {words(values)}"
        case "integer" | "number":
            return kind + _range(schema)
        case "string" if "pattern" in schema:
            return f"string {shown(schema['pattern'])}"
        case _:
            return kind


def _array(schema: Schema, words: Callable[[Schema | bool], str]) -> str:
    if "prefixItems" in schema:
        return f"list ({', '.join(map(words, schema['prefixItems']))})"
    least, most = schema.get("minItems"), schema.get("maxItems")
    inner = words(schema["items"]) if "items" in schema else "anything"
    if least is not None and least == most:
        return f"list of {least} × {inner}"
    if least is not None and most is not None:
        return f"list of {least} to {most} × {inner}"
    return f"list of {inner}"


def _range(schema: Schema) -> str:
    given = [(mark, schema[word]) for word, mark in _BOUNDS.items() if word in schema]
    bounds = [f"{mark} {at:g}" if isinstance(at, float) else f"{mark} {at}" for mark, at in given]
    return f" {' and '.join(bounds)}" if bounds else ""
