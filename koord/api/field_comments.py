"""What is said of the fields of structs, in comments that begin with `#:`."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Mapping
from functools import cache


def field_comments(struct: type) -> Mapping[str, str]:
    """The comment of each field of a struct, and of those it is made from."""
    found: dict[str, str] = {}
    for one in reversed(struct.__mro__):
        if hasattr(one, "__struct_fields__") and one.__module__.startswith("koord"):
            found |= _by_class(one.__module__).get(one.__qualname__, {})
    return found


@cache
def _by_class(module: str) -> Mapping[str, Mapping[str, str]]:
    source = inspect.getsource(sys.modules[module])
    lines = source.split("\n")
    return {
        node.name: {
            field.target.id: said
            for field in node.body
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            if (said := _comment(lines, field))
        }
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef)
    }


def _comment(lines: list[str], field: ast.AnnAssign) -> str:
    """The comment behind a field, or in the lines before it."""
    last = lines[(field.end_lineno or field.lineno) - 1]
    _, mark, behind = last.partition("#:")
    if mark:
        return behind.strip()
    above = []
    at = field.lineno - 2
    while lines[at].strip().startswith("#:"):
        above.append(lines[at].strip().removeprefix("#:").strip())
        at -= 1
    return " ".join(reversed(above))
