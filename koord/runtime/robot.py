"""The base of compiled programs: a robot, its events and its turns.

`koord compile` writes classes that derive from :class:`Robot`. Their attributes are the robot's
variables, its ports, and its copy of every shared variable: ``M`` and ``cp`` of the semantics. An
event runs on a copy of the attributes: until a decision lets it through, nothing has happened.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from koord.runtime import shapes
from koord.runtime.buffers import Buffer, Event, Tried, Written
from koord.runtime.operations import (
    UNSET,
    FaultError,
    at,
    contains,
    entry,
    first_of,
    greatest,
    has_key,
    known,
    last_of,
    least,
    no_choice,
    put,
    quotient,
    ratio,
    real,
    remainder,
    same,
    whole,
    without,
    without_key,
)
from koord.runtime.proposals import INIT_ROUND, Attempt, EventFault, Proposal, StopRequests, Write
from koord.runtime.shapes import (
    BOOL,
    FLOAT,
    INT,
    STRING,
    Array,
    Enumeration,
    PerRobot,
    Record,
    Shape,
    begun,
    blank,
    default,
    element_of,
    from_plain,
    holds_map,
    to_plain,
)
from koord.runtime.shapes import Mapping as MapOf
from koord.runtime.shapes import Sequence as ListOf
from koord.runtime.store import Layout, Shared
from koord.runtime.unput import Unput
from koord.syntax.faults import FaultKind

#: Names one evaluation of ``choose`` or of an external function within one turn. [RECORDING]
Key = tuple[int, ...]


class Turn(Enum):
    """The turn in which a program calls its host."""

    INIT = "init"
    PROG = "prog"
    ENV = "env"


class Status(Enum):
    """The status of a robot: whether it runs events. [STOP]"""

    RUNNING = 0
    ASKED = 1  #: goes on until everyone asked
    STOPPED = 2


class Host(Protocol):
    """The environment of a program: sensors, external functions, choices.

    Values are what :mod:`koord.runtime.shapes` says; lists do for tuples, and tuples for records.
    """

    def start(self, robot: int | None, name: str) -> Any:
        """The start of an arbitrary variable; ``robot`` is None for allwrite variables."""
        ...

    def read(self, robot: Robot) -> Mapping[str, Any]:
        """The readings of the sensors without a model after a round, by attribute."""
        ...

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        """The answer of an external function, whose ``requires`` are met."""
        ...

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        """A value from ``low`` to ``high``, both included."""
        ...


class AnsweringHost(Host, Protocol):
    """A host that other programs than the robots' may ask: those that claims compile to."""

    def also_answer(self, program: type[Robot]) -> None:
        """Answer the functions of a program in the shapes that it declares."""
        ...


class Forwarding:
    """A host that asks another; what it changes of the answers, subclasses say."""

    def __init__(self, host: Host) -> None:
        self.host = host

    def start(self, robot: int | None, name: str) -> Any:
        return self.host.start(robot, name)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        return self.host.read(robot)

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        return self.host.ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return self.host.choose(turn, robot, key, low, high)


#: Instead of the buffer of an event that somebody else has run: it has no output.
_ELSEWHERE = Buffer(None)


class Robot:
    """A robot that runs a compiled program.

    The attributes in ``vars(robot)`` are the program's; everything else is in slots.
    """

    #: The file that the program comes from.
    SOURCE: ClassVar[str] = ""
    #: The robot's kind, by its position among the kinds of the program.
    KIND: ClassVar[int] = 0
    SHARED: ClassVar[Layout] = Layout(())
    LOCALS: ClassVar[Mapping[str, Shape]] = {}
    PORTS: ClassVar[Mapping[str, Shape]] = {}
    #: Whether a model of the environment may fault.
    MODEL_MAY_FAULT: ClassVar[bool] = False
    #: The sensors that no model of the environment writes.
    SENSORS: ClassVar[tuple[str, ...]] = ()
    #: The others.
    MODELLED: ClassVar[tuple[str, ...]] = ()
    EXTERNALS: ClassVar[Mapping[str, Shape]] = {}
    EVENTS: ClassVar[tuple[Event, ...]] = ()

    _own: ClassVar[Mapping[str, Shape]] = {}  #: of variables and ports
    _numbers: ClassVar[dict[str, int]] = {}
    _urgent: ClassVar[tuple[int, ...]] = ()
    _modelled: ClassVar[bool] = False
    #: Sensors with maps in them: to these it matters in which order their keys are.
    _ordered: ClassVar[frozenset[str]] = frozenset()
    _blanks: ClassVar[dict[int, dict[str, Any]]] = {}

    __slots__ = (
        "__dict__",
        "_answers",
        "_buffer",
        "_buffers",
        "_in_summary",
        "_turn",
        "_unput",
        "delta",
        "host",
        "kinds",
        "numAgents",
        "pid",
        "ran",
        "status",
    )

    def __init_subclass__(cls) -> None:
        cls._own = {**cls.LOCALS, **cls.PORTS}
        cls._numbers = {v.name: k for k, v in enumerate(cls.SHARED.variables)}
        cls._urgent = tuple(k for k, event in enumerate(cls.EVENTS) if event.urgent)
        cls._modelled = cls.environment is not Robot.environment
        cls._ordered = frozenset(n for n in cls.SENSORS if holds_map(cls.PORTS[n]))
        cls._blanks = {}

    def __init__(self, pid: int, kinds: Sequence[int], delta: float, host: Host) -> None:
        """Make a robot; ``kinds`` are those of all robots, ``delta`` the round's length in s."""
        self.pid = pid
        self.kinds = tuple(kinds)
        self.numAgents = len(self.kinds)
        self.delta = delta
        self.host = host
        self.status = Status.RUNNING
        self.ran: int | None = None
        self._turn = Turn.INIT
        self._in_summary = False
        self._answers: dict[Key, Any] = {}
        self._buffer = Buffer(None)
        self._unput: Unput | None = None  #: while an event runs
        self._buffers: dict[int | None, Buffer] = {}
        self.__dict__.update(self._blank(self.numAgents))

    @classmethod
    def owes(cls) -> bool:
        """Return whether rounds wait for the robot: urgent events, or a model that may fault."""
        return bool(cls._urgent) or cls.MODEL_MAY_FAULT

    # --- what compiled programs define ------------------------------------------------------------

    def declare(self) -> None:
        """Set the allwrite variables to their initial values. [INIT]"""

    def initialise(self) -> None:
        """Set all other variables to their initial values, then run the ``init:`` block. [INIT]"""

    def environment(self) -> dict[str, Any]:
        """The ports that a model writes in the environment's turn. [ENV-MODEL]"""
        return {}

    # --- what compiled programs do ----------------------------------------------------------------

    def set(self, name: str, value: Any, path: tuple[Any, ...] = (), *places: str) -> None:
        """Write a shared variable or a part of it. [SHARED-ASSIGN] [ALLREAD]"""
        state, unput = self.__dict__, self._unput
        if not path:
            state[name] = value
        elif unput is None or not unput.put(state, name, value, path, places):
            changed = state[name] = put(getattr(self, name), value, path, *places)
            if len(path) > 1:
                path, value = _to_first_key(changed, path, value)
        self._buffer.writes.append((name, path, value))

    if not TYPE_CHECKING:  # to a type checker every name would be an attribute

        def __getattr__(self, name: str) -> Any:
            """The value of an array that the event has put something into."""
            unput = None if name == "_unput" else self._unput
            if unput is not None:
                with suppress(KeyError):
                    return unput.make(self.__dict__, name)
            story = f"{type(self).__name__!r} object has no attribute {name!r}"
            raise AttributeError(story, name=name, obj=self)

    def enter(self, lock_class: int) -> None:
        """Enter an atomic block; the decision says later whether the robot may. [ATOMIC]"""
        self._buffer.locks.add(lock_class)

    def stop(self) -> None:
        """Execute ``stop``: no more events after this one. [STOP]"""
        self._buffer.asked = StopRequests.TO_STOP

    def trystop(self) -> None:
        """Execute ``trystop()``: stop when everyone has asked. [STOP]"""
        if self._buffer.asked is StopRequests.NOTHING:
            self._buffer.asked = StopRequests.TO_STOP_TOGETHER

    def output(self, stream: str, place: str, *values: Any) -> None:
        """Execute ``stream << value << …``. [OUTPUT]"""
        self._buffer.output.append(Written(stream, place, values))

    def start(self, name: str) -> Any:
        """The value that an arbitrary variable of the robot starts with. [INIT]"""
        shape = self.LOCALS.get(name) or self.PORTS.get(name)
        if shape is None:  # the robot's own entry of an allread variable
            shape = element_of(self.SHARED.variables[self._numbers[name]].shape)
        return from_plain(shape, self.host.start(self.pid, name), self.numAgents)

    def start_shared(self, name: str) -> Any:
        """The value that an arbitrary allwrite variable starts with. [INIT]"""
        shape = self.SHARED.variables[self._numbers[name]].shape
        return from_plain(shape, self.host.start(None, name), self.numAgents)

    def ask(self, function: str, key: Key, *arguments: Any) -> Any:
        """Ask an external function; the same query has the same answer. [EXTERNAL]"""
        if key not in self._answers:
            if self._unput is not None:
                self._unput.make_all(self.__dict__)  # who is asked may look at the robot
            answer = self.host.ask(self._turn, self.pid, key, function, arguments)
            self._answers[key] = from_plain(self.EXTERNALS[function], answer, self.numAgents)
        return self._answers[key]

    def choose(self, key: Key, low: Any, high: Any, place: str) -> Any:
        """Choose a value between two bounds, inclusive. [CHOOSE]"""
        if not low <= high:
            no_choice(place)
        if key not in self._answers:
            if self._unput is not None:
                self._unput.make_all(self.__dict__)
            self._answers[key] = self.host.choose(self._turn, self.pid, key, low, high)
        return self._answers[key]

    def require(self, condition: Callable[[], bool], function: str, place: str) -> None:
        """Check a ``requires`` of an external function; one that faults is not met. [EXTERNAL]

        What functions require that a summary mentions is nobody's concern.
        """
        if self._in_summary:
            return
        self._in_summary = True
        try:
            met = condition()
        except FaultError:
            met = False
        self._in_summary = False
        if not met:
            raise FaultError(FaultKind.PRECONDITION, place, function)

    # --- rounds -----------------------------------------------------------------------------------

    def propose_init(self) -> Proposal:
        """Run INIT into a buffer; the store as declared must be in place. [INIT]"""
        buffer = self._run(Buffer(None), type(self).initialise, Turn.INIT)
        buffer.locks = set()  # nobody is kept out of INIT
        self._buffers = {None: buffer}
        return Proposal(self.pid, INIT_ROUND, (self._attempt(buffer),), urgent=True)

    def propose(
        self, round_: int, order: Iterable[int] | None = None, *, willing: bool = True
    ) -> Proposal:
        """Choose an event and run it into a buffer. [SELECT] [EVENT-TRANS]

        The first enabled one in ``order`` (that of the program) is chosen. A robot that is not
        ``willing`` skips, if no urgent event obliges it.
        """
        self._answers, self._buffers = {}, {}
        self._turn = Turn.PROG
        if self.status is Status.STOPPED:
            return Proposal(self.pid, round_)
        owed = [b for k in self._urgent if (b := self.try_event(k)) is not None and not b.in_pre]
        chosen: list[Buffer] = []
        if willing or owed:
            for position in order if order is not None else range(len(self.EVENTS)):
                tried = self.try_event(position)
                if tried is not None:
                    chosen.append(tried)
                    break
        if not chosen:
            return Proposal(self.pid, round_)
        chosen += [buffer for buffer in owed if buffer not in chosen]
        attempts = tuple(map(self._attempt, chosen))
        return Proposal(self.pid, round_, attempts, urgent=bool(owed))

    def rest(self) -> None:
        """Have no event in this program turn: somebody else knows that none is enabled. [SKIP]"""
        self._answers, self._buffers = {}, {}

    def run_elsewhere(self, event: int) -> None:
        """Have one event in this program turn, which somebody else has run. [SELECT]"""
        self._answers, self._buffers = {}, {event: _ELSEWHERE}

    def keep(self, event: int, asked: StopRequests, changes: Mapping[str, Any]) -> None:
        """Commit an event that somebody else has run: keep its changes. [END-EVENT]"""
        self.__dict__.update(changes)
        self._end(event, asked)

    def tried(self, event: int | None) -> Tried:
        """What an event in a buffer has changed of the robot, and its output."""
        buffer, held = self._buffers[event], self.__dict__
        changes = {n: value for n, value in buffer.state.items() if value is not held[n]}
        return Tried(changes, tuple(buffer.output))

    def take_over(self, attempts: Iterable[Attempt], tried: Iterable[Tried]) -> None:
        """Have events in this program turn that the robot has run in another process. [SELECT]"""
        self._answers, self._buffers = {}, {}
        for attempt, one in zip(attempts, tried, strict=True):
            buffer = self._buffers[attempt.event] = Buffer(attempt.event)
            buffer.state = {**self.__dict__, **one.changes}
            buffer.output = list(one.output)
            buffer.asked, buffer.fault = attempt.asked, attempt.fault

    def try_event(self, position: int) -> Buffer | None:
        """Run an event into a buffer, once a round; None if it is not enabled."""
        if position in self._buffers:
            return self._buffers[position]
        event = self.EVENTS[position]
        try:
            if event.pre is not None and not event.pre(self):
                return None
        except FaultError as error:
            buffer = Buffer(position)
            buffer.fault, buffer.in_pre = error.fault, True
        else:
            buffer = self._run(Buffer(position), event.effect, Turn.PROG)
        self._buffers[position] = buffer
        return buffer

    @property
    def had_an_event(self) -> bool:
        """True if the robot ran an event into a buffer in its last program turn. [ATOMIC]"""
        return bool(self._buffers)

    def commit(self, event: int | None, changed: Mapping[str, Any]) -> list[Written]:
        """Commit an event: keep its changes and its output. [END-EVENT]

        ``changed`` are the variables of the store that differ now. [REFRESH]
        """
        buffer = self._buffers[event]
        self.__dict__ = buffer.state
        self.__dict__.update(changed)
        self._end(event, buffer.asked)
        return buffer.output

    def _end(self, event: int | None, asked: StopRequests) -> None:
        self.ran = event
        if asked is StopRequests.TO_STOP:
            self.status = Status.STOPPED
        elif asked is StopRequests.TO_STOP_TOGETHER and self.status is Status.RUNNING:
            self.status = Status.ASKED

    def outcome(self, event: int | None) -> list[Written]:
        """The output of an event that was run."""
        buffer = self._buffers.get(event)
        return [] if buffer is None else buffer.output

    def discard(self, changed: Mapping[str, Any]) -> None:
        """Discard the turn: the robot skipped. [SKIP] [ATOMIC]"""
        self.__dict__.update(changed)
        self.ran = None

    def refresh(self, changed: Mapping[str, Any]) -> None:
        """Update shared variables that others changed; pending events are based on older values."""
        self.__dict__.update(changed)
        for buffer in self._buffers.values():
            buffer.state.update(changed)

    @property
    def has_model(self) -> bool:
        """True if a module of the robot has a model, which may fault."""
        return self._modelled

    def ports(self) -> dict[str, Any]:
        """The values of the robot's ports."""
        held = self.__dict__
        return {name: held[name] for name in self.PORTS}

    def evolve(self, readings: Mapping[str, Any]) -> EventFault | None:
        """Take the environment's turn: models first, on the ports before it; then sensors.
        [ENV-TRANS]

        What is read again stays the same object, so that nobody need look at it again. Raises
        ShapeError for a reading of another shape than its sensor's.
        """
        self._answers = {}
        self._turn = Turn.ENV
        held = self.__dict__
        if self._modelled:
            try:
                held.update(self.environment())
            except FaultError as error:
                return error.fault
        for name in self.SENSORS:
            if name in readings and (reading := readings[name]) is not held[name]:
                value = from_plain(self.PORTS[name], reading, self.numAgents)
                if name in self._ordered or value != held[name]:
                    held[name] = value
        return None

    # --- inside -----------------------------------------------------------------------------------

    @classmethod
    def _blank(cls, robots: int) -> dict[str, Any]:
        """The unset attributes of a new robot, shared between robots, as values are immutable."""
        if robots not in cls._blanks:
            shared = {variable.name: variable.shape for variable in cls.SHARED.variables}
            shapes = {**shared, **cls.LOCALS, **cls.PORTS}
            cls._blanks[robots] = {name: blank(shape, robots) for name, shape in shapes.items()}
        return cls._blanks[robots]

    def _run(self, buffer: Buffer, body: Callable[[Any], None], turn: Turn) -> Buffer:
        """Run a body on a copy of the attributes."""
        before = self.__dict__
        self.__dict__ = before.copy()
        self._buffer, self._turn, self._unput = buffer, turn, Unput()
        try:
            body(self)
        except FaultError as error:
            buffer.fault = error.fault
        finally:
            buffer.state = self.__dict__
            self.__dict__ = before
            self._unput = None
        # A decision that lets it through says what became of these; until then a copy of an array
        # over all robots would be kept for each of them.
        for name, _, _ in buffer.writes:
            buffer.state[name] = before[name]
        return buffer

    def _attempt(self, buffer: Buffer) -> Attempt:
        """The attempt in a buffer, as the other robots see it."""
        locks = tuple(sorted(buffer.locks)) if buffer.locks else ()
        if buffer.fault is not None:
            return Attempt(buffer.event, locks=locks, fault=self.located(buffer.fault))
        writes = tuple([self._write(*write) for write in buffer.writes])
        return Attempt(buffer.event, writes, locks, buffer.asked)

    def located(self, fault: EventFault) -> EventFault:
        """The fault with its file name: in compiled programs a place refers to their own file."""
        if fault.place.count(":") > 1:
            return fault
        return EventFault(fault.kind, f"{self.SOURCE}:{fault.place}", fault.detail)

    def _write(self, name: str, path: tuple[Any, ...], value: Any) -> Write:
        number = self._numbers[name]
        shape = self.SHARED.variables[number].shape
        if not path:
            return Write(number, path, to_plain(shape, value))
        for position, step in enumerate(path):
            match shape:
                case Record(fields=fields):
                    shape = fields[step]
                case MapOf(key=key, value=held):
                    at_key = (*path[:position], to_plain(key, step))
                    return Write(number, at_key, to_plain(held, value))
                case _:
                    shape = element_of(shape)
        return Write(number, path, to_plain(shape, value))


def _to_first_key(changed: Any, path: tuple[Any, ...], value: Any) -> tuple[tuple[Any, ...], Any]:
    """Cut a path at its first key: below a key the whole entry is one location. [LOCATION]"""
    for position, step in enumerate(path[:-1], start=1):
        if isinstance(changed, dict):
            return path[:position], changed[step]
        changed = changed[step]
    return path, value


__all__ = [
    "BOOL",
    "FLOAT",
    "INT",
    "STRING",
    "UNSET",
    "Array",
    "Enumeration",
    "Event",
    "Host",
    "Key",
    "Layout",
    "ListOf",
    "MapOf",
    "PerRobot",
    "Record",
    "Robot",
    "Shape",
    "Shared",
    "StopRequests",
    "Turn",
    "at",
    "begun",
    "contains",
    "default",
    "entry",
    "first_of",
    "greatest",
    "has_key",
    "known",
    "last_of",
    "least",
    "put",
    "quotient",
    "ratio",
    "real",
    "remainder",
    "same",
    "shapes",
    "whole",
    "without",
    "without_key",
]
