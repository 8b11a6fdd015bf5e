"""What one robot can do in a round, each turn worked out once. [T-SNAPSHOT]

A turn depends on what its event reads and on nothing else, so its outcome is kept under the numbers
of just that. A *menu* is all that a robot can do in a state; its entries that mean the same to the
others (same writes, same lock classes) stand together in a *course*.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

from koord.semantics.canonical import Cells, Own, State, Vault
from koord.semantics.commits import NOTHING, Commits
from koord.semantics.configurations import NO_EVENT, Fault, Robot, Status, Store, System
from koord.semantics.dependence import Reads, reads_of, together
from koord.semantics.domain import EXACT, Constant
from koord.semantics.exploring import ExploringInputs, explored
from koord.semantics.oracle import Inputs
from koord.semantics.races import rewritten
from koord.semantics.recording import Answer, Reading
from koord.semantics.storage import Storage, Tree
from koord.semantics.turns import Evolved, Turned, environment_turn, guard_of, program_turn
from koord.syntax import core
from koord.syntax.walk import nodes

#: Entries of a cache of turns, beyond which it is emptied.
CACHE_LIMIT = 400_000


@dataclass(frozen=True, slots=True)
class Outcome:
    """One way in which the environment's turn may go for one robot."""

    robot: int  #: the robot's number after it
    fault: Fault | None
    broken: tuple[core.Contract, ...]
    readings: tuple[Reading, ...]
    answers: tuple[Answer, ...]


@dataclass(frozen=True, slots=True)
class Entry:
    """One thing that a robot can do: run an event, or skip (``event`` is None)."""

    event: int | None
    robot: int  #: the robot's number after its program turn
    answers: tuple[Answer, ...]


@dataclass(frozen=True, slots=True)
class Failure:
    """An event that a robot can select, and that faults. [T-FAULT]"""

    event: int
    fault: Fault
    answers: tuple[Answer, ...]


@dataclass(frozen=True)
class Course:
    """Entries with the same writes and lock classes; ``runs`` says whether any of them may count
    as a run, ``skips`` whether any may count as a skip.
    """

    write: int
    entered: int  #: lock classes, a bit each
    runs: bool
    skips: bool
    running: bool  #: whether the robot's status is still running
    may_skip_first: bool  #: whether the robot may skip before anyone has moved
    entries: tuple[Entry, ...]
    outcomes: tuple[tuple[Outcome, ...], ...]  #: of each entry
    stopped: tuple[tuple[Outcome, ...], ...]  #: the same, if END-PROG stops everybody
    stopped_robots: tuple[int, ...]  #: the robots' numbers then

    def middle_numbers(self) -> tuple[int, ...]:
        """The robot's numbers after its program turn."""
        return tuple(entry.robot for entry in self.entries)

    def stopped_numbers(self) -> tuple[int, ...]:
        """The robot's numbers after its program turn, if END-PROG stops everybody."""
        return self.stopped_robots

    def all_outcomes(self, all_stop: bool) -> list[Outcome]:
        """What the environment's turn may bring."""
        outcomes = self.stopped if all_stop else self.outcomes
        return [outcome for each in outcomes for outcome in each]

    def has_news(self, all_stop: bool) -> bool:
        """Whether the environment's turn may bring a fault or a broken promise."""
        return self._stopped_news if all_stop else self._news

    @cached_property
    def _news(self) -> bool:
        return any(o.fault is not None or o.broken for o in self.all_outcomes(False))

    @cached_property
    def _stopped_news(self) -> bool:
        return any(o.fault is not None or o.broken for o in self.all_outcomes(True))

    @cached_property
    def ends(self) -> tuple[int, ...]:
        """The robot's numbers after the environment's turn, each once."""
        return _ends(self.outcomes)

    def after_stop(self, robot: int) -> int:
        """The robot's number if END-PROG stops everybody."""
        numbers = [entry.robot for entry in self.entries]
        return self.stopped_robots[numbers.index(robot)]

    @cached_property
    def stopped_ends(self) -> tuple[int, ...]:
        return _ends(self.stopped)


def _ends(outcomes: tuple[tuple[Outcome, ...], ...]) -> tuple[int, ...]:
    return tuple(dict.fromkeys(o.robot for each in outcomes for o in each if o.fault is None))


@dataclass(frozen=True, slots=True)
class Menu:
    """All that a robot can do in a state.

    ``obligations`` are the lock classes of each urgent event that forbids skipping unless one of
    them is taken. [SKIP]
    """

    courses: tuple[Course, ...]
    failures: tuple[Failure, ...]
    obligations: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Effect:
    """What an event did, without the robot that it did it to."""

    fault: Fault | None
    locals: tuple[tuple[int, int], ...]  #: (slot, number)
    ports: tuple[tuple[int, int], ...]
    entries: tuple[tuple[int, int], ...]
    status: int
    write: int
    entered: int
    answers: tuple[Answer, ...]


@dataclass(slots=True)
class _Event:
    """An event of one kind of robot with what it reads."""

    event: core.Event
    position: int
    guard: Reads
    whole: Reads
    is_open: bool  #: whether its guard leaves something open
    guards: dict[tuple[int, ...], tuple[bool, bool]] = field(default_factory=dict)
    effects: dict[tuple[int, ...], tuple[_Effect, ...]] = field(default_factory=dict)


@dataclass(slots=True)
class _Kind:
    """One kind of robot with what its events read together."""

    events: list[_Event]
    reads: Reads
    environment_pid: bool
    menus: dict[tuple[int, ...], Menu] = field(default_factory=dict)
    outcomes: dict[tuple[int, ...], tuple[Outcome, ...]] = field(default_factory=dict)


class Menus:
    """The menus of a system. ``relaxed`` keeps runs and skips apart. [T-PREFIX]"""

    def __init__(self, system: System, vault: Vault, commits: Commits, *, relaxed: bool) -> None:
        self._system = system
        self._vault = vault
        self._commits = commits
        self._relaxed = relaxed
        self._updates = rewritten(system.program)
        self._kinds = [self._kind(agent) for agent in system.program.agents]

    def menu(self, robot: int, state: State) -> Menu:
        """What one robot can do."""
        kind = self._kinds[self._system.kinds[robot]]
        key = (state[robot], *self._shared_key(robot, kind.reads, state))
        known = kind.menus.get(key)
        if known is None:
            if len(kind.menus) > CACHE_LIMIT:
                kind.menus.clear()
            known = kind.menus[key] = _MenuMaker(self, kind, robot, state).menu()
        return known

    # --- what is read ---------------------------------------------------------------------------

    def _kind(self, agent: core.Agent) -> _Kind:
        events = [self._event(event, position) for position, event in enumerate(agent.events)]
        environment = [m.environment or () for m in agent.modules]
        contracts = [
            e for m in agent.modules for c in m.contracts for e in (*c.requires, *c.ensures)
        ]
        around = reads_of(self._system.program, *environment, *contracts)
        reads = together(e.whole for e in events)
        # What the environment makes of the robot stands in its menus too.
        return _Kind(events, replace(reads, pid=reads.pid or around.pid), around.pid)

    def _event(self, event: core.Event, position: int) -> _Event:
        program = self._system.program
        guard = reads_of(program, event.guard)
        whole = together([guard, reads_of(program, event.effect)])
        return _Event(event, position, guard, whole, is_open(program, event.guard))

    def _shared_key(self, robot: int, reads: Reads, state: State) -> tuple[int, ...]:
        """Numbers of all that is read and not the robot's own."""
        count = self._system.robots
        key = [state[count + slot] for slot in reads.allwrite]
        if reads.arrays:
            owns = self._vault.robots.values
            for slot in reads.arrays:
                key += [owns[number].entries[slot] for number in state[:count]]
        if reads.pid:
            key.append(robot)
        return tuple(key)

    def key(self, robot: int, own: Own, reads: Reads, state: State) -> tuple[int, ...]:
        """Numbers of all that is read."""
        return (
            *(own.locals[slot] for slot in reads.locals),
            *(own.ports[slot] for slot in reads.ports),
            *(own.entries[slot] for slot in reads.entries),
            *self._shared_key(robot, reads, state),
        )

    # --- turns ----------------------------------------------------------------------------------

    def effects(self, event: _Event, robot: int, state: Robot[Constant]) -> Iterator[_Effect]:
        """Every outcome of an event that may be selected."""
        # The status does not matter to what happens, and is put back afterwards.
        fresh = replace(state, status=int(Status.RUNNING))
        turns = explored(
            lambda chooser: ExploringInputs(self._system, chooser),
            lambda inputs: self._turn(event, robot, fresh, inputs),
        )
        for turn in turns:
            selectable, turned = turn.outcome
            if selectable is True and all(x.condition is True for x in turned.legality):
                yield self._effect(event, robot, fresh, turned, turn.given.answers)

    def _turn(
        self, event: _Event, robot: int, state: Robot[Constant], inputs: Inputs[Constant]
    ) -> tuple[Constant, Turned[Constant]]:
        return program_turn(EXACT, self._system, robot, state, event.position, inputs)

    def _effect(
        self,
        event: _Event,
        robot: int,
        before: Robot[Constant],
        turned: Turned[Constant],
        answers: tuple[Answer, ...],
    ) -> _Effect:
        vault, after, kind = self._vault, turned.robot, before.kind
        fault = next((fault for condition, fault in turned.faults if condition is True), None)
        entries = []
        for slot in turned.allread:
            whole = after.copy.allread[slot]
            assert isinstance(whole, Tree)
            entries.append((slot, vault.entries[slot].number(whole.parts[robot])))
        updates = self._updates.get((kind, event.position), frozenset())
        assert isinstance(after.status, int)
        return _Effect(
            fault,
            _changed(vault.locals[kind], before.locals, after.locals),
            _changed(vault.ports[kind], before.ports, after.ports),
            tuple(entries),
            int(after.status),
            self._commits.number(turned, updates) if fault is None else NOTHING,
            sum(1 << k for k, condition in turned.entered.items() if condition is True),
            answers,
        )

    def applied(self, number: int, event: int, effect: _Effect) -> int:
        """The number of a robot after an event."""
        own = self._vault.robots.values[number]
        return self._vault.robots.number(
            Own(
                own.kind,
                _put(own.locals, effect.locals),
                _put(own.ports, effect.ports),
                _put(own.entries, effect.entries),
                max(own.status, effect.status),
                event if self._vault.tracks_ran else NO_EVENT,
            )
        )

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

    def guard(self, event: _Event, robot: int, state: Robot[Constant]) -> tuple[bool, bool]:
        """Whether an event's guard holds with all answers, and whether it can be off or fault."""
        turns = explored(
            lambda chooser: ExploringInputs(self._system, chooser),
            lambda inputs: guard_of(EXACT, self._system, robot, state, event.event, inputs),
        )
        results = [turn.outcome for turn in turns]
        always = all(holds is True for holds, _ in results)
        never = all(holds is not True and sound is True for holds, sound in results)
        return always, never

    # --- the environment ------------------------------------------------------------------------

    def outcomes(self, robot: int, number: int) -> tuple[Outcome, ...]:
        """What the environment's turn may make of a robot. [ENV-TRANS]"""
        own = self._vault.robots.values[number]
        kind = self._kinds[own.kind]
        key = (number, robot) if kind.environment_pid else (number,)
        known = kind.outcomes.get(key)
        if known is None:
            known = kind.outcomes[key] = self._evolved(robot, number, own)
        return known

    def _evolved(self, robot: int, number: int, own: Own) -> tuple[Outcome, ...]:
        agent = self._system.program.agents[own.kind]
        if not agent.modules:
            return (Outcome(number, None, (), (), ()),)
        state = self._vault.state_of(number, _NO_STORE)
        turns = explored(
            lambda chooser: ExploringInputs(self._system, chooser, ports=state.ports),
            lambda inputs: environment_turn(EXACT, self._system, robot, state, inputs),
        )
        found: dict[tuple[int, bool, tuple[str, ...]], Outcome] = {}
        for turn in turns:
            evolved: Evolved[Constant] = turn.outcome
            if not all(x.condition is True for x in evolved.legality):
                continue
            fault = next((fault for condition, fault in evolved.faults if condition is True), None)
            broken = tuple(contract for kept, contract in evolved.promises if kept is not True)
            changed = _changed(self._vault.ports[own.kind], state.ports, evolved.ports)
            after = self._vault.robots.number(own._replace(ports=_put(own.ports, changed)))
            outcome = Outcome(after, fault, broken, turn.given.readings, turn.given.answers)
            names = tuple(contract.name for contract in broken)
            found.setdefault((after, fault is None, names), outcome)
        return tuple(found.values())


_NO_STORE: Store[Constant] = Store((), ())


class _MenuMaker:
    """Works out one menu."""

    def __init__(self, menus: Menus, kind: _Kind, robot: int, state: State) -> None:
        self.menus, self.kind, self.robot, self.state = menus, kind, robot, state
        self.number = state[robot]
        self.own = menus._vault.robots.values[self.number]
        self.failures: list[Failure] = []
        self.obligations: list[int] = []
        self.skip_answers: list[Answer] = []
        self.found: dict[tuple[int, int, int, bool], Entry] = {}

    @cached_property
    def configured(self) -> Robot[Constant]:
        """The robot as the rules want it."""
        vault = self.menus._vault
        return vault.state_of(self.number, vault.store(self.state))

    def menu(self) -> Menu:
        if self.own.status != Status.STOPPED:
            for event in self.kind.events:
                self._consider(event)
        skipped = self.menus.skipped(self.number)
        self._add(NOTHING, 0, Entry(None, skipped, tuple(self.skip_answers)))
        return Menu(self._courses(), tuple(self.failures), tuple(self.obligations))

    def _consider(self, event: _Event) -> None:
        key = self.menus.key(self.robot, self.own, event.guard, self.state)
        guard = event.guards.get(key)
        if guard is None:
            guard = event.guards[key] = self.menus.guard(event, self.robot, self.configured)
        always, never = guard
        if event.event.urgent and always:
            self.obligations.append(sum(1 << k for k in event.event.lock_classes))
        if not never:
            for effect in self._effects(event):
                self._taken(event, effect)
        if event.is_open and event.event.urgent and not always:
            self.skip_answers += self._excuse(event)

    def _effects(self, event: _Event) -> tuple[_Effect, ...]:
        key = self.menus.key(self.robot, self.own, event.whole, self.state)
        known = event.effects.get(key)
        if known is None:
            if len(event.effects) > CACHE_LIMIT:
                event.effects.clear()
            known = tuple(self.menus.effects(event, self.robot, self.configured))
            event.effects[key] = known
        return known

    def _taken(self, event: _Event, effect: _Effect) -> None:
        if effect.fault is not None:
            failure = Failure(
                event.position, replace(effect.fault, robot=self.robot), effect.answers
            )
            self.failures.append(failure)
            return
        after = self.menus.applied(self.number, event.position, effect)
        self._add(effect.write, effect.entered, Entry(event.position, after, effect.answers))

    def _add(self, write: int, entered: int, entry: Entry) -> None:
        apart = self.menus._relaxed and entry.event is None
        self.found.setdefault((write, entered, entry.robot, apart), entry)

    def _excuse(self, event: _Event) -> tuple[Answer, ...]:
        """Answers with which an urgent event's guard does not hold."""
        menus = self.menus
        turns = explored(
            lambda chooser: ExploringInputs(menus._system, chooser),
            lambda inputs: guard_of(
                EXACT, menus._system, self.robot, self.configured, event.event, inputs
            ),
        )
        return next(turn.given.answers for turn in turns if turn.outcome[0] is not True)

    def _courses(self) -> tuple[Course, ...]:
        grouped: dict[tuple[int, int, bool, bool], list[Entry]] = {}
        values = self.menus._vault.robots.values
        for (write, entered, after, apart), entry in self.found.items():
            running = values[after].status == Status.RUNNING
            grouped.setdefault((write, entered, apart, running), []).append(entry)
        return tuple(self._course(*key, entries) for key, entries in grouped.items())

    def _course(
        self, write: int, entered: int, apart: bool, running: bool, entries: list[Entry]
    ) -> Course:
        menus, robot = self.menus, self.robot
        stopped = () if running else tuple(menus.stopped(entry.robot) for entry in entries)
        return Course(
            write,
            entered,
            any(entry.event is not None for entry in entries),
            any(entry.event is None for entry in entries),
            running,
            not self.obligations,
            tuple(entries),
            tuple(menus.outcomes(robot, entry.robot) for entry in entries),
            tuple(menus.outcomes(robot, number) for number in stopped),
            stopped,
        )


def is_open(program: core.Program, part: core.Expr | core.Block) -> bool:
    """Whether a part of a program leaves something open."""
    for node in nodes(part):
        if isinstance(node, core.ExternalCall | core.Choose):
            return True
        if isinstance(node, core.Call) and is_open(program, program.function(node.function).body):
            return True
    return False


def _changed(
    cells: list[Cells],
    before: tuple[Storage[Constant], ...],
    after: tuple[Storage[Constant], ...],
) -> tuple[tuple[int, int], ...]:
    """What is another object than before: a write makes a new one."""
    return tuple(
        (slot, cells[slot].number(new))
        for slot, (old, new) in enumerate(zip(before, after, strict=True))
        if old is not new
    )


def _put(numbers: tuple[int, ...], changed: tuple[tuple[int, int], ...]) -> tuple[int, ...]:
    if not changed:
        return numbers
    listed = list(numbers)
    for slot, number in changed:
        listed[slot] = number
    return tuple(listed)


__all__ = ["CACHE_LIMIT", "Course", "Entry", "Failure", "Menu", "Menus", "Outcome"]
