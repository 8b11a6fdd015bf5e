"""Transitions of one robot in a round, each computed once. [T-SNAPSHOT]

A turn depends on what its event looks at and on nothing else. A *menu* is all that a robot can do
in a state; its entries that mean the same to the others (same writes, same lock classes) stand
together in a *course*.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Fault, Store
from koord.semantics.domain import EXACT, Constant
from koord.semantics.environment import environment_turn
from koord.semantics.recordings import Answer, Reading
from koord.syntax import core
from koord.syntax.analysis.footprint import Reads, reads_of, together
from koord.syntax.system import Status, System
from koord.traces.enumeration import ExploringInputs, explored
from koord.verify.engines.explicit.cells import CACHE_LIMIT
from koord.verify.engines.explicit.commits import NOTHING, Commits
from koord.verify.engines.explicit.effects import Effects, EventOf
from koord.verify.engines.explicit.states import RobotState, State, StateStore


class EnvironmentOutcome(NamedTuple):
    """A possible result of the environment's turn for one robot."""

    robot: int  #: the robot's number after it
    fault: Fault | None
    broken: tuple[core.Contract, ...]
    readings: tuple[Reading, ...]
    answers: tuple[Answer, ...]


class RobotTransition(NamedTuple):
    """A transition of a robot: to run an event, or to skip (``event`` is None)."""

    event: int | None
    robot: int  #: the robot's number after its program turn
    answers: tuple[Answer, ...]


class FaultingEvent(NamedTuple):
    """An event that a robot can select and that faults. [T-FAULT]"""

    event: int
    fault: Fault
    answers: tuple[Answer, ...]


class Endings(Struct, frozen=True, dict=True):
    """The possible results of the environment's turn for a robot, for each of some entries."""

    outcomes: tuple[tuple[EnvironmentOutcome, ...], ...]

    @cached_property
    def all(self) -> list[EnvironmentOutcome]:
        """The outcomes of all entries."""
        return [outcome for each in self.outcomes for outcome in each]

    @cached_property
    def robots(self) -> tuple[int, ...]:
        """The robot's numbers after the environment's turn, each once."""
        return tuple(dict.fromkeys(o.robot for o in self.all if o.fault is None))

    @cached_property
    def has_news(self) -> bool:
        """True if the environment's turn may bring a fault or a broken promise."""
        return any(o.fault is not None or o.broken for o in self.all)

    @cached_property
    def may_be_last(self) -> bool:
        """True if the environment has no turn after some entry."""
        return not all(any(o.fault is None for o in each) for each in self.outcomes)


class TransitionGroup(Struct, frozen=True, dict=True):
    """Transitions with the same writes and lock classes.

    ``runs`` says whether any of them may count as a run, ``skips`` whether any may count as a skip.
    """

    write: int
    entered: int  #: lock classes, a bit each
    runs: bool
    skips: bool
    running: bool  #: whether the robot's status is still running
    may_skip_first: bool  #: whether the robot may skip before anyone has moved
    entries: tuple[RobotTransition, ...]
    evolved: Endings
    stopped: Endings  #: the same, if END-PROG stops everybody
    stopped_robots: tuple[int, ...]  #: the robots' numbers then
    classes: int  #: of the event's text, a bit each, if menus are labelled; else 0

    @cached_property
    def robots(self) -> tuple[int, ...]:
        """The robot's numbers after its program turn."""
        return tuple(entry.robot for entry in self.entries)

    def after_stop(self, robot: int) -> int:
        """The robot's number if END-PROG stops everybody."""
        return self.stopped_robots[self.robots.index(robot)]


class Menu(NamedTuple):
    """All transitions of a robot in a state.

    ``obligations`` are the lock classes of each urgent event that forbids skipping unless one of
    them is taken. [SKIP] ``ready`` says whether the robot could run an event whatever the answers,
    and ``asks`` which lock classes it then asks for, a bit each. [FAIR-ROBOT] [FAIR-LOCK]
    """

    courses: tuple[TransitionGroup, ...]
    failures: tuple[FaultingEvent, ...]
    obligations: tuple[int, ...]
    ready: bool
    asks: int


class _Kind(Struct):
    """A kind of robot with the variables that its events read together."""

    events: list[EventOf]
    reads: Reads
    environment_pid: bool
    menus: dict[tuple[int, ...], Menu] = field(default_factory=dict)
    outcomes: dict[tuple[int, ...], tuple[EnvironmentOutcome, ...]] = field(default_factory=dict)


class Menus:
    """The menus of a system.

    ``relaxed`` keeps runs and skips apart [T-PREFIX], ``labelled`` also events of different lock
    classes. [T-FULL-STATES]
    """

    def __init__(
        self,
        system: System,
        vault: StateStore,
        commits: Commits,
        *,
        relaxed: bool,
        labelled: bool = False,
    ) -> None:
        self._system = system
        self._vault = vault
        self._commits = commits
        self._relaxed = relaxed
        self._labelled = labelled
        self._effects = Effects(system, vault)
        self._kinds = [self._kind(kind) for kind in range(len(system.program.agents))]

    def menu(self, robot: int, state: State) -> Menu:
        """The menu of one robot in a state."""
        kind = self._kinds[self._system.kinds[robot]]
        key = self._key(robot, kind.reads, state)
        known = kind.menus.get(key)
        if known is None:
            if len(kind.menus) > CACHE_LIMIT:
                kind.menus.clear()
            maker = _MenuMaker(self, self._vault.robots.values[state[robot]], robot, state)
            known = kind.menus[key] = maker.menu(kind.events)
        return known

    def _kind(self, kind: int) -> _Kind:
        agent = self._system.program.agents[kind]
        events = [self._effects.event(kind, position) for position in range(len(agent.events))]
        environment = [m.environment or () for m in agent.modules]
        contracts = [
            e for m in agent.modules for c in m.contracts for e in (*c.requires, *c.ensures)
        ]
        around = reads_of(self._system.program, *environment, *contracts)
        reads = together(e.reads for e in events)
        # What the environment makes of the robot stands in its menus too.
        return _Kind(events, replace(reads, pid=reads.pid or around.pid), around.pid)

    def _key(self, robot: int, reads: Reads, state: State) -> tuple[int, ...]:
        """The numbers of all that the robot's turns and its environment's turn depend on."""
        count = self._system.robots
        key = [state[robot], *[state[count + slot] for slot in reads.allwrite]]
        if reads.arrays:
            owns = self._vault.robots.values
            for slot in reads.arrays:
                key += [owns[number].entries[slot] for number in state[:count]]
        if reads.is_placed:
            key.append(robot)
        return tuple(key)

    def skipped(self, number: int) -> int:
        """The number of a robot after doing nothing."""
        if not self._vault.tracks_ran:
            return number
        own = self._vault.robots.values[number]
        return self._vault.robots.number(own._replace(ran=NO_EVENT))

    def stopped(self, number: int) -> int:
        """The number of a robot that END-PROG stopped."""
        own = self._vault.robots.values[number]
        return self._vault.robots.number(own._replace(status=int(Status.STOPPED)))

    # --- the environment ------------------------------------------------------------------------

    def outcomes(self, robot: int, number: int) -> tuple[EnvironmentOutcome, ...]:
        """The possible results of the environment's turn for a robot. [ENV-TRANS]"""
        own = self._vault.robots.values[number]
        kind = self._kinds[own.kind]
        key = (number, robot) if kind.environment_pid else (number,)
        known = kind.outcomes.get(key)
        if known is None:
            known = kind.outcomes[key] = self._evolved(robot, number, own)
        return known

    def _evolved(self, robot: int, number: int, own: RobotState) -> tuple[EnvironmentOutcome, ...]:
        agent = self._system.program.agents[own.kind]
        if not agent.modules:
            return (EnvironmentOutcome(number, None, (), (), ()),)
        state = self._vault.state_of(number, _NO_STORE)
        turns = explored(
            lambda chooser: ExploringInputs(self._system, chooser, ports=state.ports),
            lambda inputs: environment_turn(EXACT, self._system, robot, state, inputs),
        )
        found: dict[tuple[int, bool, tuple[str, ...]], EnvironmentOutcome] = {}
        for turn in turns:
            evolved = turn.outcome
            if not all(x.condition is True for x in evolved.legality):
                continue
            fault = next((fault for condition, fault in evolved.faults if condition is True), None)
            broken = tuple(contract for kept, contract in evolved.promises if kept is not True)
            cells = self._vault.ports[own.kind]
            ports = tuple(
                number if old is new else cells[slot].number(new)
                for slot, (number, old, new) in enumerate(
                    zip(own.ports, state.ports, evolved.ports, strict=True)
                )
            )
            after = self._vault.robots.number(own._replace(ports=ports))
            outcome = EnvironmentOutcome(
                after, fault, broken, turn.given.readings, turn.given.answers
            )
            names = tuple(contract.name for contract in broken)
            found.setdefault((after, fault is None, names), outcome)
        return tuple(found.values())


_NO_STORE: Store[Constant] = Store((), ())


class _MenuMaker:
    """A builder of one menu."""

    def __init__(self, menus: Menus, own: RobotState, robot: int, state: State) -> None:
        self.menus, self.own, self.robot, self.state = menus, own, robot, state
        self.failures: list[FaultingEvent] = []
        self.obligations: list[int] = []
        self.excuses: list[Answer] = []
        self.ready = False
        self.asks = -1
        self.found: dict[tuple[int, int, int, bool], dict[int, RobotTransition]] = {}

    def menu(self, events: list[EventOf]) -> Menu:
        if self.own.status != Status.STOPPED:
            for event in events:
                self._consider(event)
        skipped = self.menus.skipped(self.state[self.robot])
        self._add(NOTHING, 0, RobotTransition(None, skipped, tuple(self.excuses)))
        courses = tuple(self._course(*key, entries) for key, entries in self.found.items())
        asks = self.asks if self.ready else 0
        return Menu(courses, tuple(self.failures), tuple(self.obligations), self.ready, asks)

    def _consider(self, of: EventOf) -> None:
        effects = self.menus._effects
        guard = effects.guard(of, self.robot, self.state)
        urgent = of.event.urgent
        classes = classes_of(of.event)
        self.ready |= guard.is_on
        if urgent and guard.is_on:
            self.obligations.append(classes)
        if urgent and of.guard_asks and not guard.is_on:
            self.excuses += effects.excuse(of, self.robot, self.state)
        if guard.is_off:
            return
        self.asks &= classes
        for effect, codes in effects.effects(of, self.robot, self.state):
            if effect.fault is not None:
                fault = replace(effect.fault, robot=self.robot)
                self.failures.append(FaultingEvent(of.position, fault, effect.answers))
                continue
            write = NOTHING
            if effect.writes:
                parts = effects.parts(effect, codes)
                write = self.menus._commits.number(parts, effect.updates)
            after = effects.followed(self.own, of.position, effect, codes)
            self._add(write, effect.entered, RobotTransition(of.position, after, effect.answers))

    def _add(self, write: int, entered: int, entry: RobotTransition) -> None:
        apart = 0
        if entry.event is None:
            apart = -1 if self.menus._relaxed else 0
        elif self.menus._labelled:
            apart = classes_of(self._event(entry.event))
        running = self.menus._vault.robots.values[entry.robot].status == Status.RUNNING
        key = (write, entered, apart, running)
        self.found.setdefault(key, {}).setdefault(entry.robot, entry)

    def _event(self, position: int) -> core.Event:
        return self.menus._system.agent(self.robot).events[position]

    def _course(
        self, write: int, entered: int, apart: int, running: bool, found: dict[int, RobotTransition]
    ) -> TransitionGroup:
        menus, robot, entries = self.menus, self.robot, tuple(found.values())
        stopped = () if running else tuple(menus.stopped(entry.robot) for entry in entries)
        return TransitionGroup(
            write,
            entered,
            any(entry.event is not None for entry in entries),
            any(entry.event is None for entry in entries),
            running,
            not self.obligations,
            entries,
            Endings(tuple(menus.outcomes(robot, entry.robot) for entry in entries)),
            Endings(tuple(menus.outcomes(robot, number) for number in stopped)),
            stopped,
            max(apart, 0),
        )


def classes_of(event: core.Event) -> int:
    """The lock classes in an event's text, as a bit set."""
    return sum(1 << k for k in event.lock_classes)
