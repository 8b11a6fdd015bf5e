"""Monitors: find the first property that a run breaks, and the step. [PROP-INVARIANT]

A property is looked at part by part: conjuncts, and instances of quantifiers over robots. A step
leaves most of a configuration alone, and a part that reads what it read when it last held holds
still; so of a thousand parts a step has a few looked at. First by code (:mod:`compiled`), which
says that a property holds or nothing; then by the rules.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from msgspec import Struct, field

from koord.sampling.compiled.claims import Claim
from koord.sampling.compiled.columns import Columns
from koord.sampling.compiled.round_claims import Claims
from koord.sampling.conjuncts import Conjunct, Place, changed, conjuncts_of
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant, Domain
from koord.semantics.expressions import statement
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Step
from koord.semantics.rounds import IllegalStepError
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.core import PropertyKind
from koord.syntax.system import System
from koord.traces.trace import Trace, Violation, ViolationKind

if TYPE_CHECKING:
    from koord.traces.replay import Question


class _Watched(Struct):
    """A property as conjuncts. ``stale`` are those not known to hold; all others still hold."""

    parts: list[Conjunct]
    stale: set[int]
    readers: dict[Place, list[int]]

    @classmethod
    def of(cls, system: System, stated: core.Property) -> _Watched:
        parts = conjuncts_of(system, stated.condition)
        readers: dict[Place, list[int]] = {}
        for number, part in enumerate(parts):
            for place in part.places:
                readers.setdefault(place, []).append(number)
        return cls(parts, set(range(len(parts))), readers)


class Monitor(Struct):
    """A monitor of the properties in a run's observed configurations.

    Properties that ask what nobody answers are from then on ``unjudged``; where that is None,
    looking at one raises IllegalStepError.
    """

    d: Domain[Constant]
    system: System
    inputs: Inputs[Constant]
    unjudged: dict[str, None] | None = None
    _watched: dict[str, _Watched] = field(default_factory=dict)
    _claims: dict[str, Claim] = field(default_factory=dict)
    _columns: Columns | None = None
    _seen: Configuration[Constant] | None = None

    @property
    def claims(self) -> Claims | None:
        """What it looks at, where code may do so instead as long as all of it holds."""
        if type(self) is not Monitor or self.unjudged is not None:
            return None
        stated = self.system.program.properties
        return Claims(
            tuple(p.condition for p in stated if p.kind is PropertyKind.INVARIANT),
            tuple(p.condition for p in stated if p.kind is PropertyKind.AT_ROUND),
        )

    def after(self, step: Step) -> Violation | None:
        """The first contract or property that does not hold after the step, or None.

        [PROP-INVARIANT] [PROP-ROUND] [PROP-CONTRACT]
        """
        if step.configuration.fault is not None:
            return None
        for robot, contract in step.stepped.promises:
            return Violation(ViolationKind.CONTRACT, contract.name, step.round, robot)
        between_rounds = step.is_at_round
        for stated in self.system.program.properties:
            at_round = stated.kind is PropertyKind.AT_ROUND
            if stated.kind is not PropertyKind.INVARIANT and not (at_round and between_rounds):
                continue
            if self.unjudged and stated.name in self.unjudged:
                continue
            try:
                holds = self.holds(stated, step.configuration)
            except IllegalStepError:
                if self.unjudged is None:
                    raise
                self.unjudged[stated.name] = None
                continue
            if not holds:
                return Violation(ViolationKind.PROPERTY, stated.name, step.round, step.robot)
        return None

    def holds(self, stated: core.Property, configuration: Configuration[Constant]) -> bool:
        """Return whether a property holds in a configuration."""
        columns = self._look_at(configuration)
        claim = self._claims.get(stated.name)
        if claim is None:
            claim = self._claims[stated.name] = Claim(columns, stated.condition)
        if claim.holds():
            return True
        return self._holds_by_the_rules(stated, configuration)

    def _holds_by_the_rules(
        self, stated: core.Property, configuration: Configuration[Constant]
    ) -> bool:
        watched = self._watched.get(stated.name)
        if watched is None:
            watched = self._watched[stated.name] = _Watched.of(self.system, stated)
        for number in sorted(watched.stale):
            if not self._part_holds(watched.parts[number], stated.bound, configuration):
                break
            watched.stale.discard(number)
        else:
            return True
        # The property as a whole has the word, and asks its questions under its own keys.
        holds, _ = holds_in(
            self.d, self.system, configuration, stated.condition, stated.bound, self.inputs
        )
        return holds is True

    def _look_at(self, configuration: Configuration[Constant]) -> Columns:
        """Mark what reads a place that has changed as stale."""
        before, self._seen = self._seen, configuration
        if self._columns is None:
            self._columns = Columns(self.d, self.system)
        if before is configuration:
            return self._columns
        places = [] if before is None else list(changed(before, configuration))
        self._columns.show(configuration, places)
        for watched in self._watched.values():
            for place in places:
                watched.stale.update(watched.readers.get(place, ()))
        return self._columns

    def _part_holds(
        self, part: Conjunct, bound: int, configuration: Configuration[Constant]
    ) -> bool:
        oracle = self.inputs.oracle(Phase.CHECK, 0)
        m = machine(self.d, self.system, oracle, bound=bound, view=configuration)
        m.trail.extend(part.trail)
        for slot, robot in part.robots.items():
            m.memory.bound[slot] = held(self.d, robot)
        return statement(m, part.condition) is True


class Search(Monitor):
    """A monitor that breaks off no run: it looks between rounds whether ``sought`` all hold."""

    sought: tuple[core.Property, ...] = ()

    @property
    def claims(self) -> Claims:
        return Claims(sought=tuple(stated.condition for stated in self.sought))

    def after(self, step: Step) -> None:
        return None


class Watch(Struct):
    """A watch over a recorded run: the first claim that it breaks. [PROP-INVARIANT]"""

    monitor: Monitor
    violation: Violation | None = None

    @staticmethod
    def of(trace: Trace, chosen: Collection[Question] = ()) -> Watch:
        """Watch the run of a trace, of which the answers of functions are known.

        Those to ``chosen`` questions are not: nobody gave them.
        """
        from koord.traces.replay import PropertyInputs, answered  # seldom needed

        known = {asked: value for asked, value in answered(trace).items() if asked not in chosen}
        inputs = PropertyInputs((), known)
        return Watch(Monitor(trace.numbers.domain, trace.system, inputs, unjudged={}))

    @property
    def unjudged(self) -> tuple[str, ...]:
        """The properties that ask what nobody answered."""
        return tuple(self.monitor.unjudged or ())

    def see(self, step: Step) -> None:
        """See the next step of the run."""
        if self.violation is None:
            self.violation = self.monitor.after(step)
