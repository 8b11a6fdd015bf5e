"""Instantiation of quantified facts at the terms that are used as robots. [T-EVERY-N]

A statement about all robots is never given to the solver as such. It is worked out once, for a
*blank* of which nothing is known, and said again of each *name*: each term that is used as the
number of a robot. Any choice of names is sound; which are worth it is decided by *generations*:
first come the names of the question, then those that what is said of them brings up, and so on.

What is new while something is worked out for blanks is a function of them, so that it may differ
from name to name: what makes a statement fail of a robot, say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from typing import TypeAlias

from msgspec import Struct, field

from koord.semantics.domain import conjunction
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL, INT
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.functions import Functions

Names = tuple[Term, ...]

#: What is told of names, and of their generation, when something is said of them.
Arrival: TypeAlias = "Callable[[Names, int], None]"


class Scheme(Struct):
    """A quantified fact: ``outer`` blanks are fixed by its context, ``own`` ones range over names.

    ``contexts`` are what the outer blanks stand for, each with its generation; ``known`` has those
    of a scheme that others ``use``, each time of the terms that they say. Whom a scheme ``calls``
    is told of its terms. In each context the ``doubt`` is noted, and the ``witness`` in it is a
    name.
    """

    outer: Names
    own: Names
    facts: list[Term] = field(default_factory=list)
    brings_up: list[Term] = field(default_factory=list)
    inner: list[Scheme] = field(default_factory=list)
    uses: list[tuple[Scheme, Names]] = field(default_factory=list)
    calls: list[tuple[Arrival, Names]] = field(default_factory=list)
    atom: str = ""  #: the Boolean that the scheme is about, if it is about one
    doubt: Term = True
    witness: Term | None = None
    active: bool = False
    latest: int | None = None  #: names of later generations are left out
    contexts: list[tuple[Names, int]] = field(default_factory=list)
    known: dict[tuple[object, ...], tuple[Names, int]] = field(default_factory=dict)
    said: set[tuple[object, ...]] = field(default_factory=set)


class Book(Struct):
    """Facts, names, and the schemes that are instantiated with them. ``facts`` only grows.

    So many things are said of names at ``most``: a proof that needs more is not found.
    """

    unknowns: Functions
    most: int = 20_000
    facts: list[Term] = field(default_factory=list)
    instances: int = 0
    _names: dict[object, tuple[Term, int]] = field(default_factory=dict)
    _schemes: list[Scheme] = field(default_factory=list)
    _frames: list[Scheme] = field(default_factory=list)
    _glimpses: dict[tuple[object, ...], Scheme] = field(default_factory=dict)
    _now: int = 0
    _wanted: set[tuple[str, bool]] = field(default_factory=set)
    _seen: set[int] = field(default_factory=set)
    _looked: int = 0
    _kept: list[Term] = field(default_factory=list)
    _canonical: list[Term] = field(default_factory=list)
    _arrived: list[tuple[Arrival, Names, int]] = field(default_factory=list)
    _everywhere: dict[tuple[object, ...], tuple[Scheme, Term]] = field(default_factory=dict)
    _true_of_all: set[tuple[object, ...]] = field(default_factory=set)
    _leaving: dict[tuple[object, ...], Term] = field(default_factory=dict)

    # --- writing --------------------------------------------------------------------------------

    def note(self, fact: Term) -> None:
        """Record a fact."""
        d = self.unknowns.terms
        if d.known(fact) is True:
            return
        frame = self._frame_of(fact)
        (self.facts if frame is None else frame.facts).append(fact)

    def name(self, index: Term, generation: int = 0) -> None:
        """Record that a term is used as the number of a robot."""
        frame = self._frame_of(index)
        if frame is None:
            self._put(index, max(generation, self._now))
        elif not any(index is blank for blank in frame.own):
            frame.brings_up.append(index)

    def expect(self, *names: Term, generation: int = 0) -> None:
        """Declare names that are to be instantiated from a generation on."""
        for name in names:
            self._put(name, generation)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Within the context, nothing becomes a name: what is looked at in a model need not be."""
        before = dict(self._names)
        try:
            yield
        finally:
            self._names = before

    def names(self, limit: int) -> list[Term]:
        """The names of the first generations."""
        return [term for term, born in self._names.values() if born <= limit]

    def state(self, arity: int, says: Callable[[Names], Term], latest: int | None = None) -> None:
        """Assert that a statement holds of all integers; it is said of names up to a generation."""
        frame, fact = self.worked_out(arity, says)
        frame.latest = latest
        frame.facts.append(fact)
        self._keep(frame)

    def every(
        self, low: Term, high: Term, body: Callable[[Term], Term], latest: int | None = None
    ) -> Term:
        """A Boolean equivalent to ``body`` for all integers of a range. [T-EVERY-N]

        There is one for all robots if what it says is the same for each of them. That ``body``
        holds is said of names up to the ``latest`` generation.
        """
        d = self.unknowns.terms
        frame, holds_of = self.worked_out(1, lambda names: body(names[0]))
        frame.latest = latest
        known = d.known(holds_of)
        if known is not None:
            return True if known else d.unary(UnaryOp.NOT, d.binary(BinaryOp.LT, low, high))
        (blank,) = frame.own
        if not frame.inner and not frame.uses and not frame.brings_up:
            return self._shared(frame, low, high, holds_of)
        inside = self.between(low, blank, high)
        if d.is_valid(self.implied(inside, holds_of)):
            # That an index lies in a range over which it runs, most often.
            return True
        holds = self._equivalent(frame, inside, holds_of)
        self._keep(frame)
        return holds

    def _shared(self, frame: Scheme, low: Term, high: Term, holds_of: Term) -> Term:
        """The Boolean of a statement that is the same wherever it is asked of the same terms."""
        d, (own,) = self.unknowns.terms, frame.own
        said = conjunction(d, [holds_of, self.between(low, own, high), *frame.facts])
        used = tuple(blank for blank in frame.outer if d.mentions(said, [blank]))
        blanks = self.canonical(1 + len(used))
        pairs = list(zip((own, *used), blanks, strict=True))
        low, high, holds_of = (d.put(term, pairs) for term in (low, high, holds_of))
        key = len(used), d.key(low), d.key(high), d.key(holds_of)
        if key in self._true_of_all:
            return True
        if key not in self._everywhere:
            inside = self.between(low, blanks[0], high)
            if d.is_valid(self.implied(inside, holds_of)):
                self._true_of_all.add(key)
                self._kept += [low, high, holds_of]
                return True
            facts = [d.put(fact, pairs) for fact in frame.facts]
            shared = Scheme(blanks[1:], blanks[:1], facts, latest=frame.latest)
            with d.opened(shared.outer):
                holds = self._equivalent(shared, inside, holds_of)
            self._everywhere[key] = shared, holds
            self._kept += [low, high, holds_of]
            self._schemes.append(shared)
            if not used:
                self._know_of(shared, (), self._now)
        shared, holds = self._everywhere[key]
        if frame.latest is None:
            shared.latest = None
        if used:
            self._use(shared, used)
        return d.put(holds, list(zip(blanks[1:], used, strict=True)))

    def _use(self, shared: Scheme, names: Names) -> None:
        """Say a shared statement of names from now on."""
        if self._frames:
            self._frames[-1].uses.append((shared, names))
        else:
            self._know_of(shared, names, self._now)

    def canonical(self, count: int) -> Names:
        """Blanks that stand for others, so that what is said of them can be compared."""
        while len(self._canonical) < count:
            self._canonical.append(self.unknowns.terms.blank())
        return tuple(self._canonical[:count])

    def call(self, arrival: Arrival, names: Names) -> None:
        """Tell somebody of what blanks of the context stand for, whenever they do."""
        self._frames[-1].calls.append((arrival, names))

    def keep(self, term: Term) -> None:
        """Keep a term alive, whose key somebody remembers."""
        self._kept.append(term)

    def say(self, frame: Scheme, fact: Term, names: Names) -> Term:
        """Say of names what was worked out about blanks, and return a term of them."""
        d = self.unknowns.terms
        pairs = list(zip((*frame.outer, *frame.own), names, strict=True))
        for each in frame.facts:
            self.note(d.put(each, pairs))
        for index in frame.brings_up:
            self.name(d.put(index, pairs), generation=1)
        for shared, terms in frame.uses:
            self._use(shared, tuple(d.put(term, pairs) for term in terms))
        return d.put(fact, pairs)

    def _equivalent(self, frame: Scheme, inside: Term, holds_of: Term) -> Term:
        d, (blank,) = self.unknowns.terms, frame.own
        with d.depending_on(None):
            holds, witness = d.fresh("every", BOOL), d.fresh("witness", INT)
        frame.facts.append(self.implied(d.binary(BinaryOp.AND, holds, inside), holds_of))
        fails = d.binary(BinaryOp.AND, inside, d.unary(UnaryOp.NOT, holds_of))
        frame.atom, frame.witness = d.symbol(holds), witness
        frame.doubt = d.binary(BinaryOp.OR, holds, d.put(fails, [(blank, witness)]))
        return holds

    def _know_of(self, shared: Scheme, names: Names, born: int) -> None:
        """Say a shared statement of some names from a generation on."""
        key = tuple(self.unknowns.terms.key(term) for term in names)
        known = shared.known.get(key)
        if known is None or known[1] > born:
            shared.known[key] = names, born
            shared.contexts = list(shared.known.values())

    def first(self, low: Term, high: Term, goes_on: Callable[[Term], Term]) -> tuple[Term, Term]:
        """Whether a loop runs through, and if not in which trip it is left. [T-LOOP]"""
        d = self.unknowns.terms
        through = self.every(low, high, goes_on)
        key = d.key(through), d.key(low), d.key(high)
        if d.known(through) is not None or key not in self._leaving:
            with self.about(through):
                last = d.fresh_like("witness", 0)
                self.name(last, generation=1)
                before = self.every(low, last, goes_on)
                left = d.unary(UnaryOp.NOT, goes_on(last))
                at_last = conjunction(d, [self.between(low, last, high), left, before])
                self.note(d.binary(BinaryOp.OR, through, at_last))
            self._leaving[key] = last
            self._kept += [through, low, high]
        return through, self._leaving[key]

    def glimpse(self, body: Callable[[Term], Term]) -> Term:
        """Evaluate a body at an integer of which nothing is known.

        What it notes is thrown away, so that one blank does for all glimpses at a place.
        """
        d = self.unknowns.terms
        place = tuple(d.key(blank) for blank in d.open)
        frame = self._glimpses.get(place) or Scheme(d.open, (d.blank(),))
        self._glimpses[place] = frame
        return self._work_out(frame, lambda names: body(names[0]))

    def said_of_any(
        self, low: Term, high: Term, body: Callable[[Term], Term]
    ) -> tuple[Term, Term, Term] | None:
        """A range, and what is said of any number of it; None if that depends on the context."""
        d = self.unknowns.terms
        seen = self.glimpse(body)
        own = self._glimpses[tuple(d.key(blank) for blank in d.open)].own
        (any_,) = self.canonical(1)
        said = low, high, d.put(seen, [(own[0], any_)])
        return None if any(d.mentions(term, d.open) for term in said) else said

    @contextmanager
    def about(self, term: Term) -> Iterator[None]:
        """Within the context, evaluate something that depends only on the blanks of a term."""
        frames = self._frames
        used = [k for k, frame in enumerate(frames) if self._mentions(term, frame)]
        self._reopen(frames[: used[-1] + 1] if used else [])
        try:
            yield
        finally:
            self._reopen(frames)

    def worked_out(self, arity: int, says: Callable[[Names], Term]) -> tuple[Scheme, Term]:
        """Evaluate a statement on blanks, together with the facts recorded on the way."""
        d = self.unknowns.terms
        frame = Scheme(d.open, tuple(d.blank() for _ in range(arity)))
        return frame, self._work_out(frame, says)

    def _work_out(self, frame: Scheme, says: Callable[[Names], Term]) -> Term:
        frames = self._frames
        constraints = len(self.unknowns.constraints)
        self._reopen([*frames, frame])
        try:
            with self.unknowns.terms.depending_on(None):
                fact = says(frame.own)
        finally:
            self._reopen(frames)
        new = self.unknowns.constraints[constraints:]
        del self.unknowns.constraints[constraints:]
        for constraint in new:
            # Facts about blanks are facts about every name.
            mine = self._mentions(constraint, frame)
            (frame.facts if mine else self.unknowns.constraints).append(constraint)
        return fact

    def _reopen(self, frames: list[Scheme]) -> None:
        self._frames = frames
        self.unknowns.terms.open = tuple(blank for frame in frames for blank in frame.own)

    def _keep(self, scheme: Scheme) -> None:
        """Instantiate a scheme in its context from now on."""
        if self._frames:
            self._frames[-1].inner.append(scheme)
        else:
            self._schemes.append(scheme)
            scheme.contexts.append(((), self._now))

    def _frame_of(self, term: Term) -> Scheme | None:
        """The innermost statement under evaluation on whose blanks a term depends."""
        for frame in reversed(self._frames):
            if self._mentions(term, frame):
                return frame
        return None

    def _mentions(self, term: Term, frame: Scheme) -> bool:
        return self.unknowns.terms.mentions(term, frame.own)

    def _put(self, index: Term, generation: int) -> None:
        key = self.unknowns.terms.key(index)
        if key not in self._names or self._names[key][1] > generation:
            self._names[key] = (index, generation)

    # --- unfolding ------------------------------------------------------------------------------

    def ask(self, goal: Sequence[Term]) -> None:
        """Note that a formula is about to be queried."""
        for term in goal:
            self._want(term)

    def _want(self, term: Term, without: str = "") -> None:
        """Note the polarity in which a formula's Booleans matter.

        Where nothing needs a statement to hold, nothing need be said that follows from it; where
        nothing needs it to fail, there need not be anything that it fails of.
        """
        self._kept.append(term)
        # What is passed over here may be met again where it matters: it is not noted as seen.
        seen, before = (set[int](), self._seen) if without else (self._seen, ())
        for name, leaning in self.unknowns.terms.leanings(term, seen, before):
            if name != without:
                self._wanted.add((name, leaning))

    def settle(self, limit: int) -> None:
        """Instantiate every scheme at every name, both of the first generations."""
        seen = -1
        while seen < self.instances < self.most:
            seen = self.instances
            for arrival, names, born in self._take_arrived():
                arrival(names, born)
            for fact in self.facts[self._looked :]:
                self._want(fact)
            self._looked = len(self.facts)
            for scheme in list(self._schemes):
                self._unfold(scheme, limit)
        self._now = 0

    def _take_arrived(self) -> list[tuple[Arrival, Names, int]]:
        arrived, self._arrived = self._arrived, []
        return arrived

    def _unfold(self, scheme: Scheme, limit: int) -> None:
        latest = limit if scheme.latest is None else min(limit, scheme.latest)
        names = [(key, *name) for key, name in self._names.items() if name[1] <= latest]
        needed = not scheme.atom or (scheme.atom, True) in self._wanted
        doubted = bool(scheme.atom) and (scheme.atom, False) in self._wanted
        if (needed or doubted) and not scheme.active:
            scheme.active = True
            # One formula: names are put into it at once.
            scheme.facts = [conjunction(self.unknowns.terms, scheme.facts)]
            self._want(scheme.facts[0], scheme.atom)
            self._want(scheme.doubt, scheme.atom)
        for context, born in list(scheme.contexts):
            if born > limit:
                continue
            if doubted:
                self._raise_doubt(scheme, context, born)
            if not needed:
                continue
            # Most is said already: that is seen by keys alone, which names have from the start.
            outside = self._keys(context)
            for chosen in product(names, repeat=len(scheme.own)):
                key = (*outside, *[each[0] for each in chosen])
                if key in scheme.said:
                    continue
                # Two names that are worth little are worth less together.
                late = max(born, sum([each[2] for each in chosen]))
                if late <= limit and self.instances < self.most:
                    scheme.said.add(key)
                    self._say(scheme, (*context, *[each[1] for each in chosen]), late)
        for inner in scheme.inner:
            self._unfold(inner, limit)

    def _keys(self, names: Names) -> tuple[object, ...]:
        """What some terms are known by."""
        return tuple([self.unknowns.terms.key(term) for term in names])

    def _raise_doubt(self, scheme: Scheme, context: Names, born: int) -> None:
        """Assert that if the statement fails in a context, it fails of a witness."""
        key = ("doubt", *self._keys(context))
        if scheme.witness is None or key in scheme.said:
            return
        scheme.said.add(key)
        pairs = list(zip(scheme.outer, context, strict=True))
        witness = self.unknowns.terms.put(scheme.witness, pairs)
        self.instances += 1
        self._add(self.unknowns.terms.put(scheme.doubt, pairs))
        self._put(witness, born + 1)
        here = (*context, witness)
        key = self._keys(here)
        if key not in scheme.said:
            scheme.said.add(key)
            self._say(scheme, here, born + 1)

    def _say(self, scheme: Scheme, names: Names, born: int) -> None:
        """Instantiate a scheme at names."""
        d = self.unknowns.terms
        pairs = list(zip((*scheme.outer, *scheme.own), names, strict=True))
        self.instances += 1
        for fact in scheme.facts:
            self._add(d.put(fact, pairs))
        for index in scheme.brings_up:
            self._put(d.put(index, pairs), born + 1)
        # What stands deeper is worth less: there is the more of it.
        deeper = born + 1 if scheme.outer else born
        for inner in scheme.inner:
            inner.contexts.append((names, deeper))
        for shared, terms in scheme.uses:
            self._know_of(shared, tuple(d.put(term, pairs) for term in terms), deeper)
        for arrival, terms in scheme.calls:
            self._arrived.append((arrival, tuple(d.put(term, pairs) for term in terms), deeper))

    def _add(self, fact: Term) -> None:
        """Add a fact whose relevant Booleans are known."""
        assert self._looked == len(self.facts)
        self.facts.append(fact)
        self._looked += 1

    # --- formulas -------------------------------------------------------------------------------

    def between(self, low: Term, index: Term, high: Term) -> Term:
        """The condition that an integer lies in ``[low, high)``."""
        d = self.unknowns.terms
        return conjunction(
            d, [d.binary(BinaryOp.LE, low, index), d.binary(BinaryOp.LT, index, high)]
        )

    def implied(self, condition: Term, fact: Term) -> Term:
        """The implication of a fact by a condition."""
        return self.unknowns.terms.binary(BinaryOp.IMPLIES, condition, fact)
