"""The JSON schemas of messages in an MCAP file: each with the name that viewers know it by."""

from __future__ import annotations

from typing import Any

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
