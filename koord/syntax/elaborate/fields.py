"""Where the fields of records stand."""

from __future__ import annotations

from koord.syntax.types import RecordType

#: Two names of one field of a `Task`, as published programs use them.
TASK_FIELDS = {
    "loc": "target",
    "target": "loc",
    "assignedTo": "assignId",
    "assignId": "assignedTo",
    "id": "taskId",
    "taskId": "id",
}


def field_position(record: RecordType, name: str) -> int | None:
    """Where the field stands, by either of its names."""
    found = record.position(name)
    if found is None and record.name == "Task" and name in TASK_FIELDS:
        return record.position(TASK_FIELDS[name])
    return found
