"""What a run has done: single steps, and whole rounds by code. [RECORDING]"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import TYPE_CHECKING

from msgspec import Struct

from koord.sampling.compiled.halts import Schedule
from koord.semantics.configurations import Configuration, Written
from koord.semantics.domain import Constant
from koord.semantics.recordings import Step
from koord.semantics.rounds import Stepped

if TYPE_CHECKING:
    from koord.sampling.compiled.round_log import RoundLog
    from koord.sampling.compiled.rounds import RoundCode


class TakenStep(Struct, frozen=True):
    """A step of a run, and the event that the robot could not run because a lock was taken.

    ``before`` is the configuration before the step, where it is not that after the last one told.
    """

    step: Step
    lost: str | None = None
    before: Configuration[Constant] | None = None


class MadeRound(Struct, frozen=True):
    """A whole round by code, after which all claims hold. Its steps are known until the next one.

    ``evolved`` is the environment's turn, where the rules took it.
    """

    number: int
    log: RoundLog
    code: RoundCode
    ran_before: tuple[int, ...]
    start: Configuration[Constant] | None = None
    evolved: Step | None = None

    def steps(self) -> Iterator[TakenStep]:
        """The steps of the round, one by one."""
        before = self.start
        if before is None:
            before = self.code.before(self.log, self.ran_before)
        for taken in turns_of(self.code, self.log, before, self.number):
            yield taken
            before = taken.step.configuration
        step = self.evolved
        if step is None:
            step = Step("ENV-TRANS", self.number, None, None, Stepped(self.configuration))
        yield TakenStep(step, before=before)

    @property
    def written(self) -> Iterator[tuple[int, Written[Constant]]]:
        """What robots wrote to streams in the round, in order."""
        for robot, *_, written, _ in self.log.turns:
            for one in written:
                yield robot, one

    @property
    def configuration(self) -> Configuration[Constant]:
        """The configuration after the round."""
        return (
            self.code.state.configuration() if self.evolved is None else self.evolved.configuration
        )


class Chosen(Struct, frozen=True):
    """How a schedule is followed: the generator that draws, and how often robots skip."""

    schedule: Schedule
    rng: Random | None = None
    skips_percent: int = 0


def turns_of(
    code: RoundCode, log: RoundLog, before: Configuration[Constant], number: int
) -> Iterator[TakenStep]:
    """The program turns of a log, as steps."""
    for turn, after in code.logged.turns(before, log):
        events = code.system.agent(turn.robot).events
        lost = None if turn.lost is None else events[turn.lost].name
        if turn.event is None:
            step = Step("SKIP", number, turn.robot, None, Stepped(after))
        else:
            name = events[turn.event].name
            stepped = Stepped(after, turn.written)
            step = Step("EVENT-TRANS", number, turn.robot, name, stepped)
        yield TakenStep(step, lost, before)
        before = after
