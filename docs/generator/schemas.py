"""JSON Schemas as tables: a section of each object, a row of each field."""

from __future__ import annotations

import json
from collections.abc import Callable

from docs.generator.markdown import code, plain, slug, table
from koord.api.schema_words import Schema, name_of, type_in_words

#: What is said of a field besides its description in the schema: by object and field.
Said = Callable[[str, str], str]


def sections(schema: Schema, said: Said = lambda name, field: "") -> str:
    """The object itself, where it has fields, and a section of each definition."""
    text = ""
    definitions = schema.get("$defs", {})
    whole = schema
    if "$ref" in schema:
        first = name_of(schema["$ref"])
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


def _type(schema: Schema | bool) -> str:
    """The type of a value, in words, with links to what it names."""
    return type_in_words(schema, lambda name: f"[{name}](#{slug(name)})", code)
