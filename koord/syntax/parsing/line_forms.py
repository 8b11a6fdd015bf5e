"""Parsing of single lines: an LALR machine (table.py) that is fed with tokens."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from koord.syntax.content import content_fields
from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.nodes import Builder
from koord.syntax.parsing.operands import MisplacedError
from koord.syntax.parsing.table import Machine, RefusedError, table
from koord.syntax.parsing.tokens import Token
from koord.syntax.source import Placed

#: An expression may be a tree so deep: brackets, and operators in a row, both count. What works on
#: trees later may therefore call itself.
MAX_DEPTH = 200


class UnexpectedError(Exception):
    """Raised for a token that no form of line allows where it stands."""

    def __init__(self, position: int, expected: frozenset[str]) -> None:
        super().__init__(position, expected)
        self.position = position  #: of the token in the line; the line's length if it is too short
        self.expected = expected  #: names of terminals; ``$END`` for the end of the line


@cache
def _makers() -> tuple[Callable[[list[Any]], Any], ...]:
    """The method for each rule of the table."""
    builder = Builder()
    return tuple(getattr(builder, rule.method) for rule in table().rules)


def parse_line(form: LineKind, tokens: list[Token], *, quantified: bool) -> Any:
    """Parse the tokens of a line to a node. Raises UnexpectedError or MisplacedError.

    ``quantified`` tells whether there are quantifiers among them.
    """
    if quantified:
        _mark_types(tokens)
    machine = Machine(form.value, _makers())
    position = 0
    try:
        for token in tokens:
            machine.feed(token.type, token)
            position += 1
        node = machine.finish()
    except RefusedError:
        raise UnexpectedError(position, _possible(form, tokens[:position])) from None
    if len(tokens) > MAX_DEPTH and _depth(node) > MAX_DEPTH:
        raise MisplacedError(
            "K109",
            tokens[0].span.to(tokens[-1].span),
            f"this expression is more than {MAX_DEPTH} operators or brackets deep",
            "give pieces of it names of their own",
        )
    return node


def _possible(form: LineKind, tokens: list[Token]) -> frozenset[str]:
    """The terminals accepted after a prefix of a line.

    They are fed again: the token that was refused may have changed the state of the machine.
    """
    machine = Machine(form.value, _makers())
    for token in tokens:
        machine.feed(token.type, token)
    return frozenset(machine.possible())


def _mark_types(tokens: list[Token]) -> None:
    """Mark the names that begin a type behind ``forall`` and ``exists``."""
    depth = 0
    binding: list[int] = []  # depths of quantifiers whose colon is yet to come
    for position, token in enumerate(tokens):
        kind = token.type
        if kind == "FORALL" or kind == "EXISTS":
            binding.append(depth)
        elif kind == "LPAR" or kind == "LSQB" or kind == "LBRACE":
            depth += 1
        elif kind == "RPAR" or kind == "RSQB" or kind == "RBRACE":
            depth -= 1
        elif kind == "COLON":
            if binding and binding[-1] == depth:
                binding.pop()
            continue
        elif kind != "COMMA":
            continue
        if binding and binding[-1] == depth:
            end = type_end(tokens, position + 1)
            if end is not None and end < len(tokens) and tokens[end].type == "NAME":
                tokens[position + 1].type = "TYPENAME"


def type_end(tokens: list[Token], at: int, nesting: int = 0) -> int | None:
    """The index of the token behind the type that begins at ``at``; None if none does."""
    if at >= len(tokens) or tokens[at].type != "NAME" or nesting > 10:
        return None
    at += 1
    if at < len(tokens) and tokens[at].type == "LESS":
        separator = "COMMA"
        while separator == "COMMA":
            end = type_end(tokens, at + 1, nesting + 1)
            if end is None or end >= len(tokens):
                return None
            at, separator = end, tokens[end].type
        if separator != "GREATER":
            return None
        at += 1
    while at < len(tokens) and tokens[at].type == "LSQB":
        depth = 1
        while depth:
            at += 1
            if at >= len(tokens):
                return None
            depth += (tokens[at].type == "LSQB") - (tokens[at].type == "RSQB")
        at += 1
    return at


def _depth(node: Any) -> int:
    """The depth of a tree, computed without recursion."""
    deepest = 0
    waiting = [(node, 1)]
    while waiting:
        item, depth = waiting.pop()
        deepest = max(deepest, depth)
        if isinstance(item, tuple):
            waiting.extend((child, depth) for child in item)
        elif isinstance(item, Placed):
            waiting.extend((getattr(item, name), depth + 1) for name in content_fields(type(item)))
    return deepest
