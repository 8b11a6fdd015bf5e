"""The run of a trace as the form of trace files has it. [TRACE]"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import cast

from msgspec import UNSET

from koord.semantics import configurations, recordings
from koord.semantics.configurations import NO_EVENT
from koord.semantics.domain import Constant
from koord.semantics.storage import Storage
from koord.syntax.core import Home
from koord.syntax.types import Type, show
from koord.traces import form
from koord.traces.names import Named, Names, element_type
from koord.traces.trace import BEFORE_ROUNDS, Emitted, Trace
from koord.traces.value_codec import encode_storage, encode_value


def encode_run(trace: Trace, *, with_rounds: bool = True) -> form.Run:
    """The run of a trace, or all of it but its rounds."""
    names = Names(trace.system)
    opening, loop, violation = trace.recording.opening, trace.recording.loop, trace.violation
    return form.Run(
        opening=form.Opening(
            list(opening.order),
            [_start(names, start) for start in opening.starts],
            [_answer(names, answer) for answer in opening.answers],
            _outputs(trace, BEFORE_ROUNDS).get(BEFORE_ROUNDS, []),
        ),
        initial=encode_configuration(names, trace.configurations[0]),
        rounds=encode_rounds(trace) if with_rounds else [],
        loop=UNSET if loop is None else loop,
        violation=None
        if violation is None
        else form.Violation(violation.kind, violation.name, violation.round, violation.robot),
    )


def encode_rounds(trace: Trace, first: int = 0) -> list[form.Round]:
    """The rounds of a trace, from number ``first`` on."""
    names, written = Names(trace.system), _outputs(trace, first)
    rounds = trace.recording.rounds[first:]
    after = trace.configurations[first + 1 :]
    return [
        form.Round(
            list(round_.order),
            [_event(names, robot, position) for robot, position in enumerate(round_.events)],
            [_reading(names, reading) for reading in round_.readings],
            [_answer(names, answer) for answer in round_.answers],
            round_.cut,
            written.get(number, []),
            encode_configuration(names, configuration),
        )
        for number, (round_, configuration) in enumerate(zip(rounds, after, strict=True), first)
    ]


def _outputs(trace: Trace, first: int) -> dict[int, list[form.Output]]:
    """What was written in the rounds from number ``first`` on."""
    written: dict[int, list[form.Output]] = {}
    for emitted in trace.outputs:
        if emitted.round >= first:
            written.setdefault(emitted.round, []).append(_output(emitted))
    return written


def _output(emitted: Emitted) -> form.Output:
    written = emitted.written
    values = list(map(encode_value, written.values, written.types))
    return form.Output(emitted.robot, written.stream, list(map(show, written.types)), values)


def _event(names: Names, robot: int, position: int | None) -> str | None:
    return None if position is None else names.of(robot).events[position]


def _reading(names: Names, reading: recordings.Reading) -> form.Reading:
    port = names.of(reading.robot).ports[reading.slot]
    return form.Reading(reading.robot, port.name, encode_value(reading.value, port.type))


def _start(names: Names, start: recordings.Start) -> form.Start:
    named = startable(names, start.home, start.robot)[start.slot]
    home = cast(form.Home, start.home.value)
    return form.Start(home, named.name, start.robot, encode_value(start.value, named.type))


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


def _answer(names: Names, answer: recordings.Answer) -> form.Answer:
    result, parameters = answer_types(names, answer.function, answer.key[0])
    return form.Answer(
        answer.phase,
        answer.robot,
        list(answer.key),
        answer.function,
        [encode_value(*pair) for pair in zip(answer.arguments, parameters, strict=True)],
        encode_value(answer.value, result),
    )


def answer_types(names: Names, function: str | None, site: int) -> tuple[Type, tuple[Type, ...]]:
    """The type of an answer and those of its arguments. Raises KeyError if there is no such."""
    if function is None:
        return names.choices[site], ()
    external = names.externals[function]
    return external.result.type, tuple(p.type for p in external.parameters)


def encode_configuration(
    names: Names, configuration: configurations.Configuration[Constant]
) -> form.Configuration:
    """A configuration; a robot's copy of the store is left out where it is the store."""
    fault = configuration.fault
    return form.Configuration(
        round=configuration.round,
        turn=configuration.turn,
        taken=sorted(configuration.taken),
        fault=UNSET if fault is None else _fault(fault),
        store=_store(names, configuration.store),
        robots=[
            _robot(names, number, robot, configuration.store)
            for number, robot in enumerate(configuration.robots)
        ],
    )


def _robot(
    names: Names,
    number: int,
    robot: configurations.Robot[Constant],
    store: configurations.Store[Constant],
) -> form.Robot:
    own = names.of(number)
    assert isinstance(robot.status, int)
    assert isinstance(robot.ran, int)
    return form.Robot(
        form.STATUS_NAMES[robot.status],
        None if robot.ran == NO_EVENT else own.events[robot.ran],
        robot.turn,
        _variables(own.locals, robot.locals),
        _variables(own.ports, robot.ports),
        UNSET if robot.copy is store or robot.copy == store else _store(names, robot.copy),
    )


def _store(names: Names, store: configurations.Store[Constant]) -> form.Store:
    return form.Store(
        _variables(names.allread, store.allread), _variables(names.allwrite, store.allwrite)
    )


def _variables(named: Iterable[Named], storages: Iterable[Storage[Constant]]) -> dict[str, object]:
    pairs = zip(named, storages, strict=True)
    return {one.name: encode_storage(storage, one.type) for one, storage in pairs}


def _fault(fault: configurations.Fault) -> form.Fault:
    span = fault.span
    place = (span.file, span.line, span.column, span.end_line, span.end_column)
    return form.Fault(fault.kind.name, fault.robot, place, fault.detail)
