"""Merging of robots' reports to a trace of the whole run. [TRACE]

Each robot tells its own part, and who was switched off tells nothing. What nobody saw is filled in:
a sensor that nobody looked at reads what its contract allows; the state and the output of a robot
in rounds that it was not there for are those of the reference. All that was seen is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.answer_search import Question
from koord.refinement.completion import Library, with_summaries
from koord.refinement.hearing import Heard, is_of_model, ran_in
from koord.refinement.presuming import Presumed, Presumption, presumed
from koord.refinement.running import CompiledRun, opening_order, schedule_of
from koord.refinement.translation import to_fault
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.proposals import EventFault as Found
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
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
from koord.semantics.rounds import IllegalStepError, unset_start
from koord.semantics.values import default
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Emitted, Numbers, Sources, Trace


class Gathered(Struct, frozen=True):
    """A merged run, with what it is not judged by: nobody answered what these statements ask.

    ``choices`` are the questions to which answers were chosen.
    """

    run: CompiledRun
    presumptions: tuple[Presumption, ...] = ()
    choices: frozenset[Question] = frozenset()


def gathered(
    sources: Sources,
    system: System,
    heard: Heard,
    rounds: int | None = None,
    library: Library | None = None,
    passed: Callable[[int], None] = lambda number: None,
) -> Gathered:
    """Merge reports to a run of at most so many rounds.

    ``library`` answers what only the rules ask; without one answers are chosen by which the run is
    legal, if there are any. ``passed`` hears of each round that is filled in.

    It gives up where no readings or answers are found that the program allows, of a robot that was
    switched off or to questions that only the rules have.
    """
    return _Gathering(sources, system, heard, rounds, library, passed).ran()


class _Gathering(Struct):
    sources: Sources
    system: System
    heard: Heard
    most: int | None
    library: Library | None
    passed: Callable[[int], None]

    def ran(self) -> Gathered:
        """The run as a trace. Inputs of the last round may be missing."""
        heard, system = self.heard, self.system
        first = heard.decisions.get(INIT_ROUND)
        if first is None:
            nothing = Recording(Opening(()), ())
            bare = Trace(self.sources, system, Numbers.DOUBLE, nothing, ())
            return Gathered(CompiledRun(bare, gave_up=heard.gave_up))
        order = opening_order(first, system.robots)
        fault = self._fault_of(first)
        self._begin_the_rest(range(system.robots) if fault is not None else self._silent)
        opening = Opening(order, tuple(heard.starts.values()), self._answers(INIT_ROUND))
        rounds: list[Round] = []
        while fault is None and (self.most is None or len(rounds) < self.most):
            number = len(rounds)
            decision = heard.decisions.get(number)
            if decision is None or is_of_model(decision):
                break
            fault = self._fault_of(decision) or self._stumbled(number)
            cut = not self._is_whole(number, decision)
            turns, events = schedule_of(decision, system.robots)
            readings = () if cut else self._readings(number)
            rounds.append(Round(turns, events, readings, self._answers(number), cut))
        recording = Recording(opening, tuple(rounds))
        bare = Trace(self.sources, system, Numbers.DOUBLE, recording, ())
        try:
            completed = self._completed(bare)
            trace = self._seen(completed.trace, fault)
        except KoordError as error:  # what nobody saw is nothing that the program allows
            return Gathered(CompiledRun(bare, None, error))
        place = None if fault is None else fault[1].place
        run = CompiledRun(trace, place, heard.gave_up)
        return Gathered(run, completed.presumptions, completed.choices)

    def _completed(self, bare: Trace) -> Presumed:
        """The trace with answers that only the rules ask for. Raises KoordError."""
        if self.library is None:
            return presumed(bare, self.passed)
        return Presumed(with_summaries(bare, self.library, self.passed), (), frozenset())

    @property
    def _silent(self) -> list[int]:
        """The robots that tell nothing at all."""
        return [i for i in range(self.system.robots) if i not in self.heard.tellers]

    def _begin_the_rest(self, robots: Iterable[int]) -> None:
        """Fill in starts that nobody tells: of robots that are silent, or that a fault of INIT
        forestalled.
        """
        program, starts = self.system.program, self.heard.starts
        wanted: list[tuple[int | None, core.Declaration]] = []
        for pid in robots:
            agent = self.system.agent(pid)
            ports = [port.declaration for port in agent.ports]
            wanted += [(pid, entry) for entry in (*program.allread, *agent.locals, *ports)]
        if wanted:
            wanted += [(None, entry) for entry in program.allwrite]
        for robot, entry in wanted:
            if entry.initial is not core.Start.ARBITRARY:
                continue
            variable = entry.variable
            value = default(DOUBLES, variable.own_type, self.system.robots)
            key = (variable.home, variable.slot, robot)
            starts.setdefault(key, Start(*key, value))

    # --- rounds -----------------------------------------------------------------------------------

    def _is_whole(self, number: int, decision: Decision) -> bool:
        """Return whether the environment's turn of a round is known to have happened.

        The next round has been decided after it; else a robot tells of it.
        """
        if decision.fault is not None:
            return False
        robots, following = range(self.system.robots), number + 1
        heard = self.heard
        return (
            following in heard.decisions
            or any((following, i) in heard.stood for i in robots)
            or any((number, i) in heard.stumbled for i in robots)
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
        nothing = unset_start(DOUBLES, self.system)
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
            for pid in ran_in(self.heard.decisions[INIT_ROUND]):
                told = self.heard.written.get((INIT_ROUND, pid), ())
                yield from (Emitted(INIT_ROUND, None, written) for written in told)
            return
        if step.robot is None:
            return
        told = self.heard.written.get((step.round, step.robot), step.stepped.output)
        yield from (Emitted(step.round, step.robot, written) for written in told)
