"""Prefixes of a round of any number of robots: the events that have run so far. [T-EVERY-N]

The counterpart of ``rounds.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.generic_turn import ParameterisedTurns, PerRobot
from koord.recheck.races import made
from koord.recheck.storage import Cell, Many, ParameterisedState, Robot, Storage, Store, Write
from koord.recheck.terms import INT, Term
from koord.recheck.turns import EventTurn
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import RecordType, Type, is_flat

Moves = list[list[PerRobot[EventTurn]]]


class ParameterisedPrefix(Struct, frozen=True):
    """A prefix of a round: ``state`` is its result. ``facts`` say that it is legal."""

    start: ParameterisedState
    moves: Moves  #: by kind, by event: what any robot of the kind may do
    state: ParameterisedState
    facts: tuple[Term, ...]
    winners: dict[int, Term]  #: of each lock class the one that may have entered it
    crowds: ParameterisedTurns
    ran: Callable[[Term], Term]  #: by robot: the position of the event that it has run, or -1

    def runs(self, robot: Term, position: int) -> Term:
        t = self.crowds.v.t
        return t.equal(self.ran(robot), t.integer(position))

    def ran_none(self, robot: Term) -> Term:
        return self.runs(robot, -1)

    def enters(self, lock: int, robot: Term) -> Term:
        """The condition that a robot has run an event that entered the class."""
        t, crowds = self.crowds.v.t, self.crowds
        found = []
        for kind in crowds.kinds:
            for position, move in enumerate(self.moves[kind]):
                entered = move.of(robot).entered.get(lock)
                if entered is not None:
                    here = crowds.world.is_of(crowds.v, robot, kind)
                    found.append(t.conjunction([here, self.runs(robot, position), entered]))
        return t.disjunction(found)

    def taken(self, lock: int) -> Term:
        return self.enters(lock, self.winners[lock])

    # --- the end of the program turns -----------------------------------------------------------

    def skips_legally(
        self, but: Term | None = None, mover: EventTurn | None = None
    ) -> Iterator[Term]:
        """Yield the conditions that robots that ran nothing were allowed to skip. [SKIP]

        ``mover`` is what one more robot, ``but``, runs on top.
        """
        t, crowds = self.crowds.v.t, self.crowds
        for kind in crowds.kinds:
            for move in self.moves[kind]:
                turn, robot = move.known, move.blank
                if not turn.event.urgent:
                    continue
                stopped = self.start.robot(kind, robot).stopped
                moved = [t.negation(self.ran_none(robot))]
                if but is not None:
                    moved.append(t.equal(robot, but))
                free = crowds.turns.not_obliged(turn, self.taken, mover)
                yield crowds.all_of(kind, robot, t.disjunction([stopped, *moved, free]))


def stopped_together(
    crowds: ParameterisedTurns, state: ParameterisedState
) -> tuple[Term, ParameterisedState]:
    """The condition that no robot is running, and the configuration with all stopped. [END-PROG]"""
    v, t = crowds.v, crowds.v.t
    with v.within() as robot:
        idle = t.conjunction(
            crowds.all_of(kind, robot, t.either(own.asked, own.stopped))
            for kind in crowds.kinds
            for own in [state.robot(kind, robot)]
        )

    def after(kind: int, k: Term) -> Robot:
        own = state.robot(kind, k)
        return replace(own, stopped=t.either(own.stopped, idle))

    return idle, ParameterisedState(after, state.store)


class PrefixBuilder(Struct):
    """A builder of prefixes of a round."""

    crowds: ParameterisedTurns
    start: ParameterisedState
    moves: Moves

    def gathering(self) -> ParameterisedPrefix:
        """Any legal prefix of a round, up to the whole of it."""
        crowds, v, t = self.crowds, self.crowds.v, self.crowds.v.t
        chosen = crowds.per_robot(lambda blank: v.symbol("has run", INT))
        facts: list[Term] = []
        for kind, mine in enumerate(self.moves):
            known = [
                t.at_most(t.integer(-1), chosen.known),
                t.less(chosen.known, t.integer(len(mine))),
            ]
            facts.append(crowds.all_of(kind, chosen.blank, t.conjunction(known)))
            for position, move in enumerate(mine):
                runs = t.equal(chosen.of(move.blank), t.integer(position))
                own = self.start.robot(kind, move.blank)
                may = crowds.turns.may_run(own, move.known)
                facts.append(crowds.all_of(kind, move.blank, t.implies(runs, may)))
        winners = {
            lock.index: v.symbol(f"winner of lock {lock.index}", INT)
            for lock in crowds.world.program.lock_classes
        }
        state = ParameterisedState(self._moved(chosen), Store((), ()))
        made_ = ParameterisedPrefix(self.start, self.moves, state, (), winners, crowds, chosen.of)
        for lock, winner in winners.items():
            facts.append(v.is_robot(winner))
            # One robot at most enters a class. [T-ONE-WINNER]
            facts.append(v.every(partial(_only, made_, lock, winner)))
        store = self._store(made_, facts)
        return replace(made_, state=replace(state, store=store), facts=tuple(facts))

    def _moved(self, chosen: PerRobot[Term]) -> Callable[[int, Term], Robot]:
        """A robot after the event that it ran, or unchanged. [END-EVENT] [SKIP]"""
        crowds, t, s = self.crowds, self.crowds.v.t, self.crowds.s

        def robot(kind: int, k: Term) -> Robot:
            agent, own = crowds.world.program.agents[kind], self.start.robot(kind, k)
            found = Robot(own.locals, own.ports, own.asked, own.stopped, t.integer(-1))
            for position, move in enumerate(self.moves[kind]):
                runs = t.equal(chosen.of(k), t.integer(position))
                found = s.merge_robots(runs, move.of(k).after, found, agent)
            return found

        return robot

    # --- the store ------------------------------------------------------------------------------

    def _store(self, round_: ParameterisedPrefix, facts: list[Term]) -> Store:
        program = self.crowds.world.program
        allread = tuple(
            self._entries(round_, slot, storage)
            for slot, storage in enumerate(self.start.store.allread)
        )
        allwrite = tuple(
            self._shared(round_, d, storage, facts)
            for d, storage in zip(program.allwrite, self.start.store.allwrite, strict=True)
        )
        return Store(allread, allwrite)

    def _entries(self, round_: ParameterisedPrefix, slot: int, storage: Storage) -> Many:
        """Allread entries, each as its robot left it. [T-SNAPSHOT] [ALLREAD]"""
        assert isinstance(storage, Many)

        def at(k: Term) -> Storage:
            whole = self._written_by(round_, k, Home.ALLREAD, slot, storage)
            assert isinstance(whole, Many)
            return whole.at(k)

        return Many(at)

    def _shared(
        self, round_: ParameterisedPrefix, d: core.Declaration, storage: Storage, facts: list[Term]
    ) -> Storage:
        """An allwrite variable after the prefix. [T-COMMIT]

        Writes in blocks of one class are the winner's; any other atom is as its last writer left
        it; a variable with lists in it is anything, if it is written.
        """
        crowds, slot = self.crowds, d.variable.slot
        if not any(self._writes(move.known, slot) for mine in self.moves for move in mine):
            return storage
        lock = crowds.world.guarding(slot)
        if lock is not None:
            return self._written_by(round_, round_.winners[lock], Home.ALLWRITE, slot, storage)
        v, t = crowds.v, crowds.v.t
        if not is_flat(d.variable.type):
            like = crowds.s.loosened(storage, d.variable.type)
            wrote = partial(self._wrote, round_, slot)
            nobody = v.every(lambda k: t.negation(wrote(k)))
            race = crowds.s.anything(f"{d.variable.name} after a race", d.variable.type, like)
            return crowds.s.merge(nobody, storage, race, d.variable.type)
        unset = crowds.s.unset(d.variable.type)
        marks = crowds.per_robot(
            lambda blank: self._written_by(round_, blank, Home.ALLWRITE, slot, unset)
        )
        return self._atoms(round_, d, storage, marks, (), facts)

    def _atoms(
        self,
        round_: ParameterisedPrefix,
        d: core.Declaration,
        storage: Storage,
        marks: PerRobot[Storage],
        way: tuple[int | Term, ...],
        facts: list[Term],
    ) -> Storage:
        """The atoms below a part; ``marks`` of a robot are set where it writes, with the value."""
        crowds, v, t = self.crowds, self.crowds.v, self.crowds.v.t
        if isinstance(storage, Many):
            at = storage.at
            return crowds.s.many(lambda k: self._atoms(round_, d, at(k), marks, (*way, k), facts))
        if not isinstance(storage, Cell):
            return tuple(
                self._atoms(round_, d, below, marks, (*way, k), facts)
                for k, below in enumerate(storage)
            )

        def mark(robot: Term) -> Cell:
            found = marks.of(robot)
            for step in way:
                if isinstance(found, Many):
                    assert isinstance(step, Term)
                    found = found.at(step)
                else:
                    assert isinstance(found, tuple)
                    assert isinstance(step, int)
                    found = found[step]
            assert isinstance(found, Cell)
            return found

        if mark(marks.blank).is_set.value is False:
            return storage
        type_, fields = _below(crowds, d.variable.type, way)
        lock = crowds.world.guarding(d.variable.slot, fields)
        if lock is not None:
            last = round_.winners[lock]
        else:
            last = v.symbol(f"last to write {d.variable.name}", INT)
            # Of an element of an array over robots there is one for each index.
            facts.append(t.for_all(v.scope, v.is_robot(last)))
            ordered = v.every(lambda k: t.implies(mark(k).is_set, mark(last).is_set))
            facts.append(t.for_all(v.scope, ordered))
        its = mark(last)
        value = v.merge(its.is_set, its.value, storage.value, type_)
        return Cell(t.either(storage.is_set, its.is_set), value)

    def _writes(self, turn: EventTurn, slot: int) -> bool:
        return any(_is_to(w, Home.ALLWRITE, slot) for w in turn.writes)

    def _wrote(self, round_: ParameterisedPrefix, slot: int, robot: Term) -> Term:
        """The condition that a robot has written a variable."""
        crowds, t = self.crowds, self.crowds.v.t
        return t.disjunction(
            t.conjunction(
                [crowds.world.is_of(crowds.v, robot, kind), round_.runs(robot, p), w.when]
            )
            for kind, mine in enumerate(self.moves)
            for p, move in enumerate(mine)
            if self._writes(move.known, slot)
            for w in move.of(robot).writes
            if _is_to(w, Home.ALLWRITE, slot)
        )

    def _written_by(
        self, round_: ParameterisedPrefix, robot: Term, home: Home, slot: int, storage: Storage
    ) -> Storage:
        """A variable with the writes of one robot."""
        crowds, t = self.crowds, self.crowds.v.t
        for kind, mine in enumerate(self.moves):
            for position, move in enumerate(mine):
                writes = [w for w in move.of(robot).writes if _is_to(w, home, slot)]
                if not writes:
                    continue
                here = crowds.world.is_of(crowds.v, robot, kind)
                when = t.both(here, round_.runs(robot, position))
                kept = [storage] * (slot + 1)
                store = Store(tuple(kept), ()) if home is Home.ALLREAD else Store((), tuple(kept))
                after = made(crowds.s, store, writes, when)
                storage = (after.allread if home is Home.ALLREAD else after.allwrite)[slot]
        return storage


def _is_to(w: Write, home: Home, slot: int) -> bool:
    return w.variable.home is home and w.variable.slot == slot


def _below(
    crowds: ParameterisedTurns, type_: Type, way: Sequence[int | Term]
) -> tuple[Type, list[int]]:
    """The type of a part, and the fields on the way to it."""
    fields = []
    for step in way:
        if isinstance(step, Term):
            type_ = crowds.v.element(type_)
            continue
        if isinstance(type_, RecordType):
            fields.append(step)
        type_ = crowds.v.inner(type_)[step]
    return type_, fields


def _only(round_: ParameterisedPrefix, lock: int, winner: Term, robot: Term) -> Term:
    """The facts that a robot that enters a class is its winner."""
    t = round_.crowds.v.t
    return t.implies(round_.enters(lock, robot), t.equal(robot, winner))
