"""Runs in progress, step by step by the rules, with a policy's schedule and sampled inputs.

The rules themselves stand in :mod:`rounds`; what is chosen and answered here becomes a recording,
and :func:`koord.semantics.recordings.execute` makes the same run of it again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from random import Random
from typing import Protocol

from msgspec import Struct, field
from msgspec.structs import replace

from koord.sampling.compiled.turns import Turns
from koord.sampling.initial_state_search import settle_readings, settled_start
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration, Turn
from koord.semantics.domain import Constant, Domain
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Answer, Concrete, Opening, Recording, Round, Step
from koord.semantics.rounds import (
    IllegalStepError,
    Stepped,
    enabled,
    evolved,
    faulted_start,
    may_skip,
    run_event,
    run_skip,
)
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table
from koord.syntax.diagnostics import refusal
from koord.syntax.system import Status, System
from koord.syntax.types import GrowingType, MapType, Type, contains
from koord.traces.trace import Numbers


class ProgramTurn(Struct, frozen=True):
    """A program turn: the position of the event, None for a skip."""

    robot: int
    event: int | None


class RunState(Struct, frozen=True):
    """The state of a run: its configuration, finished rounds, and the open round's recording."""

    configuration: Configuration[Constant]
    rounds: int = 0
    moves: tuple[ProgramTurn, ...] = ()
    answers: tuple[Answer, ...] = ()


class Ahead(Protocol):
    """A state between two rounds that a run has come to without its steps."""

    @property
    def round(self) -> int:
        """How many rounds are over."""

    def configuration(self) -> Configuration[Constant]:
        """The configuration there."""


class Run:
    """A run in progress. ``begin`` comes first; a ``moment`` can be saved and restored.

    A run that is not ``kept`` has no recording, and takes no more memory the longer it is.
    """

    def __init__(
        self,
        system: System,
        numbers: Numbers,
        inputs: SampledInputs,
        turns: Turns | None = None,
        *,
        kept: bool = True,
    ) -> None:
        self.system = system
        self.numbers = numbers
        self.inputs = inputs
        self.turns = Turns(numbers.domain, system) if turns is None else turns
        self._kept = kept
        self._grows = any(map(_grows, _types(system)))
        self._opening = Opening(())
        self._rounds: list[Round] = []
        self._moment: RunState | None = None
        self._ahead: Ahead | None = None

    @property
    def d(self) -> Domain[Constant]:
        return self.numbers.domain

    @property
    def moment(self) -> RunState:
        return replace(self._now, answers=tuple(self.inputs.answers.values()))

    @property
    def _now(self) -> RunState:
        if self._moment is None:
            assert self._ahead is not None, "begin comes first"
            self._moment = RunState(self._ahead.configuration(), self._ahead.round)
        return self._moment

    def go_back(self, moment: RunState) -> None:
        """Undo everything since a moment."""
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
        """The number of the open or next round."""
        if self._moment is None and self._ahead is not None:
            return self._ahead.round
        return self._now.rounds

    @property
    def waiting(self) -> tuple[int, ...]:
        """The robots that have not had their turn in this round."""
        if self.configuration.turn is Turn.ENV:
            return ()
        robots = self.configuration.robots
        return tuple(i for i, state in enumerate(robots) if state.turn is Turn.PROG)

    @property
    def begun(self) -> bool:
        """True if any robot has had a turn since INIT."""
        return self.round > 0 or bool(self._now.moves)

    @property
    def all_stopped(self) -> bool:
        return all(state.status == Status.STOPPED for state in self.configuration.robots)

    # --- steps ----------------------------------------------------------------------------------

    def begin(self, order: tuple[int, ...] | None = None) -> Step:
        """Run INIT with the robots in an order. Raises KoordError if no start can be found."""
        order = order if order is not None else tuple(range(self.system.robots))
        stepped = faulted_start(
            self.d,
            self.system,
            settled_start(self.d, self.system, self.inputs, order, self.turns),
        )
        self._opening = Opening(
            order, self.inputs.recorded_starts(), self.inputs.recorded_answers(checks=True)
        )
        self._arrive(stepped.configuration, 0)
        return Step("INIT", -1, None, None, stepped)

    def enabled(self, robot: int) -> list[int]:
        """The events that a robot may select; a lock may still be taken."""
        found = self.turns.enabled(self.configuration, robot, self.inputs)
        if found is not None:
            return found
        return enabled(self.d, self.system, self.configuration, robot, self.inputs)

    def may_skip(self, robot: int) -> bool:
        return may_skip(self.d, self.system, self.configuration, robot, self.inputs)

    def loses(self, move: ProgramTurn) -> bool:
        """Return whether an enabled event enters a lock class that is taken."""
        if move.event is None:
            return False
        try:
            run_event(self.d, self.system, self.configuration, move.robot, move.event, self.inputs)
        except IllegalStepError as refused:
            return refused.rule == "ATOMIC"
        return False

    def make(self, move: ProgramTurn) -> Step:
        """Take a program turn. Raises IllegalStepError if the rules do not allow it."""
        before, name = self._now, None
        if move.event is None:
            stepped = run_skip(self.d, self.system, before.configuration, move.robot, self.inputs)
        else:
            name = self.system.agent(move.robot).events[move.event].name
            stepped = self._ran(move.robot, move.event)
        self._check_lengths(stepped.configuration)
        moves = (*before.moves, move)
        self._moment = RunState(stepped.configuration, before.rounds, moves)
        rule = "SKIP" if move.event is None else "EVENT-TRANS"
        return Step(rule, before.rounds, move.robot, name, stepped)

    def _ran(self, robot: int, event: int) -> Stepped[Constant]:
        """Run an event, by code where that is certain. [EVENT-TRANS]"""
        configuration = self.configuration
        stepped = self.turns.run_event(configuration, robot, event, self.inputs)
        if stepped is not None:
            return stepped
        return run_event(self.d, self.system, configuration, robot, event, self.inputs)

    def evolve(self) -> Step:
        """Take the environment's turn. Raises KoordError if no readings can be found."""
        number, before, inputs = self.round, self.configuration, self.inputs
        settle_readings(
            self.d,
            self.system,
            before,
            inputs,
            lambda robot: self.turns.keeps_contracts(before.robots[robot], robot, inputs),
        )
        stepped = self.turns.evolved(before, inputs)
        if stepped is None:
            stepped = evolved(self.d, self.system, before, self.inputs)
        self._check_lengths(stepped.configuration)
        if self._kept:
            self._rounds.append(self._open_round(cut=False))
        self._arrive(stepped.configuration, number + 1)
        return Step("ENV-TRANS", number, None, None, stepped)

    # --- steps made elsewhere, by code ----------------------------------------------------------

    def go_ahead(self, ahead: Ahead, moves: Sequence[tuple[int, int | None]]) -> None:
        """Note a whole round, by its robots and events; the state is asked for if it is wanted."""
        if self._kept:
            events: list[int | None] = [None] * self.system.robots
            for robot, event in moves:
                events[robot] = event
            order = tuple(robot for robot, _ in moves)
            answers = self.inputs.recorded_answers()
            self._rounds.append(Round(order, tuple(events), (), answers))
        self._ahead, self._moment = ahead, None
        self.inputs.forget_round()
        self.inputs.look_later(ahead.configuration)

    def go_on(self, moment: RunState) -> None:
        """Go on from a moment later in the open round."""
        self._moment = moment

    def _check_lengths(self, after: Configuration[Constant]) -> None:
        if self._grows:
            check_lengths(self.configuration, after)

    def _arrive(self, configuration: Configuration[Constant], rounds: int) -> None:
        self._moment = RunState(configuration, rounds)
        self.inputs.forget_round()
        self.inputs.look_at(configuration)

    # --- the recording --------------------------------------------------------------------------

    def recording(self, *, checks: bool = False) -> Recording:
        """The run so far; a round that is open is cut.

        With ``checks`` the answers to the properties that were last looked at belong to it.
        """
        assert self._kept, "a run that is not kept has no recording"
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
        order = tuple(move.robot for move in self._now.moves)
        readings, answers = self.inputs.recorded_readings(), self.inputs.recorded_answers()
        if cut:
            # What was asked in turns that nobody took is no part of the run.
            readings = ()
            answers = tuple(a for a in answers if a.phase is Phase.PROG and a.robot in order)
        return Round(order, tuple(events), readings, answers, cut)


def new_run(
    system: System,
    numbers: Numbers,
    rng: Random,
    turns: Turns | None = None,
    *,
    kept: bool = True,
) -> Run:
    """Start a run whose every input depends on the generator only.

    With ``turns`` those of another run of the system are used again.
    """
    return Run(system, numbers, SampledInputs(Sampler(system, numbers, rng)), turns, kept=kept)


# --- values that grow without end: a run stops before the machine does ----------------------------


def _types(system: System) -> Iterator[Type]:
    """The types of all variables."""
    program = system.program
    for entry in (*program.allread, *program.allwrite):
        yield entry.variable.type
    for agent in program.agents:
        for entry in (*agent.locals, *(port.declaration for port in agent.ports)):
            yield entry.variable.type


def _grows(type_: Type) -> bool:
    return contains(type_, GrowingType) or contains(type_, MapType)


#: What one variable holds has at most so many parts. Fixed arrays have a limit of their own.
MOST_LISTED = 100_000


def check_lengths(before: Configuration[Constant], after: Configuration[Constant]) -> None:
    """Raise KoordError if a step made a list that is too long to go on with."""
    for old, new in zip(before.robots, after.robots, strict=True):
        if old is not new:
            _check_all(old.locals, new.locals)
            _check_all(old.ports, new.ports)
    _check_all(before.store.allread, after.store.allread)
    _check_all(before.store.allwrite, after.store.allwrite)


def _check_all(before: tuple[Storage[Constant], ...], after: tuple[Storage[Constant], ...]) -> None:
    scale = _Scale()
    for old, new in zip(before, after, strict=True):
        if old is not new and scale.listed(new) > MOST_LISTED:
            raise refusal(
                "K924",
                "koord run",
                f"a list has grown to more than {MOST_LISTED} parts",
                "run for fewer rounds, or take out of lists what is no more needed",
            )


class _Scale(Struct):
    """A counter of the elements of lists, including nested ones.

    A list may hold one and the same list many times over, and that one another: each is counted
    once, and the counts are added up.
    """

    _known: dict[int, int] = field(default_factory=dict)

    def listed(self, part: Storage[Constant] | Concrete) -> int:
        """Count the elements of the lists in storage or a value; other parts count zero."""
        match part:
            case Cell(value=value):
                return self.listed(value)
            case Tree(parts=parts):
                return sum(map(self.listed, parts))
            case Rec(fields=fields):
                return sum(map(self.listed, fields))
            case Seq(items=items):
                if id(part) not in self._known:
                    self._known[id(part)] = len(items) + sum(map(self.listed, items))
                return self._known[id(part)]
            case Table(entries=entries):
                inside = sum(self.listed(k) + self.listed(v) for k, v in entries)
                return 2 * len(entries) + inside
            case _:
                return 0
