"""What has to be shown for claims to hold in every round: one obligation per step of a robot.

The argument that these are enough is T-PER-EVENT of ``specs/certificates/README.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from koord.recheck.claims import (
    NO_START,
    Claim,
    ClaimKind,
    Entailment,
    History,
    Obligation,
    sound,
    taken,
)
from koord.recheck.rounds import Rounds
from koord.recheck.steps import RoundObligations
from koord.recheck.storage import Cell, State, Storage, Storages
from koord.recheck.terms import Term
from koord.recheck.turns import Initialisation, Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance, Key
from koord.syntax import core
from koord.syntax.core import Home


class Obligations:
    """All obligations of some claims about a program."""

    def __init__(
        self,
        world: Instance,
        claims: Sequence[Claim],
        v: Values,
        consequences: Sequence[core.Property] = (),
        nothing_begins: bool = False,
    ) -> None:
        self.world = world
        self.claims = claims
        self.v = v
        self.consequences = consequences
        #: Whether no configuration is an initial one: this is known of each that is looked at.
        self.nothing_begins = nothing_begins
        self.turns = Turns(self.world, self.v)
        self.rounds = Rounds(self.turns)

    @property
    def s(self) -> Storages:
        return Storages(self.v)

    def __iter__(self) -> Iterator[Obligation]:
        opening = self.turns.opening()
        yield from self._initiation(opening)
        t = self.v.t
        sound = [t.negation(fault.when) for fault in opening.faults]
        for depth in sorted({claim.depth for claim in self.claims}):
            assumed = [claim for claim in self.claims if claim.depth <= depth]
            asked = [claim for claim in self.claims if claim.depth == depth]
            first = self._followed(History(opening.state, (*opening.facts, *sound)), assumed)
            past = first
            for number in range(1, depth):
                yield from self._round(past, assumed, asked, f"round {number}")
                past = self._extended(past, assumed, f"round {number}")
            past = self._followed(self._anything(first), assumed)
            for number in range(1, depth):
                past = self._extended(past, assumed, f"an earlier round {number}")
            yield from self._round(past, assumed, asked, "")

        for property_ in self.consequences:
            claim = Claim(property_.name, ClaimKind.STATEMENT, property_)
            yield Obligation(
                f"the invariant implies {claim.name}",
                (partial(self._implied, claim, tuple(self.claims)),),
            )

    def derivation(self, claim: Claim, others: Sequence[Claim]) -> Obligation:
        """That a claim follows from others, in whatever configuration."""
        name = f"{claim.name} follows from the other claims"
        return Obligation(name, (partial(self._implied, claim, tuple(others)),))

    def _implied(self, claim: Claim, others: Sequence[Claim]) -> Entailment:
        opening = self.turns.opening()
        past = self._anything(History(opening.state, opening.facts))
        at_round = claim.at_round
        facts = taken(self.rounds.goals(past.state, others, between_rounds=at_round))
        goals = self.rounds.goals(past.state, [claim], between_rounds=at_round)
        return Entailment((*past.facts, *facts), tuple(goals), tuple(self.rounds.parts(past.state)))

    # --- where rounds start ---------------------------------------------------------------------

    def _initiation(self, opening: Initialisation) -> Iterator[Obligation]:
        if any(claim.kind is ClaimKind.FAULT for claim in self.claims):
            yield Obligation("initiation: no fault", (partial(self._no_fault_at_start, opening),))
        yield Obligation("initiation", (partial(self._starts, opening),), NO_START)

    def _no_fault_at_start(self, opening: Initialisation) -> Entailment:
        goals = [sound(self.turns, fault) for fault in opening.faults]
        return Entailment(opening.facts, tuple(goals), tuple(self.rounds.parts(opening.state)))

    def _starts(self, opening: Initialisation) -> Entailment:
        sound = [self.v.t.negation(fault.when) for fault in opening.faults]
        goals = self.rounds.goals(opening.state, self.claims, between_rounds=True)
        shown = tuple(self.rounds.parts(opening.state))
        return Entailment((*opening.facts, *sound), tuple(goals), shown)

    def _anything(self, first: History) -> History:
        """Any configuration, but for what nobody ever writes: that is as INIT left it."""
        t, facts = self.v.t, []
        state = self.rounds.anything_like(first.state, self.world.written, "")
        for i, robot in enumerate(state.robots):
            if self.world.mentions(core.Ran):
                events = t.integer(len(self.world.agent(i).events))
                facts += [t.at_most(t.integer(-1), robot.ran), t.less(robot.ran, events)]
        kept = [
            storage
            for key, storage in self._variables(first.state)
            if key not in self.world.written
        ]
        if self.nothing_begins or any(_has_unknown(storage) for storage in kept):
            # What INIT and the assumptions say of them still holds.
            facts += first.facts
        return History(state, tuple(facts))

    def _variables(self, state: State) -> Iterator[tuple[Key, Storage]]:
        store = state.store
        for home, kept in ((Home.ALLREAD, store.allread), (Home.ALLWRITE, store.allwrite)):
            for slot, storage in enumerate(kept):
                yield (home, 0, slot), storage
        for i, robot in enumerate(state.robots):
            kind = self.world.kinds[i]
            for home, kept in ((Home.LOCAL, robot.locals), (Home.PORT, robot.ports)):
                for slot, storage in enumerate(kept):
                    yield (home, kind, slot), storage

    def _followed(self, past: History, assumed: Sequence[Claim]) -> History:
        """The same, with what is assumed at the start of a round."""
        goals = self.rounds.goals(past.state, assumed, between_rounds=True)
        return History(past.state, (*past.facts, *taken(goals)))

    def _extended(self, past: History, assumed: Sequence[Claim], label: str) -> History:
        """What a whole round leads to, in which everything that is assumed held."""
        prefix, end, facts = self.rounds.ended(past, assumed, label)
        evolution = self.turns.environment(end)
        t = self.v.t
        sound = [t.negation(fault.when) for fault in evolution.faults]
        known = (*past.facts, *prefix.facts, *facts, *evolution.facts, *sound)
        return self._followed(History(evolution.state, known), assumed)

    # --- one round ------------------------------------------------------------------------------

    def _round(
        self, past: History, assumed: Sequence[Claim], asked: Sequence[Claim], label: str
    ) -> Iterator[Obligation]:
        """Everything that one more step of a round may break."""
        round_ = RoundObligations(self.rounds, past, assumed, asked, label)
        for i in range(len(self.world.kinds)):
            for position in range(len(self.world.agent(i).events)):
                yield from round_.event(i, position)
        yield from round_.quiet()
        yield from round_.updates()
        yield from round_.environment()


def _has_unknown(storage: Storage) -> bool:
    """Whether anything below is not a constant."""
    if not isinstance(storage, Cell):
        assert isinstance(storage, tuple)
        return any(_has_unknown(below) for below in storage)
    if storage.is_set.value is None:
        return True
    pending = [storage.value]
    while pending:
        value = pending.pop()
        if isinstance(value, tuple):
            pending += value
        elif not isinstance(value, Term) or value.value is None:
            return bool(storage.is_set.value)
    return False
