"""Who goes first, who skips, which event is chosen: what the semantics leaves to the schedule."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from typing import Protocol

from msgspec import Struct, field

from koord.runtime.deciding import rotating
from koord.runtime.proposals import Proposal
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

    def hears(self, proposal: Proposal) -> bool:
        """Whether a proposal is there when the round is decided; nobody asks of urgent ones."""
        ...


class Deployed:
    """What robots do when they are deployed: a rotating rank, the first enabled event, no skips."""

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        return rotating(round_, robots)

    def events(self, robot: Robot) -> Iterable[int] | None:
        return None

    def willing(self, robot: Robot) -> bool:
        return True

    def hears(self, proposal: Proposal) -> bool:
        return True


class AtRandom(Struct, frozen=True):
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

    def hears(self, proposal: Proposal) -> bool:
        return True


#: With crashes, a robot goes in so many percent of its rounds, for so many rounds at most.
_GOES_PERCENT, _LONGEST_AWAY = 10, 5


class Unheard(Struct):
    """A schedule on a bad network: proposals are lost, and robots are away for some rounds."""

    inner: Schedule
    rng: Random
    loss: float
    crashes: bool
    _away: dict[int, int] = field(default_factory=dict)

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        return self.inner.order(round_, robots)

    def events(self, robot: Robot) -> Iterable[int] | None:
        return self.inner.events(robot)

    def willing(self, robot: Robot) -> bool:
        return self.inner.willing(robot)

    def hears(self, proposal: Proposal) -> bool:
        robot = proposal.robot
        if proposal.round < self._away.get(robot, 0):
            return False
        if self.crashes and self.rng.randrange(100) < _GOES_PERCENT:
            self._away[robot] = proposal.round + self.rng.randint(1, _LONGEST_AWAY)
            return False
        return self.rng.random() >= self.loss
