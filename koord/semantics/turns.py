"""A robot's turns, initial and of the program, over any domain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Generic, TypeAlias, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import (
    NO_EVENT,
    Fault,
    Robot,
    Store,
    Turn,
    Written,
)
from koord.semantics.domain import Domain, conjunction
from koord.semantics.expressions import condition, evaluate
from koord.semantics.locations import Mask, joined
from koord.semantics.machine import Legality, Machine
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.statements import assign, machine, run
from koord.semantics.storage import Storage, stored, unset
from koord.syntax import core
from koord.syntax.core import BinaryOp, Start
from koord.syntax.system import Status, System
from koord.syntax.types import INT, ArrayType, Robots, Type

V = TypeVar("V")

Output: TypeAlias = "tuple[V, Written[V]]"


class Turned(Struct, Generic[V], frozen=True):
    """The result of a turn: the robot after it, its writes, locks, output, faults and legality.

    ``robot.copy`` holds the robot's own view after its writes; the masks say which locations of it
    it wrote. ``entered`` says for each lock class whether the turn entered it. Each fault comes
    with its condition; every ``legality`` condition must hold for the turn to be one at all.
    """

    robot: Robot[V]
    allread: Mapping[int, Mask[V]]
    allwrite: Mapping[int, Mask[V]]
    entered: Mapping[int, V]
    output: tuple[Output[V], ...]
    faults: tuple[tuple[V, Fault], ...]
    legality: tuple[Legality[V], ...]


# --- INIT ---------------------------------------------------------------------------------------


def declared(
    d: Domain[V], system: System, inputs: Inputs[V]
) -> tuple[Store[V], tuple[tuple[V, Fault], ...]]:
    """The shared store before any robot's INIT: allwrite variables as declared. [INIT]"""
    program, robots = system.program, system.size
    allread = tuple(unset(d, entry.variable.type, robots) for entry in program.allread)
    m = machine(d, system, inputs.oracle(Phase.INIT, 0))
    m.memory.allread = list(allread)
    m.memory.allwrite = [unset(d, entry.variable.type, robots) for entry in program.allwrite]
    start_all(m, program.allwrite, m.memory.allwrite, inputs, None)
    return Store(allread, tuple(m.memory.allwrite)), tuple(m.faults)


def start_all(
    m: Machine[V],
    entries: Iterable[core.Declaration],
    storages: list[Storage[V]],
    inputs: Inputs[V],
    robot: int | None,
) -> None:
    """Let variables start, in order of declaration. [INIT]"""
    for entry in entries:
        start = _starting(m, entry, entry.variable.type, inputs, robot)
        if start is not None:
            storages[entry.variable.slot] = start


def _starting(
    m: Machine[V],
    entry: core.Declaration,
    type_: Type,
    inputs: Inputs[V],
    robot: int | None,
) -> Storage[V] | None:
    """The storage that a variable starts with, or None where it stays unset."""
    if entry.initial is Start.UNSET:
        return None
    if entry.initial is Start.ARBITRARY:
        return stored(m.d, type_, inputs.start(entry, robot), m.system.size)
    return stored(m.d, type_, evaluate(m, entry.initial), m.system.size)


def initial_turn(
    d: Domain[V], system: System, robot: int, store: Store[V], inputs: Inputs[V]
) -> Turned[V]:
    """Run a robot's initial turn: initial values, then the ``init:`` block. [INIT]"""
    agent = system.agent(robot)
    m = machine(
        d,
        system,
        inputs.oracle(Phase.INIT, robot),
        robot=robot,
        locals=tuple(unset(d, x.variable.type, system.size) for x in agent.locals),
        ports=tuple(unset(d, p.declaration.variable.type, system.size) for p in agent.ports),
        copy=store,
        bound=agent.init_bound,
    )
    start_all(m, [port.declaration for port in agent.ports], m.memory.ports, inputs, robot)
    start_all(m, agent.locals, m.memory.locals, inputs, robot)
    for entry in system.program.allread:
        start_own_entry(m, entry, inputs, robot)
    run(m, agent.init)
    return turned_by(m, robot, Status.RUNNING, NO_EVENT, None)


def start_own_entry(m: Machine[V], entry: core.Declaration, inputs: Inputs[V], robot: int) -> None:
    """Set the robot's own entry of an allread variable to its start. [INIT] [ALLREAD]"""
    variable = entry.variable
    assert isinstance(variable.type, ArrayType)
    assert variable.type.size is Robots.ALL
    if entry.initial is Start.UNSET:
        return
    own = core.IndexStep(core.Pid(INT), variable.type.element)
    place = core.Place(variable, (own,), span=entry.span)
    if entry.initial is Start.ARBITRARY:
        assign(m, place, inputs.start(entry, robot))
    else:
        assign(m, place, evaluate(m, entry.initial))


# --- program turns ------------------------------------------------------------------------------


def guard_of(
    d: Domain[V], system: System, robot: int, state: Robot[V], event: core.Event, inputs: Inputs[V]
) -> tuple[V, V]:
    """Return the conditions that an event's ``pre`` holds, and that it has no fault. [SELECT]

    With answers that no external function can give it counts as holding: nobody may skip on the
    strength of them. [SKIP]
    """
    m = _machine_for(d, system, robot, state, event.bound, inputs)
    holds = condition(m, event.guard)
    sound = conjunction(d, [m.negated(fault) for fault, _ in m.faults])
    legal = conjunction(d, [needed.condition for needed in m.legality])
    return m.either(m.both(holds, sound), m.negated(legal)), sound


def program_turn(
    d: Domain[V], system: System, robot: int, state: Robot[V], position: int, inputs: Inputs[V]
) -> tuple[V, Turned[V]]:
    """Run one event: the condition that its ``pre`` holds, and the result. [EVENT-TRANS]

    A ``pre`` that cannot be evaluated is a fault of whoever selects the event, so the first
    component is whether the event may be *selected*: ``pre`` holds or faults. [SELECT] [FAULT]
    """
    event = system.agent(robot).events[position]
    m = _machine_for(d, system, robot, state, event.bound, inputs)
    holds = condition(m, event.guard)
    broken = m.truth(False)
    for fault, _ in m.faults:
        broken = m.either(broken, fault)
    run(m, event.effect)
    return m.either(holds, broken), turned_by(m, robot, None, position, state)


def skip_turn(d: Domain[V], state: Robot[V]) -> Turned[V]:
    """Skip the turn: the state stays as it is. [SKIP] [END-EVENT]"""
    after = replace(state, ran=d.const(NO_EVENT, INT), turn=Turn.ENV)
    return Turned(after, {}, {}, {}, (), (), ())


def _machine_for(
    d: Domain[V], system: System, robot: int, state: Robot[V], bound: int, inputs: Inputs[V]
) -> Machine[V]:
    return machine(
        d,
        system,
        inputs.oracle(Phase.PROG, robot),
        robot=robot,
        locals=state.locals,
        ports=state.ports,
        copy=state.copy,
        bound=bound,
    )


def turned_by(
    m: Machine[V], robot: int, status: Status | None, ran: int, before: Robot[V] | None
) -> Turned[V]:
    """The result of a turn, from the machine's memory and logs. [END-EVENT] [STOP]"""
    d, memory = m.d, m.memory
    if before is None:
        old = d.const(int(status if status is not None else Status.RUNNING), INT)
    else:
        old = before.status
    # Asking to stop never undoes a stop; stopping wins over asking.
    asked = d.binary(BinaryOp.MAX, old, d.const(int(Status.ASKED), INT))
    new = d.ite(memory.trystop, asked, old)
    new = d.ite(memory.stop, d.const(int(Status.STOPPED), INT), new)
    state = Robot(
        m.system.kinds[robot],
        tuple(memory.locals),
        tuple(memory.ports),
        Store(tuple(memory.allread), tuple(memory.allwrite)),
        new,
        d.const(ran, INT),
        Turn.ENV,
    )
    return Turned(
        state,
        m.allread_masks,
        m.allwrite_masks,
        m.entered,
        tuple(m.output),
        tuple(m.faults),
        tuple(m.legality),
    )


def committed(d: Domain[V], store: Store[V], turned: Turned[V]) -> Store[V]:
    """The store after one robot's writes, joined location by location. [SHARED-ASSIGN]"""
    copy = turned.robot.copy
    return Store(
        _joined_all(d, store.allread, copy.allread, turned.allread),
        _joined_all(d, store.allwrite, copy.allwrite, turned.allwrite),
    )


def _joined_all(
    d: Domain[V],
    target: tuple[Storage[V], ...],
    source: tuple[Storage[V], ...],
    masks: Mapping[int, Mask[V]],
) -> tuple[Storage[V], ...]:
    if not masks:
        return target
    return tuple(
        joined(d, before, source[slot], masks.get(slot)) for slot, before in enumerate(target)
    )
