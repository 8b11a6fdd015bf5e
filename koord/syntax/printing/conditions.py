"""Layout of long conditions: lines broken before `and`, `or` and `implies`.

What belongs to a condition stands deeper than its first row, so that it reads back as one.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import ast
from koord.syntax.operators import BINDS, IMPLIES, NOT
from koord.syntax.printing.expressions import print_binders, print_within
from koord.syntax.source import Span

#: So long may a line with a condition be, if there is a place to break it.
WIDTH = 100

_STEP = 4
_LOGICAL = frozenset([ast.BinaryOp.AND, ast.BinaryOp.OR, ast.BinaryOp.IMPLIES])


class Row(Struct, frozen=True):
    """A line of a condition, with the places in the text where it began and ended."""

    text: str
    first: Span
    last: Span


class _Slot(Struct, frozen=True):
    """The surroundings of an expression: text before and behind it on its row, and precedence."""

    indent: int = 0
    before: str = ""
    behind: str = ""
    binds: int = 0
    last: bool = True

    def inside(self, word: str, *, parentheses: bool) -> _Slot:
        """The surroundings of an operand behind a word, and within parentheses if needed."""
        if not parentheses:
            return replace(self, before=self.before + word, binds=0)
        return _Slot(self.indent, f"{self.before}({word}", f"){self.behind}")


def rows(condition: ast.Expr, room: int, before: str = "") -> list[Row]:
    """Lay a condition out in rows of ``room`` columns, the first behind ``before``."""
    return list(_rows(condition, _Slot(before=before), room))


def conjuncts(condition: ast.Expr) -> list[ast.Expr]:
    """The operands of ``and`` at the top of a condition."""
    found = []
    while isinstance(condition, ast.Binary) and condition.op is ast.BinaryOp.AND:
        found.append(condition.right)
        condition = condition.left
    return [condition, *reversed(found)]


def _rows(e: ast.Expr, slot: _Slot, room: int) -> Iterator[Row]:
    flat = f"{slot.before}{print_within(e, slot.binds, last=slot.last)}{slot.behind}"
    if slot.indent + len(flat) > room:
        match e:
            case ast.Binary(op=op) if op in _LOGICAL:
                yield from _chain(e, slot, room)
                return
            case ast.Quantified(quantifier=quantifier, binders=binders, body=body):
                head = print_binders(quantifier, binders)
                inner = slot.inside(head, parentheses=not slot.last or slot.binds > NOT)
                yield from _begun(e, _rows(body, inner, room))
                return
            case ast.Unary(op=ast.UnaryOp.NOT, operand=operand):
                inner = slot.inside("not ", parentheses=slot.binds > NOT)
                yield from _begun(e, _rows(operand, replace(inner, binds=NOT), room))
                return
            case _:
                pass
    yield Row(" " * slot.indent + flat, e.span, e.span)


def _begun(e: ast.Expr, inner: Iterator[Row]) -> Iterator[Row]:
    """The rows of what is inside of an expression; the first begins where that does."""
    yield replace(next(inner), first=e.span)
    yield from inner


def _chain(e: ast.Binary, slot: _Slot, room: int) -> Iterator[Row]:
    """The operands of one operator, the further ones behind it and further in."""
    outer = slot.inside("", parentheses=BINDS[e.op] < slot.binds)
    own = BINDS[e.op]
    operands = _implied(e) if own == IMPLIES else _joined(e)
    word = f"{e.op.value} "
    row: Row | None = None  # what there is room behind, perhaps
    for number, operand in enumerate(operands):
        final = number == len(operands) - 1
        loose = final if own == IMPLIES else number == 0  # may be a chain of the same operator
        inner = _Slot(
            slot.indent + (_STEP if number else 0),
            word if number else outer.before,
            outer.behind if final else "",
            own if loose else own + 1,
            outer.last and final,
        )
        found = _rows(operand, inner, room - (0 if number else _STEP))
        added = list(found if number else _further_in(found))
        if row is not None and len(added) == 1 and own != IMPLIES:
            text = f"{row.text} {added[0].text.lstrip()}"
            if len(text) <= room:
                row = Row(text, row.first, added[0].last)
                continue
        if row is not None:
            yield row
        *whole, row = added
        yield from whole
    assert row is not None
    yield row


def _further_in(found: Iterator[Row]) -> Iterator[Row]:
    """The rows with all but the first further in than the operators of the chain."""
    yield next(found)
    for row in found:
        yield replace(row, text=" " * _STEP + row.text)


def _implied(e: ast.Binary) -> list[ast.Expr]:
    found = []
    node: ast.Expr = e
    while isinstance(node, ast.Binary) and node.op is ast.BinaryOp.IMPLIES:
        found.append(node.left)
        node = node.right
    return [*found, node]


def _joined(e: ast.Binary) -> list[ast.Expr]:
    found = []
    node: ast.Expr = e
    while isinstance(node, ast.Binary) and node.op is e.op:
        found.append(node.right)
        node = node.left
    return [node, *reversed(found)]
