"""Replay of traces: check every step and configuration of a trace against the rules. [REPLAY]"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Written
from koord.semantics.domain import Constant, Domain
from koord.semantics.liveness import LIVENESS
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.properties import holds_in, overlap
from koord.semantics.recordings import (
    Answer,
    Concrete,
    Reached,
    RecordedInputs,
    RecordedOracle,
    Round,
    Step,
    execute,
)
from koord.semantics.rounds import IllegalStepError
from koord.semantics.turns import program_turn
from koord.semantics.values import identical
from koord.syntax import core
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.core import PropertyKind
from koord.syntax.system import System
from koord.syntax.walk import nodes
from koord.traces.changes import Change, differences
from koord.traces.lassos import Flaw, flaw_of
from koord.traces.names import Names
from koord.traces.rendering import show_output
from koord.traces.trace import (
    BEFORE_ROUNDS,
    Emitted,
    Numbers,
    Trace,
    Violation,
    ViolationKind,
    emitted,
)

#: An external function, and what it is asked about.
Question: TypeAlias = "tuple[str, tuple[Concrete, ...]]"


class ExpectedStep(Struct, frozen=True):
    """A step that a recording prescribes, not yet known to be legal."""

    rule: str
    round: int
    robot: int | None = None
    event: str | None = None


class Refused(Struct, frozen=True):
    """The first step of a trace that is wrong, the rule that it breaks, and how.

    ``differences`` are locations with what the rules give (``old``) and what was recorded
    (``new``).
    """

    rule: str
    step: ExpectedStep
    reason: str
    differences: tuple[Change, ...] = ()


class Replayed(Struct, frozen=True):
    """The result of a replay: the numbers of steps and rounds that are right; the first error."""

    steps: int
    rounds: int
    refused: Refused | None
    #: External functions whose summaries speak of every value of a type: taken on trust.
    trusted: tuple[str, ...] = ()


def planned(trace: Trace, begins: str = "INIT") -> Iterator[ExpectedStep]:
    """The steps that a trace's recording prescribes; ``begins`` is the rule of the first."""
    yield ExpectedStep(begins, BEFORE_ROUNDS)
    for number, round_ in enumerate(trace.recording.rounds):
        for robot in round_.order:
            position = round_.events[robot] if robot < len(round_.events) else None
            if position is None:
                yield ExpectedStep("SKIP", number, robot)
            else:
                events = trace.system.agent(robot).events
                name = events[position].name if 0 <= position < len(events) else str(position)
                yield ExpectedStep("EVENT-TRANS", number, robot, name)
        if not round_.cut:
            yield ExpectedStep("ENV-TRANS", number)


def replay(trace: Trace, seen: Callable[[Step], None] = lambda step: None) -> Replayed:
    """Replay a trace. ``seen`` is called with every step that is right."""
    steps, first, before = 0, 0, None
    names: dict[str, None] = {}
    for part in trace.parts:
        names |= dict.fromkeys(trusted(part.system.program))
        replaying = _Replay(part, before)
        refused = None
        try:
            replaying.run(_from(first, seen))
        except _RefusedError as error:
            refused = error.refused
            refused = replace(refused, step=_later(refused.step, first))
        steps, first = steps + replaying.steps, first + replaying.rounds
        if refused is not None or replaying.last is None:
            break
        before = Reached(part.system, replaying.last)
    return Replayed(steps, first, refused, tuple(names))


def _from(first: int, seen: Callable[[Step], None]) -> Callable[[Step], None]:
    """What sees steps of a part of a run, whose rounds count from ``first``."""
    return seen if not first else lambda step: seen(replace(step, round=step.round + first))


def _later(step: ExpectedStep, first: int) -> ExpectedStep:
    return replace(step, round=step.round + first)


def trusted(program: core.Program) -> tuple[str, ...]:
    """The external functions whose summaries cannot be evaluated on an answer. [REPLAY]"""
    return tuple(
        function.name
        for function in program.externals
        if any(
            isinstance(node, core.Quantified) and isinstance(node.domain, core.AllValues)
            for node in nodes(function.ensures)
        )
    )


class _RefusedError(Exception):
    """Raised with the step that is wrong, to end the replay."""

    def __init__(self, refused: Refused) -> None:
        super().__init__(refused.reason)
        self.refused = refused


class _Replay:
    """A replay in progress: its position, and the inputs recorded for later steps.

    With ``before`` it is of a part that goes on from there with another program. [RELOAD]
    """

    def __init__(self, trace: Trace, before: Reached | None = None) -> None:
        self.trace, self.before = trace, before
        self.last: Configuration[Constant] | None = None  #: the one that was reached
        self.names = Names(trace.system)
        self.d = trace.numbers.domain
        self.steps = 0
        self.rounds = 0
        self.plan = list(planned(trace, "INIT" if before is None else "RELOAD"))
        self.ends: list[Configuration[Constant]] = []  #: after INIT and after each round
        self.outputs = iter(trace.outputs)
        self.functions: dict[Question, Concrete] = {}

    def run(self, seen: Callable[[Step], None]) -> None:
        self.check_shape()
        steps = execute(self.d, self.trace.system, self.trace.recording, before=self.before)
        last: Step | None = None
        for number, plan in enumerate(self.plan):
            try:
                step = next(steps, None)
            except IllegalStepError as error:
                raise self.refusal(error.rule, plan, error.reason) from None
            if step is None:
                reason = (
                    "the run ended in a fault"
                    if last and last.configuration.fault
                    else ("the run ended in the round before, which was cut")
                )
                raise self.refusal("FAULT", plan, f"{reason}, and goes on in the trace")
            self.check_step(plan, step, closes=self.closes(number, step))
            if step.is_at_round:
                self.ends.append(step.configuration)
            last, self.last = step, step.configuration
            self.steps += 1
            seen(step)
        assert last is not None
        self.check_end(last)

    def refusal(
        self, rule: str, plan: ExpectedStep, reason: str, found: tuple[Change, ...] = ()
    ) -> _RefusedError:
        return _RefusedError(Refused(rule, plan, reason, found))

    # --- before anything runs -------------------------------------------------------------------

    def check_shape(self) -> None:
        """Check what a codec guarantees, and a trace that was made in memory may lack."""
        trace, robots = self.trace, self.trace.system.robots
        rounds = trace.recording.rounds
        first = self.plan[0]
        if len(trace.configurations) != len(rounds) + 1:
            raise self.refusal(
                "INIT",
                first,
                f"{len(rounds)} rounds have {len(trace.configurations)} configurations",
            )
        for number, round_ in enumerate(rounds):
            plan = ExpectedStep("EVENT-TRANS", number)
            if len(round_.events) != robots:
                raise self.refusal("EVENT-TRANS", plan, f"there are not {robots} robots' events")
            for robot, position in enumerate(round_.events):
                events = trace.system.agent(robot).events
                if position is not None and not 0 <= position < len(events):
                    plan = ExpectedStep("SELECT", number, robot)
                    raise self.refusal("SELECT", plan, f"the robot has no event {position}")
        self.functions = answered(trace)

    # --- step by step ---------------------------------------------------------------------------

    def closes(self, number: int, step: Step) -> bool:
        """Return whether the trace has a configuration for the state after this step."""
        if step.configuration.fault is not None or number + 1 == len(self.plan):
            return True
        return self.plan[number + 1].round != step.round

    def check_step(self, plan: ExpectedStep, step: Step, *, closes: bool) -> None:
        for made in emitted(step):
            recorded = next(self.outputs, None)
            if recorded is None or not same_output(made, recorded):
                shown = "nothing" if recorded is None else quoted(recorded)
                reason = f"the output should be {quoted(made)}; recorded is {shown}"
                raise self.refusal("OUTPUT", plan, reason)
        if not closes:
            return
        recorded_configuration = self.trace.configurations[step.round + 1]
        found = tuple(
            islice(differences(self.names, step.configuration, recorded_configuration), 20)
        )
        if found:
            raise self.refusal(step.rule, plan, "the configuration recorded is another", found)
        self.rounds = step.round + 1

    # --- the end --------------------------------------------------------------------------------

    def check_end(self, last: Step) -> None:
        plan = self.plan[-1]
        left = next(self.outputs, None)
        if left is not None:
            reason = f"the output {quoted(left)} is recorded, and nothing more was written"
            raise self.refusal("OUTPUT", plan, reason)
        for number in range(last.round + 1, len(self.trace.recording.rounds)):
            recorded = self.trace.configurations[number + 1]
            found = tuple(islice(differences(self.names, last.configuration, recorded), 20))
            if found:
                reason = "nobody moved, but the configuration recorded is another"
                raise self.refusal(
                    "EVENT-TRANS", ExpectedStep("EVENT-TRANS", number), reason, found
                )
        violation = self.trace.violation
        if self.trace.recording.loop is not None:
            self.check_lasso(violation, plan)
        elif violation is not None:
            self.check_violation(violation, plan, last)

    def check_lasso(self, violation: Violation | None, plan: ExpectedStep) -> None:
        """Check that a lasso closes, is fair, and breaks its property. [LASSO]"""
        trace = self.trace
        flaw: Flaw | None = Flaw("LASSO", "a run without end is told in exact numbers")
        if trace.numbers is Numbers.EXACT:
            stated = self.stated(violation.name) if violation is not None else None
            if violation is not None and stated is None:
                reason = f"there is no property {violation.name} that a run could break"
                raise self.refusal("LASSO", plan, reason)
            flaw = flaw_of(trace.system, trace.recording, self.ends, stated)
        if flaw is not None:
            raise self.refusal(flaw.rule, plan, flaw.reason)

    def stated(self, name: str) -> core.Property | None:
        return next((p for p in self.trace.system.program.properties if p.name == name), None)

    def check_violation(self, violation: Violation, plan: ExpectedStep, last: Step) -> None:
        """Check that a trace that claims a violation shows it."""
        rule, shown = "PROP-INVARIANT", False
        match violation.kind:
            case ViolationKind.PROPERTY:
                rule, shown = self.property_broken(violation.name, last)
            case ViolationKind.CONTRACT:
                rule = "PROP-CONTRACT"
                shown = any(
                    (robot, contract.name) == (violation.robot, violation.name)
                    for robot, contract in last.stepped.promises
                )
            case ViolationKind.LOST_UPDATE:
                rule, shown = "LOST-UPDATE", self.update_lost(violation.name)
        if not shown:
            reason = f"the trace says that {violation.name} is broken at its end, and it is not"
            raise self.refusal(rule, plan, reason)

    def property_broken(self, name: str, last: Step) -> tuple[str, bool]:
        stated = self.stated(name)
        if stated is None:
            return "PROP-INVARIANT", False
        if stated.kind in LIVENESS:
            return "LASSO", False  # no run that ends refutes it
        at_round = stated.kind is PropertyKind.AT_ROUND
        if at_round and not last.is_at_round:
            return "PROP-ROUND", False
        recording, at = self.trace.recording, last.configuration
        seen = recording.opening if last.round == BEFORE_ROUNDS else recording.rounds[last.round]
        inputs = PropertyInputs(seen.answers, self.functions)
        system, claim = self.trace.system, stated.condition
        try:
            holds, legality = holds_in(self.d, system, at, claim, stated.bound, inputs)
        except IllegalStepError as error:
            raise self.refusal(error.rule, self.plan[-1], error.reason) from None
        for needed in legality:
            if needed.condition is not True:
                reason = f"{needed.what} ({needed.span})"
                raise self.refusal(needed.rule, self.plan[-1], reason)
        return ("PROP-ROUND" if at_round else "PROP-INVARIANT"), holds is not True

    def update_lost(self, name: str) -> bool:
        trace = self.trace
        if not trace.recording.rounds:
            return False
        start, round_ = trace.configurations[-2], trace.recording.rounds[-1]
        return update_lost(self.d, trace.system, start, round_, name)


def answered(trace: Trace) -> dict[Question, Concrete]:
    """The answers of mathematical functions in the whole run of a trace, also for properties."""
    kinds = {f.name: f.kind for f in trace.system.program.externals}
    recording = trace.recording
    return {
        (answer.function, answer.arguments): answer.value
        for answers in (recording.opening.answers, *(r.answers for r in recording.rounds))
        for answer in answers
        if answer.function is not None and kinds.get(answer.function) is core.ExternalKind.FUNCTION
    }


class PropertyInputs(RecordedInputs):
    """The inputs that properties were evaluated with, and functions' answers in the whole run."""

    def __init__(self, answers: Iterable[Answer], functions: Mapping[Question, Concrete]) -> None:
        super().__init__(answers=answers)
        self.functions = functions

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _PropertyOracle(phase, robot, self.answers(phase, robot), [], self.functions)


class _PropertyOracle(RecordedOracle):
    functions: Mapping[Question, Concrete]

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        known = self.functions.get((function.name, arguments))
        return super().external(function, key, arguments) if known is None else known


def update_lost(
    d: Domain[Constant],
    system: System,
    start: Configuration[Constant],
    round_: Round,
    name: str,
) -> bool:
    """Return whether two robots write one location in a round in which one updates it.
    [LOST-UPDATE]
    """
    slots = [n.slot for n in Names(system).allwrite if n.name == name]
    inputs = RecordedInputs(readings=round_.readings, answers=round_.answers)
    updated = rewritten(system.program)
    written = []
    for robot in round_.order:
        position = round_.events[robot]
        if position is None:
            continue
        _, turned = program_turn(d, system, robot, start.robots[robot], position, inputs)
        updates = updated.get((system.kinds[robot], position), frozenset())
        written.append((turned.allwrite, updates))
    return any(
        d.known(overlap(d, mine.get(slot), theirs.get(slot))) is True
        for slot in slots
        for k, (mine, updates) in enumerate(written)
        for other, (theirs, _) in enumerate(written)
        if k != other and slot in updates
    )


def same_output(made: Emitted, recorded: Emitted) -> bool:
    """Return whether two outputs are equal and belong to the same step."""
    a, b = made.written, recorded.written
    return (
        (made.round, made.robot, a.stream) == (recorded.round, recorded.robot, b.stream)
        and len(a.values) == len(b.values)
        and all(map(identical, a.values, b.values))
    )


def quoted(emitted_: Emitted) -> str:
    """Quote an output for a message."""
    written: Written[Constant] = emitted_.written
    text = show_output(written.values, written.types)
    whose = "" if emitted_.robot is None else f" of robot {emitted_.robot}"
    return f"{text!r}{whose} on {written.stream}"
