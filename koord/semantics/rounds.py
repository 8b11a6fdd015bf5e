"""The rules of a system: INIT, program turns one at a time, the environment's turn.

This is the reference: a tiny loop over pure steps, for domains that know every scalar (exact
rationals, doubles). The verifier builds the same rounds from the same turns (:mod:`turns`), with
all robots at once, which the theorems of chapter 8 allow.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import (
    NO_EVENT,
    Configuration,
    Fault,
    Robot,
    Store,
    Turn,
    Written,
)
from koord.semantics.domain import Domain
from koord.semantics.environment import Evolved, environment_turn
from koord.semantics.machine import Legality
from koord.semantics.oracle import Inputs
from koord.semantics.storage import Storage, unset
from koord.semantics.turns import (
    Turned,
    committed,
    declared,
    guard_of,
    initial_turn,
    program_turn,
    skip_turn,
)
from koord.syntax import core
from koord.syntax.system import Status, System
from koord.syntax.types import INT

V = TypeVar("V")


class IllegalStepError(Exception):
    """Raised for a step that the rules do not allow; names the rule."""

    def __init__(self, rule: str, reason: str) -> None:
        super().__init__(f"[{rule}] {reason}")
        self.rule = rule
        self.reason = reason


class Stepped(Struct, Generic[V], frozen=True):
    """A configuration reached by one step, with the values written to streams on the way."""

    configuration: Configuration[V]
    output: tuple[Written[V], ...] = ()
    promises: tuple[tuple[int, core.Contract], ...] = ()  #: contracts that the model broke


def initialised(
    d: Domain[V], system: System, inputs: Inputs[V], order: Iterable[int] | None = None
) -> Stepped[V]:
    """The configuration after INIT, the robots' turns taken in the given order. [INIT]

    After a fault it is the one that evaluation comes to when it goes on, which assumptions are
    asked about; a run that shows it ends in :func:`faulted_start`. [FAULT]
    """
    store, faults = declared(d, system, inputs)
    turns = [initial_turn(d, system, i, store, inputs) for i in range(system.robots)]
    final = store
    output: list[Written[V]] = []
    found = first_fault(d, faults)
    for i in order if order is not None else range(system.robots):
        check_legality(d, turns[i].legality)
        final = committed(d, final, turns[i])
        if found is None:
            output += _shown(d, turns[i])
            found = first_fault(d, turns[i].faults)
    robots = tuple(replace(t.robot, copy=final, turn=Turn.PROG) for t in turns)
    return Stepped(Configuration(robots, final, 0, fault=found), tuple(output))


def faulted_start(d: Domain[V], system: System, stepped: Stepped[V]) -> Stepped[V]:
    """INIT of a run: if it faults, the variables stay unset, as no robot has started. [FAULT]"""
    fault = stepped.configuration.fault
    if fault is None:
        return stepped
    return replace(stepped, configuration=replace(unset_start(d, system), fault=fault))


def unset_start(d: Domain[V], system: System) -> Configuration[V]:
    """The configuration in which nothing is set, as no robot has started."""
    program, size = system.program, system.size

    def nothing(declarations: Iterable[core.Declaration]) -> tuple[Storage[V], ...]:
        return tuple(unset(d, entry.variable.type, size) for entry in declarations)

    store = Store(nothing(program.allread), nothing(program.allwrite))
    running, none = d.const(int(Status.RUNNING), INT), d.const(NO_EVENT, INT)
    robots = tuple(
        Robot(
            kind,
            nothing(program.agents[kind].locals),
            nothing(port.declaration for port in program.agents[kind].ports),
            store,
            running,
            none,
        )
        for kind in system.kinds
    )
    return Configuration(robots, store, 0)


def enabled(
    d: Domain[V], system: System, configuration: Configuration[V], robot: int, inputs: Inputs[V]
) -> list[int]:
    """The events that a robot may select, in program order. [SELECT]

    An event whose ``pre`` cannot be evaluated may be selected: that is a fault.
    """
    state = configuration.robots[robot]
    if state.turn is not Turn.PROG or d.known(state.status) == Status.STOPPED:
        return []
    found = []
    for position, event in enumerate(system.agent(robot).events):
        holds, sound = guard_of(d, system, robot, state, event, inputs)
        if d.known(holds) is True or d.known(sound) is False:
            found.append(position)
    return found


def may_skip(
    d: Domain[V], system: System, configuration: Configuration[V], robot: int, inputs: Inputs[V]
) -> bool:
    """Return whether a robot may skip: no urgent event is enabled with its classes free. [SKIP]"""
    state = configuration.robots[robot]
    if d.known(state.status) == Status.STOPPED:
        return True
    for event in system.agent(robot).events:
        if event.urgent and not event.lock_classes & configuration.taken:
            holds, _ = guard_of(d, system, robot, state, event, inputs)
            if d.known(holds) is True:
                return False
    return True


def run_event(
    d: Domain[V],
    system: System,
    configuration: Configuration[V],
    robot: int,
    position: int,
    inputs: Inputs[V],
) -> Stepped[V]:
    """Run one event of one robot. [EVENT-TRANS] [ATOMIC]

    Raises :class:`IllegalStepError` if it may not be selected, or enters a lock class
    that is taken.
    """
    state = _to_move(configuration, robot)
    if d.known(state.status) == Status.STOPPED:
        raise IllegalStepError("STOP", f"robot {robot} has stopped")
    name = system.agent(robot).events[position].name
    selectable, turned = program_turn(d, system, robot, state, position, inputs)
    if d.known(selectable) is not True:
        raise IllegalStepError("SELECT", f"the pre of {name} does not hold for robot {robot}")
    check_legality(d, turned.legality)
    found = first_fault(d, turned.faults)
    if found is not None:
        return Stepped(replace(configuration, fault=found), _shown(d, turned))
    entered = frozenset(c for c, condition in turned.entered.items() if d.known(condition) is True)
    if entered & configuration.taken:
        raise IllegalStepError("ATOMIC", f"{name} of robot {robot} enters a taken lock class")
    after = replace(
        configuration,
        robots=_with(_opened(d, configuration), robot, turned.robot),
        store=committed(d, configuration.store, turned),
        taken=configuration.taken | entered,
    )
    return Stepped(_ended(d, after), _shown(d, turned))


def run_skip(
    d: Domain[V], system: System, configuration: Configuration[V], robot: int, inputs: Inputs[V]
) -> Stepped[V]:
    """Skip a robot's program turn, as when its message comes too late. [SKIP] [T-SKIP]"""
    state = _to_move(configuration, robot)
    if not may_skip(d, system, configuration, robot, inputs):
        raise IllegalStepError("SKIP", f"robot {robot} has an urgent event to run")
    turned = skip_turn(d, state)
    robots = _with(_opened(d, configuration), robot, turned.robot)
    return Stepped(_ended(d, replace(configuration, robots=robots)))


def evolved(
    d: Domain[V], system: System, configuration: Configuration[V], inputs: Inputs[V]
) -> Stepped[V]:
    """Take the environment's turn: advance time, ports and copies. [ENV-TRANS] [REFRESH]"""
    if configuration.turn is not Turn.ENV or configuration.fault is not None:
        raise IllegalStepError("ENV-TRANS", "it is not the environment's turn")
    robots, found = [], None
    broken: list[tuple[int, core.Contract]] = []
    for i, state in enumerate(configuration.robots):
        turned: Evolved[V] = environment_turn(d, system, i, state, inputs)
        check_legality(d, turned.legality)
        found = found or first_fault(d, turned.faults)
        broken += [(i, contract) for kept, contract in turned.promises if d.known(kept) is False]
        robots.append(replace(state, ports=turned.ports, copy=configuration.store, turn=Turn.PROG))
    if found is not None:
        return Stepped(replace(configuration, fault=found))
    after = Configuration(tuple(robots), configuration.store, configuration.round + 1)
    return Stepped(after, promises=tuple(broken))


def _to_move(configuration: Configuration[V], robot: int) -> Robot[V]:
    if configuration.fault is not None:
        raise IllegalStepError("FAULT", "a faulted configuration has no successors")
    state = configuration.robots[robot]
    if state.turn is not Turn.PROG:
        raise IllegalStepError("EVENT-TRANS", f"robot {robot} has had its turn in this round")
    return state


def _opened(d: Domain[V], configuration: Configuration[V]) -> tuple[Robot[V], ...]:
    """The robots at the start of a turn: a round's first turn clears every ``ran``. [EVENT-TRANS]
    [EVENT-TRANS]
    """
    if any(state.turn is Turn.ENV for state in configuration.robots):
        return configuration.robots
    none = d.const(NO_EVENT, INT)
    return tuple(replace(state, ran=none) for state in configuration.robots)


def _ended(d: Domain[V], configuration: Configuration[V]) -> Configuration[V]:
    """Begin the environment's turn once every robot has had its own. [END-PROG] [STOP]"""
    if any(state.turn is Turn.PROG for state in configuration.robots):
        return configuration
    robots = configuration.robots
    if all(d.known(state.status) != Status.RUNNING for state in robots):
        stopped = d.const(int(Status.STOPPED), INT)
        robots = tuple(replace(state, status=stopped) for state in robots)
    return replace(configuration, robots=robots, turn=Turn.ENV)


def _with(robots: tuple[Robot[V], ...], robot: int, state: Robot[V]) -> tuple[Robot[V], ...]:
    return (*robots[:robot], state, *robots[robot + 1 :])


def first_fault(d: Domain[V], faults: Iterable[tuple[V, Fault]]) -> Fault | None:
    """The first fault that happened, in order of evaluation, or None. [FAULT]"""
    return next((fault for condition, fault in faults if d.known(condition) is True), None)


def check_legality(d: Domain[V], legality: Iterable[Legality[V]]) -> None:
    """Check that recorded answers are possible ones. [CHOOSE] [EXTERNAL] [ENV-CONTRACT]"""
    for needed in legality:
        if d.known(needed.condition) is not True:
            raise IllegalStepError(needed.rule, f"{needed.what} ({needed.span})")


def _shown(d: Domain[V], turned: Turned[V]) -> tuple[Written[V], ...]:
    return tuple(written for condition, written in turned.output if d.known(condition) is True)
