"""The run of a trace to JSON: its recording, its configurations, its output. [TRACE]"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from koord.semantics.configurations import NO_EVENT, Configuration, Fault, Robot, Store, Turn
from koord.semantics.domain import Constant
from koord.semantics.recording import Answer, Start
from koord.semantics.storage import Storage
from koord.syntax.core import Home
from koord.syntax.system import Status
from koord.syntax.types import Type, show
from koord.traces.names import Named, Names, element_type
from koord.traces.trace import BEFORE_ROUNDS, Emitted, Trace, Violation
from koord.traces.value_codec import Json, encode_storage, encode_value

#: How the status of a robot is written.
STATUS_NAMES = tuple(status.name.lower() for status in sorted(Status))


def encode_run(trace: Trace, rounds: list[Json] | None = None) -> dict[str, Json]:
    """The run of a trace; ``rounds`` are given where they were encoded before."""
    loop = trace.recording.loop
    repeats: dict[str, Json] = {} if loop is None else {"loop": loop}
    return {
        **encode_start_of_run(trace),
        "rounds": encode_rounds(trace) if rounds is None else rounds,
        **repeats,
        "violation": _encode_violation(trace.violation),
    }


def encode_start_of_run(trace: Trace) -> dict[str, Json]:
    """The run of a trace up to its first round."""
    names = Names(trace.system)
    opening = trace.recording.opening
    return {
        "opening": {
            "order": list(opening.order),
            "starts": [_encode_start(names, start) for start in opening.starts],
            "answers": [_encode_answer(names, answer) for answer in opening.answers],
            "output": _outputs(trace, BEFORE_ROUNDS).get(BEFORE_ROUNDS, []),
        },
        "initial": encode_configuration(names, trace.configurations[0]),
    }


def encode_rounds(trace: Trace, first: int = 0) -> list[Json]:
    """The rounds of a trace, from number ``first`` on."""
    names, written = Names(trace.system), _outputs(trace, first)
    rounds = trace.recording.rounds[first:]
    after = trace.configurations[first + 1 :]
    return [
        {
            "order": list(round_.order),
            "events": [
                None if position is None else names.of(robot).events[position]
                for robot, position in enumerate(round_.events)
            ],
            "readings": [
                {
                    "robot": reading.robot,
                    "port": names.of(reading.robot).ports[reading.slot].name,
                    "value": encode_value(
                        reading.value, names.of(reading.robot).ports[reading.slot].type
                    ),
                }
                for reading in round_.readings
            ],
            "answers": [_encode_answer(names, answer) for answer in round_.answers],
            "cut": round_.cut,
            "output": written.get(number, []),
            "after": encode_configuration(names, configuration),
        }
        for number, (round_, configuration) in enumerate(zip(rounds, after, strict=True), first)
    ]


def _outputs(trace: Trace, first: int) -> dict[int, list[Json]]:
    """What was written in the rounds from number ``first`` on."""
    written: dict[int, list[Json]] = {}
    for emitted in trace.outputs:
        if emitted.round >= first:
            written.setdefault(emitted.round, []).append(_encode_output(emitted))
    return written


def _encode_output(emitted: Emitted) -> Json:
    written = emitted.written
    pairs = zip(written.values, written.types, strict=True)
    return {
        "robot": emitted.robot,
        "stream": written.stream,
        "types": [show(type_) for type_ in written.types],
        "values": [encode_value(value, type_) for value, type_ in pairs],
    }


def _encode_start(names: Names, start: Start) -> Json:
    named = startable(names, start.home, start.robot)[start.slot]
    return {
        "home": start.home.value,
        "variable": named.name,
        "robot": start.robot,
        "value": encode_value(start.value, named.type),
    }


def startable(names: Names, home: Home, robot: int | None) -> Sequence[Named]:
    """What can start arbitrarily in a home, with the type of what starts there."""
    match home:
        case Home.ALLWRITE:
            return names.allwrite
        case Home.ALLREAD:
            return tuple(Named(n.name, n.slot, element_type(n)) for n in names.allread)
        case Home.LOCAL:
            assert robot is not None
            return names.of(robot).locals
        case _:
            assert robot is not None
            return names.of(robot).ports


def _encode_answer(names: Names, answer: Answer) -> Json:
    result, parameters = answer_types(names, answer.function, answer.key[0])
    pairs = zip(answer.arguments, parameters, strict=True)
    return {
        "phase": answer.phase.value,
        "robot": answer.robot,
        "key": list(answer.key),
        "function": answer.function,
        "arguments": [encode_value(value, type_) for value, type_ in pairs],
        "value": encode_value(answer.value, result),
    }


def answer_types(names: Names, function: str | None, site: int) -> tuple[Type, tuple[Type, ...]]:
    """The type of an answer and those of its arguments. Raises KeyError if there is no such."""
    if function is None:
        return names.choices[site], ()
    external = names.externals[function]
    return external.result.type, tuple(p.type for p in external.parameters)


def _encode_violation(violation: Violation | None) -> Json:
    if violation is None:
        return None
    return {
        "kind": violation.kind.value,
        "name": violation.name,
        "round": violation.round,
        "robot": violation.robot,
    }


def encode_configuration(names: Names, configuration: Configuration[Constant]) -> Json:
    """A configuration; a robot's copy of the store is left out where it is the store."""
    encoded: dict[str, Json] = {"round": configuration.round}
    if configuration.turn is not Turn.PROG:
        encoded["turn"] = configuration.turn.value
    if configuration.taken:
        encoded["taken"] = list[Json](sorted(configuration.taken))
    if configuration.fault is not None:
        encoded["fault"] = _encode_fault(configuration.fault)
    encoded["store"] = _encode_store(names, configuration.store)
    encoded["robots"] = [
        _encode_robot(names, number, robot, configuration.store)
        for number, robot in enumerate(configuration.robots)
    ]
    return encoded


def _encode_robot(
    names: Names, number: int, robot: Robot[Constant], store: Store[Constant]
) -> Json:
    own = names.of(number)
    assert isinstance(robot.status, int)
    assert isinstance(robot.ran, int)
    encoded: dict[str, Json] = {
        "status": STATUS_NAMES[robot.status],
        "ran": None if robot.ran == NO_EVENT else own.events[robot.ran],
        "turn": robot.turn.value,
        "locals": _encode_variables(own.locals, robot.locals),
        "ports": _encode_variables(own.ports, robot.ports),
    }
    if robot.copy is not store and robot.copy != store:
        encoded["copy"] = _encode_store(names, robot.copy)
    return encoded


def _encode_store(names: Names, store: Store[Constant]) -> Json:
    return {
        "allread": _encode_variables(names.allread, store.allread),
        "allwrite": _encode_variables(names.allwrite, store.allwrite),
    }


def _encode_variables(named: Iterable[Named], storages: Iterable[Storage[Constant]]) -> Json:
    pairs = zip(named, storages, strict=True)
    return {one.name: encode_storage(storage, one.type) for one, storage in pairs}


def _encode_fault(fault: Fault) -> Json:
    span = fault.span
    place: list[Json] = [span.file, span.line, span.column, span.end_line, span.end_column]
    return {
        "kind": fault.kind.name,
        "robot": fault.robot,
        "place": place,
        "detail": fault.detail,
    }
