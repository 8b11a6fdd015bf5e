"""The state of one running body: memory, control flow, and the path condition so far.

A machine runs one robot's turn (or evaluates one property). Its memory changes in place; what it
found out (faults, conditions of legality) is logged together with the condition of the path, the
``guard``, so that a domain that follows two branches at once loses nothing.

Expressions call functions, whose bodies are statements, and every rule about lists, places and
quantifiers evaluates operands. So a machine carries the rules of chapters 2 and 3: what stands
below them asks :meth:`Machine.value` and :meth:`Machine.run`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Fault, Written
from koord.semantics.domain import Domain
from koord.semantics.every_number import Crowd
from koord.semantics.locations import Mask
from koord.semantics.oracle import Oracle
from koord.semantics.storage import Storage, merge_storage, set_only_if
from koord.semantics.values import Value
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.faults import FaultKind
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT

V = TypeVar("V")


class Memory(Struct, Generic[V]):
    """The storage that statements change. ``after`` receives ports in the environment's turn."""

    locals: list[Storage[V]]
    ports: list[Storage[V]]
    allread: list[Storage[V]]
    allwrite: list[Storage[V]]
    after: list[Storage[V]]
    bound: list[Storage[V] | None]
    stop: V
    trystop: V
    broke: V
    returned: V
    result: Storage[V] | None = None

    def copied(self) -> Memory[V]:
        """Copy the memory, so that the copy changes independently."""
        return Memory(
            self.locals.copy(),
            self.ports.copy(),
            self.allread.copy(),
            self.allwrite.copy(),
            self.after.copy(),
            self.bound.copy(),
            self.stop,
            self.trystop,
            self.broke,
            self.returned,
            self.result,
        )

    def merged(self, d: Domain[V], condition: V, other: Memory[V]) -> Memory[V]:
        """Merge two memories: ``self`` where the condition holds, ``other`` elsewhere."""

        def storages(left: list[Storage[V]], right: list[Storage[V]]) -> list[Storage[V]]:
            pairs = zip(left, right, strict=True)
            return [merge_storage(d, condition, a, b) for a, b in pairs]

        def perhaps(a: Storage[V] | None, b: Storage[V] | None) -> Storage[V] | None:
            # What is there on one side only is set where that side was taken.
            if a is None:
                return b if b is None else set_only_if(d, b, d.unary(UnaryOp.NOT, condition))
            return set_only_if(d, a, condition) if b is None else merge_storage(d, condition, a, b)

        return Memory(
            storages(self.locals, other.locals),
            storages(self.ports, other.ports),
            storages(self.allread, other.allread),
            storages(self.allwrite, other.allwrite),
            storages(self.after, other.after),
            [perhaps(a, b) for a, b in zip(self.bound, other.bound, strict=True)],
            d.ite(condition, self.stop, other.stop),
            d.ite(condition, self.trystop, other.trystop),
            d.ite(condition, self.broke, other.broke),
            d.ite(condition, self.returned, other.returned),
            perhaps(self.result, other.result),
        )


class Legality(Struct, Generic[V], frozen=True):
    """A condition on recorded answers; a run that does not satisfy it breaks ``rule``."""

    rule: str
    condition: V
    what: str
    span: Span


class Machine(Struct, Generic[V]):
    """An evaluator at work: domain, system, robot, oracle, memory, and logs of faults.

    ``view`` is the configuration that a property is about (None in a robot's turn). ``evaluator``
    and ``runner`` are the rules of expressions and of statements (:func:`statements.machine`).
    """

    d: Domain[V]
    system: System
    robot: int | None
    oracle: Oracle[V]
    memory: Memory[V]
    guard: V
    evaluator: Callable[[Machine[V], core.Expr], Value[V]]
    runner: Callable[[Machine[V], core.Block], None]
    view: Configuration[V] | None = None
    in_environment: bool = False
    in_summary: bool = False
    trail: list[int] = field(default_factory=list)
    faults: list[tuple[V, Fault]] = field(default_factory=list)
    #: Whether a fault is certain: then nothing more is written to streams. [FAULT]
    faulted: bool = False
    legality: list[Legality[V]] = field(default_factory=list)
    entered: dict[int, V] = field(default_factory=dict)
    allread_masks: dict[int, Mask[V]] = field(default_factory=dict)
    allwrite_masks: dict[int, Mask[V]] = field(default_factory=dict)
    output: list[tuple[V, Written[V]]] = field(default_factory=list)

    # --- rules ----------------------------------------------------------------------------------

    def value(self, e: core.Expr) -> Value[V]:
        """Evaluate an expression, by the rules of chapter 2."""
        return self.evaluator(self, e)

    def run(self, block: core.Block) -> None:
        """Run statements, by the rules of chapter 3."""
        self.runner(self, block)

    # --- paths ----------------------------------------------------------------------------------

    def branch(self, condition: V, then: Callable[[], None], other: Callable[[], None]) -> None:
        """Run ``then`` where the condition holds and ``other`` elsewhere."""
        known = self.d.known(condition)
        if known is not None:
            (then if known else other)()
            return
        guard, start = self.guard, self.memory
        self.memory = start.copied()
        self.guard = self.both(guard, condition)
        then()
        after_then = self.memory
        self.memory = start
        self.guard = self.both(guard, self.negated(condition))
        other()
        self.guard = guard
        self.memory = after_then.merged(self.d, condition, self.memory)

    def within(self, condition: V, compute: Callable[[], Value[V]]) -> Value[V]:
        """Evaluate on the part of the path where a condition holds."""
        guard = self.guard
        self.guard = self.both(guard, condition)
        value = compute()
        self.guard = guard
        return value

    # --- logs -----------------------------------------------------------------------------------

    def fault_unless(self, legal: V, kind: FaultKind, span: Span, detail: str = "") -> None:
        """Log a fault where ``legal`` does not hold on this path. [FAULT]"""
        if self.d.known(legal) is True:
            return
        condition = self.both(self.guard, self.negated(legal))
        if self.d.known(condition) is not False:
            self.faults.append((condition, Fault(kind, self.robot, span, detail)))
            self.faulted = self.faulted or self.d.known(condition) is True

    def require(self, rule: str, condition: V, what: str, span: Span) -> None:
        """Log a condition on recorded answers on this path. Behind a fault nothing counts."""
        needed = self.d.binary(BinaryOp.IMPLIES, self.guard, condition)
        if self.d.known(needed) is True:
            return
        for fault, _ in self.faults:
            needed = self.either(fault, needed)
        if self.d.known(needed) is not True:
            self.legality.append(Legality(rule, needed, what, span))

    def apart(self) -> Machine[V]:
        """A machine in the same state with an empty log, which changes independently."""
        return replace(
            self,
            memory=self.memory.copied(),
            guard=self.truth(True),
            trail=self.trail.copy(),
            faults=[],
            legality=[],
            entered={},
            allread_masks={},
            allwrite_masks={},
            output=[],
        )

    # --- the robots -----------------------------------------------------------------------------

    def pid(self) -> V:
        """``pid`` of the robot that runs. [E-CONST]"""
        assert self.robot is not None
        crowd: Crowd[V] | None = self.system.crowd
        return self.d.const(self.robot, INT) if crowd is None else crowd.pid(self.robot)

    def count(self) -> V:
        """``numAgents``. [E-CONST]"""
        crowd: Crowd[V] | None = self.system.crowd
        return self.d.const(self.system.robots, INT) if crowd is None else crowd.count

    # --- Booleans -------------------------------------------------------------------------------

    def truth(self, value: bool) -> V:
        return self.d.const(value, BOOL)

    def both(self, left: V, right: V) -> V:
        return self.d.binary(BinaryOp.AND, left, right)

    def either(self, left: V, right: V) -> V:
        return self.d.binary(BinaryOp.OR, left, right)

    def negated(self, value: V) -> V:
        return self.d.unary(UnaryOp.NOT, value)
