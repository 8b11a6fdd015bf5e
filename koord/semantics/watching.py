"""Watching a run: which property is the first to break, and after which step. [PROP-INVARIANT]"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import is_

from koord.semantics.configurations import Configuration, System
from koord.semantics.domain import Constant, Domain
from koord.semantics.expressions import slot_in
from koord.semantics.occurrences import nodes, variables
from koord.semantics.oracle import Inputs
from koord.semantics.recording import Step
from koord.semantics.trace import Violation, ViolationKind
from koord.semantics.turns import holds_in
from koord.syntax import core
from koord.syntax.core import Home, PropertyKind


@dataclass
class Watch:
    """Looks at the observed configurations of a run, at each property only if it may have changed.

    A configuration shares with its predecessor whatever the step left alone, so a property that
    reads the same objects as when it last held still holds.
    """

    d: Domain[Constant]
    system: System
    inputs: Inputs[Constant]
    _reads: dict[str, _Reads] = field(default_factory=dict)
    _held: dict[str, list[object]] = field(default_factory=dict)

    def after(self, step: Step) -> Violation | None:
        """What the step broke: the first contract or property that does not hold.

        [PROP-INVARIANT] [PROP-ROUND] [PROP-CONTRACT]
        """
        if step.configuration.fault is not None:
            return None
        for robot, contract in step.stepped.promises:
            return Violation(ViolationKind.CONTRACT, contract.name, step.round, robot)
        between_rounds = step.rule in ("INIT", "ENV-TRANS")
        for stated in self.system.program.properties:
            at_round = stated.kind is PropertyKind.AT_ROUND
            if stated.kind is not PropertyKind.INVARIANT and not (at_round and between_rounds):
                continue
            if not self.holds(stated, step.configuration):
                return Violation(ViolationKind.PROPERTY, stated.name, step.round, step.robot)
        return None

    def holds(self, stated: core.Property, configuration: Configuration[Constant]) -> bool:
        """Whether a property holds in a configuration."""
        reads = self._reads.get(stated.name)
        if reads is None or reads.stated is not stated:
            reads = self._reads[stated.name] = _reads(self.system, stated)
        seen = list(reads.of(configuration))
        before = self._held.get(stated.name)
        if before is not None and len(before) == len(seen) and all(map(is_, before, seen)):
            return True
        holds, _ = holds_in(
            self.d, self.system, configuration, stated.condition, stated.bound, self.inputs
        )
        if holds is not True:
            return False
        self._held[stated.name] = seen
        return True


@dataclass(frozen=True, slots=True)
class _Reads:
    """What a property reads: slots of the store, of each robot, and whether more than variables."""

    stated: core.Property
    allread: tuple[int, ...]
    allwrite: tuple[int, ...]
    locals: tuple[tuple[int, int], ...]  #: robot, slot
    ports: tuple[tuple[int, int], ...]
    turns: bool

    def of(self, configuration: Configuration[Constant]) -> Iterator[object]:
        store, robots = configuration.store, configuration.robots
        for slot in self.allread:
            yield store.allread[slot]
        for slot in self.allwrite:
            yield store.allwrite[slot]
        for robot, slot in self.locals:
            yield robots[robot].locals[slot]
        for robot, slot in self.ports:
            yield robots[robot].ports[slot]
        if self.turns:
            yield from robots


def _reads(system: System, stated: core.Property) -> _Reads:
    read = variables(stated.condition)
    per_robot = [
        (robot, slot, variable.home)
        for variable in read
        if variable.home in (Home.LOCAL, Home.PORT)
        for robot in range(system.robots)
        if (slot := slot_in(system.agent(robot), variable)) is not None
    ]
    return _Reads(
        stated,
        tuple(v.slot for v in read if v.home is Home.ALLREAD),
        tuple(v.slot for v in read if v.home is Home.ALLWRITE),
        tuple((robot, slot) for robot, slot, home in per_robot if home is Home.LOCAL),
        tuple((robot, slot) for robot, slot, home in per_robot if home is Home.PORT),
        any(isinstance(node, core.Ran | core.Stopped) for node in nodes(stated.condition)),
    )
