"""Runs in the making: step by step by the rules, with a policy to choose and a sampler to answer.

The rules themselves stand in :mod:`rounds`; what is chosen and answered here becomes a recording,
and :func:`koord.semantics.recording.execute` makes the same run of it again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from random import Random
from typing import Protocol

from koord.semantics.answering import SampledInputs
from koord.semantics.codec_values import LONGEST_NUMBER_BITS
from koord.semantics.configurations import Configuration, Status, System, Turn
from koord.semantics.domain import Constant, Domain
from koord.semantics.json_reader import refusal
from koord.semantics.oracle import Phase
from koord.semantics.recording import Answer, Concrete, Opening, Recording, Round, Step
from koord.semantics.rounds import (
    IllegalStepError,
    enabled,
    evolved,
    may_skip,
    run_event,
    run_skip,
)
from koord.semantics.sampling import Sampler
from koord.semantics.settling import settle_readings, settled_start
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.trace import Numbers, Violation
from koord.semantics.values import Rec, Seq, Table
from koord.semantics.watching import Watch


@dataclass(frozen=True, slots=True)
class Move:
    """A program turn: the position of the event, None for a skip."""

    robot: int
    event: int | None


@dataclass(frozen=True, slots=True)
class Moment:
    """A run so far: where it is, how many rounds are behind it, and what the open one recorded."""

    configuration: Configuration[Constant]
    rounds: int = 0
    moves: tuple[Move, ...] = ()
    answers: tuple[Answer, ...] = ()


@dataclass
class Run:
    """A run in the making. ``begin`` comes first; a ``moment`` can be kept and gone back to."""

    system: System
    numbers: Numbers
    inputs: SampledInputs
    _opening: Opening = field(default=Opening(()), init=False)
    _rounds: list[Round] = field(default_factory=list, init=False)
    _moment: Moment | None = field(default=None, init=False)

    @property
    def d(self) -> Domain[Constant]:
        return self.numbers.domain

    @property
    def moment(self) -> Moment:
        return replace(self._now, answers=tuple(self.inputs.answers.values()))

    @property
    def _now(self) -> Moment:
        assert self._moment is not None, "begin comes first"
        return self._moment

    def go_back(self, moment: Moment) -> None:
        """Undo everything since that moment."""
        self._moment = moment
        del self._rounds[moment.rounds :]
        self.inputs.forget_round()
        self.inputs.answers = {(a.phase, a.robot, a.key): a for a in moment.answers}
        self.inputs.look_at(moment.configuration)

    @property
    def configuration(self) -> Configuration[Constant]:
        return self._now.configuration

    @property
    def round(self) -> int:
        """The round that is open or comes next."""
        return self._now.rounds

    @property
    def waiting(self) -> tuple[int, ...]:
        """The robots that have not had their turn in this round."""
        if self.configuration.turn is Turn.ENV:
            return ()
        robots = self.configuration.robots
        return tuple(i for i, state in enumerate(robots) if state.turn is Turn.PROG)

    @property
    def all_stopped(self) -> bool:
        return all(state.status == Status.STOPPED for state in self.configuration.robots)

    # --- steps ----------------------------------------------------------------------------------

    def begin(self, order: tuple[int, ...] | None = None) -> Step:
        """INIT, with the robots in an order. Raises KoordError if no start can be found."""
        order = order if order is not None else tuple(range(self.system.robots))
        stepped = settled_start(self.d, self.system, self.inputs, order)
        self._opening = Opening(
            order, self.inputs.recorded_starts(), self.inputs.recorded_answers(checks=True)
        )
        self._arrive(stepped.configuration, 0)
        return Step("INIT", -1, None, None, stepped)

    def enabled(self, robot: int) -> list[int]:
        """The events that a robot may select; it may lose a lock all the same."""
        return enabled(self.d, self.system, self.configuration, robot, self.inputs)

    def may_skip(self, robot: int) -> bool:
        return may_skip(self.d, self.system, self.configuration, robot, self.inputs)

    def loses(self, move: Move) -> bool:
        """Whether an event that may be selected enters a lock class that is taken."""
        if move.event is None:
            return False
        try:
            run_event(self.d, self.system, self.configuration, move.robot, move.event, self.inputs)
        except IllegalStepError as refused:
            return refused.rule == "ATOMIC"
        return False

    def make(self, move: Move) -> Step:
        """A program turn. Raises IllegalStepError if the rules do not allow it."""
        before, name = self._now, None
        if move.event is None:
            stepped = run_skip(self.d, self.system, before.configuration, move.robot, self.inputs)
        else:
            name = self.system.agent(move.robot).events[move.event].name
            stepped = run_event(
                self.d, self.system, before.configuration, move.robot, move.event, self.inputs
            )
        check_lengths(before.configuration, stepped.configuration)
        moves = (*before.moves, move)
        self._moment = Moment(stepped.configuration, before.rounds, moves)
        rule = "SKIP" if move.event is None else "EVENT-TRANS"
        return Step(rule, before.rounds, move.robot, name, stepped)

    def evolve(self) -> Step:
        """The environment's turn. Raises KoordError if no readings can be found."""
        number, before = self.round, self.configuration
        settle_readings(self.d, self.system, before, self.inputs)
        stepped = evolved(self.d, self.system, before, self.inputs)
        check_lengths(before, stepped.configuration)
        self._rounds.append(self._open_round(cut=False))
        self._arrive(stepped.configuration, number + 1)
        return Step("ENV-TRANS", number, None, None, stepped)

    def _arrive(self, configuration: Configuration[Constant], rounds: int) -> None:
        self._moment = Moment(configuration, rounds)
        self.inputs.forget_round()
        self.inputs.look_at(configuration)

    # --- the recording --------------------------------------------------------------------------

    def recording(self, *, checks: bool = False) -> Recording:
        """The run so far; a round that is open is cut.

        With ``checks`` the answers to the properties that were last looked at belong to it.
        """
        opening, rounds = self._opening, list(self._rounds)
        asked = tuple(a for a in self.inputs.answers.values() if a.phase is Phase.CHECK)
        if self._now.moves:
            rounds.append(self._open_round(cut=True))
        if checks and rounds:
            rounds[-1] = replace(rounds[-1], answers=(*rounds[-1].answers, *asked))
        elif checks:
            opening = replace(opening, answers=(*opening.answers, *asked))
        return Recording(opening, tuple(rounds))

    def _open_round(self, *, cut: bool) -> Round:
        events: list[int | None] = [None] * self.system.robots
        for move in self._now.moves:
            events[move.robot] = move.event
        return Round(
            tuple(move.robot for move in self._now.moves),
            tuple(events),
            () if cut else self.inputs.recorded_readings(),
            self.inputs.recorded_answers(),
            cut,
        )


def new_run(system: System, numbers: Numbers, rng: Random) -> Run:
    """A run whose every answer hangs on the generator."""
    return Run(system, numbers, SampledInputs(Sampler(system, numbers, rng)))


# --- policies -----------------------------------------------------------------------------------


class Policy(Protocol):
    """Who moves next, and how."""

    def move(self, run: Run, waiting: tuple[int, ...]) -> Move:
        """A move of one of the robots that wait for their turn. It is made if the rules allow."""
        ...


class First:
    """What the runtime does: robots in order, and of each the first event that is enabled."""

    def move(self, run: Run, waiting: tuple[int, ...]) -> Move:
        robot = waiting[0]
        events = run.enabled(robot)
        return Move(robot, events[0] if events else None)


@dataclass(frozen=True, slots=True)
class AtRandom:
    """Any allowed move: any robot, any of its enabled events, now and then a skip."""

    rng: Random
    skips_percent: int = 15

    def move(self, run: Run, waiting: tuple[int, ...]) -> Move:
        robot = self.rng.choice(waiting)
        events = run.enabled(robot)
        skips = self.rng.randrange(100) < self.skips_percent and run.may_skip(robot)
        return Move(robot, None if skips or not events else self.rng.choice(events))


@dataclass(frozen=True, slots=True)
class Taken:
    """A step of a run, and the event that the robot could not run because a lock was taken."""

    step: Step
    lost: str | None = None


def take(run: Run, move: Move) -> Taken:
    """Make a move, or, where it loses a lock, a skip; where that is not allowed, another event.

    Raises IllegalStepError if the move is not allowed for another reason.
    """
    try:
        return Taken(run.make(move))
    except IllegalStepError as refused:
        if refused.rule != "ATOMIC" or move.event is None:
            raise
    lost = run.system.agent(move.robot).events[move.event].name
    others = [Move(move.robot, event) for event in run.enabled(move.robot) if event != move.event]
    for instead in (Move(move.robot, None), *others):
        try:
            return Taken(run.make(instead), lost)
        except IllegalStepError as refused:
            if refused.rule not in ("SKIP", "ATOMIC"):
                raise
    raise AssertionError("a robot can neither skip nor run an event")


@dataclass
class Play:
    """A run by a policy, watched: ``steps`` makes it, and then ``violation`` is known."""

    run: Run
    policy: Policy
    rounds: int
    watch: Watch
    violation: Violation | None = None

    def steps(self) -> Iterator[Taken]:
        """The steps, up to a fault, a violation, the last round, or until everyone has stopped.

        Raises KoordError where an assumption, a contract or a summary cannot be met.
        """
        yield from self._observed(Taken(self.run.begin()))
        while not self._over:
            waiting = self.run.waiting
            if waiting:
                yield from self._observed(take(self.run, self.policy.move(self.run, waiting)))
            else:
                yield from self._observed(Taken(self.run.evolve()))

    def _observed(self, taken: Taken) -> Iterator[Taken]:
        self.violation = self.watch.after(taken.step)
        yield taken

    @property
    def _over(self) -> bool:
        if self.violation is not None or self.run.configuration.fault is not None:
            return True
        begun = len(self.run.waiting) < self.run.system.robots
        return not begun and (self.run.round >= self.rounds or self.run.all_stopped)

    def recording(self) -> Recording:
        """The run as it was made."""
        return self.run.recording(checks=self.violation is not None)


# --- numbers that grow without end --------------------------------------------------------------


def check_lengths(before: Configuration[Constant], after: Configuration[Constant]) -> None:
    """Raise KoordError if a step made a number that is too long to go on with."""
    for old, new in zip(before.robots, after.robots, strict=True):
        if old is not new:
            _check_all(old.locals, new.locals)
            _check_all(old.ports, new.ports)
    _check_all(before.store.allread, after.store.allread)
    _check_all(before.store.allwrite, after.store.allwrite)


def _check_all(before: tuple[Storage[Constant], ...], after: tuple[Storage[Constant], ...]) -> None:
    for old, new in zip(before, after, strict=True):
        if old is not new and _bits(new) > LONGEST_NUMBER_BITS:
            raise refusal(
                "koord run",
                "K923",
                f"an exact number has grown to more than {LONGEST_NUMBER_BITS} bits",
                "run with --numbers double, or for fewer rounds",
            )


def _bits(part: Storage[Constant] | Concrete) -> int:
    """The length of the longest number in storage or a value."""
    match part:
        case int():
            return part.bit_length()
        case Fraction():
            return max(part.numerator.bit_length(), part.denominator.bit_length())
        case Cell(value=value):
            return _bits(value)
        case Tree(parts=parts):
            return max(map(_bits, parts), default=0)
        case Rec(fields=parts):
            return max(map(_bits, parts), default=0)
        case Seq(items=items):
            return max(map(_bits, items), default=0)
        case Table(entries=entries):
            return max((max(_bits(k), _bits(v)) for k, v in entries), default=0)
        case _:
            return 0
