"""Witnesses: recordings from a solver's models, replayed before they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Fault
from koord.semantics.domain import EXACT, Constant
from koord.semantics.expressions import condition, statement
from koord.semantics.oracle import Phase as Asked
from koord.semantics.properties import holds_in, overlap
from koord.semantics.quantifiers import instances
from koord.semantics.recordings import (
    Answer,
    Opening,
    Reading,
    RecordedInputs,
    Recording,
    Round,
    Start,
    Step,
    execute,
    until,
)
from koord.semantics.rounds import IllegalStepError
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.turns import program_turn
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax import core
from koord.syntax.analysis.footprint import updates
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import INT, ArrayType, MapType, Type, part_types
from koord.traces.rendering import show_value
from koord.verify.claims import Claim, ClaimKind, ClaimPhase, StepFindings, broken
from koord.verify.encoding import moments
from koord.verify.encoding import solver as solving
from koord.verify.encoding.symbols import SymbolicAnswer, SymbolicInputs
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unknowns import Symbolic
from koord.verify.promises import unkept
from koord.verify.verdicts import Counterexample, NotReplayedError


class ModelReader(Struct, frozen=True):
    """A reader of concrete values from a model."""

    model: solving.Model
    system: System

    def value(self, value: Symbolic, type_: Type) -> Value[Constant]:
        """The value of a symbolic value of a type in the model."""
        if isinstance(value, Rec):
            types = part_types(type_, len(value.fields))
            return Rec(tuple(map(self.value, value.fields, types)))
        if isinstance(value, Seq):
            taken = value.items[: self._int(value.length)]
            types = part_types(type_, len(taken))
            return Seq(len(taken), tuple(map(self.value, taken, types)))
        if isinstance(value, Table):
            assert isinstance(type_, MapType)
            entries = value.entries[: self._int(value.length)]
            pairs_read = tuple(
                (self.value(k, type_.key), self.value(v, type_.value)) for k, v in entries
            )
            return Table(len(pairs_read), pairs_read)
        return self.model.scalar(value, type_)

    def truth(self, condition: Term) -> bool:
        return bool(self.model.truth(condition))

    def answers(self, inputs: SymbolicInputs) -> tuple[Answer, ...]:
        inputs.answer_summaries(self.system)
        return tuple(self._answer(answer) for answer in inputs.answers.values())

    def _answer(self, answer: SymbolicAnswer) -> Answer:
        if answer.function is None:
            # ``choose`` is of ints or floats, and its term tells which.
            value: Value[Constant] = self.model.number(answer.value)
            return Answer(answer.phase, answer.robot, answer.key, None, (), value)
        function = self.system.program.external(answer.function)
        arguments = tuple(
            self.value(value, parameter.type)
            for value, parameter in zip(answer.arguments, function.parameters, strict=True)
        )
        given = self.value(answer.value, function.result.type)
        return Answer(answer.phase, answer.robot, answer.key, answer.function, arguments, given)

    def _int(self, value: Term) -> int:
        number = self.model.scalar(value, INT)
        assert isinstance(number, int)
        return number


# --- recordings ---------------------------------------------------------------------------------


def recording_of(
    reader: ModelReader,
    opening: moments.SymbolicInit,
    taken: list[moments.SymbolicRound],
    phase: ClaimPhase,
) -> Recording:
    """The recording of a model's run, up to the given phase of its last round."""
    recorded = []
    for number, symbolic in enumerate(taken):
        last = number + 1 == len(taken)
        recorded.append(round_of(reader, symbolic, phase if last else None))
    return Recording(opening_of(reader, opening), tuple(recorded))


def opening_of(reader: ModelReader, opening: moments.SymbolicInit) -> Opening:
    """The recording of INIT in a model."""
    order = _order(reader, opening.before)
    answers = reader.answers(opening.inputs) + reader.answers(opening.moment.checks)
    return Opening(order, tuple(_start(reader, *s) for s in opening.inputs.starts), answers)


def _start(reader: ModelReader, home: Home, slot: int, robot: int | None, value: Symbolic) -> Start:
    program = reader.system.program
    if home is Home.ALLWRITE:
        type_ = program.allwrite[slot].variable.type
    elif home is Home.ALLREAD:
        whole = program.allread[slot].variable.type
        assert isinstance(whole, ArrayType)
        type_ = whole.element
    else:
        assert robot is not None
        agent = reader.system.agent(robot)
        if home is Home.LOCAL:
            type_ = agent.locals[slot].variable.type
        else:
            type_ = agent.ports[slot].declaration.variable.type
    return Start(home, slot, robot, reader.value(value, type_))


def round_of(
    reader: ModelReader, symbolic: moments.SymbolicRound, phase: ClaimPhase | None
) -> Round:
    """The recording of a round in a model, up to a phase; all of it for None."""
    system = reader.system
    events: list[int | None] = [None] * system.robots
    for option in symbolic.options:
        if reader.truth(option.chosen):
            events[option.robot] = option.position
    order = _order(reader, symbolic.before) or tuple(range(system.robots))
    answers = reader.answers(symbolic.inputs)
    cut = phase in (ClaimPhase.INSIDE, ClaimPhase.MIDDLE)
    if phase is not None:
        answers += reader.answers(_moment(symbolic, phase).checks)
    if phase is ClaimPhase.INSIDE:
        # Robots that run no event have not moved yet. [T-PREFIX]
        free = (i for i, may_skip in enumerate(symbolic.free) if reader.truth(may_skip))
        order = tuple(i for i in order if events[i] is not None) or (next(free),)
    else:
        # Who skips because a lock is taken must come behind who took it; skips may always.
        order = tuple(sorted(order, key=lambda robot: events[robot] is None))
    readings = (
        ()
        if cut
        else tuple(
            Reading(
                robot,
                slot,
                reader.value(value, system.agent(robot).ports[slot].declaration.variable.type),
            )
            for robot, slot, value in symbolic.inputs.readings
        )
    )
    return Round(order, tuple(events), readings, answers, cut)


def _moment(symbolic: moments.SymbolicRound, phase: ClaimPhase) -> moments.SymbolicConfiguration:
    if phase is ClaimPhase.END:
        return symbolic.end
    if phase is ClaimPhase.MIDDLE or symbolic.inside is None:
        return symbolic.middle
    return symbolic.inside


def _order(reader: ModelReader, before: dict[tuple[int, int], Term]) -> tuple[int, ...]:
    """The order of robots by their ranks in the model; pid order where there are none."""
    robots = range(reader.system.robots)
    if not before:
        return tuple(robots)

    def earlier(robot: int) -> int:
        ahead = sum(reader.truth(before[other, robot]) for other in range(robot))
        behind = sum(
            not reader.truth(before[robot, other]) for other in range(robot + 1, len(robots))
        )
        return ahead + behind

    return tuple(sorted(robots, key=earlier))


# --- replay -------------------------------------------------------------------------------------


def replayed(
    system: System, recording: Recording, claim: Claim, phase: ClaimPhase
) -> Counterexample:
    """Replay a recording on the exact domain, as a counterexample. Raises NotReplayedError.

    Raises :class:`NotReplayedError` where it did not.
    """
    heard: list[Answer] = []
    steps = _broken_by(system, recording, claim, heard)
    found = unkept(system, heard)
    if found is not None:
        raise NotReplayedError(f"no {found.function} keeps its summary with these answers")
    last = steps[-1]
    fault = last.configuration.fault
    # An engine may have said what other robots would do behind what breaks the claim.
    if fault is None:
        last = _first_that_breaks(system, recording, claim, steps)
    if fault is not None or last is not steps[-1]:
        recording, phase = until(recording, last), _phase_of(last)
    number = len(recording.rounds)
    if claim.kind is ClaimKind.FAULT:
        assert fault is not None
        who = f"robot {fault.robot}: " if fault.robot is not None else ""
        detail = f"{who}{fault.kind.value}" + (f" ({fault.detail})" if fault.detail else "")
        return Counterexample(recording, number, phase, detail, fault.robot, fault.span)
    detail, met_fault = "", None
    if claim.stated is not None:
        detail, met_fault = _falsified(system, recording, claim.stated, last.configuration)
    elif claim.kind is ClaimKind.LOST_UPDATE:
        met = _meetings(system, recording, steps)[claim.subject]
        return Counterexample(recording, number, phase, _lost(met), last.robot, met.span)
    elif claim.kind is ClaimKind.CONTRACT:
        detail = f"the environment's model does not keep contract {claim.subject}"
    span = claim.stated.span if claim.stated is not None else None
    robot = last.robot
    if claim.kind is ClaimKind.CONTRACT:
        robot, span = next(
            (robot, contract.span)
            for robot, contract in last.stepped.promises
            if contract.name == claim.subject
        )
    return Counterexample(recording, number, phase, detail, robot, span, met_fault)


def _first_that_breaks(
    system: System, recording: Recording, claim: Claim, steps: Sequence[Step]
) -> Step:
    """The first step of the last round that breaks a claim, if that is known; else the last."""
    last = steps[-1]
    if claim.stated is None or last.robot is None or not claim.looked_at(ClaimPhase.INSIDE):
        return last
    if _last_answers(recording):
        return last  # external functions are asked about the configuration at the end alone
    stated, inputs = claim.stated, RecordedInputs()
    for step in steps:
        if step.round == last.round and step.robot is not None:
            now = step.configuration
            holds, _ = holds_in(EXACT, system, now, stated.condition, stated.bound, inputs)
            if holds is not True:
                return step
    return last


def _phase_of(step: Step) -> ClaimPhase:
    match step.rule:
        case "INIT":
            return ClaimPhase.INIT
        case "ENV-TRANS":
            return ClaimPhase.END
        case _:
            return ClaimPhase.INSIDE


def _falsified(
    system: System,
    recording: Recording,
    stated: core.Property,
    configuration: Configuration[Constant],
) -> tuple[str, Fault | None]:
    """The values of quantified variables for which a property is false, in words.

    And the fault of its evaluation there, if it is false for that. [PROP-FAULT]
    """
    oracle = RecordedInputs(answers=_last_answers(recording)).oracle(Asked.CHECK, 0)
    m = machine(EXACT, system, oracle, bound=stated.bound, view=configuration)
    found: list[str] = []
    e: core.Expr = stated.condition
    while (
        isinstance(e, core.Quantified)
        and e.quantifier is core.QuantifierKind.FORALL
        and not isinstance(e.domain, core.AllValues)
    ):
        for label, here, value in instances(m, e):
            m.memory.bound[e.variable.slot] = held(EXACT, value)
            m.trail.append(label)
            if here is True and statement(m, e.body) is not True:
                found.append(f"{e.variable.name} = {show_value(value, e.variable.type)}")
                break
            m.trail.pop()
        else:
            break
        e = e.body
    where = f" for {', '.join(found)}" if found else ""
    m.faults = []
    condition(m, e)
    fault = next((fault for faults, fault in m.faults if faults is True), None)
    why = ""
    if fault is not None:
        more = f" ({fault.detail})" if fault.detail else ""
        why = f", since it cannot be evaluated: {fault.kind.value}{more} at {fault.span}"
    return f"{stated.name} is false{where}{why}", fault


def simplified(system: System, recording: Recording, claim: Claim, tries: int = 200) -> Recording:
    """A recording with fewer events that breaks the claim in the same way, if there is one.

    Leaves out events of robots one by one, from the end, as long as the claim stays broken.
    """
    for number in reversed(range(len(recording.rounds))):
        for robot in range(system.robots):
            round_ = recording.rounds[number]
            if round_.events[robot] is None:
                continue
            if tries == 0:
                return recording
            tries -= 1
            events = (*round_.events[:robot], None, *round_.events[robot + 1 :])
            rounds_ = (
                *recording.rounds[:number],
                replace(round_, events=events),
                *recording.rounds[number + 1 :],
            )
            try:
                _broken_by(system, replace(recording, rounds=rounds_), claim)
            except NotReplayedError:
                continue
            recording = replace(recording, rounds=rounds_)
    return recording


def _broken_by(
    system: System, recording: Recording, claim: Claim, heard: list[Answer] | None = None
) -> list[Step]:
    """Execute a recorded run whose last step breaks the claim. Raises NotReplayedError.

    All answers that this asks for are added to ``heard``.
    """
    heard = [] if heard is None else heard
    try:
        steps = list(execute(EXACT, system, recording, heard))
    except IllegalStepError as error:
        raise NotReplayedError(str(error)) from error
    last = steps[-1]
    if claim.kind is ClaimKind.FAULT:
        if last.configuration.fault is None:
            raise NotReplayedError("no fault happened")
        return steps
    if last.configuration.fault is not None:
        raise NotReplayedError("the run faults before it breaks the claim")
    inputs = RecordedInputs(answers=_last_answers(recording), heard=heard)
    findings = _findings(system, recording, steps)
    try:
        violated, legality = broken(EXACT, system, claim, last.configuration, findings, inputs)
    except IllegalStepError as error:
        raise NotReplayedError(str(error)) from error
    if any(needed.condition is not True for needed in legality):
        raise NotReplayedError("an external function's answer does not meet its summary")
    if violated is not True:
        raise NotReplayedError(f"{claim.name} is not broken where the run ends")
    return steps


def _last_answers(recording: Recording) -> tuple[Answer, ...]:
    source = recording.rounds[-1].answers if recording.rounds else recording.opening.answers
    return tuple(answer for answer in source if answer.phase is Asked.CHECK)


def _findings(system: System, recording: Recording, steps: list[Step]) -> StepFindings[Constant]:
    """The findings of the last step of an exact run, besides its configuration."""
    last = steps[-1]
    promises = tuple((False, contract.name) for _, contract in last.stepped.promises)
    if not recording.rounds or last.rule == "ENV-TRANS":
        return StepFindings(False, (), promises)
    met = _meetings(system, recording, steps)
    names = (declaration.variable.name for declaration in system.program.allwrite)
    return StepFindings(False, tuple((name in met, name) for name in names), promises)


class _Meeting(Struct, frozen=True):
    """Two writes to one location of an allwrite variable in a round, one of them an update."""

    name: str
    first: int
    later: int
    updater: int  #: one of the two; the later one if both updated
    span: Span  #: of the statement that updates


def _lost(met: _Meeting) -> str:
    """Describe the effect of two writes that met."""
    both = f"robots {met.first} and {met.later} write {met.name} in one round"
    if met.updater == met.later:
        return f"{both}: robot {met.later} updates what it read before robot {met.first} wrote"
    return f"{both}: robot {met.later} undoes what robot {met.first} updated"


def _meetings(system: System, recording: Recording, steps: list[Step]) -> dict[str, _Meeting]:
    """By variable, a robot's update that met another's write in the last round. [LOST-UPDATE]"""
    round_ = recording.rounds[-1]
    start = next(step.configuration for step in reversed(steps) if step.is_at_round)
    inputs = RecordedInputs(answers=round_.answers)
    written = []
    for robot in round_.order:
        position = round_.events[robot]
        if position is not None:
            state = start.robots[robot]
            _, turned = program_turn(EXACT, system, robot, state, position, inputs)
            mine = tuple(updates(system.agent(robot).events[position].effect))
            written.append((robot, turned.allwrite, mine))
    met: dict[str, _Meeting] = {}
    for (first, its_writes, its), (later, other_writes, others) in combinations(written, 2):
        for slot, declaration in enumerate(system.program.allwrite):
            if overlap(EXACT, its_writes.get(slot), other_writes.get(slot)) is not True:
                continue
            name = declaration.variable.name
            for updater, updated in ((later, others), (first, its)):
                for span in (span for of, span in updated if of == slot):
                    met.setdefault(name, _Meeting(name, first, later, updater, span))
    return met
