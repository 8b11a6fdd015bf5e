"""The judge: is a run of a compiled program one of the semantics? [REPLAY]"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.running import Ran
from koord.refinement.summaries import with_summaries
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.recordings import (
    Answer,
    Concrete,
    RecordedInputs,
    Recording,
    Round,
    Step,
    execute,
)
from koord.semantics.rounds import (
    IllegalStepError,
    evolved,
    initialised,
    run_event,
    run_skip,
)
from koord.semantics.values import default
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import Type
from koord.traces.replay import Planned, Refused, Replayed, replay
from koord.traces.trace import Trace


class Judged(Struct, frozen=True):
    """What the judge found: how many steps were right, and the first that is not, if any."""

    trace: Trace
    replayed: Replayed
    refused: Refused | None

    @property
    def steps(self) -> int:
        return self.replayed.steps


def judge(ran: Ran) -> Judged:
    """Replay a run on the reference semantics over doubles, rule by rule, for equality.

    Of a fault, its place in the text is compared as well.
    """
    if not ran.trace.configurations:
        nothing = Replayed(0, 0, None)
        return Judged(ran.trace, nothing, None)
    trace = ran.trace if ran.fault_place is None else completed(ran.trace)
    last: list[Step] = []

    def keep(step: Step) -> None:
        last[:] = [step]

    replayed = replay(trace, keep)
    refused = replayed.refused
    if refused is None and ran.fault_place is not None:
        refused = _elsewhere(last[0], ran.fault_place)
    return Judged(trace, replayed, refused)


def judge_robots(trace: Trace, fault_place: str | None = None) -> Judged:
    """Judge a trace that robots made, whose library nobody asked what only summaries mention.

    Raises KoordError where the reference's library has no answer that a summary allows.
    """
    return judge(Ran(with_summaries(trace), fault_place))


def _elsewhere(step: Step, place: str) -> Refused | None:
    """The fault, if the rules find it at another place of the text."""
    fault = step.configuration.fault
    assert fault is not None
    if str(fault.span) == place:
        return None
    planned = Planned(step.rule, step.round, step.robot, step.event)
    reason = f"the fault is at {fault.span}, and not at {place}"
    return Refused("FAULT", planned, reason)


# --- faults -------------------------------------------------------------------------------------


def completed(trace: Trace) -> Trace:
    """A trace that ends in a fault, with all that evaluation asks for behind it.

    Evaluation by the rules is total: it goes on behind a fault, with answers that have no meaning.
    A program that runs ends at once. So answers that are missing in the last step are made up.
    """
    try:
        return _completed(trace)
    except IllegalStepError:
        return trace  # and replay will say where and why


def _completed(trace: Trace) -> Trace:
    system, recording = trace.system, trace.recording
    opening, rounds = recording.opening, recording.rounds
    if not rounds:
        starts = RecordedInputs(starts=opening.starts)
        inputs = _Completing(system, opening.answers, opening.answers, starts)
        initialised(DOUBLES, system, inputs, opening.order)
        whole = Recording(replace(opening, answers=tuple(inputs.answers)), ())
        return replace(trace, recording=whole)
    before = Recording(opening, rounds[:-1])
    *_, start = execute(DOUBLES, system, before)
    configuration, last = start.configuration, rounds[-1]
    answers = (*opening.answers, *(a for round_ in rounds for a in round_.answers))
    inputs = _Completing(system, answers, last.answers, RecordedInputs(readings=last.readings))
    configuration = _turns(system, configuration, last, inputs)
    if not last.cut and configuration.fault is None:
        evolved(DOUBLES, system, configuration, inputs)
    whole = Recording(opening, (*rounds[:-1], replace(last, answers=tuple(inputs.answers))))
    return replace(trace, recording=whole)


def _turns(
    system: System, configuration: Configuration[Constant], last: Round, inputs: _Completing
) -> Configuration[Constant]:
    """The configuration after the program turns of the last round, up to the fault."""
    for robot in last.order:
        position = last.events[robot]
        if position is None:
            stepped = run_skip(DOUBLES, system, configuration, robot, inputs)
        else:
            stepped = run_event(DOUBLES, system, configuration, robot, position, inputs)
        configuration = stepped.configuration
        if configuration.fault is not None:
            break
    return configuration


class _Completing:
    """Inputs from a recording; answers that are missing are made up, and noted."""

    def __init__(
        self,
        system: System,
        run: tuple[Answer, ...],
        given: tuple[Answer, ...],
        others: RecordedInputs,
    ) -> None:
        self.system = system
        self.run = run  #: those of the whole run
        self.given = given
        self.others = others
        self.answers: list[Answer] = list(self.given)
        self._known: dict[tuple[Phase, int, Key], Answer] = {
            (a.phase, a.robot, a.key): a for a in self.given
        }
        self._said: dict[tuple[str, tuple[Concrete, ...]], Concrete] = {
            (a.function, a.arguments): a.value for a in self.run if a.function
        }

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        return self.others.start(declaration, robot)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        return self.others.sensor(robot, port)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _CompletingOracle(self, phase, robot)

    def answer(
        self,
        where: tuple[Phase, int, Key],
        function: str | None,
        arguments: tuple[Concrete, ...],
        made_up: Concrete,
    ) -> Concrete:
        """What was recorded, or what is made up."""
        if where not in self._known:
            if function is not None:
                made_up = self._said.setdefault((function, arguments), made_up)
            self._known[where] = Answer(*where, function, arguments, made_up)
            self.answers.append(self._known[where])
        return self._known[where].value


class _CompletingOracle(Struct, frozen=True):
    inputs: _Completing
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        value = self.inputs.answer((self.phase, self.robot, key), None, (), low)
        assert isinstance(value, Constant)
        return value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        where = (self.phase, self.robot, key)
        of_type = default(DOUBLES, function.result.type, self.inputs.system.robots)
        return self.inputs.answer(where, function.name, arguments, of_type)

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        return True

    def vouches_for(self, function: core.External) -> bool:
        return False
