"""The run of a trace from JSON, every part of it checked against the program. [TRACE]"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from koord.semantics.configurations import (
    NO_EVENT,
    Configuration,
    Fault,
    FaultKind,
    Robot,
    Store,
    Turn,
    Written,
)
from koord.semantics.domain import Constant
from koord.semantics.oracle import Phase
from koord.semantics.recording import Answer, Concrete, Opening, Reading, Recording, Round, Start
from koord.semantics.storage import Storage
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import Type
from koord.traces.encode_runs import STATUS_NAMES, answer_types, startable
from koord.traces.json_reader import Reader, shortened
from koord.traces.names import KindNames, Named, Names
from koord.traces.trace import (
    BEFORE_ROUNDS,
    Emitted,
    Numbers,
    Sources,
    Trace,
    Violation,
    ViolationKind,
)
from koord.traces.value_codec import decode_storage, decode_value

_ROUND = ("order", "events", "readings", "answers", "cut", "output", "after")


def decode_run(reader: Reader, sources: Sources, system: System, numbers: Numbers) -> Trace:
    """The trace of that system whose run a part of a document holds. Raises KoordError."""
    return _Decoding(Names(system), numbers).trace(reader, sources)


class _Decoding(Struct, frozen=True):
    """What the values of a run are decoded by."""

    names: Names
    numbers: Numbers

    @property
    def robots(self) -> int:
        return self.names.system.robots

    def trace(self, reader: Reader, sources: Sources) -> Trace:
        parts = reader.fields(("opening", "initial", "rounds", "violation"), ("loop",))
        opening = parts["opening"].fields(("order", "starts", "answers", "output"))
        outputs = self.outputs(opening["output"], BEFORE_ROUNDS)
        configurations = [self.configuration(parts["initial"])]
        rounds = []
        for number, item in enumerate(parts["rounds"].items()):
            of_round = item.fields(_ROUND)
            rounds.append(self.round(of_round))
            outputs += self.outputs(of_round["output"], number)
            configurations.append(self.configuration(of_round["after"]))
        recording = Recording(
            Opening(
                self.order(opening["order"]),
                tuple(self.start(item) for item in opening["starts"].items()),
                self.answers(opening["answers"]),
            ),
            tuple(rounds),
            parts["loop"].integer(0, len(rounds)) if "loop" in parts else None,
        )
        return Trace(
            sources,
            self.names.system,
            self.numbers,
            recording,
            tuple(configurations),
            tuple(outputs),
            self.violation(parts["violation"], len(rounds)),
        )

    # --- the recording --------------------------------------------------------------------------

    def round(self, parts: dict[str, Reader]) -> Round:
        return Round(
            self.order(parts["order"]),
            tuple(
                self.event(item, self.names.of(robot))
                for robot, item in enumerate(parts["events"].items(self.robots))
            ),
            tuple(self.reading(item) for item in parts["readings"].items()),
            self.answers(parts["answers"]),
            parts["cut"].boolean(),
        )

    def robot(self, reader: Reader) -> int:
        return reader.integer(0, self.robots)

    def order(self, reader: Reader) -> tuple[int, ...]:
        return tuple(self.robot(item) for item in reader.items())

    def event(self, reader: Reader, own: KindNames) -> int | None:
        if reader.value is None:
            return None
        name = reader.text()
        if name not in own.events:
            known = ", ".join(own.events) or "none"
            raise reader.refuse(
                f"the robot has no event {shortened(name)!r}; its events are: {known}", "K914"
            )
        return own.events.index(name)

    def start(self, reader: Reader) -> Start:
        parts = reader.fields(("home", "variable", "robot", "value"))
        home = parts["home"].member(Home)
        if home is Home.BOUND:
            raise parts["home"].refuse("bound variables have no start")
        robot = None if home is Home.ALLWRITE else self.robot(parts["robot"])
        if home is Home.ALLWRITE and parts["robot"].value is not None:
            raise parts["robot"].refuse("an allwrite variable belongs to no robot")
        named = self.named(parts["variable"], startable(self.names, home, robot))
        return Start(home, named.slot, robot, self.value(parts["value"], named.type))

    def reading(self, reader: Reader) -> Reading:
        parts = reader.fields(("robot", "port", "value"))
        robot = self.robot(parts["robot"])
        named = self.named(parts["port"], self.names.of(robot).ports)
        return Reading(robot, named.slot, self.value(parts["value"], named.type))

    def named(self, reader: Reader, among: Sequence[Named]) -> Named:
        name = reader.text()
        for named in among:
            if named.name == name:
                return named
        for named in among:
            if named.older == name:
                return named
        raise reader.refuse(f"the program has no {shortened(name)!r} here", "K914")

    def answers(self, reader: Reader) -> tuple[Answer, ...]:
        return tuple(self.answer(item) for item in reader.items())

    def answer(self, reader: Reader) -> Answer:
        parts = reader.fields(("phase", "robot", "key", "function", "arguments", "value"))
        key = tuple(item.integer() for item in parts["key"].items())
        if not key:
            raise parts["key"].refuse("there should be the number of a call here, at least")
        named = parts["function"].value is not None
        function = parts["function"].text() if named else None
        try:
            result, parameters = answer_types(self.names, function, key[0])
        except KeyError:
            what = "no such function" if named else f"no choose with the number {key[:1]}"
            raise parts["function" if named else "key"].refuse(
                f"the program has {what}", "K914"
            ) from None
        arguments = parts["arguments"].items(len(parameters))
        pairs = zip(arguments, parameters, strict=True)
        return Answer(
            parts["phase"].member(Phase),
            self.robot(parts["robot"]),
            key,
            function,
            tuple(self.value(item, type_) for item, type_ in pairs),
            self.value(parts["value"], result),
        )

    def value(self, reader: Reader, type_: Type) -> Concrete:
        return decode_value(reader, type_, self.robots, self.numbers)

    # --- what was seen --------------------------------------------------------------------------

    def outputs(self, reader: Reader, number: int) -> list[Emitted]:
        return [self.output(item, number) for item in reader.items()]

    def output(self, reader: Reader, number: int) -> Emitted:
        parts = reader.fields(("robot", "stream", "types", "values"))
        types = []
        for item in parts["types"].items():
            known = self.names.outputs.get(item.text())
            if known is None:
                raise item.refuse("the program writes nothing of that type", "K914")
            types.append(known)
        pairs = zip(parts["values"].items(len(types)), types, strict=True)
        values = tuple(self.value(item, type_) for item, type_ in pairs)
        robot = None if parts["robot"].value is None else self.robot(parts["robot"])
        return Emitted(number, robot, Written(parts["stream"].text(), values, tuple(types)))

    def violation(self, reader: Reader, rounds: int) -> Violation | None:
        if reader.value is None:
            return None
        parts = reader.fields(("kind", "name", "round", "robot"))
        return Violation(
            parts["kind"].member(ViolationKind),
            parts["name"].text(),
            parts["round"].integer(BEFORE_ROUNDS, rounds),
            None if parts["robot"].value is None else self.robot(parts["robot"]),
        )

    def configuration(self, reader: Reader) -> Configuration[Constant]:
        parts = reader.fields(("round", "store", "robots"), ("turn", "taken", "fault"))
        store = self.store(parts["store"])
        taken = parts["taken"].items() if "taken" in parts else []
        return Configuration(
            tuple(
                self.of_robot(number, item, store)
                for number, item in enumerate(parts["robots"].items(self.robots))
            ),
            store,
            parts["round"].integer(0),
            parts["turn"].member(Turn) if "turn" in parts else Turn.PROG,
            frozenset(item.integer(0) for item in taken),
            self.fault(parts["fault"]) if "fault" in parts else None,
        )

    def of_robot(self, number: int, reader: Reader, store: Store[Constant]) -> Robot[Constant]:
        parts = reader.fields(("status", "ran", "turn", "locals", "ports"), ("copy",))
        own = self.names.of(number)
        status = parts["status"].text()
        if status not in STATUS_NAMES:
            raise parts["status"].refuse(
                f"{shortened(status)!r} is none of {', '.join(STATUS_NAMES)}"
            )
        ran = self.event(parts["ran"], own)
        return Robot(
            self.names.system.kinds[number],
            self.variables(parts["locals"], own.locals),
            self.variables(parts["ports"], own.ports),
            self.store(parts["copy"]) if "copy" in parts else store,
            STATUS_NAMES.index(status),
            NO_EVENT if ran is None else ran,
            parts["turn"].member(Turn),
        )

    def store(self, reader: Reader) -> Store[Constant]:
        parts = reader.fields(("allread", "allwrite"))
        return Store(
            self.variables(parts["allread"], self.names.allread),
            self.variables(parts["allwrite"], self.names.allwrite),
        )

    def variables(self, reader: Reader, among: Sequence[Named]) -> tuple[Storage[Constant], ...]:
        held = reader.value if isinstance(reader.value, dict) else {}
        names = [n.older if n.name not in held and n.older in held else n.name for n in among]
        parts = reader.fields(names)
        return tuple(
            decode_storage(parts[name], named.type, self.robots, self.numbers)
            for name, named in zip(names, among, strict=True)
        )

    def fault(self, reader: Reader) -> Fault:
        parts = reader.fields(("kind", "robot", "place", "detail"))
        kind = parts["kind"].text()
        if kind not in FaultKind.__members__:
            raise parts["kind"].refuse(f"there is no fault of the kind {shortened(kind)!r}")
        file, *numbers = parts["place"].items(5)
        line, column, end_line, end_column = (number.integer(0) for number in numbers)
        return Fault(
            FaultKind[kind],
            None if parts["robot"].value is None else self.robot(parts["robot"]),
            Span(file.text(), line, column, end_line, end_column),
            parts["detail"].text(),
        )
