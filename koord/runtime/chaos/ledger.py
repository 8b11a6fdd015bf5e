"""A robot that only keeps books: what it wrote, and which of its rounds were kept.

Its program is a function of pid and round, so that anybody can check what was decided. What it
would lose in a crash and what it keeps in a journal on disk are as on a real robot.
"""

from __future__ import annotations

from random import Random

import msgspec
from msgspec import Struct, field

from koord.runtime.chaos.network import Newborn
from koord.runtime.proposals import INIT_ROUND, Admitted, Attempt, Plain, Proposal, Write
from koord.runtime.protocol.entries import LastRun, LogEntry
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import fresh, returning

#: The variable that all robots write in their atomic block, and how many blocks there are.
SHARED, CLASSES = 0, 2


def proposal_of(robot: int, round_: int) -> Proposal:
    """What a robot would do in a round: nothing, something, or something in an atomic block."""
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


class Journal(Struct):
    """What a crash does not take: the last proposal made, and the rounds that were kept."""

    proposed: Proposal | None = None
    kept: list[int] = field(default_factory=list)


class StormRobot:
    """The robot. ``store`` is what its decisions add up to."""

    def __init__(self, pid: int, journal: Journal) -> None:
        self.pid = pid
        self.store: dict[tuple[Plain, ...], Plain] = {}
        self.round = INIT_ROUND
        self.holding: Reason | None = None
        self.acted: list[LogEntry] = []
        self._journal = journal

    def propose(self, round_: int) -> Proposal | None:
        """A robot that is back is silent until the others are where it was."""
        before = self._journal.proposed
        if before is not None and before.round >= round_:
            return before if before.round == round_ else None
        self._journal.proposed = proposal_of(self.pid, round_)
        return self._journal.proposed

    def commit(self, entry: LogEntry, kept: Admitted | None) -> None:
        if entry.round != self.round:
            raise AssertionError(f"{self.pid} commits {entry.round}, and is at {self.round}")
        for write in entry.decision.writes:
            self.store[(write.variable, *write.path)] = write.value
        if kept is not None:
            self._keep(entry.round)
        self.round += 1
        self.acted.append(entry)

    def _keep(self, round_: int) -> None:
        journal = self._journal
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
    """All robots of a run, with the journals that survive them."""

    def __init__(self, setup: Setup) -> None:
        self.journals = [Journal() for _ in range(setup.robots)]
        self.ledgers = [StormRobot(pid, journal) for pid, journal in enumerate(self.journals)]
        self._setup = setup

    def switch_on(self, pid: int, incarnation: int, back: bool) -> Newborn:
        """A robot with an empty memory, but for its journal."""
        ledger = self.ledgers[pid] = StormRobot(pid, self.journals[pid])
        begin = returning if back else fresh
        return Newborn(ledger, self._setup, begin(self._setup, pid, incarnation))
