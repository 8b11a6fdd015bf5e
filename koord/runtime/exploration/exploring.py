"""Exploring all interleavings, and checking the invariants in each state."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from random import Random

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.exploration.claims import (
    Accepted,
    BrokenInvariant,
    acted_rightly,
    agree,
    lasting,
    one_winner,
    valid,
)
from koord.runtime.exploration.world import (
    DOWN,
    Act,
    Cause,
    ExplorationBounds,
    Explorer,
    ProtocolState,
    Transition,
)
from koord.runtime.protocol.events import Timer
from koord.runtime.protocol.messages import Acknowledge, Held
from koord.runtime.protocol.setup import Setup, Timing

#: How often a random walk takes a crash, and a timer, if it can.
CRASHES, TIMERS = 0.03, 0.1


class InvariantViolation(Struct, frozen=True):
    """An invariant that does not hold, and what led to it."""

    broken: BrokenInvariant
    story: tuple[str, ...]


class Explored(Struct, frozen=True):
    """What was seen."""

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
    """Everything that can happen within the bounds, breadth first, until something is broken."""
    setup = setup if setup is not None else Setup(bounds.robots, Timing.zero())
    return _Search(Explorer(setup, bounds)).run()


def wander(
    bounds: ExplorationBounds, seed: int, walks: int, length: int, setup: Setup | None = None
) -> Explored:
    """Random walks through the same transitions: deeper than everything can be looked at.

    Every message that was ever sent can still arrive, so a walk is as unlucky as a network can be.
    """
    setup = setup if setup is not None else Setup(bounds.robots, Timing.zero())
    return _Search(Explorer(setup, bounds)).walk(Random(seed), walks, length)


class _Search:
    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self._bounds = explorer.bounds
        self._from: dict[ProtocolState, tuple[ProtocolState, int, Cause] | None] = {}
        self._entries: set[bytes] = set()
        self._epochs: set[int] = set()
        self._transitions = 0
        self._lasting: set[tuple[int, int]] = set()

    def run(self) -> Explored:
        start = self._explorer.initial()
        self._from[start] = None
        layer = deque([start])
        depth = 0
        while layer:
            if self._bounds.depth is not None and depth == self._bounds.depth:
                return self._explored(depth, complete=False)
            depth += 1
            following: deque[ProtocolState] = deque()
            for world in layer:
                for transition in self._explorer.transitions(world):
                    self._transitions += 1
                    broken = next(self._broken(world, transition), None)
                    if broken is not None:
                        violation = InvariantViolation(broken, self._story(world, transition))
                        return self._explored(depth, complete=False, violation=violation)
                    if transition.world not in self._from:
                        self._from[transition.world] = (
                            world,
                            transition.robot,
                            transition.cause,
                        )
                        following.append(transition.world)
                if len(self._from) > self._bounds.states:
                    return self._explored(depth, complete=False)
            layer = following
        return self._explored(depth, complete=True)

    def walk(self, random: Random, walks: int, length: int) -> Explored:
        start = self._explorer.initial()
        seen = {start}
        deepest = 0
        for _ in range(walks):
            world = start
            story: list[Transition] = []
            for depth in range(1, length + 1):
                transition = self._chosen(world, random)
                if transition is None:
                    break
                story.append(transition)
                self._transitions += 1
                broken = next(self._broken(world, transition), None)
                if broken is not None:
                    lines = tuple(self._explorer.tell(t.robot, t.cause) for t in story)
                    return self._walked(len(seen), depth, InvariantViolation(broken, lines))
                world = transition.world
                seen.add(world)
                deepest = max(deepest, depth)
        return self._walked(len(seen), deepest, None)

    def _chosen(self, world: ProtocolState, random: Random) -> Transition | None:
        """A transition; now and then a crash, if a majority that knows everything is left."""
        crashes: list[Transition] = []
        others: list[Transition] = []
        for transition in self._explorer.transitions(world):
            (crashes if transition.cause is Act.CRASH else others).append(transition)
        voters = sum(state.is_voter for state in self._explorer.states(world))
        may_crash = voters > self._explorer.setup.majority or not others
        if crashes and may_crash and random.random() < CRASHES:
            return random.choice(crashes)
        timers = [t for t in others if isinstance(t.cause, Timer)]
        if timers and random.random() < TIMERS:
            return random.choice(timers)
        return random.choice(others) if others else None

    def _walked(self, states: int, depth: int, violation: InvariantViolation | None) -> Explored:
        found = self._explored(depth, complete=False, violation=violation)
        return replace(found, states=states)

    def _explored(
        self, depth: int, *, complete: bool, violation: InvariantViolation | None = None
    ) -> Explored:
        return Explored(
            self._bounds,
            len(self._from),
            self._transitions,
            depth,
            complete,
            len(self._entries),
            len(self._epochs),
            len(self._explorer.parcels),
            violation,
        )

    def _broken(self, world: ProtocolState, transition: Transition) -> Iterator[BrokenInvariant]:
        after = transition.world
        for held in transition.committed:
            self._entries.add(held.digest)
            self._epochs.add(held.epoch)
            yield from self._of_commit(world, after, transition, held)
        for local in after.locals:
            yield from self._of_coordinator(local, after)
        if after.sent != world.sent:
            rival = self._explorer.contradiction(world, after)
            if rival is not None:
                yield BrokenInvariant("I-ONE-ENTRY", f"another entry of its epoch: {rival.message}")

    def _of_coordinator(self, local: int, world: ProtocolState) -> Iterable[BrokenInvariant]:
        """(I-LASTING), once for each state and history."""
        if local == DOWN or (local, world.acted) in self._lasting:
            return
        self._lasting.add((local, world.acted))
        yield from lasting(self._explorer.locals[local].state, self._explorer.acted(world))

    def _of_commit(
        self, world: ProtocolState, after: ProtocolState, transition: Transition, held: Held
    ) -> Iterable[BrokenInvariant]:
        yield from agree(self._explorer.acted(after)[held.round + 1].entry, held.entry)
        yield from one_winner(held.entry, self._explorer.propose)
        yield from valid(held.entry, self._explorer.propose)
        local = world.locals[transition.robot]
        roster = self._explorer.locals[local].state.roster
        accepted = [
            Accepted(m.epoch, parcel.sender, parcel.incarnation)
            for parcel in self._explorer.sent(after)
            if isinstance(m := parcel.message, Acknowledge) and m.digest == held.digest
        ]
        yield from acted_rightly(self._explorer.setup, held, roster, accepted)

    def _story(self, world: ProtocolState, last: Transition) -> tuple[str, ...]:
        lines = [self._explorer.tell(last.robot, last.cause)]
        while (before := self._from[world]) is not None:
            world, robot, cause = before
            lines.append(self._explorer.tell(robot, cause))
        return tuple(reversed(lines))
