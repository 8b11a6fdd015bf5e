"""Exploration of all interleavings, with the invariants checked in each state."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.runtime.exploration.claims import (
    Accepted,
    BrokenInvariant,
    InvariantViolation,
    acted_rightly,
    agree,
    lasting,
    one_winner,
    saved,
    valid,
)
from koord.runtime.exploration.world import (
    Cause,
    ExplorationBounds,
    Explorer,
    ProtocolState,
    Transition,
)
from koord.runtime.protocol.messages import Acknowledge, Held
from koord.runtime.protocol.setup import Setup, Timing


class Explored(Struct, frozen=True):
    """The result of an exploration: bounds, counts, and the violation, if any."""

    bounds: ExplorationBounds
    states: int
    transitions: int
    depth: int
    complete: bool  #: whether nothing within the bounds was left out
    committed: int  #: different entries committed, over all runs
    epochs: int  #: in how many epochs something was committed
    messages: int  #: different messages
    violation: InvariantViolation | None = None


def explore(bounds: ExplorationBounds, setup: Setup | None = None) -> Explored:
    """Explore all states within the bounds, breadth first, until an invariant is violated."""
    setup = setup if setup is not None else Setup(bounds.robots, Timing.zero())
    return Search(Explorer(setup, bounds)).run()


class Search:
    """A search through all transitions, with statistics."""

    def __init__(self, explorer: Explorer) -> None:
        self.explorer = explorer
        self.bounds = explorer.bounds
        self._from: dict[ProtocolState, tuple[ProtocolState, int, Cause] | None] = {}
        self._entries: set[bytes] = set()
        self._epochs: set[int] = set()
        self.transitions = 0
        self._lasting: set[tuple[int, int]] = set()
        self._disks: set[tuple[int, int]] = set()

    def run(self) -> Explored:
        start = self.explorer.initial()
        self._from[start] = None
        layer = deque([start])
        depth = 0
        while layer:
            if self.bounds.depth is not None and depth == self.bounds.depth:
                return self.explored(depth, complete=False)
            depth += 1
            following: deque[ProtocolState] = deque()
            for world in layer:
                for transition in self.explorer.transitions(world):
                    self.transitions += 1
                    broken = next(self.broken(world, transition), None)
                    if broken is not None:
                        violation = InvariantViolation(broken, self._story(world, transition))
                        return self.explored(depth, complete=False, violation=violation)
                    if transition.world not in self._from:
                        self._from[transition.world] = (
                            world,
                            transition.robot,
                            transition.cause,
                        )
                        following.append(transition.world)
                if len(self._from) > self.bounds.states:
                    return self.explored(depth, complete=False)
            layer = following
        return self.explored(depth, complete=True)

    def explored(
        self, depth: int, *, complete: bool, violation: InvariantViolation | None = None
    ) -> Explored:
        return Explored(
            self.bounds,
            len(self._from),
            self.transitions,
            depth,
            complete,
            len(self._entries),
            len(self._epochs),
            len(self.explorer.parcels),
            violation,
        )

    def broken(self, world: ProtocolState, transition: Transition) -> Iterator[BrokenInvariant]:
        after = transition.world
        for held in transition.committed:
            self._entries.add(held.digest)
            self._epochs.add(held.epoch)
            yield from self._of_commit(world, after, transition, held)
        for local in after.locals:
            yield from self._of_coordinator(local, after)
        if after.sent != world.sent:
            yield from self._of_disk(world, after, transition.robot)
            rival = self.explorer.contradiction(world, after)
            if rival is not None:
                yield BrokenInvariant("I-ONE-ENTRY", f"another entry of its epoch: {rival.message}")

    def _of_coordinator(self, local: int, world: ProtocolState) -> Iterable[BrokenInvariant]:
        """Yield committed entries that a coordinator lacks, once per state. (I-LASTING)"""
        state = self.explorer.locals[local].state
        if state is None or (local, world.acted) in self._lasting:
            return
        self._lasting.add((local, world.acted))
        yield from lasting(state, self.explorer.acted(world))

    def _of_disk(
        self, world: ProtocolState, after: ProtocolState, robot: int
    ) -> Iterable[BrokenInvariant]:
        """Yield what a robot says that is not on its disk, once per state. (I-SAVED)"""
        new = after.sent & ~world.sent
        local = after.locals[robot]
        if (local, new) in self._disks:
            return
        self._disks.add((local, new))
        at = self.explorer.locals[local]
        assert at.state is not None
        for parcel in self.explorer.these(new):
            yield from saved(parcel.message, parcel.incarnation, at.state, at.disk)

    def _of_commit(
        self, world: ProtocolState, after: ProtocolState, transition: Transition, held: Held
    ) -> Iterable[BrokenInvariant]:
        yield from agree(self.explorer.acted(after)[held.round + 1].entry, held.entry)
        yield from one_winner(held.entry, self.explorer.propose)
        yield from valid(held.entry, self.explorer.propose)
        state = self.explorer.locals[world.locals[transition.robot]].state
        assert state is not None
        accepted = [
            Accepted(m.epoch, parcel.sender, parcel.incarnation)
            for parcel in self.explorer.sent(after)
            if isinstance(m := parcel.message, Acknowledge) and m.digest == held.digest
        ]
        yield from acted_rightly(self.explorer.setup, held, state.roster, accepted)

    def _story(self, world: ProtocolState, last: Transition) -> tuple[str, ...]:
        lines = [self.explorer.tell(last.robot, last.cause)]
        while (before := self._from[world]) is not None:
            world, robot, cause = before
            lines.append(self.explorer.tell(robot, cause))
        return tuple(reversed(lines))
