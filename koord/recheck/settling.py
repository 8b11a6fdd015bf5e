"""Obligations put to the solver, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from koord.recheck.obligations import Goal, Obligation, Shown
from koord.recheck.script import Script
from koord.recheck.solving import Answer, Session
from koord.recheck.terms import Term
from koord.recheck.values import Values
from koord.syntax.types import EnumType


@dataclass(frozen=True, slots=True)
class Settled:
    """What became of an obligation: ``claim`` is the goal that does not follow, or is not known to.

    ``state`` is the solver's counterexample, in the words of the program.
    """

    name: str
    answer: Answer
    claim: str = ""
    state: tuple[str, ...] = ()


@dataclass(slots=True)
class Settling:
    """Puts obligations to one session."""

    values: Values
    session: Session
    progress: Callable[[str], None] = lambda text: None
    _script: Script = field(default_factory=Script)
    _declared: int = 0

    def settle(self, obligations: Iterable[Obligation]) -> Iterator[Settled]:
        for obligation in obligations:
            self.progress(obligation.name)
            yield self._settled(obligation)

    def _settled(self, obligation: Obligation) -> Settled:
        known = {id(fact) for fact in (*obligation.given, *obligation.hypotheses)}
        goals = [goal for goal in obligation.goals if id(goal.holds) not in known]
        t = self.values.t
        if all(goal.holds.value is True for goal in goals):
            return Settled(obligation.name, Answer.UNSAT)
        self.session.tell(["(push 1)"])
        facts = (*self.values.ranges, *obligation.given, *obligation.hypotheses)
        self.session.tell(self._asserted(facts))
        settled = self._together(obligation, goals, t.disjunction(map(self._fails, goals)))
        self.session.tell(["(pop 1)"])
        return settled

    def _together(self, obligation: Obligation, goals: list[Goal], fails: Term) -> Settled:
        """All goals at once, and where that does not do one by one."""
        if self._ask(fails) is Answer.UNSAT:
            self.session.tell(["(pop 1)"])
            return Settled(obligation.name, Answer.UNSAT)
        self.session.tell(["(pop 1)"])
        open_ = ""
        for goal in goals:
            answer = self._ask(self._fails(goal))
            if answer is Answer.SAT:
                state = tuple(self._told(obligation.shown))
                self.session.tell(["(pop 1)"])
                return Settled(obligation.name, answer, goal.claim, state)
            if answer is Answer.UNKNOWN:
                open_ = open_ or goal.claim
            self.session.tell(["(pop 1)"])
        if open_:
            return Settled(obligation.name, Answer.UNKNOWN, open_)
        return Settled(obligation.name, Answer.UNSAT)

    def _ask(self, question: Term) -> Answer:
        """Leaves the question pushed, so that its model can be looked at."""
        self.session.tell(["(push 1)"])
        return self.session.check(self._asserted([question]))

    def _fails(self, goal: Goal) -> Term:
        return self.values.t.both(goal.legal, self.values.t.negation(goal.holds))

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

    def _told(self, shown: Sequence[Shown]) -> Iterator[str]:
        """The counterexample, in the words of the program."""
        for one in shown:
            definitions, text = self._script.text(one.term)
            news = self.values.declarations[self._declared :]
            self._declared = len(self.values.declarations)
            if news or definitions:
                self.session.tell([*news, *definitions])
            value = self.session.values([text])[0]
            if isinstance(one.type, EnumType) and value.isdigit():
                number = int(value)
                if number < len(one.type.members):
                    value = one.type.members[number]
            if one.what.startswith("robot "):
                if value == "true":
                    yield one.what
            else:
                yield f"{one.what} = {value}"
