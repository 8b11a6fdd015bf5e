"""Machine code of one robot's turns and of statements. [T-SNAPSHOT]

``event_I_E(state, choice, out)`` runs event E of robot I on a state, with the choices that a number
below their combinations stands for. It puts a :class:`Course` into ``out`` and gives flags. The
environment's turn of robot I, ``environment_I``, gives flags and puts a whole state into ``out``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec import Struct

from koord.kernels.assembling import Cells, Evaluation
from koord.kernels.dependence import Dependence
from koord.kernels.terms import Scalar
from koord.kernels.turns import TurnTerms
from koord.machine.code import BYTES, I1, I64, Code, Ir, word

#: The turn is possible: the event may be selected and the answers are legal.
POSSIBLE = 1
FAULTS = 2
#: An integer does not fit into its cell: there is no machine code for this program.
TOO_LARGE = 4

#: Behind so many flags stands how far it is to the next combination.
FLAGS = 3


class Course(Struct, frozen=True):
    """Where the parts of one robot's move stand, in bytes.

    ``entered`` are lock classes, a bit each; ``own`` the robot's cells after the turn; ``values``,
    ``mask`` and ``updates`` have the store's cells, those of the two last ones all bits or none.
    """

    own: int
    values: int
    mask: int
    updates: int
    size: int
    entered: int = 0


def course(cells: Cells, own_cells: int) -> Course:
    """The parts of the moves of robots with at most so many cells."""
    own, shared = cells.whole(own_cells), cells.shared_bytes
    return Course(8, 8 + own, 8 + own + shared, 8 + own + 2 * shared, 8 + own + 3 * shared)


def _weights(counts: Sequence[int]) -> list[int]:
    """What one more of each choice adds to the number of a combination."""
    weights, weight = [], 1
    for count in reversed(counts):
        weights.append(weight)
        weight *= count
    return weights[::-1]


def choices_of(code: Code, counts: Sequence[int], chosen: Ir) -> list[Ir]:
    """The number of the option of each choice, from that of the combination."""
    b = code.b
    return [
        b.urem(b.udiv(chosen, word(weight)), word(count))
        for weight, count in zip(_weights(counts), counts, strict=True)
    ]


def to_next(code: Code, turn: TurnTerms, hangs: Ir | None) -> Ir:
    """How far it is to the next combination in which a choice that matters is another one.

    Behind the last choice that matters all choices are the first: those with others come to the
    same. So one more of that choice is next, which may change those before it. ``hangs`` has the
    choices that matter, by :class:`~koord.kernels.dependence.Dependence`; None: there is none.
    """
    b, far = code.b, word(turn.combinations)
    if hangs is not None:
        for number, weight in enumerate(_weights(turn.counts)):
            bit = b.and_(hangs, word(1 << number))
            far = b.select(b.icmp_signed("!=", bit, word(0)), word(weight), far)
    return b.shl(far, word(FLAGS))


def event_code(module: Any, name: str, turn: TurnTerms, robot: int, cells: Cells, of: Course) -> Ir:
    """The function of one event of one robot."""
    code = Code(module, name, (BYTES, I64, BYTES), I64)
    state, chosen, out = code.arguments
    b, layout = code.b, cells.layout
    terms = Evaluation(code, cells, state, choices_of(code, turn.counts, chosen))
    dependence = Dependence(terms)
    possible = dependence.of(turn.possible)
    with b.if_then(b.not_(terms.value(turn.possible))):
        b.ret(to_next(code, turn, possible))
    too_large = terms.value(False)
    entered = word(0)
    for lock, condition in turn.entered:
        entered = b.or_(entered, b.select(terms.value(condition), word(1 << lock), word(0)))
    code.put(out, of.entered, entered)
    own = layout.robots[robot]
    code.copy(
        code.at(out, of.own),
        code.at(state, own.first * cells.size),
        (own.end - own.first) * cells.size,
    )
    for cell, scalar in turn.after:
        too_large = _noted(terms, scalar, True, too_large)
        offset = of.own + (cell - own.first) * cells.size
        code.put(out, offset, cells.narrow(code, terms.value(scalar)))
    for k in range(cells.shared_bytes // 8):
        for part in (of.values, of.mask, of.updates):
            code.put(out, part + 8 * k, word(0))
    for write in turn.writes:
        too_large = _noted(terms, write.value, write.condition, too_large)
        offset = (write.cell - layout.shared_first) * cells.size
        mask = b.sext(terms.value(write.condition), cells.type)
        value = cells.narrow(code, terms.value(write.value))
        code.put(out, of.values + offset, b.and_(value, mask))
        code.put(out, of.mask + offset, mask)
        if write.cell in turn.updates:
            code.put(out, of.updates + offset, mask)
    comes_to = [dependence.of(condition) for _, condition in turn.entered]
    comes_to += [dependence.of(scalar) for _, scalar in turn.after]
    comes_to += [dependence.where(write.condition, write.value) for write in turn.writes]
    hangs = dependence.either(possible, dependence.of(turn.faults), *comes_to)
    b.ret(b.or_(_flags(code, terms, turn, too_large), to_next(code, turn, hangs)))
    return code.function


def environment_code(module: Any, name: str, turn: TurnTerms, cells: Cells) -> Ir:
    """The function of the environment's turn of one robot; ``out`` has the state before it."""
    code = Code(module, name, (BYTES, I64, BYTES), I64)
    state, chosen, out = code.arguments
    terms = Evaluation(code, cells, state, choices_of(code, turn.counts, chosen))
    too_large = terms.value(False)
    for cell, scalar in turn.after:
        too_large = _noted(terms, scalar, True, too_large)
        code.put(out, cell * cells.size, cells.narrow(code, terms.value(scalar)))
    code.b.ret(_flags(code, terms, turn, too_large))
    return code.function


def statement_code(module: Any, name: str, holds: Scalar, cells: Cells) -> Ir:
    """The function that says whether a statement holds in a state."""
    code = Code(module, name, (BYTES,), I1)
    code.b.ret(Evaluation(code, cells, code.arguments[0], ()).value(holds))
    return code.function


def _noted(terms: Evaluation, scalar: Scalar, condition: Scalar, before: Ir) -> Ir:
    """Whether a value that is kept on a condition, or one before, is too large for its cell."""
    if isinstance(scalar, bool) or not terms.cells.may_not_fit(scalar):
        return before
    b = terms.code.b
    fits = terms.cells.fits(terms.code, terms.value(scalar))
    return b.or_(before, b.and_(terms.value(condition), b.not_(fits)))


def _flags(code: Code, terms: Evaluation, turn: TurnTerms, too_large: Ir) -> Ir:
    b = code.b
    possible = b.zext(terms.value(turn.possible), I64)
    faults = b.select(terms.value(turn.faults), word(FAULTS), word(0))
    large = b.select(too_large, word(TOO_LARGE), word(0))
    return b.or_(b.or_(possible, faults), large)
