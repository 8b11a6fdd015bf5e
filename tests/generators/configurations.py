"""Random values, and random configurations at the start of a round, reachable or not."""

from __future__ import annotations

from fractions import Fraction
from random import Random
from typing import TypeAlias

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import EXACT, Constant
from koord.semantics.storage import Cell, Storage, Tree, unset
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.system import Status, System
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    MapType,
    OpaqueType,
    QueueType,
    RecordType,
    Robots,
    StreamType,
    StringType,
    Type,
)

Concrete: TypeAlias = "Value[Constant]"

_INTS = (-2, -1, 0, 0, 1, 1, 2, 3, 4)
_FLOATS = tuple(Fraction(n, 2) for n in range(-4, 7))
_TEXTS = ("", "go", "stop", "far")


def value(random: Random, type_: Type, robots: int, length: int | None = None) -> Concrete:
    """A random value of a type; ``length`` is that of a list, if it is given."""
    match type_:
        case IntType():
            return random.choice(_INTS)
        case FloatType():
            return random.choice(_FLOATS)
        case BoolType():
            return random.random() < 0.5
        case StringType() | StreamType():
            return random.choice(_TEXTS)
        case EnumType(members=members):
            return random.randrange(len(members))
        case RecordType(fields=fields):
            return Rec(tuple(value(random, field, robots) for _, field in fields))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            return _sequence(random, element, robots, count)
        case ListType(element=element) | QueueType(element=element):
            count = random.choice((0, 1, 1, 2, 3)) if length is None else length
            return _sequence(random, element, robots, count)
        case MapType(key=key, value=held):
            keys = dict.fromkeys(value(random, key, robots) for _ in range(random.randint(0, 2)))
            entries = tuple((k, value(random, held, robots)) for k in keys)
            return Table(len(entries), entries)
        case OpaqueType():
            raise AssertionError("no program text has opaque values")


def _sequence(random: Random, element: Type, robots: int, count: int) -> Concrete:
    return Seq(count, tuple(value(random, element, robots) for _ in range(count)))


def storage(random: Random, type_: Type, robots: int, unset_rate: float) -> Storage[Constant]:
    """What a variable may hold: mostly set atoms."""
    match type_:
        case RecordType(fields=fields):
            return Tree(tuple(storage(random, field, robots, unset_rate) for _, field in fields))
        case ArrayType(element=element, size=size):
            count = robots if size is Robots.ALL else size
            return Tree(tuple(storage(random, element, robots, unset_rate) for _ in range(count)))
        case _:
            if random.random() < unset_rate:
                return unset(EXACT, type_, robots)
            return Cell(True, value(random, type_, robots))


def configuration(
    random: Random, system: System, unset_rate: float = 0.04
) -> Configuration[Constant]:
    """A random configuration at the start of a round: copies equal the store."""
    program, robots = system.program, system.robots

    def made(type_: Type) -> Storage[Constant]:
        return storage(random, type_, robots, unset_rate)

    store = Store(
        tuple(made(entry.variable.type) for entry in program.allread),
        tuple(made(entry.variable.type) for entry in program.allwrite),
    )
    states = []
    for number, kind in enumerate(system.kinds):
        agent = system.agent(number)
        states.append(
            Robot(
                kind,
                tuple(made(entry.variable.type) for entry in agent.locals),
                tuple(made(port.declaration.variable.type) for port in agent.ports),
                store,
                int(random.choices((Status.RUNNING, Status.ASKED), (9, 1))[0]),
                random.choice((NO_EVENT, *range(len(agent.events)))),
            )
        )
    return Configuration(tuple(states), store, 0)
