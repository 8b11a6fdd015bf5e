"""Whether what is claimed holds after each turn of a trace, and what it is made of there.

[PROP-INVARIANT] [PROP-ROUND] [PROP-EVENTUALLY] [PROP-LEADS-TO] [ENV-CONTRACT]
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.liveness import LIVENESS, Response, responses
from koord.semantics.oracle import Inputs, NoInputs, Phase
from koord.semantics.properties import holds_in
from koord.semantics.recordings import ROUND_ENDS, Concrete, RecordedInputs, Step
from koord.semantics.rounds import IllegalStepError
from koord.semantics.statements import machine
from koord.syntax import core
from koord.syntax.core import BinaryOp, PropertyKind
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import System
from koord.syntax.walk import asks
from koord.traces.formula_values import FormulaReader
from koord.traces.lassos import broken_by
from koord.traces.replay import PropertyInputs, Question, answered
from koord.traces.story_form import FormulaAt, Track
from koord.traces.trace import BEFORE_ROUNDS, Trace, ViolationKind

#: After so many of the last turns a statement is evaluated.
_MOST_ASKED = 2_000

#: So many parts of formulas are told of a story, so that pages stay small.
_MOST_PARTS = 3_000


def stated_in(trace: Trace) -> core.Property | None:
    """The property that a trace breaks, None if it breaks none."""
    violation = trace.violation
    if violation is None or violation.kind is not ViolationKind.PROPERTY:
        return None
    properties = trace.system.program.properties
    return next((p for p in properties if p.name == violation.name), None)


def tracks_of(trace: Trace, told: Sequence[Step], steps: Sequence[Step]) -> list[Track]:
    """The statements that a trace is about, after each of the steps that are ``told``.

    ``steps`` are all of them, from INIT on.
    """
    violation, stated = trace.violation, stated_in(trace)
    if violation is not None and violation.kind is ViolationKind.CONTRACT:
        return _contract(trace, told)
    if stated is None:
        return []
    if stated.kind in LIVENESS:
        return _responses(trace, stated, told, steps)
    if stated.kind is PropertyKind.AT_ROUND:
        return [_track(trace, stated, stated.name, told, ROUND_ENDS)]
    return [_track(trace, stated, stated.name, told, ())]


class _Asked(Struct, frozen=True):
    """A statement asked of the configurations of a trace."""

    trace: Trace
    stated: core.Property
    functions: dict[Question, Concrete]
    quoting: Quoting

    def inputs(self, step: Step) -> Inputs[Constant]:
        """The answers that the statement was evaluated with."""
        recording = self.trace.recording
        seen = recording.opening if step.round == BEFORE_ROUNDS else recording.rounds[step.round]
        return PropertyInputs(seen.answers, self.functions)

    def holds(self, step: Step) -> bool | None:
        """Whether it holds after a step; None where that is not known."""
        configuration = step.configuration
        if configuration.fault is not None:
            return None
        try:
            found, legality = holds_in(
                self.trace.numbers.domain,
                self.trace.system,
                configuration,
                self.stated.condition,
                self.stated.bound,
                self.inputs(step),
            )
        except IllegalStepError:
            return None
        if any(needed.condition is not True for needed in legality):
            return None
        return found is True

    def reader(self, step: Step, left: int) -> FormulaReader:
        """A reader of the statement's parts after a step."""
        d, system = self.trace.numbers.domain, self.trace.system
        oracle = self.inputs(step).oracle(Phase.CHECK, 0)
        view: Configuration[Constant] = step.configuration
        made = machine(d, system, oracle, bound=self.stated.bound, view=view)
        return FormulaReader(made, self.quoting, left)


def _track(
    trace: Trace,
    stated: core.Property,
    name: str,
    told: Sequence[Step],
    rules: Sequence[str],
) -> Track:
    """A statement after each turn; of a statement about ends of rounds only after those."""
    functions = answered(trace)
    asked = _Asked(trace, stated, functions, Quoting.of(trace.system.program))
    first = max(0, len(told) - _MOST_ASKED)
    truth: list[bool | None] = [
        asked.holds(step) if k >= first and (not rules or step.rule in rules) else None
        for k, step in enumerate(told)
    ]
    formulas: list[FormulaAt] = []
    left = _MOST_PARTS
    for k in range(len(told) - 1, -1, -1):
        if truth[k] is None:
            continue
        reader = asked.reader(told[k], min(left, 400))
        before = reader.left
        formulas.append(FormulaAt(k, reader.root(stated.condition)))
        left -= max(1, before - reader.left)
        if left <= 0:
            break
    text = asked.quoting.text(stated.condition)
    return Track(name, text, truth, formulas[::-1])


def track_of_states(
    system: System, stated: core.Property, states: Sequence[Configuration[Constant] | None]
) -> list[Track]:
    """A statement in configurations that no run is known to reach; none if it asks functions."""
    if asks(system.program, stated.condition):
        return []
    quoting = Quoting.of(system.program)
    truth: list[bool | None] = []
    formulas: list[FormulaAt] = []
    for k, state in enumerate(states):
        if state is None:
            truth.append(None)
            continue
        made = machine(
            EXACT, system, NoInputs().oracle(Phase.CHECK, 0), bound=stated.bound, view=state
        )
        holds, _ = holds_in(EXACT, system, state, stated.condition, stated.bound, NoInputs())
        truth.append(holds is True)
        formulas.append(FormulaAt(k, FormulaReader(made, quoting).root(stated.condition)))
    return [Track(stated.name, quoting.text(stated.condition), truth, formulas)]


def _responses(
    trace: Trace, stated: core.Property, told: Sequence[Step], steps: Sequence[Step]
) -> list[Track]:
    """Trigger and goal of the response that a lasso breaks. [LASSO]"""
    ends = [step.configuration for step in steps if step.is_at_round]
    response: Response | None = None
    if trace.recording.loop is not None:
        broken = broken_by(trace.system, trace.recording, ends, stated)
        response = None if broken is None else broken[0]
    if response is None:
        response = responses(trace.system, stated)[0]
    whose = "" if response.robot is None else f" of robot {response.robot}"
    found = []
    if response.trigger is not None:
        name = f"{stated.name}{whose}: trigger"
        found.append(_track(trace, response.trigger, name, told, ROUND_ENDS))
    name = f"{stated.name}{whose}: goal"
    found.append(_track(trace, response.goal, name, told, ROUND_ENDS))
    return found


def _contract(trace: Trace, told: Sequence[Step]) -> list[Track]:
    """The contract that a model breaks in the last turn. [ENV-CONTRACT]"""
    violation = trace.violation
    assert violation is not None
    last = told[-1]
    if violation.robot is None or len(told) < 2 or last.rule != "ENV-TRANS":
        return []
    robot, system, d = violation.robot, trace.system, trace.numbers.domain
    contracts = (c for module in system.agent(robot).modules for c in module.contracts)
    contract = next((c for c in contracts if c.name == violation.name), None)
    if contract is None:
        return []
    round_ = trace.recording.rounds[last.round]
    inputs = RecordedInputs(readings=round_.readings, answers=round_.answers)
    before = told[-2].configuration.robots[robot].ports
    after = last.configuration.robots[robot].ports
    made = machine(
        d, system, inputs.oracle(Phase.ENV, robot), robot=robot, ports=before, after=after
    )
    made.in_environment = True
    made.memory.bound = [None] * contract.bound
    reader = FormulaReader(made, Quoting.of(system.program))
    required = reader.together("requires", BinaryOp.AND, map(reader.root, contract.requires))
    ensured = reader.together("ensures", BinaryOp.AND, map(reader.root, contract.ensures))
    text = f"contract {contract.name} of robot {robot}"
    whole = reader.together(text, BinaryOp.IMPLIES, [required, ensured])
    if not contract.requires:
        whole = reader.together(text, BinaryOp.AND, [ensured])
    truth: list[bool | None] = [None] * (len(told) - 1) + [False]
    return [Track(text, text, truth, [FormulaAt(len(told) - 1, whole)])]
