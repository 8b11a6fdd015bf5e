"""Summaries of loops over all robots. [T-LOOP]

The body runs once, for a blank number, from a memory in which everything that it changes is some
new term. How the new values come from the old ones tells what the whole loop does: a flag that is
set in some trip, the least of some values, the sum of some. What is not understood may be anything
afterwards, so that a proof never rests on it.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import TypeAlias

from msgspec import Struct

from koord.semantics.domain import conjunction, disjunction
from koord.semantics.every_number import NotFiniteError
from koord.semantics.machine import Machine, Memory
from koord.syntax.core import BinaryOp
from koord.syntax.faults import FaultKind
from koord.syntax.source import Span
from koord.syntax.types import FLOAT
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.functions import FunctionTerms, TripOracle
from koord.verify.engines.every_n.instantiation import Book
from koord.verify.engines.every_n.memories import UNLISTED, Path, scalars, with_scalars
from koord.verify.engines.every_n.sums import Sums

EXITS = (("broke",), ("returned",))

#: How often the body is looked at again because it changes more than was thought.
MOST_LOOKS = 5


class Facts(Struct, frozen=True):
    """Facts of all robots, to which loops add.

    ``overlooked`` are loops that were not understood: what they change may then be anything.
    """

    book: Book
    sums: Sums
    overlooked: list[Span]


class MachineLoop:
    """A loop over all robots in a machine."""

    def __init__(
        self,
        facts: Facts,
        m: Machine[Term],
        low: Term,
        high: Term,
        body: Callable[[Machine[Term], Term], None],
        span: Span,
    ) -> None:
        self.facts = facts
        self.m = m
        self.low = low
        self.high = high
        self.body = body
        self.span = span
        self._old: dict[Path, Term] = {}  #: what the changed scalars held before
        self._any: dict[Path, Term] = {}  #: the new terms in their place
        self._trips: dict[tuple[object, ...], tuple[tuple[Term, ...], Machine[Term]]] = {}
        self._kept = m.memory  #: what each trip starts from

    def run(self) -> None:
        """Apply the loop to the machine. [S-FOR] [S-BREAK]"""
        start = self.m.memory
        outer = start.broke
        start.broke = start.returned = False
        self._kept = start.copied()
        self._find_changes()
        exits = self._glimpse(lambda trip: self._leaves(trip.memory))
        self._log_faults(exits)
        if self.m.d.known(exits) is False:
            self._put_all(lambda path: self._summary(path))
        elif self._d.mentions(exits, list(self._any.values())):
            self._poison()
        else:
            self._leave()
        self.m.memory.broke = outer

    @property
    def _d(self) -> FunctionTerms:
        return self.facts.book.unknowns.terms

    # --- trips ----------------------------------------------------------------------------------

    def _trip(self, number: Term) -> Machine[Term]:
        """The machine after one trip from a memory in which anything may have changed."""
        d = self._d
        # What is new in a trip depends on the blanks that are open.
        key = tuple(d.key(term) for term in (number, *d.open))
        if key not in self._trips:
            self._trips[key] = (number, *d.open), self._trip_from(self._kept, number)
        return self._trips[key][1]

    def _trip_from(self, memory: Memory[Term], number: Term) -> Machine[Term]:
        inner = self.m.apart()
        inner.oracle = TripOracle(self.facts.book.unknowns)
        inner.memory = memory.copied()
        self.body(inner, number)
        if inner.entered or inner.allread_masks or inner.allwrite_masks:
            what = "a loop over all robots writes shared variables"
            raise NotFiniteError(self.span, what)
        for needed in inner.legality:
            self.facts.book.note(needed.condition)
        return inner

    def _glimpse(self, of: Callable[[Machine[Term]], Term]) -> Term:
        return self.facts.book.glimpse(lambda number: of(self._trip(number)))

    def _find_changes(self) -> None:
        """Find the scalars that the body changes, with a fresh term for each."""
        for _ in range(MOST_LOOKS):
            found: dict[Path, Term] = {}

            def look(trip: Machine[Term], found: dict[Path, Term] = found) -> Term:
                before = dict(scalars(self._kept))
                after = dict(scalars(trip.memory))
                for path in dict.fromkeys([*before, *after]):
                    if path in before and path in after and self._same(before[path], after[path]):
                        continue
                    if path not in EXITS and path[0] != "result":
                        found[path] = before.get(path, after.get(path, False))
                return True

            self._glimpse(look)
            new = {path: old for path, old in found.items() if path not in self._any}
            if not new:
                return
            held_before = dict(scalars(self._kept))
            for path, old in new.items():
                if path in held_before:
                    self._old[path] = old
                self._any[path] = self._d.fresh_like("loop", old)
            self._kept = with_scalars(self._kept, self._any)
            self._trips.clear()
        raise NotFiniteError(self.span, "a loop over all robots changes ever more")

    def _same(self, left: Term, right: Term) -> bool:
        d = self._d
        return left is right or d.key(left) == d.key(right)

    def _leaves(self, memory: Memory[Term]) -> Term:
        return self.m.either(memory.broke, memory.returned)

    def _log_faults(self, exits: Term) -> None:
        """Log the faults of a trip, if the loop reaches it. [FAULT]"""
        m, inside = self.m, self.facts.book.between

        def quiet(number: Term) -> Term:
            faults = [fault for fault, _ in self._trip(number).faults]
            there = inside(self.low, number, self.high)
            return m.negated(m.both(there, disjunction(m.d, faults)))

        if self._d.is_valid(self.facts.book.glimpse(quiet)):
            return

        def sound(number: Term) -> Term:
            trip = self._trip(number)
            faults = disjunction(m.d, [fault for fault, _ in trip.faults])
            if m.d.known(faults) is False:
                return True
            if self._d.mentions(faults, list(self._any.values())):
                raise NotFiniteError(self.span, "a loop over all robots may fault by and by")
            return m.negated(m.both(faults, self._stays(exits, number)))

        safe = self.facts.book.every(self.low, self.high, sound, latest=_ASKED)
        m.fault_unless(safe, FaultKind.UNSET, self.span, "in a loop over all robots")

    def _stays(self, exits: Term, number: Term) -> Term:
        """The condition that the loop is not left before a trip."""
        if self.m.d.known(exits) is False:
            return True

        def goes_on(earlier: Term) -> Term:
            return self.m.negated(self._leaves(self._trip(earlier).memory))

        return self.facts.book.every(self.low, number, goes_on)

    # --- leaving --------------------------------------------------------------------------------

    def _leave(self) -> None:
        """Summarise a loop that changes nothing except in the trip that leaves it.
        [S-BREAK] [S-RETURN]
        """
        m, d, book = self.m, self._d, self.facts.book
        if not self._only_when_left():
            self._poison()
            return

        def goes_on(number: Term) -> Term:
            return m.negated(self._leaves(self._trip(number).memory))

        start, left = m.memory, self._memory_when_left()
        if left is None:
            through, last = book.first(self.low, self.high, goes_on)
            left = self._trip_from(start, last).memory
        else:
            through = book.every(self.low, self.high, goes_on)
        left.broke = False
        m.memory = start if d.known(through) is True else left.merged(d, m.negated(through), start)

    def _memory_when_left(self) -> Memory[Term] | None:
        """The memory after the trip that leaves the loop, where it is the same whichever it is.

        Then nobody needs to know which it is. Of Booleans it is enough that they are the same in
        all trips that leave it; what the loop itself has introduced is gone. Of what cannot be
        listed nothing may change.
        """
        d, book, start = self._d, self.facts.book, self.m.memory
        before, found = dict(scalars(start)), list[Memory[Term]]()

        def look(number: Term) -> Term:
            # Where no trip changes what was there, each starts from the same.
            is_same = not any(path in self._old for path in self._any)
            looked = self._trip(number) if is_same else self._trip_from(start, number)
            trip = looked.memory.copied()
            gone = [old is None for old in start.bound]
            trip.bound = [None if no else new for no, new in zip(gone, trip.bound, strict=True)]
            leaves, same = self._leaves(trip), dict[Path, Term]()
            for path, value in scalars(trip):
                if path[-1] in UNLISTED and before.get(path) != value:
                    return True
                if not d.mentions(value, [number]):
                    continue
                if not d.is_boolean(value):
                    return True
                if self._same(value, leaves) or d.is_valid(book.implied(leaves, value)):
                    same[path] = True
                elif d.is_valid(book.implied(leaves, self.m.negated(value))):
                    same[path] = False
                else:
                    return True
            found.append(with_scalars(trip, same))
            return True

        book.glimpse(look)
        return found[0] if found else None

    def _only_when_left(self) -> bool:
        """Return whether no trip changes anything that counts, but the one that leaves the loop."""
        counting = [path for path in self._any if path in self._old]

        def check(trip: Machine[Term]) -> Term:
            after = dict(scalars(trip.memory))
            same = [
                self.m.d.binary(BinaryOp.EQ, after[path], self._any[path])
                for path in counting
                if path in after
            ]
            kept = conjunction(self.m.d, same)
            return self.m.either(self._leaves(trip.memory), kept)

        d = self._d
        return d.is_valid(self._glimpse(check))

    # --- going through --------------------------------------------------------------------------

    def _put_all(self, value: Callable[[Path], Term]) -> None:
        after = {path: value(path) for path in self._any}
        example: list[Memory[Term]] = []

        def look(trip: Machine[Term]) -> Term:
            example.append(trip.memory)
            return True

        self._glimpse(look)
        self.m.memory = with_scalars(self._shaped(example[0]), after)

    def _shaped(self, example: Memory[Term]) -> Memory[Term]:
        """The memory before the loop, with room for the variables that the loop introduces."""
        memory = self.m.memory.copied()
        for slot, storage in enumerate(memory.bound):
            if storage is None:
                memory.bound[slot] = example.bound[slot]
        return memory

    def _poison(self) -> None:
        """Havoc: the loop's changed scalars may hold anything, and the loop may have been left."""
        self.facts.overlooked.append(self.span)
        self._put_all(self._anything)
        if self._glimpse_returns():
            raise NotFiniteError(self.span, "a loop over all robots returns in a way of its own")

    def _glimpse_returns(self) -> bool:
        return self.m.d.known(self._glimpse(lambda trip: trip.memory.returned)) is not False

    def _anything(self, path: Path) -> Term:
        return self._d.fresh_like("any", self._any[path])

    def _summary(self, path: Path) -> Term:
        """The value of a scalar after all trips. [T-LOOP]"""
        if path not in self._old:
            return self._anything(path)
        change = LoopEffect(self, path)
        flag = self._d.is_boolean(self._any[path])
        found = change.as_flag() if flag else change.as_number()
        if found is None:
            self.facts.overlooked.append(self.span)
            return self._anything(path)
        return found

    def value_after(self, path: Path, number: Term) -> Term:
        """The value of a scalar after one trip."""
        return dict(scalars(self._trip(number).memory))[path]


class LoopEffect(Struct):
    """The effect of a loop on one scalar."""

    loop: MachineLoop
    path: Path

    def as_flag(self) -> Term | None:
        """Summarise a Boolean that some trips set, or some trips clear."""
        m, low, high = self.loop.m, self.loop.low, self.loop.high
        if self._is(self._put(self._seen(), False), False):
            stays = self._with(True)
            if self._reads_changes(stays):
                return None
            return m.both(self._old, self.loop.facts.book.every(low, high, stays))
        if self._is(self._put(self._seen(), True), True):
            comes = self._with(False)
            if self._reads_changes(comes):
                return None
            never = self.loop.facts.book.every(low, high, lambda k: m.negated(comes(k)))
            return m.either(self._old, m.negated(never))
        return None

    def as_number(self) -> Term | None:
        """Summarise a number that grows in each trip, or is the least or greatest of some."""
        d = self.loop.facts.book.unknowns.terms
        zero = 0 if d.is_integer(self._any) else d.const(0, FLOAT)
        added = self._with(zero)
        if not self._reads_changes(added):
            grown = self._glimpse(
                lambda k: d.binary(
                    BinaryOp.EQ, self._after(k), d.binary(BinaryOp.ADD, self._any, added(k))
                )
            )
            if d.is_valid(grown):
                total = self.loop.facts.sums.of(self.loop.low, self.loop.high, added)
                return d.binary(BinaryOp.ADD, self._old, total)
        for op in (BinaryOp.MIN, BinaryOp.MAX):
            found = self._extreme(op)
            if found is not None:
                return found
        return None

    # --- extremes -------------------------------------------------------------------------------

    def _extreme(self, op: BinaryOp) -> Term | None:
        d, m, book = self._d, self.loop.m, self.loop.facts.book
        for position in range(_MOST_PARTS):
            found = self._shape(op, position)
            if found is None:
                continue
            best = d.fresh_like("extreme", self._any)
            witness = d.fresh_like("witness", 0)
            book.name(witness)

            def bounded(k: Term, found: Found = found, best: Term = best) -> Term:
                takes, value = found(k)
                pair = (best, value) if op is BinaryOp.MIN else (value, best)
                return d.binary(BinaryOp.IMPLIES, takes, d.binary(BinaryOp.LE, *pair))

            book.note(self.loop.facts.book.every(self.loop.low, self.loop.high, bounded))
            first = (best, self._old) if op is BinaryOp.MIN else (self._old, best)
            book.note(d.binary(BinaryOp.LE, *first))
            takes, value = found(witness)
            there = book.between(self.loop.low, witness, self.loop.high)
            taken = conjunction(d, [there, takes, d.binary(BinaryOp.EQ, best, value)])
            book.note(m.either(d.binary(BinaryOp.EQ, best, self._old), taken))
            return best
        return None

    def _shape(self, op: BinaryOp, position: int) -> Found | None:
        """Match a scalar that becomes the lesser (greater) of itself and another term."""
        d = self._d

        def found(k: Term) -> tuple[Term, Term]:
            after = self._after(k)
            parts = (p for p in d.parts_like(after) if not d.mentions(p, self._changed))
            value = next(islice(parts, position, None), None)
            if value is None:
                return False, self._any
            one = 1 if op is BinaryOp.MIN else -1
            worse = d.binary(BinaryOp.ADD, value, one)
            takes = d.binary(BinaryOp.EQ, d.with_values(after, [(self._any, worse)]), value)
            return takes, value

        def right(k: Term) -> Term:
            takes, value = found(k)
            if d.known(takes) is False or d.mentions(takes, self._changed):
                return False
            other = d.binary(op, self._any, value)
            return d.binary(BinaryOp.EQ, self._after(k), d.ite(takes, other, self._any))

        return found if d.is_valid(self._glimpse(right)) else None

    # --- pieces ---------------------------------------------------------------------------------

    @property
    def _d(self) -> FunctionTerms:
        return self.loop.facts.book.unknowns.terms

    @property
    def _any(self) -> Term:
        return self.loop._any[self.path]

    @property
    def _old(self) -> Term:
        return self.loop._old[self.path]

    @property
    def _changed(self) -> list[Term]:
        return list(self.loop._any.values())

    def _after(self, number: Term) -> Term:
        return self.loop.value_after(self.path, number)

    def _seen(self) -> Term:
        return self._glimpse(self._after)

    def _glimpse(self, of: Callable[[Term], Term]) -> Term:
        return self.loop.facts.book.glimpse(of)

    def _put(self, term: Term, value: Term) -> Term:
        found: Term = self._d.with_values(term, [(self._any, value)])
        return found

    def _with(self, value: Term) -> Callable[[Term], Term]:
        """The value of a scalar after a trip, as a function of the trip, from a value before it."""
        return lambda number: self._put(self._after(number), value)

    def _reads_changes(self, of: Callable[[Term], Term]) -> bool:
        return bool(self._d.mentions(self._glimpse(of), self._changed))

    def _is(self, term: Term, value: bool) -> bool:
        return bool(self._d.known(term) is value)


#: That trips do not fault is said of the robots that a question names first. Each may be a trip
#: after one that leaves the loop, and of that one it would be said, too: ever more names.
_ASKED = 0

Found: TypeAlias = "Callable[[Term], tuple[Term, Term]]"

#: So many parts of a new value are tried as the one that it is the least of.
_MOST_PARTS = 6
