"""Statements about all numbers, said of a few of them. [T-EVERY-N]

What is said of all robots is true of those that a question names: the one that moves, those of whom
a claim is denied, the winner of a lock. A solver that finds no way out for these has settled the
question for any number of robots. Which are taken decides what can be shown, never what is true.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import product

from msgspec import Struct, field

from koord.recheck.terms import BOOL, INT, Term
from koord.recheck.values import Values

#: One statement is said of so many tuples of names at most, and all together so many times.
_MOST_TUPLES = 400
_MOST_INSTANCES = 20_000


class Grounding(Struct):
    """Says statements of names. What does not hold of all fails of a witness, which is a symbol."""

    v: Values
    names: list[Term] = field(default_factory=list)
    #: So many of the names come first: of the others one at most occurs in a tuple.
    few: int = 0
    _instances: int = 0
    _quantified: dict[int, bool] = field(default_factory=dict)
    _witnesses: dict[int, list[Term]] = field(default_factory=dict)
    _atoms: dict[int, tuple[Term, Term]] = field(default_factory=dict)
    _denials: dict[str, Term] = field(default_factory=dict)
    _kept: list[Term] = field(default_factory=list)

    def denied(self, goal: Term) -> Term:
        """That a statement does not hold: it fails of some witnesses, the same for each goal."""
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
        """The numbers of which goals were denied so far."""
        return [witness for witness in self._denials.values() if witness.sort == INT]

    def said(self, term: Term, *, holds: bool = True) -> Term:
        """What a statement (or its negation) says of the names."""
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
        """What Booleans mean that stand for statements about all numbers."""
        t, found, done = self.v.t, [], 0
        while done < len(self._atoms):
            for term, atom in list(self._atoms.values())[done:]:
                done += 1
                found.append(t.either(t.negation(atom), self.said(term)))
                found.append(t.either(atom, self.said(term, holds=False)))
        return found

    def _named(self, term: Term) -> Term:
        """The term with a Boolean for each statement about all numbers that stands deep in it."""
        known: dict[int, Term] = {}
        pending = [term]
        while pending:
            node = pending[-1]
            if not self._has_quantifier(node) or id(node) in known:
                known.setdefault(id(node), node)
                pending.pop()
                continue
            if node.head == "forall":
                pending.pop()
                known[id(node)] = self._atom(node)
                continue
            below = [a for a in node.args if id(a) not in known]
            if below:
                pending += below
                continue
            pending.pop()
            known[id(node)] = self.v.t.again(node, [known[id(a)] for a in node.args])
        return known[id(term)]

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
            self._witnesses[id(term)] = [
                self.v.symbol("what it fails of", b.sort) for b in term.binders
            ]
        for binder, witness in zip(term.binders, self._witnesses[id(term)], strict=True):
            body = self.v.t.put(body, binder, witness)
        return self.said(body, holds=False)

    def _is_sayable(self, term: Term) -> bool:
        """Whether a statement is about all numbers, and about nothing that is left open."""
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
    """The terms that are used as numbers of robots: what functions of such numbers are asked of."""
    seen: set[int] = set()
    given: set[int] = set()
    pending = list(terms)
    while pending:
        node = pending.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if node.head in v.indexed:
            for a in node.args:
                if a.sort == INT and not v.t.free(a) and id(a) not in given:
                    given.add(id(a))
                    yield a
        pending += node.args


def plainest(names: Sequence[Term], most: int) -> list[Term]:
    """The names that are written most simply."""
    return sorted(names, key=_size)[:most]


def _size(term: Term) -> int:
    return 1 + sum(_size(a) for a in term.args)
