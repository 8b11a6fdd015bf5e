"""A run on a bad network with every invariant watched, and a calm end to show that it goes on."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.chaos.faults import CALM, Faults
from koord.runtime.chaos.ledger import Ledgers, proposal_of
from koord.runtime.chaos.network import Network, Sent
from koord.runtime.exploration.claims import (
    Accepted,
    BrokenInvariant,
    acted_rightly,
    agree,
    lasting,
    one_winner,
    valid,
)
from koord.runtime.protocol.entries import Held
from koord.runtime.protocol.messages import Acknowledge, Decide
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import Coordinator, State


class Weathered(Struct, frozen=True):
    """What a storm left: how far the robots came, and what is broken, if anything."""

    seed: int
    rounds: int  #: committed by anybody, INIT not counted
    rounds_in_storm: int
    skips_late: int
    epochs: int
    crashes: int
    datagrams: int
    broken: BrokenInvariant | None = None


class StormPlan(Struct, frozen=True):
    """How long it blows, and how long it may take to recover."""

    storm_s: float = 5.0
    calm_rounds: int = 3  #: that every robot must commit after the storm
    calm_s: float = 30.0  #: within so much time


def weather(setup: Setup, faults: Faults, seed: int, course: StormPlan = StormPlan()) -> Weathered:
    """Run robots through a storm and into a calm. A function of its arguments."""
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
    """Until a time; or until all that are up have come so far, which must be before that time."""
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
    """Sees everything, and says what is wrong with it."""

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
        """After each step, at the robot that took it."""
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
        """Each robot's own books agree with what was decided about it."""
        for robot, journal in enumerate(ledgers.journals):
            if network.nodes[robot] is None:
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
