"""Reloading: another program goes on from where robots are, between two rounds. [RELOAD]

:func:`correspondence` says which variables and events of the other program are those of the one
that ran, and :func:`reloaded` makes the configuration in which the other one goes on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from enum import Enum
from typing import TypeAlias, TypeVar

from msgspec import Struct

from koord.semantics.configurations import NO_EVENT, Configuration, Fault, Robot, Store, Turn
from koord.semantics.domain import Domain
from koord.semantics.machine import Legality
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.rounds import IllegalStepError, Stepped, check_legality, first_fault
from koord.semantics.statements import machine
from koord.semantics.storage import Storage, unset
from koord.semantics.turns import Turned, committed, start_all, start_own_entry, turned_by
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, Start
from koord.syntax.system import System
from koord.syntax.types import INT

V = TypeVar("V")

#: For each variable of a program, the slot of the one that it goes on as; None: it starts.
Slots: TypeAlias = "tuple[int | None, ...]"


class Fate(Enum):
    """The fates of variables whose values are not kept."""

    NEW = "new"
    RETYPED = "of another type"
    MOVED = "of another kind"  #: local, allread, allwrite
    GONE = "gone"


class Unkept(Struct, frozen=True):
    """A variable whose value is not kept; ``agent`` is whose it is, "" if all robots have it.

    ``home`` is that in the program that goes on; of one that is gone, that which it had. ``is_set``
    says whether it starts with a value.
    """

    name: str
    agent: str
    home: Home
    fate: Fate
    is_set: bool


class KindMatch(Struct, frozen=True):
    """For one kind of robot, the old slots of its new locals and ports, and events.

    ``events[k]`` is the position that event k of the old program has in the new one, ``NO_EVENT``
    if there is none of its name.
    """

    locals: Slots
    ports: Slots
    events: tuple[int, ...]


class Correspondence(Struct, frozen=True):
    """What of one program goes on in another, and which variables' values are not kept."""

    allread: Slots
    allwrite: Slots
    kinds: tuple[KindMatch, ...]
    unkept: tuple[Unkept, ...]


def correspondence(before: System, after: System) -> Correspondence:
    """What of a system goes on in another one. [RELOAD]

    Raises :class:`IllegalStepError` if robots, their kinds or δ are others.
    """
    _check_robots(before, after)
    old, new = before.program, after.program
    allread, allwrite = _slots(old.allread, new.allread), _slots(old.allwrite, new.allwrite)
    kinds = tuple(map(_kind_match, old.agents, new.agents))
    return Correspondence(allread, allwrite, kinds, tuple(_unkept(old, new)))


def reloaded(
    d: Domain[V],
    before: System,
    after: System,
    configuration: Configuration[V],
    inputs: Inputs[V],
) -> Stepped[V]:
    """The configuration in which the system ``after`` goes on from one of ``before``. [RELOAD]

    Raises :class:`IllegalStepError` where it may not: inside a round, with other robots, or if the
    value with which a variable starts faults.
    """
    if configuration.fault is not None:
        raise IllegalStepError("FAULT", "a faulted configuration has no successors")
    robots = configuration.robots
    if configuration.turn is not Turn.PROG or any(r.turn is not Turn.PROG for r in robots):
        raise IllegalStepError("RELOAD", "a program goes on between two rounds, not inside one")
    match = correspondence(before, after)
    store = _declared(d, after, match, configuration.store, inputs)
    turns = [
        _resumed(d, after, match, pid, state, store, inputs) for pid, state in enumerate(robots)
    ]
    for turned in turns:
        _check_sound(d, turned.legality, turned.faults)
        store = committed(d, store, turned)
    resumed = tuple(
        _going_on(d, match.kinds[state.kind], state, turned.robot, store)
        for state, turned in zip(robots, turns, strict=True)
    )
    return Stepped(Configuration(resumed, store, configuration.round))


# --- what is kept ---------------------------------------------------------------------------------


def _check_robots(before: System, after: System) -> None:
    """Check that a system has the robots of another one. Raises IllegalStepError."""
    old = [agent.name for agent in before.program.agents]
    new = [agent.name for agent in after.program.agents]
    if len(old) != len(new) or (len(old) > 1 and old != new):
        listed = ", ".join(name or "one without a name" for name in old)
        raise IllegalStepError("RELOAD", f"the kinds of robots are others: they were {listed}")
    if before.kinds != after.kinds:
        raise IllegalStepError("RELOAD", "the robots are others, or of other kinds")
    if before.delta_s != after.delta_s:
        reason = f"a round would take {after.delta_s} s, and takes {before.delta_s} s"
        raise IllegalStepError("RELOAD", reason)


def _kind_match(old: core.Agent, new: core.Agent) -> KindMatch:
    events = [event.name for event in new.events]
    return KindMatch(
        _slots(old.locals, new.locals),
        _slots(_of_ports(old), _of_ports(new), _labels(old), _labels(new)),
        tuple(events.index(e.name) if e.name in events else NO_EVENT for e in old.events),
    )


def _of_ports(agent: core.Agent) -> tuple[core.Declaration, ...]:
    return tuple(port.declaration for port in agent.ports)


def _labels(agent: core.Agent) -> list[str]:
    """The names of ports, each with its module's, however the text spells it."""
    return [f"{port.module}.{port.declaration.variable.name}" for port in agent.ports]


def _names(entries: Iterable[core.Declaration]) -> list[str]:
    return [entry.variable.name for entry in entries]


def _slots(
    old: Sequence[core.Declaration],
    new: Sequence[core.Declaration],
    old_names: Sequence[str] = (),
    new_names: Sequence[str] = (),
) -> Slots:
    """For each variable the slot of the one of its name and type, if there is one."""
    named = zip(old_names or _names(old), old, strict=True)
    known = {(name, entry.variable.type): entry.variable.slot for name, entry in named}
    return tuple(
        known.get((name, entry.variable.type))
        for name, entry in zip(new_names or _names(new), new, strict=True)
    )


def _unkept(old: core.Program, new: core.Program) -> Iterator[Unkept]:
    """The variables whose values are not kept: those of all robots, then those of each kind."""
    were, are = _homes(old.allread, old.allwrite), _homes(new.allread, new.allwrite)
    kinds = [
        (b.name, _homes(a.locals) | _ports(a), _homes(b.locals) | _ports(b))
        for a, b in zip(old.agents, new.agents, strict=True)
    ]
    # What all robots share may have been a robot's own, or becomes it.
    owned = {name: entry for _, own, _ in kinds for name, entry in own.items()}
    owning = {name for _, _, own in kinds for name in own}
    yield from _changed("", were, are, owned | were, owning)
    for agent, own, owns in kinds:
        yield from _changed(agent, own, owns, were | own, set(are))


def _changed(
    agent: str,
    were: Mapping[str, core.Declaration],
    are: Mapping[str, core.Declaration],
    known: Mapping[str, core.Declaration],
    elsewhere: Set[str],
) -> Iterator[Unkept]:
    """The variables of all robots, or of a kind, whose values are not kept.

    ``known`` are all that there were, by name, and ``elsewhere`` the names that now stand for
    variables of another home.
    """
    for name, entry in are.items():
        before, home = known.get(name), entry.variable.home
        if before is None:
            fate = Fate.NEW
        elif before.variable.home is not home:
            fate = Fate.MOVED
        elif before.variable.type != entry.variable.type:
            fate = Fate.RETYPED
        else:
            continue
        yield Unkept(name, agent, home, fate, entry.initial is not Start.UNSET)
    for name, entry in were.items():
        if name not in are and name not in elsewhere:
            yield Unkept(name, agent, entry.variable.home, Fate.GONE, is_set=False)


def _homes(*of: tuple[core.Declaration, ...]) -> dict[str, core.Declaration]:
    return {entry.variable.name: entry for entries in of for entry in entries}


def _ports(agent: core.Agent) -> dict[str, core.Declaration]:
    return dict(zip(_labels(agent), _of_ports(agent), strict=True))


# --- values ---------------------------------------------------------------------------------------


def _kept(
    d: Domain[V],
    system: System,
    entries: Sequence[core.Declaration],
    slots: Slots,
    held: Sequence[Storage[V]],
) -> tuple[Storage[V], ...]:
    """What variables hold when a program goes on; those that start are unset yet."""
    return tuple(
        unset(d, entry.variable.type, system.size) if slot is None else held[slot]
        for entry, slot in zip(entries, slots, strict=True)
    )


def _declared(
    d: Domain[V], system: System, match: Correspondence, held: Store[V], inputs: Inputs[V]
) -> Store[V]:
    """The store before any robot's own entries start: what is kept, and new allwrite variables."""
    program = system.program
    allread = _kept(d, system, program.allread, match.allread, held.allread)
    allwrite = _kept(d, system, program.allwrite, match.allwrite, held.allwrite)
    m = machine(d, system, inputs.oracle(Phase.INIT, 0), copy=Store(allread, allwrite))
    start_all(m, _new(program.allwrite, match.allwrite), m.memory.allwrite, inputs, None)
    _check_sound(d, m.legality, m.faults)
    return Store(allread, tuple(m.memory.allwrite))


def _resumed(
    d: Domain[V],
    system: System,
    match: Correspondence,
    pid: int,
    state: Robot[V],
    store: Store[V],
    inputs: Inputs[V],
) -> Turned[V]:
    """A robot whose new ports, locals and own entries have started; ``init:`` is not run."""
    agent, of_kind = system.agent(pid), match.kinds[state.kind]
    ports = _of_ports(agent)
    m = machine(
        d,
        system,
        inputs.oracle(Phase.INIT, pid),
        robot=pid,
        locals=_kept(d, system, agent.locals, of_kind.locals, state.locals),
        ports=_kept(d, system, ports, of_kind.ports, state.ports),
        copy=store,
    )
    start_all(m, _new(ports, of_kind.ports), m.memory.ports, inputs, pid)
    start_all(m, _new(agent.locals, of_kind.locals), m.memory.locals, inputs, pid)
    for entry in _new(system.program.allread, match.allread):
        start_own_entry(m, entry, inputs, pid)
    return turned_by(m, pid, None, NO_EVENT, state)


def _new(entries: Sequence[core.Declaration], slots: Slots) -> list[core.Declaration]:
    """The variables that go on as none, in order of declaration."""
    return [entry for entry, slot in zip(entries, slots, strict=True) if slot is None]


def _check_sound(
    d: Domain[V], legality: Iterable[Legality[V]], faults: Iterable[tuple[V, Fault]]
) -> None:
    """Check that variables have started without a fault. Raises IllegalStepError."""
    found = first_fault(d, faults)
    if found is not None:
        reason = f"the value with which a variable starts faults: {found.kind.value} ({found.span})"
        raise IllegalStepError("RELOAD", reason)
    check_legality(d, legality)


def _going_on(
    d: Domain[V], match: KindMatch, state: Robot[V], resumed: Robot[V], store: Store[V]
) -> Robot[V]:
    """A robot that goes on: its status stays, and what it ran, if there is an event of the name."""
    ran = d.const(NO_EVENT, INT)
    for old, new in enumerate(match.events):
        is_that = d.binary(BinaryOp.EQ, state.ran, d.const(old, INT))
        ran = d.ite(is_that, d.const(new, INT), ran)
    return Robot(state.kind, resumed.locals, resumed.ports, store, state.status, ran)
