"""Presumptions: a run with answers that only the rules ask for, and that nobody gave. [EXTERNAL]

A robot tells what its program asks. What summaries, assumptions and contracts ask besides is
chosen so that they hold, if they can: what nobody said accuses nobody. So a run is legal as far as
it is known, and whoever judges it says which statements were only presumed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.answer_search import AnswerSearch, Posed, Question, Verdict
from koord.refinement.claims import (
    Assumed,
    AssumedPart,
    Claim,
    InitialTurn,
    Kept,
    ProgramTurn,
)
from koord.refinement.completion import CompletedInputs, Where, asked_in, asking_contracts, by_place
from koord.sampling.conjuncts import conjuncts_of
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.environment import Ports, moved
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import (
    Answer,
    Concrete,
    Opening,
    RecordedInputs,
    Recording,
    Round,
)
from koord.semantics.rounds import IllegalStepError, evolved, initialised, run_event, run_skip
from koord.semantics.turns import declared
from koord.syntax import core
from koord.syntax.analysis.premises import PremiseKind
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import NOWHERE, Span
from koord.traces.trace import Trace

#: INIT, among the rounds of questions.
_INIT = -1


class Presumption(Struct, frozen=True):
    """An assumption or a contract that asks what nobody answered, and was not judged by that.

    The name of a contract has its module before it.
    """

    kind: PremiseKind
    name: str

    def __str__(self) -> str:
        return f"{self.kind.value} {self.name}"


class Presumed(Struct, frozen=True):
    """A trace with answers that nobody gave: ``choices`` are their questions."""

    trace: Trace
    presumptions: tuple[Presumption, ...]
    choices: frozenset[Question]


def presumed(trace: Trace, passed: Callable[[int], None] = lambda number: None) -> Presumed:
    """Complete a trace with answers that only the rules ask for, so that it is legal if it can be.

    A trace that breaks a rule all the same is completed up to there: replay will say where.
    ``passed`` hears of each round. Raises KoordError where it is not known whether it can be.
    """
    return _Presuming(trace).presumed(passed)


class _Presuming:
    """The run of a trace, from INIT on and round by round."""

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        self.system = trace.system
        self.program = trace.system.program
        recording = trace.recording
        rounds = (round_.answers for round_ in recording.rounds)
        told = (answer for answers in (recording.opening.answers, *rounds) for answer in answers)
        self.search = AnswerSearch(self.system, told)
        externals = self.program.externals
        self._has_summaries = self._asks(tuple((one.requires, one.ensures) for one in externals))
        self._asking = [asking_contracts(self.program, agent) for agent in self.program.agents]
        self._moving = [
            bool(self._asking[kind]) or self._asks(tuple(one.environment for one in agent.modules))
            for kind, agent in enumerate(self.program.agents)
        ]
        self._posed: list[Posed] = []
        self._made: dict[int, tuple[Answer, ...]] = {}  #: in the rules' turns, by round
        self._at: Configuration[Constant] | None = None  #: None: nothing more is looked at

    def _asks(self, part: object) -> bool:
        """Return whether a part of the program asks external functions."""
        return bool(asked_in(self.program, part))

    def presumed(self, passed: Callable[[int], None]) -> Presumed:
        recording = self.trace.recording
        try:
            self._open(recording.opening)
        except IllegalStepError:
            self._at = None
        rounds = []
        for number, round_ in enumerate(recording.rounds):
            rounds.append(self._round(number, round_))
            passed(number)
        extra = self._extra()
        opening = replace(
            recording.opening, answers=_joined(recording.opening.answers, extra[_INIT])
        )
        rounds = [
            replace(round_, answers=_joined(round_.answers, extra.get(number, {})))
            for number, round_ in enumerate(rounds)
        ]
        trace = replace(self.trace, recording=Recording(opening, tuple(rounds)))
        named = (_presumption(posed.claim) for posed in self._posed if posed.choices)
        presumptions = dict.fromkeys(one for one in named if one is not None)
        return Presumed(trace, tuple(presumptions), self.search.choices)

    def _extra(self) -> dict[int, dict[Where, Answer]]:
        """The answers that are not told, by round, with the values chosen in the end."""
        found: dict[int, dict[Where, Answer]] = {_INIT: {}}
        for number, made in self._made.items():
            found[number] = by_place(self._in_the_end(number, answer) for answer in made)
        for posed in self._posed:
            found.setdefault(posed.round, {}).update(by_place(posed.made))
        return found

    def _in_the_end(self, number: int, answer: Answer) -> Answer:
        if answer.function is None:
            return answer
        where = answer.phase, answer.robot, answer.key
        question = self.search.question(number, where, answer.function, answer.arguments)
        value = self.search.value(question)
        return answer if value is None else replace(answer, value=value)

    # --- the run ----------------------------------------------------------------------------------

    def _open(self, opening: Opening) -> None:
        starts = RecordedInputs(starts=opening.starts)
        turn = _Asked(self, _INIT, by_place(opening.answers), starts)
        inputs = turn.inputs()
        if self._has_summaries:
            store, _ = declared(DOUBLES, self.system, inputs)
            for robot in range(self.system.robots):
                turn.pose(InitialTurn(robot, store))
        at = initialised(DOUBLES, self.system, inputs, opening.order).configuration
        self._made[_INIT] = inputs.made
        if at.fault is not None:
            return
        for assumption in self.program.assumptions:
            if self._asks(assumption.condition):
                for part in conjuncts_of(self.system, assumption.condition):
                    turn.pose(AssumedPart(part, assumption.bound, at))
                turn.pose(Assumed(assumption, at))
        self._at = at

    def _round(self, number: int, round_: Round) -> Round:
        """Follow a round; return it with readings of sensors that nobody read."""
        at, self._at = self._at, None
        if at is None:
            return round_
        turn = _Asked(self, number, by_place(round_.answers), RecordedInputs())
        inputs = turn.inputs()
        made = [inputs]
        try:
            at = self._program_turns(at, round_, turn, inputs)
            if round_.cut or at.fault is not None:
                return round_
            readings = self.search.readings(at, round_.readings)
            round_ = replace(round_, readings=readings)
            turn.others = RecordedInputs(readings=readings)
            sensed = self._sensed(at, turn)
            made = [inputs, sensed]
            at = evolved(DOUBLES, self.system, at, sensed).configuration
            self._at = at if at.fault is None else None
        except IllegalStepError:
            pass  # replay finds the same step, and tells of it
        finally:
            self._made[number] = (*(a for one in made for a in one.made), *turn.moves)
        return round_

    def _program_turns(
        self, at: Configuration[Constant], round_: Round, turn: _Asked, inputs: CompletedInputs
    ) -> Configuration[Constant]:
        for robot in round_.order:
            event = round_.events[robot]
            if self._has_summaries:
                turn.pose(ProgramTurn(robot, event, at))
            if event is None:
                at = run_skip(DOUBLES, self.system, at, robot, inputs).configuration
            else:
                at = run_event(DOUBLES, self.system, at, robot, event, inputs).configuration
            if at.fault is not None:
                break
        return at

    def _sensed(self, at: Configuration[Constant], turn: _Asked) -> CompletedInputs:
        """Choose answers for the contracts of a round; return the environment's inputs.

        What models ask has an influence on the run, and what contracts ask has none.
        """
        models = turn.inputs(lasting=True)
        for robot, state in enumerate(at.robots):
            if not self._moving[state.kind]:
                continue
            m = moved(DOUBLES, self.system, robot, state, models)
            ports = Ports(state.ports, tuple(m.memory.after))
            turn.moves = models.made
            for module, contract in self._asking[state.kind]:
                turn.pose(Kept(robot, module, contract, ports))
        turn.told = {**turn.told, **by_place(models.made)}
        return turn.inputs()

    def pose(self, posed: Posed) -> None:
        """Choose answers by which a claim holds. Raises KoordError where nobody knows any."""
        verdict = self.search.pose(posed)
        if posed.made:
            self._posed.append(posed)
        if verdict is Verdict.UNKNOWN:
            raise _undecided(posed)


class _Asked(Struct):
    """What is asked in a round, and the answers that were told in it."""

    run: _Presuming
    number: int
    told: Mapping[Where, Answer]
    others: RecordedInputs
    moves: tuple[Answer, ...] = ()  #: answers that models were given

    def pose(self, claim: Claim) -> None:
        self.run.pose(Posed(claim, self.number, self.told, self.others))

    def inputs(self, *, lasting: bool = False) -> CompletedInputs:
        """Inputs of the rules; ``lasting``: which must not be changed any more."""
        search = self.run.search

        def ask(
            phase: Phase,
            robot: int,
            key: Key,
            function: core.External | None,
            arguments: tuple[Concrete, ...],
        ) -> Concrete | None:
            if function is None:
                return arguments[0] if phase is Phase.ENV else None
            if search.is_told(phase, key):
                return None
            where = phase, robot, key
            question = search.question(self.number, where, function.name, arguments)
            value = None if lasting else search.value(question)
            return search.fix(question, function, robot) if value is None else value

        return CompletedInputs(self.others, self.told, ask)


def _joined(told: tuple[Answer, ...], extra: Mapping[Where, Answer]) -> tuple[Answer, ...]:
    return tuple({**extra, **by_place(told)}.values())


def _presumption(claim: Claim) -> Presumption | None:
    match claim:
        case Kept(module=module, contract=contract):
            return Presumption(PremiseKind.CONTRACT, f"{module.name}.{contract.name}")
        case Assumed(assumption=assumption):
            return Presumption(PremiseKind.ASSUMPTION, assumption.name)
        case _:
            return None


class UndecidedError(KoordError):
    """Raised where nobody knows whether the rules allow a run, as answers are not known."""


def _undecided(posed: Posed) -> UndecidedError:
    """The reason to give up where nobody knows whether a claim can hold."""
    when = "at the start" if posed.round == _INIT else f"in round {posed.round + 1}"
    what = _presumption(posed.claim) or "a summary"
    story = f"nobody answered what {what} asks {when}, and no answers were found that it allows"
    return UndecidedError(refusal("K918", _place(posed.claim), story).diagnostics)


def _place(claim: Claim) -> Span:
    match claim:
        case Kept(contract=contract):
            return contract.span
        case Assumed(assumption=assumption):
            return assumption.span
        case AssumedPart(part=part):
            return part.condition.span
        case InitialTurn() | ProgramTurn():
            return NOWHERE
