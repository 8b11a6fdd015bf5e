"""Codec of a trace's run, to and from the form of trace files, checked by the program. [TRACE]"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar, cast

import msgspec
from msgspec import UNSET, Struct, UnsetType, field

from koord.semantics import configurations, recordings
from koord.semantics.configurations import NO_EVENT, Configuration, Fault, Robot, Store, Written
from koord.semantics.domain import Constant
from koord.semantics.recordings import Answer, Concrete, Opening, Reading, Recording, Round, Start
from koord.semantics.storage import Storage
from koord.syntax.core import Home
from koord.syntax.faults import FaultKind
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import Type, show
from koord.traces import form
from koord.traces.json_reader import FormError, JsonNode, shortened
from koord.traces.names import KindNames, Named, Names, element_type
from koord.traces.trace import BEFORE_ROUNDS, Emitted, Numbers, Sources, Trace, Violation
from koord.traces.value_codec import (
    Json,
    decode_storage,
    decode_value,
    encode_storage,
    encode_value,
)


def encode_run(trace: Trace, *, with_rounds: bool = True) -> form.Run:
    """Encode the run of a trace, with or without its rounds."""
    names = Names(trace.system)
    opening, loop, violation = trace.recording.opening, trace.recording.loop, trace.violation
    return form.Run(
        opening=form.Opening(
            list(opening.order),
            [encode_start(names, start) for start in opening.starts],
            [encode_answer(names, answer) for answer in opening.answers],
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
    """Encode the rounds of a trace from number ``first`` on."""
    names, written = Names(trace.system), _outputs(trace, first)
    encoded: Encoded = {}
    rounds = trace.recording.rounds[first:]
    after = trace.configurations[first + 1 :]
    return [
        form.Round(
            list(round_.order),
            [_event(names, robot, position) for robot, position in enumerate(round_.events)],
            [encode_reading(names, reading) for reading in round_.readings],
            [encode_answer(names, answer, encoded) for answer in round_.answers],
            round_.cut,
            written.get(number, []),
            encode_configuration(names, configuration),
        )
        for number, (round_, configuration) in enumerate(zip(rounds, after, strict=True), first)
    ]


def _outputs(trace: Trace, first: int) -> dict[int, list[form.Output]]:
    """Return the outputs of the rounds from number ``first`` on, by round."""
    written: dict[int, list[form.Output]] = {}
    for emitted in trace.outputs:
        if emitted.round >= first:
            of_round = written.setdefault(emitted.round, [])
            of_round.append(encode_output(emitted.robot, emitted.written))
    return written


def encode_output(robot: int | None, written: Written[Constant]) -> form.Output:
    values = list(map(encode_value, written.values, written.types))
    return form.Output(robot, written.stream, list(map(show, written.types)), values)


def _event(names: Names, robot: int, position: int | None) -> str | None:
    return None if position is None else names.of(robot).events[position]


def encode_reading(names: Names, reading: recordings.Reading) -> form.Reading:
    port = names.of(reading.robot).ports[reading.slot]
    return form.Reading(reading.robot, port.name, encode_value(reading.value, port.type))


def encode_start(names: Names, start: recordings.Start) -> form.Start:
    named = startable(names, start.home, start.robot)[start.slot]
    home = cast(form.Home, start.home.value)
    return form.Start(home, named.name, start.robot, encode_value(start.value, named.type))


def startable(names: Names, home: Home, robot: int | None) -> Sequence[Named]:
    """The variables of a home that can start arbitrarily, with the types of their starts."""
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


#: Values that live on, as they were encoded by their types: both by their ids.
Encoded: TypeAlias = dict[tuple[int, int], Json]


def encode_answer(
    names: Names, answer: recordings.Answer, encoded: Encoded | None = None
) -> form.Answer:
    """Encode an answer; an argument that was ``encoded`` before is not encoded again."""
    result, parameters = answer_types(names, answer.function, answer.key[0])
    known: Encoded = {} if encoded is None else encoded
    arguments = []
    for value, type_ in zip(answer.arguments, parameters, strict=True):
        key = id(value), id(type_)
        if key not in known:
            known[key] = encode_value(value, type_)
        arguments.append(known[key])
    return form.Answer(
        answer.phase,
        answer.robot,
        list(answer.key),
        answer.function,
        arguments,
        encode_value(answer.value, result),
    )


def answer_types(names: Names, function: str | None, site: int) -> tuple[Type, tuple[Type, ...]]:
    """The type of an answer and those of its arguments. Raises KeyError for an unknown function."""
    if function is None:
        return names.choices[site], ()
    external = names.externals[function]
    return external.result.type, tuple(p.type for p in external.parameters)


def encode_configuration(
    names: Names, configuration: configurations.Configuration[Constant]
) -> form.Configuration:
    """Encode a configuration; a robot's copy is left out where it equals the store."""
    fault = configuration.fault
    return form.Configuration(
        round=configuration.round,
        turn=configuration.turn,
        taken=sorted(configuration.taken),
        fault=UNSET if fault is None else _fault(fault),
        store=_store(names, configuration.store),
        robots=[
            encode_robot(names, number, robot, configuration.store)
            for number, robot in enumerate(configuration.robots)
        ],
    )


def encode_robot(
    names: Names,
    number: int,
    robot: configurations.Robot[Constant],
    store: configurations.Store[Constant] | None = None,
) -> form.Robot:
    """Encode the state of a robot; its copy is left out where it equals the store."""
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


def decode_run(run: form.Run, sources: Sources, system: System, numbers: Numbers) -> Trace:
    """Decode a system's trace from the run in a file. Raises FormError."""
    return Decoding(Names(system), numbers).trace(run, sources)


D = TypeVar("D")

#: The texts of what is remembered may take up so many bytes: those of an hour of 16 robots do.
_MOST_KNOWN = 32 << 20


class Known(Struct):
    """What was decoded: by how, as what, for how many robots, and of which text."""

    made: dict[tuple[object, object, int, bytes], Any] = field(default_factory=dict)
    size: int = 0

    def add(self, key: tuple[object, object, int, bytes], made: object) -> None:
        """Remember what was decoded; all is forgotten where it takes up too much."""
        self.size += len(key[-1])
        if self.size > _MOST_KNOWN:
            self.made.clear()
            self.size = len(key[-1])
        self.made[key] = made


class Decoding(Struct, frozen=True):
    """The names and the number domain by which the values of a run are decoded.

    Most values come again, in the next round or of another robot: what is ``known`` is not decoded
    twice, and takes up memory once. Decodings with the same numbers may share it.
    """

    names: Names
    numbers: Numbers
    known: Known = field(default_factory=Known)

    @property
    def robots(self) -> int:
        return self.names.system.robots

    def trace(self, run: form.Run, sources: Sources) -> Trace:
        opening, rounds = run.opening, run.rounds
        outputs = self.outputs(opening, BEFORE_ROUNDS)
        for number, round_ in enumerate(rounds):
            outputs += self.outputs(round_, number)
        if not isinstance(run.loop, UnsetType) and run.loop >= len(rounds):
            raise FormError(f"{run.loop} is out of range", ".loop", part=run)
        recording = Recording(
            Opening(
                self.order(opening), tuple(map(self.start, opening.starts)), self.answers(opening)
            ),
            tuple(map(self.round, rounds)),
            None if isinstance(run.loop, UnsetType) else run.loop,
        )
        ends = (run.initial, *(round_.after for round_ in rounds))
        return Trace(
            sources,
            self.names.system,
            self.numbers,
            recording,
            tuple(map(self.configuration, ends)),
            tuple(outputs),
            None if run.violation is None else self.violation(run.violation, len(rounds)),
        )

    # --- the recording --------------------------------------------------------------------------

    def round(self, part: form.Round) -> Round:
        self.expect(self.robots, part.events, ".events", part)
        return Round(
            self.order(part),
            tuple(
                self.event(name, self.names.of(robot), f".events[{robot}]", part)
                for robot, name in enumerate(part.events)
            ),
            tuple(map(self.reading, part.readings)),
            self.answers(part),
            part.cut,
        )

    def expect(self, count: int, items: Sequence[object], path: str, part: form.Form) -> None:
        if len(items) != count:
            reason = f"there should be {count} elements here, not {len(items)}"
            raise FormError(reason, path, part=part)

    def robot(self, robot: int, part: form.Form, path: str = ".robot") -> int:
        if robot >= self.robots:
            raise FormError(f"{robot} is out of range", path, part=part)
        return robot

    def order(self, part: form.Opening | form.Round) -> tuple[int, ...]:
        return tuple(self.robot(i, part, f".order[{k}]") for k, i in enumerate(part.order))

    def event(self, name: str | None, own: KindNames, path: str, part: form.Form) -> int | None:
        if name is None:
            return None
        if name not in own.events:
            known = ", ".join(own.events) or "none"
            reason = f"the robot has no event {shortened(name)!r}; its events are: {known}"
            raise FormError(reason, path, "K914", part)
        return own.events.index(name)

    def start(self, part: form.Start) -> Start:
        home = Home(part.home)
        if home is Home.ALLWRITE and part.robot is not None:
            raise FormError("an allwrite variable belongs to no robot", ".robot", part=part)
        if home is not Home.ALLWRITE and part.robot is None:
            raise FormError("there should be an integer here, not null", ".robot", part=part)
        robot = None if part.robot is None else self.robot(part.robot, part)
        named = self.named(part.variable, startable(self.names, home, robot), ".variable", part)
        return Start(home, named.slot, robot, self.value(part.value, named.type, ".value", part))

    def reading(self, part: form.Reading) -> Reading:
        robot = self.robot(part.robot, part)
        named = self.named(part.port, self.names.of(robot).ports, ".port", part)
        return Reading(robot, named.slot, self.value(part.value, named.type, ".value", part))

    def named(self, name: str, among: Sequence[Named], path: str, part: form.Form) -> Named:
        for named in among:
            if named.name == name:
                return named
        for named in among:
            if named.older == name:
                return named
        raise FormError(f"the program has no {shortened(name)!r} here", path, "K914", part)

    def answers(self, part: form.Opening | form.Round) -> tuple[Answer, ...]:
        return tuple(map(self.answer, part.answers))

    def answer(self, part: form.Answer) -> Answer:
        key, function = tuple(part.key), part.function
        try:
            result, parameters = answer_types(self.names, function, key[0])
        except KeyError:
            path, what = ".function", "no such function"
            if function is None:
                path, what = ".key", f"no choose with the number {key[:1]}"
            raise FormError(f"the program has {what}", path, "K914", part) from None
        arguments = self.values(part.arguments, parameters, ".arguments", part)
        value = self.value(part.value, result, ".value", part)
        return Answer(part.phase, self.robot(part.robot, part), key, function, arguments, value)

    def value(self, value: object, type_: Type, path: str, part: form.Form) -> Concrete:
        try:
            return self.once(decode_value, JsonNode(value), type_)
        except FormError as error:
            raise FormError(error.message, path + error.path, error.code, part) from None

    def once(
        self, decode: Callable[[JsonNode, Type, int, Numbers], D], node: JsonNode, type_: Type
    ) -> D:
        """Decode a value or storage, if that was not done before. Raises FormError."""

        def make() -> D:
            return decode(node, type_, self.robots, self.numbers)

        is_scalar = not isinstance(node.value, dict | list)
        return make() if is_scalar else self.known_or(make, (decode, type_), node.value)

    def known_or(self, make: Callable[[], D], what: tuple[object, object], of: object) -> D:
        """What was made of an equal part of a document before, or is made now. Raises FormError."""
        try:
            text = msgspec.json.encode(of)
        except (OverflowError, UnicodeEncodeError):  # long numbers, half characters
            return make()
        if b"null" in text:  # it stands for numbers that are none, too
            return make()
        key = (*what, self.robots, text)
        if key not in self.known.made:
            self.known.add(key, make())
        found: D = self.known.made[key]
        return found

    def values(
        self, values: Sequence[object], types: Sequence[Type], path: str, part: form.Form
    ) -> tuple[Concrete, ...]:
        self.expect(len(types), values, path, part)
        pairs = enumerate(zip(values, types, strict=True))
        return tuple(self.value(v, type_, f"{path}[{k}]", part) for k, (v, type_) in pairs)

    # --- what was seen --------------------------------------------------------------------------

    def outputs(self, part: form.Opening | form.Round, number: int) -> list[Emitted]:
        return [self.output(output, number) for output in part.output]

    def output(self, part: form.Output, number: int) -> Emitted:
        types = []
        for k, name in enumerate(part.types):
            known = self.names.outputs.get(name)
            if known is None:
                reason = "the program writes nothing of that type"
                raise FormError(reason, f".types[{k}]", "K914", part)
            types.append(known)
        values = self.values(part.values, types, ".values", part)
        robot = None if part.robot is None else self.robot(part.robot, part)
        return Emitted(number, robot, Written(part.stream, values, tuple(types)))

    def violation(self, part: form.Violation, rounds: int) -> Violation:
        if part.round >= rounds:
            raise FormError(f"{part.round} is out of range", ".round", part=part)
        robot = None if part.robot is None else self.robot(part.robot, part)
        return Violation(part.kind, part.name, part.round, robot)

    def configuration(self, part: form.Configuration) -> Configuration[Constant]:
        self.expect(self.robots, part.robots, ".robots", part)
        store = self.store(part.store)
        return Configuration(
            tuple(self.of_robot(number, one, store) for number, one in enumerate(part.robots)),
            store,
            part.round,
            part.turn,
            frozenset(part.taken),
            None if isinstance(part.fault, UnsetType) else self.fault(part.fault),
        )

    def of_robot(self, number: int, part: form.Robot, store: Store[Constant]) -> Robot[Constant]:
        own = self.names.of(number)
        if part.status not in form.STATUS_NAMES:
            reason = f"{shortened(part.status)!r} is none of {', '.join(form.STATUS_NAMES)}"
            raise FormError(reason, ".status", part=part)
        ran = self.event(part.ran, own, ".ran", part)
        return Robot(
            self.names.system.kinds[number],
            self.variables(part.locals, own.locals, ".locals", part),
            self.variables(part.ports, own.ports, ".ports", part),
            store if isinstance(part.copy, UnsetType) else self.store(part.copy),
            form.STATUS_NAMES.index(part.status),
            NO_EVENT if ran is None else ran,
            part.turn,
        )

    def store(self, part: form.Store) -> Store[Constant]:
        def make() -> Store[Constant]:
            return Store(
                self.variables(part.allread, self.names.allread, ".allread", part),
                self.variables(part.allwrite, self.names.allwrite, ".allwrite", part),
            )

        return self.known_or(make, (Store, None), part)

    def variables(
        self, held: Mapping[str, object], among: Sequence[Named], path: str, part: form.Form
    ) -> tuple[Storage[Constant], ...]:
        names = [n.older if n.name not in held and n.older in held else n.name for n in among]
        try:
            parts = JsonNode(held).fields(names)
            return tuple(
                self.once(decode_storage, parts[name], named.type)
                for name, named in zip(names, among, strict=True)
            )
        except FormError as error:
            raise FormError(error.message, path + error.path, error.code, part) from None

    def fault(self, part: form.Fault) -> Fault:
        if part.kind not in FaultKind.__members__:
            reason = f"there is no fault of the kind {shortened(part.kind)!r}"
            raise FormError(reason, ".kind", part=part)
        robot = None if part.robot is None else self.robot(part.robot, part)
        return Fault(FaultKind[part.kind], robot, Span(*part.place), part.detail)
