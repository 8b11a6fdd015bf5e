"""The binding strengths of operators, for the parser and the printer."""

from __future__ import annotations

from koord.syntax.ast import BinaryOp, UnaryOp

#: The operator that each spelling means.
SPELLINGS = {
    **{operator.value: operator for operator in BinaryOp},
    "&&": BinaryOp.AND,
    "||": BinaryOp.OR,
    "≠": BinaryOp.NE,
    "≤": BinaryOp.LE,
    "≥": BinaryOp.GE,
}

IMPLIES = 1  #: groups to the right: ``a implies (b implies c)``
NOT = 4
COMPARISON = 5  #: does not chain
ADDITIVE = 6
NEG = 8
POSTFIX = 9  #: indices, fields, calls, literals and names

#: A larger number binds tighter.
BINDS: dict[BinaryOp | UnaryOp, int] = {
    BinaryOp.IMPLIES: IMPLIES,
    BinaryOp.OR: 2,
    BinaryOp.AND: 3,
    UnaryOp.NOT: NOT,
    BinaryOp.EQ: COMPARISON,
    BinaryOp.NE: COMPARISON,
    BinaryOp.LT: COMPARISON,
    BinaryOp.LE: COMPARISON,
    BinaryOp.GT: COMPARISON,
    BinaryOp.GE: COMPARISON,
    BinaryOp.ADD: ADDITIVE,
    BinaryOp.SUB: ADDITIVE,
    BinaryOp.MUL: 7,
    BinaryOp.DIV: 7,
    BinaryOp.MOD: 7,
    UnaryOp.NEG: NEG,
}
