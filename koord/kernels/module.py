"""The module that one system's machine code is written into, and what its functions share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec import Struct

from koord.kernels.assembling import Cells
from koord.kernels.context import Goals
from koord.kernels.layout import Layout
from koord.kernels.terms import Scalar
from koord.kernels.turn_code import FAULTS, POSSIBLE, TOO_LARGE, Course
from koord.kernels.turns import TurnTerms
from koord.machine.code import Code, Ir, word


class RoundModule(Struct, frozen=True):
    """A module of LLVM with the terms of all turns. ``environments`` are by robot, if it has one.

    ``statements`` are what the goals say, as terms. ``idle`` are cells that every environment's
    turn overwrites and none reads: what they hold at the end of the program turns is forgotten.
    """

    module: Any
    cells: Cells
    goals: Goals
    events: tuple[tuple[TurnTerms, ...], ...]
    environments: tuple[TurnTerms | None, ...]
    statements: tuple[Scalar, ...]
    course: Course
    idle: frozenset[int]

    @property
    def layout(self) -> Layout:
        return self.cells.layout

    @property
    def robots(self) -> range:
        """The robots, by number."""
        return range(len(self.layout.robots))

    @property
    def shared_words(self) -> int:
        """The words of the store's cells in a course."""
        return self.cells.shared_bytes // 8

    @property
    def has_environment(self) -> bool:
        """Return whether any robot's environment takes turns."""
        return any(e is not None for e in self.environments)


def either(code: Code, words: Sequence[Ir]) -> Ir:
    """All bits that any word has."""
    result = word(0)
    for part in words:
        result = code.b.or_(result, part)
    return result


def outcome(code: Code, flags: Ir, wanted: int) -> Ir:
    """Whether a turn is possible, and ``wanted`` (nothing, or a fault) is what becomes of it."""
    both = code.b.and_(flags, word(POSSIBLE | FAULTS))
    return code.b.icmp_signed("==", both, word(POSSIBLE | wanted))


def is_too_large(code: Code, flags: Ir) -> Ir:
    """Whether a turn makes an integer that does not fit into its cell."""
    return code.b.icmp_signed("!=", code.b.and_(flags, word(TOO_LARGE)), word(0))
