"""Merging of robots' reports to a trace of the whole run. [TRACE]

Each robot tells its own part, and who was switched off tells nothing. What nobody saw is filled in:
a sensor that nobody looked at reads what its contract allows; the state and the output of a robot
in rounds that it was not there for are those of the reference. All that was seen is compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct, field
from msgspec.structs import replace

from koord.refinement.completion import Library, with_summaries
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
)
from koord.refinement.running import CompiledRun, opening_order, schedule_of
from koord.refinement.translation import to_fault
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.proposals import EventFault as Found
from koord.semantics.configurations import Configuration, Robot, Store, Written
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import (
    Answer,
    Opening,
    Reading,
    Recording,
    Round,
    Start,
    Step,
    execute,
)
from koord.semantics.rounds import IllegalStepError
from koord.semantics.values import default
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Emitted, Numbers, Sources, Trace


class DisagreementError(Exception):
    """Raised where two robots acted on different decisions of a round, or started differently."""


class _Heard(Struct):
    """The reports of all robots, by subject. Of duplicates the last counts."""

    decisions: dict[int, Decision] = field(default_factory=dict)
    starts: dict[tuple[Home, int, int | None], Start] = field(default_factory=dict)
    answers: dict[int, dict[tuple[Phase, int, Key], Answer]] = field(default_factory=dict)
    readings: dict[int, dict[tuple[int, int], Reading]] = field(default_factory=dict)
    stood: dict[tuple[int, int], Robot[Constant]] = field(default_factory=dict)
    stumbled: dict[tuple[int, int], Found] = field(default_factory=dict)
    written: dict[tuple[int, int], tuple[Written[Constant], ...]] = field(default_factory=dict)
    undeclared: bool = False
    gave_up: KoordError | None = None

    def hear(self, pid: int, told: Told) -> None:
        match told:
            case Began(start=start):
                key = (start.home, start.slot, start.robot)
                if repr(self.starts.setdefault(key, start)) != repr(start):
                    raise DisagreementError(f"{pid} began with {start}, not {self.starts[key]}")
            case Undeclared():
                self.undeclared = True
            case TurnAnswers(round=round_, answer=answer):
                of_round = self.answers.setdefault(round_, {})
                of_round[answer.phase, answer.robot, answer.key] = answer
            case Sensed(round=round_, reading=reading):
                self.readings.setdefault(round_, {})[pid, reading.slot] = reading
            case Stood(round=round_, robot=robot):
                self.stood[round_, pid] = robot
            case Stumbled(round=round_, fault=fault):
                self.stumbled[round_, pid] = fault
            case Kept(round=round_, written=written):
                self.written[round_, pid] = written
            case Coordinated() | Left():
                pass  # says who, and when; all that was decided is told by those who acted on it
            case GaveUp(why=why):
                self.gave_up = KoordError(why) if why else self.gave_up
            case Acted(decision=decision):
                round_ = decision.round
                # As texts, because what is no number does not equal itself.
                if repr(self.decisions.setdefault(round_, decision)) != repr(decision):
                    raise DisagreementError(
                        f"{pid} acted on {decision} in round {round_}, "
                        f"another robot on {self.decisions[round_]}"
                    )


def gathered(
    sources: Sources,
    system: System,
    told: Sequence[Sequence[Told]],
    rounds: int | None = None,
    library: Library | None = None,
) -> CompiledRun:
    """Merge reports to a run of at most so many rounds. ``told[i]`` is by robot i.

    ``library`` answers what only the rules ask; without one the reference's does.

    It gives up where no readings or answers are found that the program allows, of a robot that was
    switched off or to questions that only the rules have. Raises DisagreementError.
    """
    heard = _Heard()
    for pid, story in enumerate(told):
        for one in story:
            heard.hear(pid, one)
    return _Gathering(sources, system, heard, rounds, library).ran()


class _Gathering(Struct):
    sources: Sources
    system: System
    heard: _Heard
    most: int | None
    library: Library | None

    def ran(self) -> CompiledRun:
        """The run as a trace. Inputs of the last round may be missing."""
        heard, system = self.heard, self.system
        first = heard.decisions.get(INIT_ROUND)
        if first is None:
            nothing = Recording(Opening(()), ())
            bare = Trace(self.sources, system, Numbers.DOUBLE, nothing, ())
            return CompiledRun(bare, gave_up=heard.gave_up)
        order = opening_order(first, system.robots)
        fault = self._fault_of(first)
        if fault is not None:
            self._begin_the_rest()
        opening = Opening(order, tuple(heard.starts.values()), self._answers(INIT_ROUND))
        rounds: list[Round] = []
        while fault is None and (self.most is None or len(rounds) < self.most):
            number = len(rounds)
            decision = heard.decisions.get(number)
            if decision is None or not self._is_whole(number, decision):
                break
            fault = self._fault_of(decision) or self._stumbled(number)
            cut = decision.fault is not None
            turns, events = schedule_of(decision, system.robots)
            readings = () if cut else self._readings(number)
            rounds.append(Round(turns, events, readings, self._answers(number), cut))
        recording = Recording(opening, tuple(rounds))
        bare = Trace(self.sources, system, Numbers.DOUBLE, recording, ())
        try:
            trace = self._seen(with_summaries(bare, self.library), fault)
        except KoordError as error:  # what nobody saw is nothing that the program allows
            return CompiledRun(bare, None, error)
        return CompiledRun(trace, None if fault is None else fault[1].place, heard.gave_up)

    def _begin_the_rest(self) -> None:
        """Fill in the starts that robots did not reach, because INIT ended in a fault."""
        program, starts = self.system.program, self.heard.starts
        wanted: list[tuple[int | None, core.Declaration]] = [(None, e) for e in program.allwrite]
        for pid in range(self.system.robots):
            agent = self.system.agent(pid)
            ports = [port.declaration for port in agent.ports]
            wanted += [(pid, entry) for entry in (*program.allread, *agent.locals, *ports)]
        for robot, entry in wanted:
            variable = entry.variable
            value = default(DOUBLES, variable.own_type, self.system.robots)
            key = (variable.home, variable.slot, robot)
            starts.setdefault(key, Start(*key, value))

    # --- rounds -----------------------------------------------------------------------------------

    def _is_whole(self, number: int, decision: Decision) -> bool:
        """Return whether the environment's turn of a round is known to have happened."""
        if decision.fault is not None:
            return decision.fault.event is not None
        return any((number + 1, i) in self.heard.stood for i in range(self.system.robots)) or any(
            (number, i) in self.heard.stumbled for i in range(self.system.robots)
        )

    def _fault_of(self, decision: Decision) -> tuple[int | None, Found] | None:
        """The fault that a round ends in, and its robot."""
        faulted = decision.fault
        if faulted is None:
            return None
        nobody = decision.round == INIT_ROUND and self.heard.undeclared
        return (None if nobody else faulted.robot), faulted.fault

    def _stumbled(self, number: int) -> tuple[int | None, Found] | None:
        """The fault of a model at the end of a round, if that ended the run. [ENV-TRANS]"""
        following = self.heard.decisions.get(number + 1)
        if following is not None and following.fault is None:
            return None
        found = [i for i in range(self.system.robots) if (number, i) in self.heard.stumbled]
        return (found[0], self.heard.stumbled[number, found[0]]) if found else None

    def _answers(self, number: int) -> tuple[Answer, ...]:
        return tuple(self.heard.answers.get(number, {}).values())

    def _readings(self, number: int) -> tuple[Reading, ...]:
        """The reported readings at the end of a round."""
        return tuple(self.heard.readings.get(number, {}).values())

    # --- what the whole went through --------------------------------------------------------------

    def _seen(self, trace: Trace, fault: tuple[int | None, Found] | None) -> Trace:
        """The trace with the reported configurations and output."""
        configurations: list[Configuration[Constant]] = []
        outputs: list[Emitted] = []
        last: Step | None = None
        try:
            for step in execute(DOUBLES, self.system, trace.recording):
                if last is not None and step.round != last.round:
                    configurations.append(self._configuration(last))
                outputs += self._outputs(step)
                last = step
        except IllegalStepError:
            pass  # replay finds the same step, and tells of it
        # Behind an illegal step, or a fault in INIT, there is nothing to compare any more.
        nothing: Configuration[Constant] = Configuration((), Store((), ()), 0)
        configurations.append(nothing if last is None else self._configuration(last))
        while len(configurations) <= len(trace.recording.rounds):
            configurations.append(configurations[-1])
        if fault is not None:
            configurations[-1] = replace(configurations[-1], fault=to_fault(fault[1], fault[0]))
        return replace(trace, configurations=tuple(configurations), outputs=tuple(outputs))

    def _configuration(self, step: Step) -> Configuration[Constant]:
        """The configuration after a step, with the robots' states as reported."""
        by_rules = step.configuration
        seen = [self.heard.stood.get((step.round + 1, i)) for i in range(len(by_rules.robots))]
        robots = tuple(a or b for a, b in zip(seen, by_rules.robots, strict=True))
        store = next((robot.copy for robot in seen if robot is not None), by_rules.store)
        return replace(by_rules, robots=robots, store=store, fault=None)

    def _outputs(self, step: Step) -> Iterator[Emitted]:
        """Yield the output of a step, as reported by its robot."""
        if step.rule == "INIT":
            for pid in self._who_began():
                told = self.heard.written.get((INIT_ROUND, pid), ())
                yield from (Emitted(INIT_ROUND, None, written) for written in told)
            return
        if step.robot is None:
            return
        told = self.heard.written.get((step.round, step.robot), step.stepped.output)
        yield from (Emitted(step.round, step.robot, written) for written in told)

    def _who_began(self) -> Iterator[int]:
        """Yield the robots admitted in INIT, in order, and the one that faulted."""
        decision = self.heard.decisions[INIT_ROUND]
        yield from (taken.robot for taken in decision.ran)
        if decision.fault is not None:
            yield decision.fault.robot
