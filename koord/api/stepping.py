"""Stepping: runs in which the caller picks each robot and event, with undo."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from koord.api.programs import Loadable, Program, program_of
from koord.api.robots import Robots, Seconds, delta_of, fleet_of, system_of
from koord.api.run import Ending, HowToRun, RunSession, session_of
from koord.api.traces import Trace, sources_of
from koord.sampling.made_rounds import TakenStep
from koord.sampling.policies import First, take
from koord.sampling.running import ProgramTurn, Run, RunState
from koord.semantics.recordings import Step
from koord.traces.trace import Numbers, Violation, assembled


class Option(Struct, frozen=True):
    """A possible next turn: of a robot, with one of its events or a skip.

    What ``loses`` would enter a lock that is taken, and cannot be made.
    """

    move: ProgramTurn
    event: str | None
    loses: bool

    @property
    def robot(self) -> int:
        """The robot of the turn."""
        return self.move.robot


class Shift(Struct, frozen=True):
    """A step that was made, with the state before it."""

    before: RunState
    taken: TakenStep


class Stepper(Struct):
    """A run by hand: look at the :meth:`options`, :meth:`make` one of them, :meth:`undo` it.

    >>> stepper = koord.step("task.krd")
    >>> stepper.make(stepper.options()[0])
    """

    program: Program
    session: RunSession
    taken: list[Step] = field(default_factory=list)
    _past: list[RunState] = field(default_factory=list)

    @property
    def run(self) -> Run:
        """The run in its present state."""
        return self.session.play.run

    def begin(self) -> Step:
        """Begin the run. Raises KoordError where no start meets the assumptions."""
        return self._noted(self.run.begin())

    @property
    def rounds(self) -> int:
        """The number of rounds after which the run ends."""
        return self.session.play.rounds

    @property
    def violation(self) -> Violation | None:
        """The first violation of the run, if there is one by now."""
        return self.session.play.violation

    @property
    def is_over(self) -> bool:
        """True if no step can follow: a fault, a violation, the last round, all stopped."""
        return self.session.play.is_over

    def options(self) -> tuple[Option, ...]:
        """The possible next turns; none where the environment's turn is next."""
        return tuple(Option(move, self._name(move), self.run.loses(move)) for move in self._moves())

    def _moves(self) -> Iterator[ProgramTurn]:
        for robot in self.run.waiting:
            yield from (ProgramTurn(robot, event) for event in self.run.enabled(robot))
            if self.run.may_skip(robot):
                yield ProgramTurn(robot, None)

    def _name(self, move: ProgramTurn) -> str | None:
        if move.event is None:
            return None
        return self.run.system.agent(move.robot).events[move.event].name

    def make(self, option: Option) -> Shift:
        """Make one of the turns. Raises IllegalStepError if the rules do not allow it."""
        moment = self.run.moment
        step = self.run.make(option.move)
        return self._shift(moment, TakenStep(step))

    def finish_round(self) -> Iterator[Shift]:
        """Let the remaining robots of the round move as the runtime would."""
        policy = First()
        while self.run.waiting and not self.is_over:
            moment = self.run.moment
            yield self._shift(moment, take(self.run, policy.move(self.run, self.run.waiting)))

    def evolve(self) -> Shift:
        """Take the environment's turn, which ends the round."""
        moment = self.run.moment
        return self._shift(moment, TakenStep(self.run.evolve()))

    def _shift(self, before: RunState, taken: TakenStep) -> Shift:
        self._past.append(before)
        self._noted(taken.step)
        return Shift(before, taken)

    def _noted(self, step: Step) -> Step:
        self.taken.append(step)
        self.session.play.violation = self.session.play.watch.after(step)
        return step

    def undo(self) -> bool:
        """Undo the last program turn, also across the end of a round.

        Whether there was one.
        """
        if not self._past:
            return False
        while self._past:
            self.run.go_back(self._past.pop())
            if self.taken.pop().rule != "ENV-TRANS":
                break
        self.session.play.violation = None
        return True

    @property
    def ending(self) -> Ending:
        """The present state of the run."""
        return Ending.of(self.run, self.violation)

    def trace(self) -> Trace:
        """The trace of the run so far."""
        recording = self.run.recording(checks=self.violation is not None)
        sources, run = sources_of(self.program), self.run
        return Trace(
            assembled(sources, run.system, run.numbers, recording, self.taken, self.violation)
        )


def step(
    program: Loadable,
    *,
    robots: Robots = None,
    rounds: int = 20,
    delta_s: Seconds = None,
    numbers: Numbers | str = Numbers.EXACT,
    seed: int = 0,
) -> Stepper:
    """Begin a run by hand. The arguments are those of :func:`koord.run`, and so are the errors.

    >>> stepper = koord.step("task.krd", robots=2)
    """
    loaded = program_of(program)
    system = system_of(loaded.core, fleet_of(robots), delta_of(delta_s))
    how = HowToRun(rounds, numbers=Numbers(numbers), traced=False)
    stepper = Stepper(loaded, session_of(loaded, system, how, seed, None))
    stepper.begin()
    return stepper
