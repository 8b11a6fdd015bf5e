"""Which names a tree mentions."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from enum import Enum
from fractions import Fraction

from koord.syntax import ast
from koord.syntax.content import content_fields
from koord.syntax.source import Span

_LEAVES = (str, int, Fraction, Enum, type(None), Span, ast.Comment)


def mentioned(program: ast.Program, variables: Container[str]) -> dict[str, Span]:
    """The names in expressions that are not those of variables, and those of ports of modules.

    Each with the first place where it stands.
    """
    parts: dict[type, tuple[str, ...]] = {}
    names: dict[str, Span] = {}

    def note(name: str, span: Span) -> None:
        first = names.setdefault(name, span)
        if (span.line, span.column) < (first.line, first.column):
            names[name] = span

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
                note(node.name, node.span)
            continue
        if kind is ast.Attribute:
            assert isinstance(node, ast.Attribute)
            if isinstance(node.base, ast.Name) and node.base.name in modules:
                note(node.name.name, node.name.span)
            else:
                stack.append(node.base)
            continue
        known = parts.get(kind)
        if known is None:
            known = () if isinstance(node, _LEAVES) else _parts(node)
            parts[kind] = known
        for part in known:
            stack.append(getattr(node, part))
    return names


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
    return content_fields(type(node))
