"""JSON Schemas as tables: a section of each object, a row of each field."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from docs.generator.markdown import code, plain, slug, table

Schema = Mapping[str, Any]

#: What is said of a field besides its description in the schema: by object and field.
Said = Callable[[str, str], str]


def sections(schema: Schema, said: Said = lambda name, field: "") -> str:
    """The object itself, where it has fields, and a section of each definition."""
    text = ""
    definitions = schema.get("$defs", {})
    whole = schema
    if "$ref" in schema:
        first = _name(schema["$ref"])
        text += f"\nThe file is a [{first}](#{slug(first)}).\n"
    elif "properties" in schema:
        text += "\n" + _object("", whole, said)
    for name in sorted(definitions):
        text += f"\n## {name}\n\n{_body(name, definitions[name], said)}"
    return text


def _body(name: str, schema: Schema, said: Said) -> str:
    text = f"{plain(schema['description'])}\n\n" if "description" in schema else ""
    if "properties" in schema:
        return text + _object(name, schema, said)
    return text + f"{_type(schema)}\n"


def _object(name: str, schema: Schema, said: Said) -> str:
    required = schema.get("required", ())
    rows = []
    for field, form in schema["properties"].items():
        notes = [plain(form["description"])] if "description" in form else []
        if more := said(name, field):
            notes.append(plain(more))
        if field in required:
            usual = "required"
        elif "default" in form and form["default"] not in (None, {}, []):
            usual = code(json.dumps(form["default"], ensure_ascii=False))
        else:
            usual = ""
        rows.append((code(field), _type(form), usual, "; ".join(notes)))
    return table(("field", "is", "default", "what it says"), rows)


def _name(reference: str) -> str:
    return reference.rpartition("/")[2]


def _type(schema: Schema | bool) -> str:
    """The type of a value, in words."""
    if isinstance(schema, bool) or not schema:
        return "anything"
    if "$ref" in schema:
        name = _name(schema["$ref"])
        return f"[{name}](#{slug(name)})"
    for word in ("anyOf", "oneOf"):
        if word in schema:
            return " or ".join(dict.fromkeys(map(_type, schema[word])))
    if "allOf" in schema:
        return " and ".join(map(_type, schema["allOf"]))
    if "const" in schema:
        return code(json.dumps(schema["const"]))
    if "enum" in schema:
        return ", ".join(code(json.dumps(one, ensure_ascii=False)) for one in schema["enum"])
    kinds = schema.get("type", "anything")
    if isinstance(kinds, str):
        kinds = [kinds]
    return " or ".join(_one_type(kind, schema) for kind in kinds)


def _one_type(kind: str, schema: Schema) -> str:
    match kind:
        case "array":
            return _array(schema)
        case "object":
            values = schema.get("additionalProperties", True)
            if "properties" in schema:
                fields = ", ".join(
                    f"{code(field)}: {_type(form)}" for field, form in schema["properties"].items()
                )
                return f"object ({fields})"
            return "object" if isinstance(values, bool) else f"object of {_type(values)}"
        case "integer" | "number":
            return kind + _range(schema)
        case "string" if "pattern" in schema:
            return f"string {code(schema['pattern'])}"
        case _:
            return kind


def _array(schema: Schema) -> str:
    if "prefixItems" in schema:
        return f"[{', '.join(map(_type, schema['prefixItems']))}]".replace("[", "\\[", 1)
    least, most = schema.get("minItems"), schema.get("maxItems")
    inner = _type(schema["items"]) if "items" in schema else "anything"
    if least is not None and least == most:
        return f"list of {least} × {inner}"
    if least is not None and most is not None:
        return f"list of {least} to {most} × {inner}"
    return f"list of {inner}"


def _range(schema: Schema) -> str:
    marks = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = [f"{mark} {schema[word]}" for word, mark in marks.items() if word in schema]
    return f" {' and '.join(bounds)}" if bounds else ""
