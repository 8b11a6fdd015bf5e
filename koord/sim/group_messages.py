"""What the processes of a simulated run tell each other, by pipes between them alone.

They are forks of one process, so that values of programs may travel as Python objects: classes of
records are the same ones on both sides, and are named by where they are.
"""

from __future__ import annotations

import copyreg
import io
import pickle
from collections.abc import Callable, Iterable, Mapping
from types import FunctionType
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import numpy as np

from koord.runtime.buffers import Tried
from koord.runtime.columns.parts import DeedTurns, Turned
from koord.runtime.proposals import Admitted, Attempt, Decision, Proposal, StopRequests, Write
from koord.runtime.robot import Key, Robot, Turn
from koord.sim.sensing import FleetSensors


class Query(NamedTuple):
    """What a robot asked its host; ``function`` is None for a choice between two bounds."""

    turn: Turn
    robot: int
    key: Key
    function: str | None
    arguments: tuple[Any, ...]
    answer: Any


class Step(NamedTuple):
    """What the first process tells of a round: its decision, and the environment's turn.

    ``ran`` and ``writes`` are those of the decision, without structs. ``sensed`` are positions,
    headings and arrivals of all robots, as bytes. ``readings`` are what robots read that were asked
    one by one, and ``served`` what plug-ins serve them with where they read for themselves.
    ``as_deeds`` says that the first process has machine code.
    """

    round: int
    ran: list[tuple[Any, ...]]
    writes: list[tuple[Any, ...]]
    sensed: tuple[bytes, bytes, bytes]
    readings: Mapping[int, Mapping[str, Any]]
    served: Mapping[int, dict[str, Any]] | None
    as_deeds: bool

    @classmethod
    def of(
        cls,
        decision: Decision,
        sensors: FleetSensors,
        readings: Mapping[int, Mapping[str, Any]],
        served: Mapping[int, dict[str, Any]] | None = None,
        *,
        as_deeds: bool,
    ) -> Step:
        ran = [(taken.robot, taken.event, taken.asked.value) for taken in decision.ran]
        writes = [(write.variable, write.path, write.value) for write in decision.writes]
        return cls(decision.round, ran, writes, packed(sensors), readings, served, as_deeds)

    @property
    def decision(self) -> Decision:
        """The decision, without those who skipped."""
        ran = tuple([Admitted(pid, event, _ASKED[asked]) for pid, event, asked in self.ran])
        return Decision(self.round, ran, (), tuple([Write(*one) for one in self.writes]))


class Turns(NamedTuple):
    """The program turns of a group of robots (:func:`flat`), and what they asked."""

    round: int
    turned: list[tuple[Any, ...]]
    deeds: list[DeedTurns]
    queries: list[Query]


class Sensed(NamedTuple):
    """What the robots of a group read, and what their models asked, in the environment's turn."""

    readings: dict[int, Mapping[str, Any]]
    queries: list[Query]


def packed(sensors: FleetSensors) -> tuple[bytes, bytes, bytes]:
    """What programs and their libraries may learn of a fleet's sensors, as bytes."""
    return (
        sensors.position.tobytes(),
        sensors.heading_rad.tobytes(),
        sensors.reached.tobytes(),
    )


def unpacked(parts: tuple[bytes, bytes, bytes], before: FleetSensors) -> FleetSensors:
    """The sensors that were packed; the rest is as it was ``before``."""
    position, heading, reached = parts
    return FleetSensors(
        np.frombuffer(position).reshape(-1, 3),
        np.frombuffer(heading),
        np.frombuffer(reached, np.bool_),
        before.state,
        before.short_m,
        before.planners,
        {},
    )


# --- turns ----------------------------------------------------------------------------------------


def flat(turn: Turned) -> tuple[Any, ...]:
    """A robot's turn without structs, which take four times as long to encode."""
    proposal, tried = turn
    attempts = [
        (
            attempt.event,
            [(write.variable, write.path, write.value) for write in attempt.writes],
            attempt.locks,
            attempt.asked.value,
            attempt.fault,
            *one,
        )
        for attempt, one in zip(proposal.attempts, tried, strict=True)
    ]
    return proposal.robot, proposal.round, proposal.urgent, attempts


def whole(turn: tuple[Any, ...]) -> Turned:
    """A turn that was made flat."""
    robot, round_, urgent, parts = turn
    attempts = [
        Attempt(event, tuple([Write(*one) for one in writes]), locks, _ASKED[asked], fault)
        for event, writes, locks, asked, fault, _, _ in parts
    ]
    tried = [Tried(changes, output) for *_, changes, output in parts]
    return Turned(Proposal(robot, round_, tuple(attempts), urgent), tuple(tried))


_ASKED = {asked.value: asked for asked in StopRequests}


# --- values of programs ---------------------------------------------------------------------------

#: The classes of records of the programs that run, by where they are.
_RECORDS: WeakValueDictionary[int, type[tuple[Any, ...]]] = WeakValueDictionary()


def _record(number: int, parts: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple.__new__(_RECORDS[number], parts)


def _reduced(record: tuple[Any, ...]) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    return _record, (id(type(record)), tuple(record))


class Messages:
    """The encoding of messages with values of compiled programs. Make it before forking."""

    def __init__(self, classes: Iterable[type[Robot]]) -> None:
        self._kept = [*_records(classes)]
        _RECORDS.update({id(one): one for one in self._kept})
        self._table = copyreg.dispatch_table | dict.fromkeys(self._kept, _reduced)

    def encoded(self, message: object) -> bytes:
        into = io.BytesIO()
        pickler = pickle.Pickler(into, pickle.HIGHEST_PROTOCOL)
        pickler.dispatch_table = self._table
        pickler.dump(message)
        return into.getvalue()

    @staticmethod
    def decoded(raw: bytes) -> Any:
        """The message that was encoded. Nothing may be passed in but what our own forks sent."""
        return pickle.loads(raw)


def _records(classes: Iterable[type[Robot]]) -> Iterable[type[tuple[Any, ...]]]:
    """The classes of records in the modules of compiled programs."""
    for program in classes:
        made = next(v for v in vars(program).values() if isinstance(v, FunctionType))
        for one in made.__globals__.values():
            is_record = isinstance(one, type) and issubclass(one, tuple)
            if is_record and one.__module__ == program.__module__:
                yield one
