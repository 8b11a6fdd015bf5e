"""JSON messages in MCAP files: schemas under names that viewers know, and encoded values."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, assert_never

from koord.runtime.shapes import (
    Array,
    Enumeration,
    Mapping,
    PerRobot,
    Record,
    Scalar,
    ScalarKind,
    Sequence,
    Shape,
)

Message = dict[str, Any]

_NUMBER: Message = {"type": "number"}
_TIME: Message = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}
_VECTOR: Message = {"type": "object", "properties": dict.fromkeys("xyz", _NUMBER)}
_TURN: Message = {"type": "object", "properties": dict.fromkeys("xyzw", _NUMBER)}
_TEXT: Message = {"type": "string"}

_TRANSFORM: Message = {
    "title": "foxglove.FrameTransform",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "parent_frame_id": _TEXT,
        "child_frame_id": _TEXT,
        "translation": _VECTOR,
        "rotation": _TURN,
    },
}
TRANSFORMS = (
    "foxglove.FrameTransforms",
    {
        "title": "foxglove.FrameTransforms",
        "type": "object",
        "properties": {"transforms": {"type": "array", "items": _TRANSFORM}},
    },
)
_ARRAY: Message = {"type": "array", "items": {"type": "object"}}
_ENTITY: Message = {
    "title": "foxglove.SceneEntity",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "frame_id": _TEXT,
        "id": _TEXT,
        "lifetime": _TIME | {"title": "duration"},
        "frame_locked": {"type": "boolean"},
    }
    | dict.fromkeys(("metadata", "arrows", "cubes", "spheres", "cylinders", "lines"), _ARRAY)
    | dict.fromkeys(("triangles", "texts", "models"), _ARRAY),
}
SCENE = (
    "foxglove.SceneUpdate",
    {
        "title": "foxglove.SceneUpdate",
        "type": "object",
        "properties": {"deletions": _ARRAY, "entities": {"type": "array", "items": _ENTITY}},
    },
)
LOG = (
    "foxglove.Log",
    {
        "title": "foxglove.Log",
        "type": "object",
        "properties": {
            "timestamp": _TIME,
            "level": {"type": "integer"},
            "message": _TEXT,
            "name": _TEXT,
            "file": _TEXT,
            "line": {"type": "integer"},
        },
    },
)
PROGRAM = (
    "koord.program",
    {
        "title": "koord.program",
        "type": "object",
        "properties": {
            "round": {"type": "integer"},
            "accepted": {"type": "boolean"},
            "notes": {"type": "array", "items": _TEXT},
            "text": _TEXT,
        },
    },
)
ROUND = (
    "koord.round",
    {
        "type": "object",
        "properties": {
            "round": {"type": "integer"},
            "ran": {
                "type": "array",
                "items": {
                    "type": "object",
                    "properties": {"robot": {"type": "integer"}, "event": _TEXT},
                },
            },
            "blocked": {"type": "array", "items": {"type": "integer"}},
            "stopped": {"type": "array", "items": {"type": "integer"}},
        },
    },
)
CHANGES = (
    "koord.changes",
    {
        "type": "object",
        "properties": {
            "round": {"type": "integer"},
            "changes": {
                "type": "array",
                "items": {
                    "type": "object",
                    "properties": {
                        "robot": {"type": "integer"},
                        "variable": _TEXT,
                        "index": {"type": "integer"},
                        "value": {},
                    },
                },
            },
        },
    },
)


# --- values of programs ---------------------------------------------------------------------------


#: Lengths to a tenth of a millimetre.
_DIGITS = 4


#: From a plain value to JSON that is readable without the program.
Naming = Callable[[Any], Any]


def naming(shape: Shape) -> Naming:
    """How plain values of a shape become JSON that is readable without the program."""
    of = _naming(shape)
    return lambda plain: None if plain is None else of(plain)


def _naming(shape: Shape) -> Naming:
    """The same of values that are set."""
    match shape:
        case Scalar(kind=ScalarKind.FLOAT):
            return rounded
        case Scalar():
            return lambda plain: plain
        case Enumeration(members=members):
            return members.__getitem__
        case Record(make=make, fields=fields):
            names: tuple[str, ...] = getattr(make, "_fields", ())
            parts = [*zip(names, map(naming, fields), strict=True)]
            return lambda plain: {n: part(p) for (n, part), p in zip(parts, plain, strict=True)}
        case Array(element=element) | PerRobot(element=element) | Sequence(element=element):
            of = naming(element)
            return lambda plain: [of(item) for item in plain]
        case Mapping(key=key, value=value):
            of_key, of_value = naming(key), naming(value)
            return lambda plain: [{"key": of_key(k), "value": of_value(v)} for k, v in plain]
    assert_never(shape)


def rounded(number: float) -> float | str:
    """Round a number to significant digits; infinities and NaN become text, as JSON lacks them."""
    return round(number, _DIGITS) if math.isfinite(number) else str(number)
