"""The fixed parameters of a protocol run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import Struct, field

from koord.runtime.proposals import Decision, Proposal, decide, rotating

#: From the proposals of a round (None: not there) to what becomes of it. A host whose store can say
#: its digest puts in a function that fills that in.
Decide = Callable[[int, Sequence[Proposal | None]], Decision]


def decided(round_: int, proposals: Sequence[Proposal | None]) -> Decision:
    """The default rule of decision: admit robots in the order of their ranks. (R-DECIDE)"""
    there = {robot: p for robot, p in enumerate(proposals) if p is not None}
    return decide(round_, there, rotating(max(round_, 0), len(proposals)))


class Timing(Struct, frozen=True):
    """Timeouts in seconds. Safety depends on none of these."""

    delta_s: float  #: the length of a round; 0: as fast as it goes
    patience_s: float  #: how long the coordinator waits for proposals
    resend_s: float  #: before something unanswered is sent again, the first time
    silence_s: float  #: before a coordinator that is not heard is given up
    slot_s: float  #: between the robots that could stand in its place
    hold_s: float  #: how long a commit may be overdue before the robot holds

    @staticmethod
    def of(delta_s: float, robots: int, unhurried_s: float = 0.1) -> Timing:
        """Timeouts for rounds of this length. Many robots on one machine answer one after another.

        Rounds without a length are waited for as if they were ``unhurried_s`` long.
        """
        unit = max(delta_s, 0.02) if delta_s > 0 else unhurried_s
        return Timing(
            delta_s=delta_s,
            patience_s=0.7 * unit,
            resend_s=max(unit / 10, 0.005, min(0.0005 * robots, unit / 2)),
            silence_s=3 * unit,
            slot_s=min(unit / 4, 4 * unit / robots),
            hold_s=2 * unit,
        )

    @staticmethod
    def zero() -> Timing:
        """Timeouts of zero, for exploration, where timers expire at any time."""
        return Timing(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Setup(Struct, frozen=True):
    """The parameters of a run: number of robots, timeouts, and robots that must be heard."""

    robots: int
    timing: Timing
    owing: frozenset[int] = frozenset()  #: robots whose programs have urgent events (R-OWED)
    rounds: int | None = None  #: the run ends after so many rounds besides INIT
    first: int = 0  #: the coordinator of epoch 0
    kept: int = 64  #: so many committed entries are kept for those who ask (R-ASK)
    decide: Decide = field(default=decided)

    @property
    def majority(self) -> int:
        return self.robots // 2 + 1

    @property
    def everyone(self) -> frozenset[int]:
        return frozenset(range(self.robots))

    def coordinator(self, epoch: int) -> int:
        """The robot that an epoch belongs to."""
        return (self.first + epoch) % self.robots

    def epoch_above(self, epoch: int, robot: int) -> int:
        """The lowest epoch above the one given that belongs to a robot."""
        return epoch + 1 + (robot - self.coordinator(epoch + 1)) % self.robots

    def distance(self, robot: int, epoch: int) -> int:
        """The number of robots before this one in the succession of an epoch's coordinator."""
        return self.epoch_above(epoch, robot) - epoch - 1
