"""Generated programs with large numbers: constants of up to 200 bits, params, and δ at extremes."""

from __future__ import annotations

from fractions import Fraction
from random import Random
from typing import Any

from msgspec.structs import replace

from koord.refinement.generating.palette import Profile
from koord.refinement.generating.programs import system
from koord.syntax import core
from koord.syntax.analysis.limits import excesses
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import FLOAT, INT
from tests.generators.profiles import FINITE
from tests.generators.wellformed import complaints

#: Where representations of numbers end: of bytes, doubles, machine words, vectors of literals.
SIZES = (8, 24, 31, 46, 47, 48, 52, 53, 60, 63, 64, 100, 200)

#: Rounds that take next to no time, and rounds that take for ever.
DELTAS = (Fraction(1, 2**200), Fraction(1, 10**9), Fraction(1, 3), Fraction(10**30), Fraction(7))

#: How often constants are made large before the program is left as it is.
ATTEMPTS = 6

_WHERE = frozenset({BinaryOp.ADD, BinaryOp.SUB, BinaryOp.MUL, BinaryOp.MIN, BinaryOp.MAX})
_ASKED = frozenset({BinaryOp.EQ, BinaryOp.NE, BinaryOp.LT, BinaryOp.LE})


def large(random: Random, profile: Profile = FINITE) -> System:
    """A random system in which some of the constants that are calculated with are large."""
    made = replace(system(random, profile), delta_s=random.choice(DELTAS))
    program = made.program
    for _ in range(ATTEMPTS):
        grown = replace(
            program,
            agents=tuple(_grown(agent, random) for agent in program.agents),
            functions=tuple(_grown(function, random) for function in program.functions),
            properties=tuple(_grown(stated, random) for stated in program.properties),
        )
        if grown != program and not complaints(grown) and not excesses(grown, made.kinds):
            return replace(made, program=grown)
    return made


def extreme(random: Random) -> int:
    """A number at which something may end."""
    return random.choice((1, -1)) * (1 << random.choice(SIZES)) + random.choice((-1, 0, 0, 1))


def _grown(node: Any, random: Random) -> Any:
    """The same with large numbers in sums, in comparisons, and where values are assigned."""
    changed = {
        name: _part(getattr(node, name), random)
        for name in node.__struct_fields__
        if name != "span"
    }
    grown = replace(node, **changed)
    match grown:
        case core.Binary(op=op, left=left, right=right) if op in _WHERE | _ASKED:
            # Comparisons get few: else next to nothing depends on what is compared.
            rate = 0.3 if op in _WHERE else 0.15
            return replace(
                grown, left=_enlarged(left, random, rate), right=_enlarged(right, random, rate)
            )
        case core.Assign(value=value):
            return replace(grown, value=_enlarged(value, random, 0.4))
        case _:
            return grown


def _part(part: Any, random: Random) -> Any:
    if isinstance(part, tuple):
        return tuple(_part(item, random) for item in part)
    return _grown(part, random) if isinstance(part, core.Node) else part


def _enlarged(expression: core.Expr, random: Random, rate: float) -> core.Expr:
    if not isinstance(expression, core.Const) or random.random() > rate:
        return expression
    if expression.type == INT:
        return replace(expression, value=extreme(random))
    if expression.type == FLOAT:
        return replace(expression, value=Fraction(extreme(random), random.choice((1, 2, 3, 2**60))))
    return expression
