"""Properties of configurations and rounds; lost updates. [PROP-INVARIANT] [LOST-UPDATE]

What statements read there is in :mod:`koord.semantics.places`; when they hold, in
:func:`koord.semantics.expressions.statement`.
"""

from __future__ import annotations

from typing import TypeVar

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Domain, conjunction, disjunction
from koord.semantics.expressions import statement
from koord.semantics.locations import Mask, written
from koord.semantics.machine import Legality
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.statements import machine
from koord.semantics.values import equal
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import BOOL

V = TypeVar("V")


def holds_in(
    d: Domain[V],
    system: System,
    configuration: Configuration[V],
    e: core.Expr,
    bound: int,
    inputs: Inputs[V],
) -> tuple[V, tuple[Legality[V], ...]]:
    """Return the condition that a closed statement holds in a configuration. [PROP-INVARIANT]

    The second component is what recorded answers of external functions in it must satisfy.
    """
    m = machine(d, system, inputs.oracle(Phase.CHECK, 0), bound=bound, view=configuration)
    return statement(m, e), tuple(m.legality)


def overlap(d: Domain[V], mine: Mask[V] | None, theirs: Mask[V] | None) -> V:
    """Return the condition that two robots wrote a common location of a variable. [LOST-UPDATE]"""
    if mine is None or theirs is None:
        return d.const(False, BOOL)
    met = [
        conjunction(d, [mine.whole, written(d, theirs)]),
        conjunction(d, [theirs.whole, written(d, mine)]),
    ]
    met += [overlap(d, a, b) for a, b in zip(mine.parts, theirs.parts, strict=False)]
    for index, part in mine.elements:
        for their_index, their_part in theirs.elements:
            same = d.binary(BinaryOp.EQ, index, their_index)
            met.append(conjunction(d, [same, overlap(d, part, their_part)]))
    for condition, key in mine.keys:
        for other, their_key in theirs.keys:
            met.append(conjunction(d, [condition, other, equal(d, key, their_key)]))
    return disjunction(d, met)
