"""Obligations for claims about a fixed number of robots, one per robot's step, and their check.

The argument that these are enough is T-PER-EVENT of ``specs/certificates/README.md``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from msgspec import Struct, field
from msgspec.structs import replace

from koord.recheck.claims import (
    NO_START,
    Claim,
    ClaimKind,
    Entailment,
    Goal,
    History,
    Obligation,
    ShownTerm,
    as_facts,
    sound,
)
from koord.recheck.rounds import Rounds
from koord.recheck.script import Script
from koord.recheck.solving import SolverAnswer, SolverEndedError, SolverSession
from koord.recheck.steps import RoundObligations
from koord.recheck.storage import Cell, State, Storage, Storages
from koord.recheck.terms import Term, Terms
from koord.recheck.turns import Initialisation, Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance, Key
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import EnumType


class Obligations:
    """All obligations of claims about a program."""

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
        """The entailment of a claim by others, in any configuration."""
        name = f"{claim.name} follows from the other claims"
        return Obligation(name, (partial(self._implied, claim, tuple(others)),))

    def _implied(self, claim: Claim, others: Sequence[Claim]) -> Entailment:
        opening = self.turns.opening()
        past = self._anything(History(opening.state, opening.facts))
        at_round = claim.at_round
        facts = as_facts(self.rounds.goals(past.state, others, between_rounds=at_round))
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
        """An arbitrary configuration, with variables that are never written as INIT left them."""
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
        """The history, with the claims assumed at the start of a round."""
        goals = self.rounds.goals(past.state, assumed, between_rounds=True)
        return History(past.state, (*past.facts, *as_facts(goals)))

    def _extended(self, past: History, assumed: Sequence[Claim], label: str) -> History:
        """The history extended by a whole round in which all assumptions held."""
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
        """Yield the obligations of one more step of a round."""
        round_ = RoundObligations(self.rounds, past, assumed, asked, label)
        for i in range(len(self.world.kinds)):
            for position in range(len(self.world.agent(i).events)):
                yield from round_.event(i, position)
        yield from round_.quiet()
        yield from round_.updates()
        yield from round_.environment()


def _has_unknown(storage: Storage) -> bool:
    """Return whether anything below is not a constant."""
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


#: What an attempt that knows less may take.
QUICK_S = 1.0

#: After so many in vain, and no more successes, quick attempts are not worth it.
_MOST_QUICK_FAILS = 2


class Discharged(Struct, frozen=True):
    """The result of an obligation: ``claim`` is the goal that does not follow, or may not.

    ``state`` is the solver's counterexample, in the words of the program.
    """

    name: str
    answer: SolverAnswer
    claim: str = ""
    state: tuple[str, ...] = ()
    #: What it means that nothing satisfies the hypotheses; empty if something may.
    hollow: str = ""


class Settling(Struct):
    """The check of obligations in one solver session."""

    values: Values
    session: SolverSession
    deadline: Callable[[], float]  #: how many seconds the next question may take
    progress: Callable[[str], None] = lambda text: None
    _script: Script = field(default_factory=Script)
    _declared: int = 0
    _quick_fails: int = 0

    def weighed(self, one: Discharged, obligation: Obligation) -> Discharged:
        """The result, with a note if the hypotheses are soon found unsatisfiable."""
        if not obligation.hollow or one.answer is not SolverAnswer.UNSAT:
            return one
        with self.pushed([*self.values.ranges, *obligation.attempts[0]().hypotheses]):
            is_hollow = self._check(quick=True) is SolverAnswer.UNSAT
        return replace(one, hollow=obligation.hollow) if is_hollow else one

    def settled(self, obligation: Obligation) -> Discharged:
        *quick, exact = obligation.attempts
        for attempt in quick:
            if self._quick_fails > _MOST_QUICK_FAILS:
                break  # this program needs to know more
            if self._tried(obligation.name, attempt(), (), quick=True).answer is SolverAnswer.UNSAT:
                self._quick_fails = max(0, self._quick_fails - 1)
                return Discharged(obligation.name, SolverAnswer.UNSAT)
            self._quick_fails += 1
        return self.exactly(obligation.name, exact())

    def exactly(self, name: str, attempt: Entailment, without: Sequence[str] = ()) -> Discharged:
        """Check one attempt; the claims in ``without`` are shown elsewhere."""
        return self._tried(name, attempt, without)

    def _tried(
        self, name: str, attempt: Entailment, without: Sequence[str], *, quick: bool = False
    ) -> Discharged:
        t = self.values.t
        known = {id(part) for fact in attempt.hypotheses for part in _parts(fact)}
        goals = []
        for goal in attempt.goals:
            if goal.claim in without:
                continue
            left = [part for part in _parts(goal.holds) if id(part) not in known]
            if any(part.value is not True for part in left):
                goals.append(replace(goal, holds=t.conjunction(left)))
        if not goals:
            return Discharged(name, SolverAnswer.UNSAT)
        # What answers satisfy that any claim asks for, they satisfy.
        legal = [goal.legal for goal in attempt.goals]
        proved: list[Goal] = []
        with self.pushed([*self.values.ranges, *attempt.hypotheses, *legal]):
            with self.pushed([t.negation(t.conjunction(goal.holds for goal in goals))]):
                answer = self._check(quick=quick)
            if quick or answer is SolverAnswer.UNSAT:
                return Discharged(name, answer)
            settled = self._one_by_one(name, attempt, goals, proved)
        if settled.answer is not SolverAnswer.UNKNOWN or not proved:
            return settled
        # Perhaps what is open follows from the goals that are proved, with nothing else given.
        left_over = [goal for goal in goals if goal not in proved]
        with self.pushed([*self.values.ranges, *legal, *(goal.holds for goal in proved)]):
            found = [self._alone(name, attempt, goal).answer for goal in left_over]
        if all(answer is SolverAnswer.UNSAT for answer in found):
            return Discharged(name, SolverAnswer.UNSAT)
        return settled

    def _one_by_one(
        self, name: str, attempt: Entailment, goals: Sequence[Goal], proved: list[Goal]
    ) -> Discharged:
        """Check goals one by one; those that follow are hypotheses for the rest."""
        left = list(goals)
        while True:
            waiting = []
            for goal in left:
                settled = self._alone(name, attempt, goal)
                if settled.answer is SolverAnswer.SAT:
                    return settled
                if settled.answer is SolverAnswer.UNKNOWN:
                    waiting.append(goal)
                else:
                    proved.append(goal)
                    self.tell([goal.holds])
            if not waiting:
                return Discharged(name, SolverAnswer.UNSAT)
            if len(waiting) == len(left):
                return Discharged(name, SolverAnswer.UNKNOWN, waiting[0].claim)
            left = waiting

    def _alone(self, name: str, attempt: Entailment, goal: Goal) -> Discharged:
        """Check one goal, case by case."""
        for case in conjuncts(self.values.t, goal.holds):
            with self.pushed([self.values.t.negation(case)]):
                answer = self._check()
                if answer is SolverAnswer.SAT:
                    state = tuple(self._told(attempt.shown))
                    return Discharged(name, answer, goal.claim, state)
            if answer is SolverAnswer.UNKNOWN:
                return Discharged(name, answer, goal.claim)
        return Discharged(name, SolverAnswer.UNSAT, goal.claim)

    def _check(self, *, quick: bool = False) -> SolverAnswer:
        return self.check(QUICK_S if quick else math.inf)

    @contextmanager
    def pushed(self, facts: Sequence[Term]) -> Iterator[None]:
        """Within the context, assert facts."""
        self.session.tell(["(push 1)", *self._asserted(facts)])
        try:
            yield
        finally:
            self.session.tell(["(pop 1)"])

    def tell(self, facts: Sequence[Term]) -> None:
        """Assert a fact in the present context."""
        self.session.tell(self._asserted(facts))

    def check(self, seconds: float) -> SolverAnswer:
        """Check whether the assertions are satisfiable."""
        left = min(seconds, self.deadline())
        if left <= 0:
            return SolverAnswer.UNKNOWN
        self.session.allow(left)
        return self.session.check()

    def _asserted(self, terms: Sequence[Term]) -> list[str]:
        commands: list[str] = []
        for term in terms:
            if term.value is True:
                continue
            definitions, text = self._script.text(term)
            commands += [*definitions, f"(assert {text})"]
        news = self.values.declarations[self._declared :]
        self._declared = len(self.values.declarations)
        return [*news, *commands]

    def _told(self, shown: Sequence[ShownTerm]) -> Iterator[str]:
        """The counterexample, in the words of the program."""
        for one in shown:
            definitions, text = self._script.text(one.term)
            news = self.values.declarations[self._declared :]
            self._declared = len(self.values.declarations)
            try:
                if news or definitions:
                    self.session.tell([*news, *definitions])
                value = self.session.values([text])[0]
            except SolverEndedError as error:  # what it found stands
                yield f"{one.what} is not known, nor what comes after it: {error} when it was asked"
                return
            if isinstance(one.type, EnumType) and value.isdigit():
                number = int(value)
                if number < len(one.type.members):
                    value = one.type.members[number]
            if one.what.startswith("robot "):
                if value == "true":
                    yield one.what
            else:
                yield f"{one.what} = {value}"


def _parts(term: Term) -> tuple[Term, ...]:
    """The operands of a conjunction."""
    return term.args if term.head == "and" else (term,)


def conjuncts(t: Terms, term: Term) -> list[Term]:
    """Terms whose conjunction is equivalent to this one: ``a or (b and c)`` is two of them."""
    if term.head == "and":
        return [part for arg in term.args for part in conjuncts(t, arg)]
    if term.head == "or":
        for k, arg in enumerate(term.args):
            if arg.head == "and":
                rest = [*term.args[:k], *term.args[k + 1 :]]
                return [p for x in arg.args for p in conjuncts(t, t.disjunction([*rest, x]))]
    if term.head == "forall":
        return [t.for_all(term.binders, part) for part in conjuncts(t, term.args[0])]
    return [term]
