"""The store after the writes of one robot, or of several in any order. [T-COMMIT]"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec import Struct, field

from koord.recheck.storage import Cell, Storage, Storages, Store, Write
from koord.recheck.terms import INT, Term
from koord.syntax.core import Home
from koord.syntax.types import Type, is_flat


class WrittenPart(Struct, frozen=True):
    """The writes of one robot, under the condition ``when``."""

    robot: int
    when: Term
    writes: tuple[Write, ...]


def made(s: Storages, store: Store, writes: Iterable[Write], when: Term) -> Store:
    """Apply a robot's writes one after the other: ``S ⊕ W``."""
    allread, allwrite = list(store.allread), list(store.allwrite)
    for w in writes:
        kept = allread if w.variable.home is Home.ALLREAD else allwrite
        slot = w.variable.slot
        kept[slot] = _written(s, kept[slot], w, when)
    return Store(tuple(allread), tuple(allwrite))


def _written(s: Storages, storage: Storage, w: Write, when: Term) -> Storage:
    return s.put(storage, w.variable.type, w.locations, w.value, s.v.t.both(when, w.when))


class Racing(Struct):
    """A join of several robots' writes: in each atom the one of greatest rank wins.

    ``exclusive`` are the allwrite variables that one robot at most writes. Ranks are unknown and
    distinct; they are made when first needed.
    """

    s: Storages
    label: str
    exclusive: frozenset[int] = frozenset()
    facts: list[Term] = field(default_factory=list)
    _ranks: dict[int, Term] = field(default_factory=dict)

    def joined(self, store: Store, parts: Sequence[WrittenPart]) -> Store:
        allread, allwrite = list(store.allread), list(store.allwrite)
        raced: dict[int, list[tuple[WrittenPart, Write]]] = {}
        for part in parts:
            for w in part.writes:
                slot = w.variable.slot
                if w.variable.home is Home.ALLREAD:
                    allread[slot] = _written(self.s, allread[slot], w, part.when)
                else:
                    raced.setdefault(slot, []).append((part, w))
        for slot, writes in raced.items():
            type_ = writes[0][1].variable.type
            if slot in self.exclusive or len({part.robot for part, _ in writes}) == 1:
                for part, w in writes:
                    allwrite[slot] = _written(self.s, allwrite[slot], w, part.when)
            elif is_flat(type_):
                allwrite[slot] = self._won(allwrite[slot], type_, writes)
            else:
                allwrite[slot] = self._any(allwrite[slot], type_, writes)
        return Store(tuple(allread), tuple(allwrite))

    def _won(
        self, storage: Storage, type_: Type, writes: Sequence[tuple[WrittenPart, Write]]
    ) -> Storage:
        """Each atom as its last writer leaves it."""
        by_robot: dict[int, Storage] = {}
        for part, w in writes:
            before = by_robot.get(part.robot)
            marks = self.s.unset(type_) if before is None else before
            by_robot[part.robot] = _written(self.s, marks, w, part.when)
        nobody = self.s.v.t.integer(-1)
        ranked = [(self._rank(robot), marks) for robot, marks in by_robot.items()]
        return self._atoms(storage, type_, ranked, nobody)

    def _atoms(
        self,
        storage: Storage,
        type_: Type,
        ranked: Sequence[tuple[Term, Storage]],
        rank: Term,
    ) -> Storage:
        """``marks`` of a robot are set where it writes, with the value that it writes."""
        t, v = self.s.v.t, self.s.v
        if isinstance(storage, Cell):
            is_set, value = storage.is_set, storage.value
            for its_rank, marks in ranked:
                assert isinstance(marks, Cell)
                is_set = t.either(is_set, marks.is_set)
                wins = t.both(marks.is_set, t.less(rank, its_rank))
                value = v.merge(wins, marks.value, value, type_)
                rank = t.ite(wins, its_rank, rank)
            return Cell(is_set, value)
        assert isinstance(storage, tuple)
        below = []
        for k, (part_storage, part) in enumerate(zip(storage, v.inner(type_), strict=True)):
            inner = [(r, m[k]) for r, m in ranked if isinstance(m, tuple)]
            below.append(self._atoms(part_storage, part, inner, rank))
        return tuple(below)

    def _rank(self, robot: int) -> Term:
        if robot not in self._ranks:
            t = self.s.v.t
            rank = self.s.v.symbol(f"place of {robot} in the order of {self.label}", INT)
            self.facts.append(t.at_most(t.integer(0), rank))
            for other in self._ranks.values():
                self.facts.append(t.negation(t.equal(rank, other)))
            self._ranks[robot] = rank
        return self._ranks[robot]

    def _any(
        self, storage: Storage, type_: Type, writes: Sequence[tuple[WrittenPart, Write]]
    ) -> Storage:
        """Lists that several robots may write: any value, where one of them does."""
        t = self.s.v.t
        written = t.disjunction(t.both(part.when, w.when) for part, w in writes)
        name = f"{writes[0][1].variable.name} after a race"
        like = self.s.loosened(storage, type_)
        return self.s.merge(written, self.s.anything(name, type_, like), storage, type_)
