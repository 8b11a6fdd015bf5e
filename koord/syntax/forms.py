"""Forms of JSON: the base of structs from which ``koord schema`` is generated."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from msgspec import Meta, Struct


def defined(name: str) -> Meta:
    """A value that is described by its name among a schema's ``$defs``."""
    return Meta(extra_json_schema={"$ref": f"#/$defs/{name}"})


def words(*allowed: str) -> Meta:
    """One of these words."""
    assert allowed, "a schema that nothing meets"
    return Meta(extra_json_schema={"enum": list(allowed)})


Natural: TypeAlias = Annotated[int, Meta(ge=0)]
FromOne: TypeAlias = Annotated[int, Meta(ge=1)]
Told: TypeAlias = Annotated[str, Meta(min_length=1)]
Exact: TypeAlias = Annotated[str, defined("Fraction")]
Value: TypeAlias = Annotated[Any, defined("Value")]
#: Where the world's tasks are, in metres.
Tasks: TypeAlias = list[tuple[Exact, Exact, Exact]]
Digest: TypeAlias = Annotated[
    str,
    Meta(
        description="SHA-256 of the text in UTF-8.",
        extra_json_schema={"pattern": "^[0-9a-f]{64}$"},
    ),
]

#: The schemas of values of params, by the names that forms refer to.
VALUES: dict[str, Any] = {
    "Fraction": {"type": "string", "pattern": "^-?[0-9]+(/[0-9]+)?$"},
    "Value": {
        "description": "An int, a bool, a string or member of an enumeration, a float as a "
        "fraction, a list; a pos is a list of three.",
        "oneOf": [
            {"type": "integer"},
            {"type": "boolean"},
            {"type": "string"},
            {"type": "array", "items": {"$ref": "#/$defs/Value"}},
            {
                "type": "object",
                "additionalProperties": False,
                "required": ["fraction"],
                "properties": {"fraction": {"$ref": "#/$defs/Fraction"}},
            },
        ],
    },
}


class Form(Struct, forbid_unknown_fields=True):
    """A JSON object that allows no further fields."""


class Text(Form):
    """A text that a document is about, complete."""

    name: str
    text: str
    sha256: Digest


class NotCovered(Form):
    name: str
    reason: str
