"""Who goes first, who skips, which event is chosen: what the semantics leaves to the schedule."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from random import Random
from typing import Protocol

from koord.runtime.deciding import rotating
from koord.runtime.robot import Robot


class Schedule(Protocol):
    """The choices of the rounds of a run."""

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        """The ranks of a round: every robot once, the first one first."""
        ...

    def events(self, robot: Robot) -> Iterable[int] | None:
        """In which order a robot tries its events; None: as they stand in the program."""
        ...

    def willing(self, robot: Robot) -> bool:
        """Whether a robot runs an event if it may."""
        ...


class Deployed:
    """What robots do when they are deployed: a rotating rank, the first enabled event, no skips."""

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        return rotating(round_, robots)

    def events(self, robot: Robot) -> Iterable[int] | None:
        return None

    def willing(self, robot: Robot) -> bool:
        return True


@dataclass(frozen=True, slots=True)
class AtRandom:
    """Any order, any enabled event, now and then a skip: all that the rules allow."""

    rng: Random
    skips_percent: int = 15

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        ranks = list(range(robots))
        self.rng.shuffle(ranks)
        return tuple(ranks)

    def events(self, robot: Robot) -> Iterable[int] | None:
        positions = list(range(len(robot.EVENTS)))
        self.rng.shuffle(positions)
        return positions

    def willing(self, robot: Robot) -> bool:
        return self.rng.randrange(100) >= self.skips_percent
