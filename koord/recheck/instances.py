"""Instantiation: obligations about any number of robots, settled for named robots. [T-EVERY-N]

First everything is said of few names, then of more, and what is still open is put to the solver
with its quantifiers. What refutes a counterexample does so for every number of robots; what nothing
refutes is open, and never refuted here.

What is said of all robots is true of those that a question names: the one that moves, those of whom
a claim is denied, the winner of a lock. A solver that finds no way out for these has settled the
question for any number of robots. Which are taken decides what can be shown, never what is true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product

from msgspec import Struct, field

from koord.recheck.claims import Entailment, Goal, Obligation
from koord.recheck.monomials import Monomials
from koord.recheck.obligations import Discharged, Settling, conjuncts
from koord.recheck.solving import SolverAnswer
from koord.recheck.terms import BOOL, INT, Term, quoted, subterms
from koord.recheck.values import FAR, Values

#: How long all goals of an attempt together may take, with quantifiers.
_AT_ONCE_S = 1.0

#: How long a question with quantifiers may take.
_QUANTIFIED_S = 5.0

#: How many names there are more from one generation to the next.
_MORE = (0, 8, 12)

#: The same where the names that there were first come first.
_MORE_IN_TURN = (0, 32)

#: How long a question may take whose attempt knows less than the last, one of the last, and of the
#: last once more, with names in turn.
_LOOSE_S = 1.0
_EXACT_S = 5.0
_IN_TURN_S = 20.0


class _Case(Struct):
    """A conjunct of a goal."""

    goal: Goal
    holds: Term


class _Try:
    """An attempt at an obligation."""

    def __init__(
        self,
        settling: Settling,
        attempt: Entailment,
        seconds: float,
        done: set[str],
        *,
        in_turn: bool = False,
    ) -> None:
        self.settling = settling
        self.attempt = attempt
        self.seconds = seconds  #: what a question may take
        self.done = done  #: the claims that were shown in another way
        self.in_turn = in_turn  #: whether names come in the order in which they were met
        self.shown: list[Term] = []
        self.grounding = Grounding(self.settling.values)
        self.monomials = Monomials(self.settling.values)

    def cases(self) -> list[_Case]:
        """The conjuncts of the goals that have to follow."""
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
        """The hypotheses, with the legality of the answers in all goals."""
        legal = [goal.legal for goal in self.attempt.goals]
        return [*self._ranges(), *self.attempt.hypotheses, *legal, *self.shown]

    def _ranges(self) -> list[Term]:
        """What is known of numbers, without sums that this question does not speak of."""
        values, goals = self.settling.values, self.attempt.goals
        here = _heads(
            [*self.attempt.hypotheses, *(g.holds for g in goals), *(g.legal for g in goals)]
        )
        others = {one.total.head for one in values.sums} - here
        return [fact for fact in values.ranges if not _heads([fact]) & others]

    def with_names(self, cases: Sequence[_Case], more: int) -> list[_Case]:
        """The cases that do not follow from instances for the names, and some more names."""
        names = self.grounding.names
        before = len(names)
        if more and cases:
            denied = [self.grounding.denied(case.holds) for case in cases]
            self._name([*denied, *self.given], more)
        if more and len(names) == before:
            return list(cases)
        return self._open(cases)

    def with_quantifiers(self, cases: Sequence[_Case]) -> list[_Case]:
        """The cases that do not follow for the solver either, given quantified hypotheses."""
        if not cases:
            return []
        with self.settling.pushed(self.given):
            return [case for case in cases if not self._follows(case)]

    def _name(self, terms: Sequence[Term], more: int) -> None:
        """Add names, from the terms that occur in the instances so far."""
        names, v = self.grounding.names, self.settling.values
        ends = (v.t.integer(0), v.t.minus(v.count, v.t.integer(1)))
        names += [end for end in ends if end not in names]
        said = [*(self.grounding.said(term) for term in terms), *self.grounding.definitions()]
        found = [n for n in numbers(self.settling.values, said) if n not in names]
        names += sorted(found, key=self._rank)[:more]

    def _rank(self, name: Term) -> tuple[bool, int, int]:
        """First those that there are since something is denied, then the simplest.

        And first of all neighbours in rings. In turn, the witnesses that there were first.
        """
        grounding = self.grounding
        if self.in_turn:
            return not _is_around(name), _size(name), grounding.born.get(name.head, 0)
        is_first = name.head in grounding.of_denied or _is_around(name)
        return not is_first, _size(name), 0

    def _open(self, cases: Sequence[_Case]) -> list[_Case]:
        """The cases that do not follow from the instances for the names.

        Where unknowns are multiplied, products are unknowns first: a solver may not end otherwise.
        """
        grounding = self.grounding
        said = [grounding.said(fact) for fact in self.given]
        denials = [grounding.denied(case.holds) for case in cases]
        facts = [*said, *grounding.definitions()]
        linear = self.monomials.linear
        pairs = list(zip(cases, denials, strict=True))
        plain = [linear(fact) for fact in facts]
        if any(x is not y for x, y in zip(plain, facts, strict=True)) or any(
            linear(denied) is not denied for denied in denials
        ):
            pairs = self._left(plain, pairs, linear)
        return [case for case, _ in self._left(facts, pairs, lambda term: term)]

    def _left(
        self,
        facts: Sequence[Term],
        pairs: Sequence[tuple[_Case, Term]],
        told: Callable[[Term], Term],
    ) -> list[tuple[_Case, Term]]:
        """The cases, each with its denial, that do not follow from facts, as they are told."""
        settling, left = self.settling, []
        if not pairs:
            return []
        with settling.pushed(facts):
            for case, denied in pairs:
                with settling.pushed([told(denied)]):
                    answer = settling.check(self.seconds)
                if answer is SolverAnswer.UNSAT:
                    self.shown.append(case.holds)
                    settling.tell([told(self.grounding.said(case.holds))])
                else:
                    left.append((case, denied))
        return left

    def _follows(self, case: _Case) -> bool:
        t = self.settling.values.t
        with self.settling.pushed([t.negation(case.holds)]):
            return self.settling.check(_QUANTIFIED_S) is SolverAnswer.UNSAT


def settled(settling: Settling, obligation: Obligation) -> Discharged:
    """Settle an obligation about any number of robots: proved, or open."""
    *quick, exact = [attempt() for attempt in obligation.attempts]
    if _at_once(settling, exact):
        return Discharged(obligation.name, SolverAnswer.UNSAT)
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
    if left:
        trying = _Try(settling, exact, _IN_TURN_S, done, in_turn=True)
        left = trying.cases()
    for more in _MORE_IN_TURN:
        if left and settling.deadline() > 0:
            left = trying.with_names(left, more)
    if not left:
        return Discharged(obligation.name, SolverAnswer.UNSAT)
    return Discharged(obligation.name, SolverAnswer.UNKNOWN, left[0].goal.claim)


def _at_once(settling: Settling, attempt: Entailment) -> bool:
    """Return whether all goals follow, within a short time limit."""
    t, goals = settling.values.t, attempt.goals
    denied = t.negation(t.conjunction(goal.holds for goal in goals))
    if denied.value is False:
        return True
    legal = [goal.legal for goal in goals]
    with settling.pushed([*settling.values.ranges, *attempt.hypotheses, *legal, denied]):
        return settling.check(_AT_ONCE_S) is SolverAnswer.UNSAT


# --- statements about all numbers, said of a few of them ------------------------------------------

#: One statement is said of so many tuples of names at most, and all together so many times.
_MOST_TUPLES = 400
_MOST_INSTANCES = 20_000


class Grounding(Struct):
    """A grounding of statements for names, with Skolem constants for negated ones."""

    v: Values
    names: list[Term] = field(default_factory=list)
    #: So many of the names come first: of the others one at most occurs in a tuple.
    few: int = 0
    #: The witnesses of what is said of numbers of which a goal is denied.
    of_denied: set[str] = field(default_factory=set)
    born: dict[str, int] = field(default_factory=dict)  #: which witness came when
    _instances: int = 0
    _quantified: dict[int, bool] = field(default_factory=dict)
    _witnesses: dict[int, list[Term]] = field(default_factory=dict)
    _atoms: dict[int, tuple[Term, Term]] = field(default_factory=dict)
    _denials: dict[str, Term] = field(default_factory=dict)
    _kept: list[Term] = field(default_factory=list)

    def denied(self, goal: Term) -> Term:
        """The negation of a statement, with Skolem constants, the same for each goal."""
        t, used = self.v.t, 0
        pending, denied = [goal], []
        while pending:
            term = pending.pop()
            if term.head == "or":
                pending += term.args
            elif term.head == "forall":
                body = term.args[0]
                for binder in term.binders:
                    body = t.put(body, binder, self._denial(used, binder.sort))
                    used += 1
                pending.append(body)
            else:
                denied.append(self.said(term, holds=False))
        return t.conjunction(denied)

    def _denial(self, position: int, sort: str) -> Term:
        name = f"of {sort} {position} it is denied"
        if name not in self._denials:
            self._denials[name] = self.v.symbol(name, sort)
        return self._denials[name]

    def denied_of(self) -> list[Term]:
        """The Skolem constants of the goals negated so far."""
        return [witness for witness in self._denials.values() if witness.sort == INT]

    def said(self, term: Term, *, holds: bool = True) -> Term:
        """The instances of a statement (or its negation) for the names."""
        t = self.v.t
        match term.head, term.args:
            case "not", [a]:
                return self.said(a, holds=not holds)
            case "and", args if holds:
                return t.conjunction(self.said(a) for a in args)
            case "or", args if not holds:
                return t.conjunction(self.said(a, holds=False) for a in args)
            case "forall", [body] if self._is_sayable(term):
                return self._of_names(term, body) if holds else self._of_witness(term, body)
            case _:
                # Deeper down a Boolean stands for it: it means the same in all places.
                plain = self._named(term)
                return plain if holds else t.negation(plain)

    def definitions(self) -> list[Term]:
        """The definitions of Booleans that stand for quantified statements."""
        t, found, done = self.v.t, [], 0
        while done < len(self._atoms):
            for term, atom in list(self._atoms.values())[done:]:
                done += 1
                found.append(t.either(t.negation(atom), self.said(term)))
                found.append(t.either(atom, self.said(term, holds=False)))
        return found

    def _named(self, term: Term) -> Term:
        """The term with a Boolean in place of each quantified statement inside it."""

        def instead(node: Term) -> Term | None:
            if not self._has_quantifier(node):
                return node
            return self._atom(node) if node.head == "forall" else None

        return self.v.t.rebuilt(term, {}, instead)

    def _atom(self, term: Term) -> Term:
        if not self._is_sayable(term):
            return term
        if id(term) not in self._atoms:
            self._atoms[id(term)] = term, self.v.symbol("every", BOOL)
        return self._atoms[id(term)][1]

    def _of_names(self, term: Term, body: Term) -> Term:
        t = self.v.t
        tuples = product(self.names, repeat=len(term.binders))
        said, few = [], self.names[: self.few]
        for number, chosen in enumerate(tuples):
            if number >= _MOST_TUPLES or self._instances >= _MOST_INSTANCES:
                break
            if sum(name not in few for name in chosen) > 1:
                continue
            self._instances += 1
            instance = body
            for binder, name in zip(term.binders, chosen, strict=True):
                instance = t.put(instance, binder, name)
            said.append(self.said(instance))
        return t.conjunction(said)

    def _of_witness(self, term: Term, body: Term) -> Term:
        if id(term) not in self._witnesses:
            self._kept.append(term)
            made = [self.v.symbol("what it fails of", b.sort) for b in term.binders]
            self._witnesses[id(term)] = made
            for witness in made:
                self.born[witness.head] = len(self.born)
            if self._is_of_denied(term):
                self.of_denied |= {witness.head for witness in made}
        for binder, witness in zip(term.binders, self._witnesses[id(term)], strict=True):
            body = self.v.t.put(body, binder, witness)
        return self.said(body, holds=False)

    def _is_of_denied(self, term: Term) -> bool:
        """Return whether a statement is about a number of which a goal is denied."""
        denied = {witness.head for witness in self._denials.values()}
        return any(node.head in denied for node in subterms([term]))

    def _is_sayable(self, term: Term) -> bool:
        """Return whether a statement is a closed quantifier over integers."""
        return not self.v.t.free(term) and all(b.sort == INT for b in term.binders)

    def _has_quantifier(self, term: Term) -> bool:
        known = self._quantified
        pending = [term]
        while pending:
            node = pending[-1]
            below = [a for a in node.args if id(a) not in known]
            if below:
                pending += below
                continue
            pending.pop()
            inside = any(known[id(a)] for a in node.args)
            known[id(node)] = node.head == "forall" or inside
        self._kept.append(term)
        return known[id(term)]


def numbers(v: Values, terms: Iterable[Term]) -> Iterator[Term]:
    """The terms that are used as numbers of robots: arguments of functions of robots.

    And places in rings that something is compared with: it is there that robots write.
    """
    given: set[int] = set()
    for node in subterms(terms):
        if node.head in v.indexed:
            for a in node.args:
                if a.sort == INT and not v.t.free(a) and id(a) not in given:
                    given.add(id(a))
                    yield a
        elif node.head == "=":
            for a in node.args:
                if _is_around(a) and not v.t.free(a) and id(a) not in given:
                    given.add(id(a))
                    yield a


def _is_around(term: Term) -> bool:
    """Return whether a term is a place in a ring of any number of robots."""
    if term.head != "ite" or term.sort != INT:
        return False
    while term.head == "ite":
        term = term.args[1] if term.args[2].value == 0 else term.args[2]
    return term.head == quoted(FAR)


def _heads(terms: Iterable[Term]) -> set[str]:
    return {node.head for node in subterms(terms)}


def _size(term: Term) -> int:
    return 1 + sum(_size(a) for a in term.args)
