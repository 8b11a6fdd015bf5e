"""Obligations about any number of robots, settled for the few that they name. [T-EVERY-N]

First everything is said of few names, then of more, and what is still open is put to the solver
with its quantifiers. What refutes a counterexample does so for every number of robots; what nothing
refutes is open, and never refuted here.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from koord.recheck.claims import Attempt, Goal, Obligation
from koord.recheck.discharge import Settled, Settling, conjuncts
from koord.recheck.grounding import Grounding, numbers, plainest
from koord.recheck.solving import Answer
from koord.recheck.terms import Term

#: How long all goals of an attempt together may take, with quantifiers.
_AT_ONCE_S = 1.0

#: How long a question with quantifiers may take.
_QUANTIFIED_S = 5.0

#: How many names there are more from one generation to the next.
_MORE = (0, 8, 12)

#: How long a question may take whose attempt knows less than the last, and one of the last.
_LOOSE_S = 1.0
_EXACT_S = 5.0


class _Case(Struct):
    """A part of a goal, and the goal."""

    goal: Goal
    holds: Term


class _Try:
    """One attempt at an obligation."""

    def __init__(
        self, settling: Settling, attempt: Attempt, seconds: float, done: set[str]
    ) -> None:
        self.settling = settling
        self.attempt = attempt
        self.seconds = seconds  #: what a question may take
        self.done = done  #: the claims that were shown in another way
        self.shown: list[Term] = []
        self.grounding = Grounding(self.settling.values)

    def cases(self) -> list[_Case]:
        """What has to follow, part by part."""
        v = self.settling.values
        known = {id(part) for fact in self.attempt.hypotheses for part in conjuncts(v.t, fact)}
        cases = [
            _Case(goal, case)
            for goal in self.attempt.goals
            for case in conjuncts(v.t, goal.holds)
            if case.value is not True and id(case) not in known and goal.claim not in self.done
        ]
        self.shown += [goal.holds for goal in self.attempt.goals if goal.claim in self.done]
        for case in cases:
            self.grounding.denied(case.holds)
        self.grounding.names += [*self.attempt.names, *self.grounding.denied_of()]
        self.grounding.few = len(self.grounding.names)
        return cases

    @property
    def given(self) -> list[Term]:
        """What is known. What answers satisfy that any claim asks for, they satisfy."""
        legal = [goal.legal for goal in self.attempt.goals]
        return [*self.settling.values.ranges, *self.attempt.hypotheses, *legal, *self.shown]

    def with_names(self, cases: Sequence[_Case], more: int) -> list[_Case]:
        """What does not follow from what is said of the names, and of so many more."""
        names = self.grounding.names
        before = len(names)
        if more and cases:
            denied = [self.grounding.denied(case.holds) for case in cases]
            self._name([*denied, *self.given], more)
        if more and len(names) == before:
            return list(cases)
        return self._open(cases)

    def with_quantifiers(self, cases: Sequence[_Case]) -> list[_Case]:
        """What does not follow for the solver, either, given everything as it is said of all."""
        if not cases:
            return []
        with self.settling.pushed(self.given):
            return [case for case in cases if not self._follows(case)]

    def _name(self, terms: Sequence[Term], more: int) -> None:
        """So many more names, of those that what is said so far brings up."""
        names, v = self.grounding.names, self.settling.values
        ends = (v.t.integer(0), v.t.minus(v.count, v.t.integer(1)))
        names += [end for end in ends if end not in names]
        said = [*(self.grounding.said(term) for term in terms), *self.grounding.definitions()]
        found = [n for n in numbers(self.settling.values, said) if n not in names]
        names += plainest(found, more)

    def _open(self, cases: Sequence[_Case]) -> list[_Case]:
        """The cases that do not follow from what is said of the names."""
        settling, grounding = self.settling, self.grounding
        left = []
        facts = [grounding.said(fact) for fact in self.given]
        denials = [grounding.denied(case.holds) for case in cases]
        with settling.pushed([*facts, *grounding.definitions()]):
            for case, denied in zip(cases, denials, strict=True):
                with settling.pushed([denied]):
                    answer = settling.check(self.seconds)
                if answer is Answer.UNSAT:
                    self.shown.append(case.holds)
                    settling.tell([grounding.said(case.holds)])
                else:
                    left.append(case)
        return left

    def _follows(self, case: _Case) -> bool:
        t = self.settling.values.t
        with self.settling.pushed([t.negation(case.holds)]):
            return self.settling.check(_QUANTIFIED_S) is Answer.UNSAT


def settled(settling: Settling, obligation: Obligation) -> Settled:
    """An obligation about any number of robots: met, or open."""
    *quick, exact = [attempt() for attempt in obligation.attempts]
    if _at_once(settling, exact):
        return Settled(obligation.name, Answer.UNSAT)
    done: set[str] = set()
    for attempt in quick:
        trying = _Try(settling, attempt, _LOOSE_S, done)
        open_ = {case.goal.claim for case in trying.with_names(trying.cases(), 0)}
        done |= {goal.claim for goal in attempt.goals if goal.claim not in open_}
    trying = _Try(settling, exact, _EXACT_S, done)
    left = trying.cases()
    for more in _MORE:
        if left and settling.deadline() <= 0:
            break
        if left:
            left = trying.with_names(left, more)
        if left and not more:
            left = trying.with_quantifiers(left)
    if not left:
        return Settled(obligation.name, Answer.UNSAT)
    return Settled(obligation.name, Answer.UNKNOWN, left[0].goal.claim)


def _at_once(settling: Settling, attempt: Attempt) -> bool:
    """Whether all goals follow, as the solver finds out quickly."""
    t, goals = settling.values.t, attempt.goals
    denied = t.negation(t.conjunction(goal.holds for goal in goals))
    if denied.value is False:
        return True
    legal = [goal.legal for goal in goals]
    with settling.pushed([*settling.values.ranges, *attempt.hypotheses, *legal, denied]):
        return settling.check(_AT_ONCE_S) is Answer.UNSAT
