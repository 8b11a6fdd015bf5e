"""Policies: schedulers that choose the next move, and runs that follow one. [SELECT] [SKIP]"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import Protocol

from msgspec import Struct

from koord.sampling.monitors import Monitor
from koord.sampling.running import ProgramTurn, Run
from koord.semantics.recordings import Recording, Step
from koord.semantics.rounds import IllegalStepError
from koord.traces.trace import Violation


class Policy(Protocol):
    """A scheduler: it chooses which robot moves next, and how."""

    def move(self, run: Run, waiting: tuple[int, ...]) -> ProgramTurn:
        """Choose a move of one of the waiting robots. It is made if the rules allow."""
        ...


class First:
    """The schedule of the runtime: robots in order, each with its first enabled event."""

    def move(self, run: Run, waiting: tuple[int, ...]) -> ProgramTurn:
        robot = waiting[0]
        events = run.enabled(robot)
        return ProgramTurn(robot, events[0] if events else None)


class AtRandom(Struct, frozen=True):
    """A random schedule: any robot, any of its enabled events, now and then a skip."""

    rng: Random
    skips_percent: int = 15

    def move(self, run: Run, waiting: tuple[int, ...]) -> ProgramTurn:
        robot = self.rng.choice(waiting)
        events = run.enabled(robot)
        skips = self.rng.randrange(100) < self.skips_percent and run.may_skip(robot)
        return ProgramTurn(robot, None if skips or not events else self.rng.choice(events))


class TakenStep(Struct, frozen=True):
    """A step of a run, and the event that the robot could not run because a lock was taken."""

    step: Step
    lost: str | None = None


def take(run: Run, move: ProgramTurn) -> TakenStep:
    """Make a move; one that loses a lock becomes a skip or, if that is illegal, another event.

    Raises IllegalStepError if the move is not allowed for another reason.
    """
    try:
        return TakenStep(run.make(move))
    except IllegalStepError as refused:
        if refused.rule != "ATOMIC" or move.event is None:
            raise
    lost = run.system.agent(move.robot).events[move.event].name
    others = [
        ProgramTurn(move.robot, event) for event in run.enabled(move.robot) if event != move.event
    ]
    for instead in (ProgramTurn(move.robot, None), *others):
        try:
            return TakenStep(run.make(instead), lost)
        except IllegalStepError as refused:
            if refused.rule not in ("SKIP", "ATOMIC"):
                raise
    raise AssertionError("a robot can neither skip nor run an event")


class Play(Struct):
    """A run by a policy with monitors: ``steps`` makes it; then ``violation`` is known."""

    run: Run
    policy: Policy
    rounds: int
    watch: Monitor
    violation: Violation | None = None

    def steps(self) -> Iterator[TakenStep]:
        """Yield the steps, up to a fault, a violation, the last round, or until all robots stopped.

        Raises KoordError where an assumption, a contract or a summary cannot be met.
        """
        yield from self._observed(TakenStep(self.run.begin()))
        while not self.is_over:
            waiting = self.run.waiting
            if waiting:
                yield from self._observed(take(self.run, self.policy.move(self.run, waiting)))
            else:
                yield from self._observed(TakenStep(self.run.evolve()))

    def _observed(self, taken: TakenStep) -> Iterator[TakenStep]:
        self.violation = self.watch.after(taken.step)
        yield taken

    @property
    def is_over(self) -> bool:
        """True if no step can follow: a fault, a violation, the last round, all stopped."""
        if self.violation is not None or self.run.configuration.fault is not None:
            return True
        begun = len(self.run.waiting) < self.run.system.robots
        return not begun and (self.run.round >= self.rounds or self.run.all_stopped)

    def recording(self) -> Recording:
        """The recording of the run."""
        return self.run.recording(checks=self.violation is not None)
