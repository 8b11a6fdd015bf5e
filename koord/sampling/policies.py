"""Policies: schedulers that choose the next move, and runs that follow one. [SELECT] [SKIP]"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct
from msgspec.structs import replace

from koord.sampling.compiled.halts import Schedule, Stage
from koord.sampling.made_rounds import Chosen, MadeRound, TakenStep
from koord.sampling.monitors import Monitor
from koord.sampling.running import ProgramTurn, Run, RunState
from koord.semantics.recordings import Recording
from koord.semantics.rounds import IllegalStepError
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.diagnostics import KoordError
from koord.traces.trace import Violation

if TYPE_CHECKING:
    from koord.sampling.coded_rounds import CodedRounds


class Policy(Protocol):
    """A scheduler: it chooses which robot moves next, and how."""

    def move(self, run: Run, waiting: tuple[int, ...]) -> ProgramTurn:
        """Choose a move of one of the waiting robots. It is made if the rules allow."""
        ...

    def move_of(self, run: Run, robot: int) -> ProgramTurn:
        """Choose a move of one robot, which was chosen before."""
        ...


class First:
    """The schedule of the runtime: robots in order, each with its first enabled event."""

    def move(self, run: Run, waiting: tuple[int, ...]) -> ProgramTurn:
        return self.move_of(run, waiting[0])

    def move_of(self, run: Run, robot: int) -> ProgramTurn:
        events = run.enabled(robot)
        return ProgramTurn(robot, events[0] if events else None)


class AtRandom(Struct, frozen=True):
    """A random schedule: any robot, any of its enabled events, now and then a skip."""

    rng: Random
    skips_percent: int = 15

    def move(self, run: Run, waiting: tuple[int, ...]) -> ProgramTurn:
        return self.move_of(run, self.rng.choice(waiting))

    def move_of(self, run: Run, robot: int) -> ProgramTurn:
        events = run.enabled(robot)
        skips = self.rng.randrange(100) < self.skips_percent and run.may_skip(robot)
        return ProgramTurn(robot, None if skips or not events else self.rng.choice(events))


def _chosen(policy: Policy) -> Chosen | None:
    """How code follows a policy, if it can."""
    if type(policy) is First:
        return Chosen(Schedule.IN_ORDER)
    if type(policy) is AtRandom:
        return Chosen(Schedule.AT_RANDOM, policy.rng, policy.skips_percent)
    return None


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
    """A run by a policy with monitors: ``steps`` makes it; then ``violation`` is known.

    Where not all that the run did ``is_told`` yet, it is ahead of the last step.
    """

    run: Run
    policy: Policy
    rounds: int
    watch: Monitor
    violation: Violation | None = None
    is_told: bool = True
    _coded: CodedRounds | None = None

    def steps(self) -> Iterator[TakenStep]:
        """Yield the steps, up to a fault, a violation, the last round, or until all robots stopped.

        A step that is cancelled halfway does not count. Raises KoordError where an assumption, a
        contract or a summary cannot be met.
        """
        for part in self.parts():
            if isinstance(part, MadeRound):
                yield from part.steps()
            else:
                yield part

    def parts(self) -> Iterator[TakenStep | MadeRound]:
        """As :meth:`steps`, with whole rounds where code made them and no claim was broken."""
        yield self._begun()
        coded = self._coded
        while not self.is_over:
            if coded is not None and len(self.run.waiting) == self.run.system.robots:
                yield from self._by_code(coded)
                if coded.has_halted:
                    continue
            if not self.is_over:
                yield self._observed(self._turn)

    def _turn(self) -> TakenStep:
        if not self.run.waiting:
            return TakenStep(self.run.evolve())
        return take(self.run, self.policy.move(self.run, self.run.waiting))

    def _begun(self) -> TakenStep:
        taken = TakenStep(self.run.begin())
        chosen = _chosen(self.policy)
        if chosen is not None and self.watch.claims is not None:
            from koord.sampling.coded_rounds import CodedRounds  # short runs do without it

            self._coded = CodedRounds(self.run, chosen, lambda: self.watch.claims)
            if self._coded.holds():
                return taken
        self.violation = self.watch.after(taken.step)
        return taken

    def _by_code(self, coded: CodedRounds) -> Iterator[TakenStep | MadeRound]:
        """Make rounds by code, then the step that it is in doubt about."""
        try:
            yield from coded.rounds(self.rounds)
        except (KoordError, OutOfBudgetError):
            yield from self._opened(coded)
            raise
        yield from self._opened(coded)
        run, (stage, robot, event) = self.run, coded.halt
        if coded.sensed is not None:
            taken, moment = coded.sensed
            self.is_told = True
            yield self._observed(lambda: taken, moment)
        elif stage == Stage.GUARDS:
            yield self._observed(lambda: take(run, self.policy.move_of(run, robot)))
        elif stage in (Stage.EVENT, Stage.CLAIMS):
            yield self._observed(lambda: take(run, ProgramTurn(robot, event)))

    def _opened(self, coded: CodedRounds) -> Iterator[TakenStep]:
        """The steps of a round that halted, which the run has already taken."""
        for number, taken in enumerate(coded.opened, 1):
            self.is_told = number == len(coded.opened) and coded.sensed is None
            yield taken

    def _observed(self, make: Callable[[], TakenStep], moment: RunState | None = None) -> TakenStep:
        """Take a step and look at the claims; where that is cancelled, there was no step.

        The ``moment`` is that before the step, where it is not the present one.
        """
        moment = self.run.moment if moment is None else moment
        try:
            taken = replace(make(), before=moment.configuration)
            self.violation = self.watch.after(taken.step)
        except OutOfBudgetError:
            self.run.go_back(moment)
            raise
        return taken

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
