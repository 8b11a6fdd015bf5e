"""The judge of refinement: is a run of a compiled program one of the semantics? [REPLAY]"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from koord.refinement.completion import CompletedInputs, by_place, program_turns
from koord.refinement.running import CompiledRun
from koord.semantics.domain import DOUBLES
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import (
    Concrete,
    Reached,
    RecordedInputs,
    Recording,
    Step,
    execute,
)
from koord.semantics.rounds import IllegalStepError, evolved, initialised
from koord.semantics.values import default
from koord.syntax import core
from koord.traces.replay import ExpectedStep, Refused, Replayed, replay
from koord.traces.trace import Trace


class Judged(Struct, frozen=True):
    """The judgement on a run: the steps that are right, and the first that is not, if any."""

    trace: Trace
    replayed: Replayed
    refused: Refused | None

    @property
    def steps(self) -> int:
        return self.replayed.steps


def judge(ran: CompiledRun, seen: Callable[[Step], None] = lambda step: None) -> Judged:
    """Replay a run on the reference semantics over doubles, rule by rule, for equality.

    Of a fault, its place in the text is compared as well. ``seen`` is called with each step that is
    right.
    """
    if not ran.trace.configurations:
        nothing = Replayed(0, 0, None)
        return Judged(ran.trace, nothing, None)
    trace = ran.trace if ran.fault_place is None else completed(ran.trace)
    last: list[Step] = []

    def keep(step: Step) -> None:
        last[:] = [step]
        seen(step)

    replayed = replay(trace, keep)
    refused = replayed.refused
    if refused is None and ran.fault_place is not None:
        refused = _elsewhere(last[0], ran.fault_place)
    return Judged(trace, replayed, refused)


def _elsewhere(step: Step, place: str) -> Refused | None:
    """The fault, if the rules find it at another place of the text."""
    fault = step.configuration.fault
    assert fault is not None
    if str(fault.span) == place:
        return None
    planned = ExpectedStep(step.rule, step.round, step.robot, step.event)
    reason = f"the fault is at {fault.span}, and not at {place}"
    return Refused("FAULT", planned, reason)


# --- faults -------------------------------------------------------------------------------------


def completed(trace: Trace) -> Trace:
    """Complete a trace that ends in a fault with all that evaluation asks for behind it.

    Evaluation by the rules is total: it goes on behind a fault, with answers that have no meaning.
    A program that runs ends at once. So answers that are missing in the last step are made up.
    """
    *earlier, last = trace.parts
    before = Reached(earlier[-1].system, earlier[-1].configurations[-1]) if earlier else None
    try:
        done = _completed(last, before)
        return replace(trace, later=(*trace.later[:-1], done)) if earlier else done
    except IllegalStepError:
        return trace  # and replay will say where and why


def _completed(trace: Trace, before: Reached | None) -> Trace:
    system, recording = trace.system, trace.recording
    opening, rounds = recording.opening, recording.rounds
    answers = (*opening.answers, *(a for round_ in rounds for a in round_.answers))
    known = {(a.function, a.arguments): a.value for a in answers if a.function}

    def make_up(
        phase: Phase,
        robot: int,
        key: Key,
        function: core.External | None,
        arguments: tuple[Concrete, ...],
    ) -> Concrete:
        if function is None:
            return arguments[0]
        some = default(DOUBLES, function.result.type, system.robots)
        return known.setdefault((function.name, arguments), some)

    if not rounds and before is not None:
        return trace  # where it goes on there is no fault
    if not rounds:
        starts = RecordedInputs(starts=opening.starts)
        inputs = CompletedInputs(starts, by_place(opening.answers), make_up)
        initialised(DOUBLES, system, inputs, opening.order)
        whole = Recording(replace(opening, answers=inputs.answers), ())
        return replace(trace, recording=whole)
    *_, start = execute(DOUBLES, system, Recording(opening, rounds[:-1]), before=before)
    last = rounds[-1]
    inputs = CompletedInputs(
        RecordedInputs(readings=last.readings), by_place(last.answers), make_up
    )
    configuration = program_turns(system, start.configuration, last, inputs)
    if not last.cut and configuration.fault is None:
        evolved(DOUBLES, system, configuration, inputs)
    whole = Recording(opening, (*rounds[:-1], replace(last, answers=inputs.answers)))
    return replace(trace, recording=whole)
