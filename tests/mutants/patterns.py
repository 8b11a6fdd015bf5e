"""Replace one piece of a syntax tree: an expression, some statements, or a `case`.

Pieces are compared as trees, so layout, comments and places in a file do not matter.
"""

from __future__ import annotations

import ast
import builtins
import copy
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

#: Whether a name is read or written follows from where it stands.
_CONTEXT = re.compile(r"ctx=(?:Load|Store|Del)\(\)")

_Node = TypeVar("_Node", bound=ast.AST)


def definitions(tree: ast.AST, names: list[str]) -> list[ast.AST]:
    """What is defined under a dotted name: functions or classes; without a name, the tree."""
    found = [tree]
    for name in names:
        found = [inner for outer in found for inner in _defined(outer) if inner.name == name]
    return found


def _defined(outer: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]:
    """The functions and classes in a scope, but not those in one of them."""
    for node in ast.iter_child_nodes(outer):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node
        else:
            yield from _defined(node)


def replace(scope: ast.AST, old: str, new: str) -> int:
    """Put `new` wherever `old` stands, and say how often that was."""
    replacing = _replacing(old, new)
    replacing.visit(scope)
    return replacing.times


def _replacing(old: str, new: str) -> _Expression | _Statements | _Case:
    """Both are a `case`, or expressions; if one of them cannot be read as such, statements."""
    if old.startswith("case "):
        return _Case(_case(old), _case(new))
    try:
        return _Expression(_expression(old), _expression(new))
    except SyntaxError:
        return _Statements(ast.parse(old).body, ast.parse(new).body)


def _case(text: str) -> ast.match_case:
    (match,) = ast.parse(f"match _:\n {text}\n  pass").body
    assert isinstance(match, ast.Match)
    return match.cases[0]


def _expression(text: str) -> ast.expr:
    return ast.parse(f"({text}\n)", mode="eval").body


@dataclass
class _Expression(ast.NodeTransformer):
    old: ast.expr
    new: ast.expr
    times: int = 0

    def visit(self, node: ast.AST) -> ast.AST:
        if not _equal(node, self.old):
            return self.generic_visit(node)
        self.times += 1
        return _placed(self.new, node)


@dataclass
class _Statements(ast.NodeTransformer):
    """Statements that stand one after the other in a block."""

    old: list[ast.stmt]
    new: list[ast.stmt]
    times: int = 0

    def visit(self, node: ast.AST) -> ast.AST:
        self.generic_visit(node)  # first what is inside: `new` may have `old` in it
        for name in ("body", "orelse", "finalbody"):
            block = getattr(node, name, None)
            if isinstance(block, list):
                self._replace_in(block)
        return node

    def _replace_in(self, block: list[ast.stmt]) -> None:
        size = len(self.old)
        for at in reversed(range(len(block) - size + 1)):
            if all(map(_equal, block[at : at + size], self.old)):
                self.times += 1
                block[at : at + size] = [_placed(each, block[at]) for each in self.new]


@dataclass
class _Case(ast.NodeTransformer):
    """The pattern and the guard of a case; what it does stays."""

    old: ast.match_case
    new: ast.match_case
    times: int = 0

    def visit_match_case(self, case: ast.match_case) -> ast.AST:
        self.generic_visit(case)
        if _equal(case.pattern, self.old.pattern) and _equal(case.guard, self.old.guard):
            self.times += 1
            case.guard = self.new.guard and _placed(self.new.guard, case.pattern)
            case.pattern = _placed(self.new.pattern, case.pattern)
        return case


def _equal(one: ast.AST | None, other: ast.AST | None) -> bool:
    """Whether two trees are the same, wherever they stand."""
    if one is None or other is None:
        return one is other
    return type(one) is type(other) and _form(one) == _form(other)


def _form(node: ast.AST) -> str:
    return _CONTEXT.sub("", ast.dump(node))


def _placed(node: _Node, where: ast.AST) -> _Node:
    """A copy of a tree that stands at another place."""
    placed = copy.deepcopy(node)
    for each in ast.walk(placed):
        ast.copy_location(each, where)
    return placed


def unbound_names(module: ast.Module) -> set[str]:
    """The names that are read somewhere in a module, and bound nowhere in it."""
    read, bound = set[str](), {*dir(builtins), "__file__", "__name__", "__path__", "__doc__"}
    for node in ast.walk(module):
        match node:
            case ast.Name(id=name, ctx=ast.Load()):
                read.add(name)
            case ast.Name(id=name) | ast.arg(arg=name):
                bound.add(name)
            case (
                ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
                | ast.ClassDef(name=name)
            ):
                bound.add(name)
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                bound.add(name)
            case ast.ExceptHandler(name=str(name)) | ast.MatchMapping(rest=str(name)):
                bound.add(name)
            case ast.Import(names=imported) | ast.ImportFrom(names=imported):
                bound |= {(of.asname or of.name).partition(".")[0] for of in imported}
            case _:
                pass
    return read - bound
