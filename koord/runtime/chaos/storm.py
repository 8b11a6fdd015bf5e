"""Storms: runs on a bad network, with every invariant checked, by robots without programs.

Its program is a function of pid and round, so that anybody can check what was decided. What it
would lose in a crash and what it keeps in a journal on disk are as on a real robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from random import Random
from types import MappingProxyType

import msgspec
from msgspec import Struct, field
from msgspec.structs import replace

from koord.runtime.alike import keeps_last
from koord.runtime.chaos.network import CALM, Faults, Network, Newborn, Sent, SwitchedOn
from koord.runtime.exploration.claims import (
    Accepted,
    BrokenInvariant,
    acted_rightly,
    agree,
    lasting,
    one_winner,
    valid,
)
from koord.runtime.proposals import (
    INIT_ROUND,
    Admitted,
    Attempt,
    Decision,
    Plain,
    Proposal,
    Write,
)
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import (
    INCARNATION_STEP,
    Acknowledge,
    Decide,
    Held,
    LastRun,
    LogEntry,
)
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import (
    Coordinator,
    Durable,
    State,
    durable,
    fresh,
    recovered,
    returning,
)

#: The variable that all robots write in their atomic block, and how many blocks there are.
SHARED, CLASSES = 0, 2


def proposal_of(robot: int, round_: int) -> Proposal:
    """The proposal of a robot for a round: nothing, a write, or a write in an atomic block."""
    own = Write(1, (robot,), round_)
    if round_ == INIT_ROUND:
        return Proposal(robot, round_, (Attempt(None, (own,)),))
    choice = Random(robot * 1_000_003 + round_).randrange(6)
    match choice:
        case 0:
            return Proposal(robot, round_)
        case 1 | 2:
            return Proposal(robot, round_, (Attempt(0, (own,)),))
        case 3:  # two urgent events, in two atomic blocks
            attempts = tuple(
                Attempt(1 + k, (Write(SHARED, (k,), robot), own), (k,)) for k in range(CLASSES)
            )
            return Proposal(robot, round_, attempts, urgent=True)
        case _:
            shared = Write(SHARED, (choice % CLASSES,), robot)
            return Proposal(robot, round_, (Attempt(3, (shared, own), (choice % CLASSES,)),))


#: A store by location. It never changes: each round has its own, for all robots at that place.
Stored = Mapping[tuple[Plain, ...], Plain]

_EMPTY: Stored = MappingProxyType({})


@keeps_last
def _after(store: Stored, decision: Decision) -> Stored:
    """The store after a decision."""
    changed = dict(store)
    for write in decision.writes:
        changed[(write.variable, *write.path)] = write.value
    return changed


class Journal(Struct):
    """The disk of a robot: its last proposal, the rounds that were kept, and what it saved."""

    proposed: Proposal | None = None
    kept: list[int] = field(default_factory=list)
    saved: Durable | None = None
    store: Stored = field(default_factory=lambda: _EMPTY)
    is_mute: bool = False  #: an earlier disk was lost, and the robot's locals with it


class StormRobot:
    """A test robot. ``store`` is the sum of its decisions."""

    def __init__(self, pid: int, journal: Journal) -> None:
        self.pid = pid
        self.store = _EMPTY
        self.round = INIT_ROUND
        self.holding: Reason | None = None
        self.acted: list[LogEntry] = []
        self._journal = journal

    def propose(self, round_: int) -> Proposal | None:
        """Propose for a round. A robot that is back is silent until the others are where it was."""
        if self._journal.is_mute:
            return None
        before = self._journal.proposed
        if before is not None and before.round >= round_:
            return before if before.round == round_ else None
        self._journal.proposed = proposal_of(self.pid, round_)
        return self._journal.proposed

    def save(self, state: State) -> bool:
        self._journal.saved, self._journal.store = durable(state), self.store
        return True

    def come_back(self, saved: Durable) -> None:
        """Be where the disk says. Entries that were committed since are committed again."""
        self.store, self.round = self._journal.store, saved.round

    def commit(self, entry: LogEntry, kept: Admitted | None) -> None:
        if entry.round != self.round:
            raise AssertionError(f"{self.pid} commits {entry.round}, and is at {self.round}")
        self.store = _after(self.store, entry.decision)
        if kept is not None:
            self._keep(entry.round)
        self.round += 1
        self.acted.append(entry)

    def _keep(self, round_: int) -> None:
        journal = self._journal
        if journal.is_mute:
            return
        if journal.kept and round_ <= journal.kept[-1]:
            return  # before the crash
        if journal.proposed is None or journal.proposed.round != round_:
            raise AssertionError(f"{self.pid} is to keep {round_}, and has no buffer for it")
        journal.kept.append(round_)

    def show(self) -> bytes:
        return msgspec.msgpack.encode(list(self.store.items()))

    def install(self, round_: int, store: bytes, ran: LastRun | None) -> None:
        items = msgspec.msgpack.decode(store)
        self.store = {tuple(place): value for place, value in items}
        self.round = round_
        if ran is not None:
            self._keep(ran.round)

    def hold(self, reason: Reason | None) -> None:
        self.holding = reason


class Ledgers:
    """All robots of a run, with the journals that survive their crashes."""

    def __init__(self, setup: Setup) -> None:
        self.journals = [Journal() for _ in range(setup.robots)]
        self.ledgers = [StormRobot(pid, journal) for pid, journal in enumerate(self.journals)]
        self._setup = setup

    def switch_on(self, pid: int, start: int, how: SwitchedOn) -> Newborn:
        """Switch a robot on: its memory is empty except for its journal."""
        setup = self._setup
        if how is SwitchedOn.LOST:
            self.journals[pid] = Journal(is_mute=True)
        journal = self.journals[pid]
        ledger = self.ledgers[pid] = StormRobot(pid, journal)
        saved = journal.saved
        if how is SwitchedOn.LOST or (saved is None and journal.is_mute):
            return Newborn(ledger, setup, returning(setup, pid, start * INCARNATION_STEP))
        if saved is None:
            return Newborn(ledger, setup, fresh(setup, pid))
        ledger.come_back(saved)
        return Newborn(ledger, setup, recovered(setup, pid, saved, start))


class Weathered(Struct, frozen=True):
    """The result of a storm: the rounds reached, and the broken invariant, if any."""

    seed: int
    rounds: int  #: committed by anybody, INIT not counted
    rounds_in_storm: int
    skips_late: int
    epochs: int
    crashes: int
    datagrams: int
    broken: BrokenInvariant | None = None


class StormPlan(Struct, frozen=True):
    """The length of a storm, and of the calm in which robots have to recover."""

    storm_s: float = 5.0
    calm_rounds: int = 3  #: that every robot must commit after the storm
    calm_s: float = 30.0  #: within so much time


def weather(setup: Setup, faults: Faults, seed: int, course: StormPlan = StormPlan()) -> Weathered:
    """Run robots through a storm and into a calm. A function of its arguments.

    No disk is lost where robots owe proposals: who has lost its locals makes none any more, and the
    others would wait for it.
    """
    if setup.owing:
        faults = replace(faults, losses=0.0)
    ledgers = Ledgers(setup)
    network = Network(setup, faults, seed, ledgers.switch_on)
    watch = _Watch(setup)
    broken: BrokenInvariant | None = None
    try:
        broken = _blow(network, watch, course.storm_s, None)
        stormy = watch.rounds
        if broken is None:
            network.faults = replace(CALM, most_delay_s=0.002)
            until = network.now + course.calm_s
            broken = _blow(network, watch, until, watch.rounds + course.calm_rounds)
        broken = broken or watch.at_the_end(network, ledgers)
    except AssertionError as error:
        stormy, broken = watch.rounds, BrokenInvariant("ledger", str(error))
    return Weathered(
        seed,
        watch.rounds,
        stormy,
        watch.late,
        len(watch.epochs),
        network.crashes,
        watch.datagrams,
        broken,
    )


def _blow(
    network: Network, watch: _Watch, until_s: float, goal: int | None
) -> BrokenInvariant | None:
    """Run until a time, or until all live robots reach a round, which must be before that time."""
    while network.now < until_s:
        robot = network.step()
        broken = next(watch.look(network, robot), None)
        if broken is not None:
            return broken
        if goal is not None and all(
            state.round > goal and state.is_voter for state in network.running()
        ):
            return None
    if goal is None:
        return None
    lag = {state.pid: (state.round, state.office) for state in network.running()}
    return BrokenInvariant("progress", f"not at round {goal}: {lag}")


class _Watch:
    """A monitor that checks all invariants."""

    def __init__(self, setup: Setup) -> None:
        self.late = 0
        self.epochs: set[int] = set()
        self.datagrams = 0
        self._setup = setup
        self._acted: list[Held] = []
        self._rosters: list[tuple[int, ...]] = []
        self._accepted: dict[bytes, set[Accepted]] = {}
        self._decided: dict[tuple[int, int], bytes] = {}
        self._promised: dict[int, int] = {}

    @property
    def rounds(self) -> int:
        return len(self._acted) - 1

    def look(self, network: Network, robot: int | None) -> Iterator[BrokenInvariant]:
        """Yield the invariants broken after a step, at the robot that took it."""
        for sent in network.sent:
            yield from self._read(sent)
        network.sent.clear()
        node = network.nodes[robot] if robot is not None else None
        if node is None:
            return
        state = node.state
        yield from self._commits(state)
        if (
            isinstance(state.office, Coordinator)
            and self._promised.get(state.pid) != state.promised
        ):
            self._promised[state.pid] = state.promised
            yield from lasting(state, self._acted)

    def _read(self, sent: Sent) -> Iterator[BrokenInvariant]:
        self.datagrams += 1
        match sent.message:
            case Acknowledge(epoch=epoch, digest=mark):
                one = Accepted(epoch, sent.sender, sent.incarnation)
                self._accepted.setdefault(mark, set()).add(one)
            case Decide(epoch=epoch, entry=entry):
                key = (epoch, entry.round)
                mark = repr(entry).encode()
                if self._decided.setdefault(key, mark) != mark:
                    yield BrokenInvariant("I-ONE-ENTRY", f"epoch and round {key}")
            case _:
                pass

    def _commits(self, state: State) -> Iterator[BrokenInvariant]:
        for held in state.log[-16:]:
            place = held.round + 1
            if place < len(self._acted):
                yield from agree(self._acted[place].entry, held.entry)
                if self._acted[place].digest != held.digest:
                    yield BrokenInvariant("I-AGREE", f"round {held.round} on two histories")
            elif place == len(self._acted):
                yield from self._first_commit(held)

    def _first_commit(self, held: Held) -> Iterator[BrokenInvariant]:
        roster = self._rosters[-1] if self._rosters else (0,) * self._setup.robots
        yield from one_winner(held.entry, proposal_of)
        yield from valid(held.entry, proposal_of)
        yield from acted_rightly(
            self._setup, held, roster, self._accepted.get(held.digest, frozenset())
        )
        self._acted.append(held)
        self.epochs.add(held.epoch)
        self.late += len(held.entry.late)
        changed = list(roster)
        for admission in held.entry.admitted:
            changed[admission.robot] = admission.incarnation
        self._rosters.append(tuple(changed))

    def at_the_end(self, network: Network, ledgers: Ledgers) -> BrokenInvariant | None:
        """The violation, if a robot's own records disagree with the decisions about it."""
        for robot, journal in enumerate(ledgers.journals):
            if network.nodes[robot] is None or journal.is_mute:
                continue
            through = [
                held.round
                for held in self._acted[: ledgers.ledgers[robot].round + 1]
                if any(taken.robot == robot for taken in held.entry.decision.ran)
            ]
            if journal.kept != through:
                return BrokenInvariant(
                    "ledger", f"{robot} kept {journal.kept}, was let through {through}"
                )
        stores = {
            ledger.round: ledger.store
            for robot, ledger in enumerate(ledgers.ledgers)
            if network.nodes[robot] is not None
        }
        for robot, ledger in enumerate(ledgers.ledgers):
            if network.nodes[robot] is not None and ledger.store != stores[ledger.round]:
                return BrokenInvariant(
                    "ledger", f"{robot} has another store at round {ledger.round}"
                )
        return None
