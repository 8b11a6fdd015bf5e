"""Instrumented robots: deployed robots that report their actions, to be judged. [RECORDING]

A robot tells as things happen, in values of the semantics, and before anybody else can know of
them: so what a robot did that is killed is known as well.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from koord.refinement.inquiry import Inquiry
from koord.refinement.reports import (
    Acted,
    Began,
    Coordinated,
    GaveUp,
    Kept,
    Left,
    Sensed,
    Stood,
    Stumbled,
    Told,
    TurnAnswers,
    Undeclared,
    shortened,
)
from koord.refinement.running import Compiled, size_of
from koord.refinement.tracing_host import TracingHost
from koord.refinement.translation import Translation, to_written
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.journal import Recollection
from koord.runtime.deploy.member import Member, Platform
from koord.runtime.proposals import INIT_ROUND, Admitted, Decision, EventFault, Faulted, Proposal
from koord.runtime.protocol.messages import LogEntry
from koord.runtime.robot import Robot, Turn
from koord.semantics.recordings import Answer, Reading, Start
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.system import System

#: What a robot says that gave up.
GAVE_UP = "gave up"


class Witness(TracingHost):
    """The host of a deployed robot, which reports to the judge in values of the semantics.

    ``starts`` are those that do not hang on the host, by robot and attribute.
    """

    host: Platform

    def __init__(
        self,
        host: Platform,
        made: Compiled,
        system: System,
        starts: Mapping[tuple[int | None, str], Any],
        tell: Callable[[Told], None],
    ) -> None:
        shapes = {name: s for one in made.classes for name, s in one.EXTERNALS.items()}
        super().__init__(host, Translation(system, made.names), shapes, self._note)
        self.starts = starts
        self.made = made
        self.say = tell
        self.round_of: Callable[[Turn], int] = lambda turn: INIT_ROUND

    def _note(self, turn: Turn, given: Start | Reading | Answer) -> None:
        match given:
            case Start():
                self.say(Began(given))
            case Reading():
                self.say(Sensed(self.round_of(turn), given))
            case Answer():
                self.say(TurnAnswers(self.round_of(turn), given))

    def answered(self, answer: Answer) -> None:
        """Report an answer that a contract asked for."""
        self._note(Turn.ENV, answer)

    def started_with(self, answer: Answer) -> None:
        """Report an answer that an assumption asked for."""
        self.say(TurnAnswers(INIT_ROUND, answer))

    def stood(self, round_: int, robot: Robot) -> None:
        self.say(Stood(round_, self.translation.robot(robot)))

    def kept(self, round_: int, robot: Robot, event: int | None) -> None:
        places = self.made.places
        written = tuple(to_written(one, places[one.place]) for one in robot.outcome(event))
        self.say(Kept(round_, written))

    def start(self, robot: int | None, name: str) -> Any:
        if (robot, name) not in self.starts:
            return super().start(robot, name)
        value = self.starts[robot, name]
        self.say(Began(self.translation.start(robot, name, value)))
        return value


class GaveUpError(Exception):
    """Raised where a robot cannot go on, and nothing under test is to blame."""


class InstrumentedRobot(Member):
    """A deployed robot that reports its actions.

    It gives up if its host does, or if a value is larger than ``largest``. Raises GaveUpError.
    """

    def __init__(self, robot: Robot, witness: Witness, largest: int | None = None) -> None:
        """Make a member of a robot whose program asks through a witness."""
        super().__init__(robot, witness.host)
        self._largest = largest
        self._witness = witness
        self._from_journal: Proposal | None = None
        self._witness.round_of = self._round_of
        self._inquiry = Inquiry(self._witness.host, self._witness.translation, robot.pid)

    def _round_of(self, turn: Turn) -> int:
        return self.round - 1 - self._turns if turn is Turn.ENV else self.round

    def propose(self, round_: int) -> Proposal | None:
        if self._largest is not None and size_of(self.robot) > self._largest:
            raise self._given_up(())
        before = self._proposal
        try:
            made = super().propose(round_)
        except KoordError as error:
            raise self._given_up(error.diagnostics) from error
        if made is not None and made is not before and round_ != INIT_ROUND:
            self._witness.stood(round_, self.robot)
            if round_ == INIT_ROUND + 1:
                self._inquiry.of_start(self.robot, self._witness.started_with)
        return made

    def _given_up(self, why: tuple[Diagnostic, ...]) -> GaveUpError:
        self._witness.say(GaveUp(why))
        return GaveUpError(GAVE_UP)

    def _begin(self) -> EventFault | None:
        fault = super()._begin()
        if fault is not None:
            self._witness.say(Undeclared())
        return fault

    def _sense(self) -> EventFault | None:
        fault = super()._sense()
        if fault is not None:
            self._witness.say(Stumbled(self._round_of(Turn.ENV), fault))
        return fault

    def _evolve(self) -> EventFault | None:
        before = self._inquiry.before(self.robot)
        fault = super()._evolve()
        if before is not None and fault is None:
            self._inquiry.make(before, self.robot, self._witness.answered)
        return fault

    def recall(self, what: Recollection) -> None:
        self._from_journal = None if what.page is None else what.page.proposal
        super().recall(what)

    def decided(self, round_: int, proposals: Sequence[Proposal | None]) -> Decision:
        self._witness.say(Coordinated(round_, time.monotonic()))
        return super().decided(round_, proposals)

    def commit(self, entry: LogEntry, kept: Admitted | None) -> None:
        self._witness.say(Acted(shortened(entry.decision)))
        super().commit(entry, kept)

    def _act(self, kept: Admitted | None, changed: dict[str, Any]) -> None:
        if kept is not None and not self.mute:
            self._tell_output(kept.event)
        super()._act(kept, changed)

    def _end(self, faulted: Faulted, kept: Admitted | None) -> None:
        if not self.mute and (kept is not None or faulted.robot == self.robot.pid):
            self._tell_output(faulted.event if kept is None else kept.event)
        super()._end(faulted, kept)

    def _tell_output(self, event: int | None) -> None:
        """Report output from before a crash, which the journal does not have."""
        if self._proposal is not None and self._proposal is not self._from_journal:
            self._witness.kept(self._proposal.round, self.robot, event)

    def finish(self) -> None:
        """Take the environment's turn after the last round, to observe the final state."""
        if not (self.mute or self.fault is not None or self.round == INIT_ROUND):
            try:
                fault = self._sense()
            except KoordError as error:
                self._given_up(error.diagnostics)
                return
            if fault is None:
                self._witness.stood(self.round, self.robot)
        self._witness.say(Left(self.round))


def instrumented(
    job: Job, pid: int, made: Compiled, system: System, tell: Callable[[Told], None]
) -> InstrumentedRobot:
    """Make a robot as ``koord deploy`` does, that reports its actions."""
    host = job.platform(pid)
    witness = Witness(host, made, system, {}, tell)
    robot = job.program_of(pid)(pid, job.kinds, job.delta_s, witness)
    return InstrumentedRobot(robot, witness)
