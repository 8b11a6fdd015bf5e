"""Rounding of recorded runs: exact numbers as doubles, and the violations that remain. [RERUN]

A counterexample is a run on exact numbers. A compiled program comes to the same states up to
rounding, and that may be enough to mend what is broken: ``x != 0.3`` holds of 0.30000000000000004.
So what a run claims is asked of the program's own numbers as well, by the same judgements. [RERUN]
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import assert_never

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Store
from koord.semantics.configurations import Robot as RobotState
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.environment import environment_turn
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Answer, Opening, Reading, RecordedInputs, Round
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, Value, map_atoms
from koord.syntax import core
from koord.traces.lassos import flaw_of
from koord.traces.replay import update_lost
from koord.traces.trace import Trace, Violation, ViolationKind

#: Two floats are the same up to rounding if they are this close, relative to the larger of them
#: or, near zero, in their own unit.
ROUNDING = 1e-9


class Passed(Struct):
    """The configurations of a compiled program that repeats a run, on doubles."""

    #: After INIT and after each whole round.
    ends: list[Configuration[Constant]] = field(default_factory=list)
    #: Where the run ended, which may be inside a round.
    last: Configuration[Constant] | None = None
    #: Before the last turn of the environment.
    turned: Configuration[Constant] | None = None


class Mended(Struct, frozen=True):
    """The result that the run violates nothing on doubles."""

    reason: str


class Unjudged(Struct, frozen=True):
    """The result that states agree up to rounding, but doubles leave the violation unjudged."""

    reason: str


def judged(trace: Trace, passed: Passed) -> Mended | Unjudged | None:
    """Judge whether a violation on exact numbers remains on doubles; None if it does."""
    violation = trace.violation
    if trace.recording.loop is not None:
        return _lasso(trace, passed, violation)
    if violation is None:
        return None
    match violation.kind:
        case ViolationKind.PROPERTY:
            return _property(trace, passed, violation)
        case ViolationKind.CONTRACT:
            return _contract(trace, passed, violation)
        case ViolationKind.LOST_UPDATE:
            return _update(trace, passed, violation)
    assert_never(violation.kind)


def _lasso(trace: Trace, passed: Passed, violation: Violation | None) -> Mended | None:
    """Judge whether a lasso closes, is fair, and breaks its property on doubles. [LASSO]"""
    stated = None if violation is None else _stated(trace, violation)
    flaw = flaw_of(trace.system, trace.recording, passed.ends, stated, DOUBLES)
    return None if flaw is None else Mended(f"on doubles, {flaw.reason}")


def _property(trace: Trace, passed: Passed, violation: Violation) -> Mended | Unjudged | None:
    name, last = violation.name, passed.last
    stated = _stated(trace, violation)
    if stated is None or last is None:
        return None
    inputs = _inputs(_last_of(trace))
    try:
        holds, _ = holds_in(DOUBLES, trace.system, last, stated.condition, stated.bound, inputs)
    except IllegalStepError:
        # It asks a function about rounded numbers.
        return Unjudged(f"nobody recorded what {name} asks about rounded numbers")
    return Mended(f"on doubles, {name} holds there") if holds is True else None


def _stated(trace: Trace, violation: Violation) -> core.Property | None:
    """The property of the program that a run is to break."""
    properties = trace.system.program.properties
    return next((p for p in properties if p.name == violation.name), None)


def _contract(trace: Trace, passed: Passed, violation: Violation) -> Mended | Unjudged | None:
    name, robot, turned = violation.name, violation.robot, passed.turned
    if robot is None or turned is None:
        return None
    inputs = _inputs(_last_of(trace))
    try:
        made = environment_turn(DOUBLES, trace.system, robot, turned.robots[robot], inputs)
    except IllegalStepError:
        return Unjudged(f"nobody recorded what the model under {name} asks about rounded numbers")
    kept = any(promised is True and of.name == name for promised, of in made.promises)
    return Mended(f"on doubles, robot {robot} keeps contract {name}") if kept else None


def _update(trace: Trace, passed: Passed, violation: Violation) -> Mended | Unjudged | None:
    number = len(trace.recording.rounds) - 1
    if not 0 <= number < len(passed.ends):
        return None
    round_ = _last_of(trace)
    assert isinstance(round_, Round)
    try:
        lost = update_lost(
            DOUBLES,
            trace.system,
            passed.ends[number],
            replace(round_, readings=_readings(round_), answers=_answers(round_)),
            violation.name,
        )
    except IllegalStepError:
        return Unjudged(f"nobody recorded what is asked about rounded numbers before {number + 1}")
    return None if lost else Mended(f"on doubles, no update of {violation.name} is lost there")


def _last_of(trace: Trace) -> Opening | Round:
    recording = trace.recording
    return recording.rounds[-1] if recording.rounds else recording.opening


def _inputs(of: Opening | Round) -> RecordedInputs:
    readings = _readings(of) if isinstance(of, Round) else ()
    return RecordedInputs(readings=readings, answers=_answers(of))


def _readings(round_: Round) -> tuple[Reading, ...]:
    return tuple(replace(one, value=_double(one.value)) for one in round_.readings)


def _answers(of: Opening | Round) -> tuple[Answer, ...]:
    return tuple(
        replace(one, arguments=tuple(map(_double, one.arguments)), value=_double(one.value))
        for one in of.answers
    )


# --- floats, as doubles -------------------------------------------------------------------------


def as_doubles(recorded: Configuration[Constant]) -> Configuration[Constant]:
    """Convert exact numbers to the nearest doubles."""

    def all_of(storages: tuple[Storage[Constant], ...]) -> tuple[Storage[Constant], ...]:
        return tuple(map(storage, storages))

    def storage(one: Storage[Constant]) -> Storage[Constant]:
        if isinstance(one, Tree):
            return Tree(all_of(one.parts))
        return Cell(one.is_set, _double(one.value))

    def store(one: Store[Constant]) -> Store[Constant]:
        return Store(all_of(one.allread), all_of(one.allwrite))

    robots = tuple(
        replace(r, locals=all_of(r.locals), ports=all_of(r.ports), copy=store(r.copy))
        for r in recorded.robots
    )
    return replace(recorded, robots=robots, store=store(recorded.store))


def _double(one: Value[Constant]) -> Value[Constant]:
    return map_atoms(one, lambda x: float(x) if isinstance(x, Fraction) else x)


# --- floats, up to rounding ---------------------------------------------------------------------


def unrounded(
    recorded: Configuration[Constant], found: Configuration[Constant]
) -> Configuration[Constant]:
    """The found configuration, with recorded numbers for floats that equal them up to rounding."""

    def robot(a: RobotState[Constant], b: RobotState[Constant]) -> RobotState[Constant]:
        locals_, ports = _all(a.locals, b.locals), _all(a.ports, b.ports)
        return replace(b, locals=locals_, ports=ports, copy=_store(a.copy, b.copy))

    return replace(
        found,
        robots=tuple(map(robot, recorded.robots, found.robots)),
        store=_store(recorded.store, found.store),
    )


def _store(recorded: Store[Constant], found: Store[Constant]) -> Store[Constant]:
    return Store(_all(recorded.allread, found.allread), _all(recorded.allwrite, found.allwrite))


def _all(
    recorded: tuple[Storage[Constant], ...], found: tuple[Storage[Constant], ...]
) -> tuple[Storage[Constant], ...]:
    return tuple(map(_storage, recorded, found))


def _storage(recorded: Storage[Constant], found: Storage[Constant]) -> Storage[Constant]:
    match recorded, found:
        case Tree(parts=a), Tree(parts=b):
            return Tree(_all(a, b))
        case Cell(is_set=True, value=a), Cell(is_set=True, value=b):
            return Cell(True, _value(a, b))
        case _:
            return found


def unrounded_values(
    recorded: tuple[Value[Constant], ...], found: tuple[Value[Constant], ...]
) -> tuple[Value[Constant], ...]:
    """Match item by item; surplus items are the found ones."""
    return (*map(_value, recorded, found), *found[len(recorded) :])


def _value(recorded: Value[Constant], found: Value[Constant]) -> Value[Constant]:
    match recorded, found:
        case Fraction(), float():
            near = math.isclose(recorded, found, rel_tol=ROUNDING, abs_tol=ROUNDING)
            return recorded if near else found
        case Rec(fields=a), Rec(fields=b):
            return Rec(unrounded_values(a, b))
        case Seq(items=a), Seq(items=b) if len(a) == len(b):
            return Seq(len(b), unrounded_values(a, b))
        case Table(entries=a), Table(entries=b) if len(a) == len(b):
            pairs = zip(a, b, strict=True)
            return Table(len(b), tuple((_value(k, m), _value(v, w)) for (k, v), (m, w) in pairs))
        case _:
            return found
