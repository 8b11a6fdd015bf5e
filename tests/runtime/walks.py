"""Random walks through the transitions of the protocol."""

from __future__ import annotations

from random import Random

from msgspec.structs import replace

from koord.runtime.exploration.claims import InvariantViolation
from koord.runtime.exploration.exploring import Explored, Search
from koord.runtime.exploration.world import (
    Act,
    ExplorationBounds,
    Explorer,
    ProtocolState,
    Transition,
)
from koord.runtime.protocol.events import Timer
from koord.runtime.protocol.setup import Setup, Timing

#: How often a random walk takes a crash, and a timer, if it can.
CRASHES, TIMERS = 0.03, 0.1


def wander(
    bounds: ExplorationBounds, seed: int, walks: int, length: int, setup: Setup | None = None
) -> Explored:
    """Random walks through the same transitions: deeper than everything can be looked at.

    Every message that was ever sent can still arrive, so a walk is as unlucky as a network can be.
    """
    setup = setup if setup is not None else Setup(bounds.robots, Timing.zero())
    return Walks(Explorer(setup, bounds)).walk(Random(seed), walks, length)


class Walks(Search):
    """Random walks, with whatever a search checks of each transition."""

    def walk(self, random: Random, walks: int, length: int) -> Explored:
        start = self.explorer.initial()
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
                self.transitions += 1
                broken = next(self.broken(world, transition), None)
                if broken is not None:
                    lines = tuple(self.explorer.tell(t.robot, t.cause) for t in story)
                    return self._walked(len(seen), depth, InvariantViolation(broken, lines))
                world = transition.world
                seen.add(world)
                deepest = max(deepest, depth)
        return self._walked(len(seen), deepest, None)

    def _chosen(self, world: ProtocolState, random: Random) -> Transition | None:
        """A transition; now and then a crash. A majority that remembers is left."""
        crashes: list[Transition] = []
        others: list[Transition] = []
        remembering = sum(
            local.disk.roster[local.pid] == local.disk.incarnation
            for local in map(self.explorer.locals.__getitem__, world.locals)
        )
        may_lose = remembering > self.explorer.setup.majority
        for transition in self.explorer.transitions(world):
            if transition.cause is Act.CRASH:
                crashes.append(transition)
            elif may_lose or transition.cause is not Act.LOST:
                others.append(transition)
        if crashes and random.random() < CRASHES:
            return random.choice(crashes)
        timers = [t for t in others if isinstance(t.cause, Timer)]
        if timers and random.random() < TIMERS:
            return random.choice(timers)
        return random.choice(others) if others else None

    def _walked(self, states: int, depth: int, violation: InvariantViolation | None) -> Explored:
        found = self.explored(depth, complete=False, violation=violation)
        return replace(found, states=states)
