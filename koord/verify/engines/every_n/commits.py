"""The store after a crowd's writes: each location by the robot that wins it. [T-EVERY-N]"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TypeAlias

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import Store
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.locations import Mask, joined, restricted
from koord.semantics.storage import (
    Many,
    Storage,
    Tree,
    many_of,
    merge_storage_known,
    remembering,
)
from koord.semantics.turns import Turned
from koord.syntax import core
from koord.syntax.analysis.footprint import WriteExtent
from koord.syntax.core import BinaryOp
from koord.syntax.types import (
    INT,
    ArrayType,
    RecordType,
    Robots,
    Type,
    is_by_robot,
    is_flat,
    part_types,
    within,
)
from koord.verify.encoding.choices import racy_places
from koord.verify.encoding.terms import Term, Terms
from koord.verify.engines.every_n.all_robots import ParameterisedSystem

#: Of variables with more locations than this it is not said who wrote which of them last.
MOST_RACING = 4


#: A location of a slot, and the robot that wrote it last.
LastWrite: TypeAlias = "tuple[int, tuple[int, ...], Term]"

#: The way down to locations of a variable: a position, or None for any robot's number.
Way: TypeAlias = "tuple[int | None, ...]"


class PossibleTurn(Struct, frozen=True):
    """A turn that a robot may take: its kind and event, and the condition that it is taken."""

    kind: int
    position: int
    chosen: Term
    turned: Turned[Term]


class Guards(Struct, frozen=True):
    """The locations that are written in atomic blocks only: by at most one robot in a round.

    ``classes`` are the lock classes of the blocks that write a slot; ``racy`` are the places that
    events write outside of any block, as the way down: a position, or None for any index.
    """

    classes: Mapping[int, int]
    racy: frozenset[tuple[int, Way]]

    @staticmethod
    def of(program: core.Program) -> Guards:
        """Find the guarded locations of a program's events. [ATOMIC]"""
        slots = {entry.variable.name: entry.variable.slot for entry in program.allwrite}
        classes = {slots[name]: c.index for c in program.lock_classes for name in c.variables}
        return Guards(classes, frozenset(_way(place) for place in racy_places(program)))

    def is_racy(self, slot: int, place: Way = ()) -> bool:
        """Return whether robots may write (a part of, all of) a location at the same time."""
        return any(
            slot == its_slot and all(a is None or a == b for a, b in zip(way, place, strict=False))
            for its_slot, way in self.racy
        )


NO_GUARDS = Guards({}, frozenset())


def _way(place: core.Place) -> tuple[int, Way]:
    way = (step.position if isinstance(step, core.FieldStep) else None for step in place.steps)
    return place.variable.slot, tuple(way)


class Commits(Struct):
    """The commit of all robots' writes into a store.

    ``moves`` are the turns that a robot may take; ``everybody`` takes one of them in INIT.
    """

    world: ParameterisedSystem
    store: Store[Term]
    moves: Callable[[Term], list[PossibleTurn]]
    guards: Guards
    label: str
    everybody: bool = False
    winners: dict[int, Term] = field(default_factory=dict)
    _laws: list[Callable[[Term], Term]] = field(default_factory=list)
    _known: list[Term] = field(default_factory=list)
    _last: list[LastWrite] = field(default_factory=list)

    def know(self, robot: Term) -> None:
        """Assert for a robot, whose moves are being computed, the facts about every robot."""
        if not self.world.d.open:
            self._known.append(robot)
        for law in self._laws:
            self.world.book.note(law(robot))

    def _require(self, law: Callable[[Term], Term]) -> None:
        """Assert a fact for every robot whose moves are computed, now or later."""
        self._laws.append(law)
        for robot in self._known:
            self.world.book.note(law(robot))

    def entries(self, slot: int) -> Storage[Term]:
        """An allread variable after the round: every robot's own entry. [T-SNAPSHOT] [ALLREAD]"""
        before = self.store.allread[slot]
        assert isinstance(before, Many)
        d = self.world.d

        def at(robot: Term) -> Storage[Term]:
            self.world.book.name(robot)
            entry = before.at(robot)
            for k, move in enumerate(self.moves(robot)):
                own: Storage[Term] = entry
                if slot in move.turned.allread:
                    copy = move.turned.robot.copy.allread[slot]
                    assert isinstance(copy, Many)
                    own = copy.at(robot)
                # What is no robot has no entry, so that nobody ever asks what is in it.
                certain = self.everybody and k == 0
                entry = own if certain else merge_storage_known(d, move.chosen, own, entry)
            return entry

        return many_of(before.crowd, at)

    def everything(self, slot: int) -> Storage[Term]:
        """An allwrite variable after the round. [T-ONE-WINNER] [T-COMMIT]"""
        return self.world.naming(self._after_all(slot))

    def _after_all(self, slot: int) -> Storage[Term]:
        if not self._is_written(slot):
            return self.store.allwrite[slot]
        if slot in self.guards.classes and not self.guards.is_racy(slot):
            return self._put(slot, self.winner(self.guards.classes[slot]))
        return self._raced(slot)

    def winner(self, lock_class: int) -> Term:
        """The robot that enters a lock class in this round, if any does. [T-ONE-WINNER]"""
        if lock_class not in self.winners:
            with self.world.book.about(0):
                self._choose(lock_class)
        return self.winners[lock_class]

    def _choose(self, lock_class: int) -> None:
        winner = self.winners[lock_class] = self._somebody(f"winner {lock_class}")
        d, book = self.world.d, self.world.book

        def alone(robot: Term) -> Term:
            same = d.binary(BinaryOp.EQ, robot, winner)
            return book.implied(self.enters(lock_class, robot), same)

        self._require(alone)

    def enters(self, lock_class: int, robot: Term) -> Term:
        """The condition that a robot enters a lock class."""
        d = self.world.d
        return disjunction(
            d,
            [
                d.binary(BinaryOp.AND, move.chosen, move.turned.entered[lock_class])
                for move in self.moves(robot)
                if lock_class in move.turned.entered
            ],
        )

    def _somebody(self, name: str) -> Term:
        """A fresh name of a robot."""
        world = self.world
        robot = world.d.fresh(f"{name} {self.label}", INT)
        world.book.note(world.book.between(0, robot, world.crowd.count))
        world.book.name(robot)
        return robot

    def _is_written(self, slot: int) -> bool:
        """Return whether any robot may write a variable in this round, from a look at one robot."""
        seen: list[bool] = []

        def look(robot: Term) -> Term:
            seen.extend(slot in move.turned.allwrite for move in self.moves(robot))
            return True

        self.world.book.glimpse(look)
        return any(seen)

    def _put(self, slot: int, robot: Term) -> Storage[Term]:
        """The variable with one robot's writes applied."""
        d, after = self.world.d, self.store.allwrite[slot]
        for move in self.moves(robot):
            mask = restricted(d, move.turned.allwrite.get(slot), move.chosen)
            if mask is not None:
                after = joined(d, after, move.turned.robot.copy.allwrite[slot], mask)
        return after

    # --- races ----------------------------------------------------------------------------------

    def _raced(self, slot: int) -> Storage[Term]:
        """A variable with races: each location as its last writer left it."""
        before = self.store.allwrite[slot]
        type_ = self.world.program.allwrite[slot].variable.type
        if is_flat(type_) and any(map(is_by_robot, within(type_))):
            self.world.book.state(1, partial(self._has_last_writer, slot, type_))
            return self._last_written(slot, before, partial(self._last_writer, slot))
        places = locations(before) if is_flat(type_) else []
        racing = [place for place in places if self._writer_of_class(slot, place) is None]
        if not places or len(racing) > MOST_RACING:
            with self.world.d.depending_on(None):
                name = f"raced {self.world.program.allwrite[slot].variable.name} {self.label}"
                return self.world.unknowns.storage(name, type_, before, WriteExtent.WHOLE)
        writers: dict[tuple[Term, ...], Term] = {}
        for place in racing:
            writer = writers[place] = self._somebody(f"last {slot}")
            self._require(self._nobody_else(slot, place, writer))
            for other in self._last:
                self._same((slot, place, writer), other)
            self._last.append((slot, place, writer))
        return self._last_written(slot, before, lambda place, _: writers[place])

    def _has_last_writer(self, slot: int, type_: Type, robots: tuple[Term, ...]) -> Term:
        """The fact that what a robot writes, in a race for elements, has a last writer."""
        (robot,), found = robots, []
        for move in self.moves(robot):
            for place, way in places_of(type_, move.turned.allwrite.get(slot)):
                if self._writer_of_class(slot, way) is None:
                    last = self._last_writer(slot, place, way)
                    found.append(
                        self.world.book.implied(
                            self.writes(slot, place, robot), self.writes(slot, place, last)
                        )
                    )
        return conjunction(self.world.d, found)

    def _writer_of_class(self, slot: int, way: Way) -> Term | None:
        """The only robot that may write some locations, if they are written in blocks only."""
        lock_class = self.guards.classes.get(slot)
        if lock_class is None or self.guards.is_racy(slot, way):
            return None
        return self.winner(lock_class)

    def _last_writer(self, slot: int, place: tuple[Term, ...], way: Way) -> Term:
        """The last robot that writes a location, if one does; a function of its indices."""
        world = self.world
        indices = tuple(index for index, step in zip(place, way, strict=True) if step is None)
        with world.d.depending_on(indices):
            robot = world.d.fresh(f"last {slot} {way} {self.label}", INT)
        world.book.note(world.book.between(0, robot, world.crowd.count))
        world.book.name(robot, generation=1)
        return robot

    def _last_written(
        self,
        slot: int,
        before: Storage[Term],
        racer: Callable[[tuple[Term, ...], Way], Term],
        place: tuple[Term, ...] = (),
        way: Way = (),
    ) -> Storage[Term]:
        """A location, and all below it, as the last robot that writes it leaves it. [T-COMMIT]

        ``racer`` is the last to write where there are races.
        """
        if isinstance(before, Many):
            at = before.at

            def element(i: Term) -> Storage[Term]:
                return self._last_written(slot, at(i), racer, (*place, i), (*way, None))

            return many_of(before.crowd, remembering(element))
        if isinstance(before, Tree):
            return Tree(
                tuple(
                    self._last_written(slot, part, racer, (*place, k), (*way, k))
                    for k, part in enumerate(before.parts)
                )
            )
        d = self.world.d
        after: Storage[Term] = before
        writer = self._writer_of_class(slot, way)
        if writer is None:
            writer = racer(place, way)
        for move in self.moves(writer):
            mask = move.turned.allwrite.get(slot)
            if mask is not None:
                written = conjunction(d, [move.chosen, masked(d, mask, place)])
                theirs = part_at(move.turned.robot.copy.allwrite[slot], place)
                after = merge_storage_known(d, written, theirs, after)
        return after

    def _nobody_else(
        self, slot: int, place: tuple[int, ...], writer: Term
    ) -> Callable[[Term], Term]:
        """A fact, as a function of a robot: if it wrote a location, the last writer did."""

        def law(robot: Term) -> Term:
            theirs = self.writes(slot, place, robot)
            return self.world.book.implied(theirs, self.writes(slot, place, writer))

        return law

    def _same(self, one: LastWrite, other: LastWrite) -> None:
        """Assert one order: last writers of two locations that each wrote both are one robot."""
        d, (slot, place, writer), (its_slot, its_place, its_writer) = self.world.d, one, other
        both = d.binary(
            BinaryOp.AND,
            self.writes(its_slot, its_place, writer),
            self.writes(slot, place, its_writer),
        )
        same = d.binary(BinaryOp.EQ, writer, its_writer)
        self.world.book.note(self.world.book.implied(both, same))

    def writes(self, slot: int, place: tuple[Term, ...], robot: Term) -> Term:
        """The condition that a robot writes a location."""
        d = self.world.d
        found = []
        for move in self.moves(robot):
            mask = move.turned.allwrite.get(slot)
            if mask is not None:
                found.append(conjunction(d, [move.chosen, masked(d, mask, place)]))
        return disjunction(d, found)


# --- locations of flat variables: the positions of parts, from the outside in --------------------


def locations(storage: Storage[Term], above: tuple[int, ...] = ()) -> list[tuple[int, ...]]:
    """The atoms of a variable."""
    if not isinstance(storage, Tree):
        return [above]
    return [
        place
        for position, part in enumerate(storage.parts)
        for place in locations(part, (*above, position))
    ]


def places_of(
    type_: Type, mask: Mask[Term] | None, place: tuple[Term, ...] = (), way: Way = ()
) -> Iterator[tuple[tuple[Term, ...], Way]]:
    """The atoms of a flat variable that a mask is about; of arrays over robots, element by element.

    An array over robots that is written as a whole is left out.
    """
    match type_:
        case _ if mask is None:
            return
        case ArrayType(element=element, size=Robots.ALL):
            for index, below in mask.elements:
                yield from places_of(element, below, (*place, index), (*way, None))
        case RecordType() | ArrayType():
            size = type_.size if isinstance(type_, ArrayType) else 0
            assert isinstance(size, int)
            for k, part in enumerate(part_types(type_, size)):
                below = mask.parts[k] if k < len(mask.parts) else None
                if mask.whole is not False:
                    below = replace(below, whole=True) if below is not None else Mask(True)
                yield from places_of(part, below, (*place, k), (*way, k))
        case _:
            yield place, way


def part_at(storage: Storage[Term], place: tuple[Term, ...]) -> Storage[Term]:
    """The part of a variable at a place that exists."""
    for step in place:
        assert isinstance(storage, Tree)
        if isinstance(storage, Many):
            storage = storage.at(step)
        else:
            assert isinstance(step, int)
            storage = storage.parts[step]
    return storage


def masked(d: Terms, mask: Mask[Term] | None, place: tuple[Term, ...]) -> Term:
    """The condition that a mask covers an atom."""
    if mask is None:
        return False
    found = [mask.whole]
    if mask.parts:
        assert isinstance(place[0], int)
        found.append(masked(d, mask.parts[place[0]], place[1:]))
    for index, below in mask.elements:
        here = d.binary(BinaryOp.EQ, index, place[0])
        found.append(conjunction(d, [here, masked(d, below, place[1:])]))
    return disjunction(d, found)
