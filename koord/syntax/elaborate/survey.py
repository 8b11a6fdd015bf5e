"""Which names a tree mentions."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from dataclasses import fields
from enum import Enum
from fractions import Fraction

from koord.syntax import ast
from koord.syntax.source import Span

_LEAVES = (str, int, Fraction, Enum, type(None), Span, ast.Comment)


def mentioned(program: ast.Program, variables: Container[str]) -> frozenset[str]:
    """The names in expressions that are not those of variables, and those of ports of modules."""
    parts: dict[type, tuple[str, ...]] = {}
    names: set[str] = set()
    modules = set(_modules(program.sections))
    stack: list[object] = [program.sections]
    while stack:
        node = stack.pop()
        if isinstance(node, tuple):
            stack.extend(node)
            continue
        kind = type(node)
        if kind is ast.Name:
            assert isinstance(node, ast.Name)
            if node.name not in variables:
                names.add(node.name)
            continue
        if kind is ast.Attribute:
            assert isinstance(node, ast.Attribute)
            if isinstance(node.base, ast.Name) and node.base.name in modules:
                names.add(node.name.name)
            else:
                stack.append(node.base)
            continue
        known = parts.get(kind)
        if known is None:
            known = () if isinstance(node, _LEAVES) else _parts(node)
            parts[kind] = known
        for part in known:
            stack.append(getattr(node, part))
    return frozenset(names)


def _modules(sections: Iterable[ast.Section]) -> Iterator[str]:
    for section in sections:
        if isinstance(section, ast.Using):
            yield section.module.name
        elif isinstance(section, ast.Agent):
            yield from _modules(section.sections)


def _parts(node: object) -> tuple[str, ...]:
    if isinstance(node, ast.Ident):
        return ()
    assert isinstance(node, ast.Node)
    return tuple(field.name for field in fields(node) if field.name != "span")
