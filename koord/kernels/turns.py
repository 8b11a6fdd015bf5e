"""Turns of one robot on a snapshot, as terms. [T-SNAPSHOT]

A kernel is a function of the cells of a state and of the choices that its caller makes: whether the
turn is possible, whether it faults, which lock classes it enters, what its robot's cells hold after
it, and which cells of the store it writes. It is what the rules of :mod:`koord.semantics` say of
the turn, run on terms.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.kernels.choices import ChoiceInputs
from koord.kernels.layout import Layout
from koord.kernels.terms import NoKernelError, Scalar, TermDomain
from koord.semantics.configurations import Configuration
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.environment import environment_turn
from koord.semantics.oracle import Inputs, NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.turns import program_turn
from koord.syntax import core
from koord.syntax.types import EnumType

#: A turn with more combinations of choices is left to Python.
_MOST_COMBINATIONS = 65_536


class Write(Struct, frozen=True):
    """A cell of the store with the condition that the turn writes it, and what it writes."""

    cell: int
    condition: Scalar
    value: Scalar


class TurnTerms(Struct, frozen=True):
    """A turn of one robot. ``after`` are the cells of the robot that the turn may change.

    ``counts`` are the numbers of options of its choices. ``entered`` has a bit for each lock class.
    """

    counts: tuple[int, ...]
    possible: Scalar
    faults: Scalar
    entered: tuple[tuple[int, Scalar], ...]
    after: tuple[tuple[int, Scalar], ...]
    writes: tuple[Write, ...]
    updates: frozenset[int] = frozenset()  #: cells that it computes from their old values

    @property
    def combinations(self) -> int:
        """So many ways there are to choose."""
        product = 1
        for count in self.counts:
            product *= count
        return product


class TurnMaker:
    """A maker of the turns of one system, on cells that hold integers of ``bits`` bits."""

    def __init__(self, layout: Layout, bits: int) -> None:
        self.layout = layout
        self.domain = TermDomain()
        self._bounds = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        self.before: Configuration[Scalar] = layout.configuration(self._cell, True, int)

    def _cell(self, number: int) -> Scalar:
        cell = self.layout.cells[number]
        if cell.is_bool:
            return self.domain.cell(number, None)
        if isinstance(cell.type, EnumType):
            return self.domain.cell(number, (0, len(cell.type.members) - 1))
        return self.domain.cell(number, self._bounds)

    def event(self, robot: int, position: int, updates: frozenset[int]) -> TurnTerms:
        """One event of one robot. [EVENT-TRANS]"""
        d, layout, system = self.domain, self.layout, self.layout.system
        inputs = ChoiceInputs(d, system)
        before = self.before.robots[robot]
        selectable, turned = program_turn(d, system, robot, before, position, inputs)
        legal = [needed.condition for needed in turned.legality]
        writes, updated = [], []
        for slot, mask in sorted(turned.allwrite.items()):
            storage = turned.robot.copy.allwrite[slot]
            values = dict(layout.of_shared(slot, storage))
            for cell, conditions in layout.written(slot, storage, mask):
                condition = disjunction(d, conditions)
                if condition is not False:
                    writes.append(Write(cell, condition, values[cell]))
                    if slot in updates:
                        updated.append(cell)
        return TurnTerms(
            _few(inputs.counts),
            conjunction(d, [selectable, *legal]),
            disjunction(d, [condition for condition, _ in turned.faults]),
            tuple(turned.entered.items()),
            self._changed(layout.of_robot(robot, turned.robot)),
            tuple(writes),
            frozenset(updated),
        )

    def environment(self, robot: int) -> TurnTerms:
        """The environment's turn of one robot. [ENV-TRANS]"""
        d, layout, system = self.domain, self.layout, self.layout.system
        inputs = ChoiceInputs(d, system)
        evolved = environment_turn(d, system, robot, self.before.robots[robot], inputs)
        legal = [needed.condition for needed in evolved.legality]
        return TurnTerms(
            _few(inputs.counts),
            conjunction(d, legal),
            disjunction(d, [condition for condition, _ in evolved.faults]),
            (),
            self._changed(layout.of_ports(robot, evolved.ports)),
            (),
        )

    def statement(self, condition: core.Expr, bound: int) -> Scalar:
        """The condition that a closed statement holds in the state. [PROP-INVARIANT]"""
        inputs: Inputs[Scalar] = NoInputs()
        holds, legal = holds_in(
            self.domain, self.layout.system, self.before, condition, bound, inputs
        )
        return conjunction(self.domain, [holds, *(x.condition for x in legal)])

    def _changed(self, cells: Iterator[tuple[int, Scalar]]) -> tuple[tuple[int, Scalar], ...]:
        return tuple((cell, value) for cell, value in cells if value is not self._cell(cell))


def _few(counts: list[int]) -> tuple[int, ...]:
    product = 1
    for count in counts:
        product *= count
    if product > _MOST_COMBINATIONS:
        raise NoKernelError(f"a turn leaves {product} combinations open")
    return tuple(counts)
