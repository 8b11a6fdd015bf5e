"""Engines of a run in several processes: each makes the program turns of some robots.

The first process decides, and has all robots as they are: what a robot did elsewhere it takes over
from there. Every other acts on what was decided, for its own robots (decision record 0112).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from koord.runtime.buffers import Tried
from koord.runtime.columns.columns import Columns
from koord.runtime.columns.effects import Deed, WrittenRows
from koord.runtime.columns.engine import ColumnEngine, MachineFleet, RoundTurns
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.machine.made import Turns
from koord.runtime.engine import Deployed, Schedule
from koord.runtime.proposals import Decision, Proposal
from koord.runtime.robot import Host, Robot

_PLAIN = Deployed()


class Turned(NamedTuple):
    """A robot's program turn: what it proposes, and what each of its attempts has changed."""

    proposal: Proposal
    tried: tuple[Tried, ...]


class DeedTurns(NamedTuple):
    """The same event of several robots of one kind, as machine code has written it.

    ``owes`` says of whom it was owed; ``words`` and ``flags`` are those of ``rows``.
    """

    kind: int
    event: int
    pids: list[int]
    owes: list[bool]
    words: bytes
    flags: bytes

    @property
    def rows(self) -> WrittenRows:
        count = len(self.pids)
        words = np.frombuffer(self.words, np.int64).reshape(count, -1)
        flags = np.frombuffer(self.flags, np.uint8).reshape(count, -1)
        return WrittenRows(self.pids, words, flags)


class PartTurns(NamedTuple):
    """The program turns of some robots; of those who skip nothing is told."""

    turned: list[Turned]
    deeds: list[DeedTurns]


class PartedEngine(ColumnEngine):
    """An engine whose program turns other processes may make, by copies of it.

    In the first process ``collect`` says what they have proposed. A copy makes :meth:`turns`, and
    acts by :meth:`follow`. Until :meth:`keep_to` all turns are made here.
    """

    def __init__(
        self,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        delta_s: float,
        host: Host,
        turns: LazyTurns | None,
    ) -> None:
        super().__init__(classes, kinds, delta_s, host, turns)
        self.collect: Callable[[], PartTurns] | None = None
        self._took: tuple[Robot, ...] = ()  #: who may have turns that are no more
        self._elsewhere: dict[tuple[int, int], list[DeedTurns]] | None = None
        self._turned_elsewhere: dict[int, Turned] = {}
        self._part: tuple[int, ...] | None = None
        self._made_turns = RoundTurns({}, {}, [])

    # --- the first process ------------------------------------------------------------------------

    def _proposed(self, schedule: Schedule) -> Mapping[int, Proposal]:
        if self._part is None:
            return super()._proposed(schedule)
        robots = self._robots
        proposals = {pid: robots[pid].propose(self.round) for pid in self._part}
        if self.collect is not None:
            turns = self.collect()
            for robot in self._took:
                robot.rest()
            assert not turns.deeds  # nobody who has no machine code yet is told of any
            proposals |= self._taken(turns.turned)
        return proposals

    def _proposals(self, fleet: MachineFleet, schedule: Schedule, round_: RoundTurns) -> None:
        self._elsewhere = None
        super()._proposals(fleet, schedule, round_)
        for what, deeds in tuple(self._others(round_).items()):
            for deed in deeds:
                self._propose_rows(fleet, what, deed.rows, deed.owes, round_)

    def _propose_rows(
        self,
        fleet: MachineFleet,
        what: tuple[int, int],
        rows: WrittenRows,
        owes: Sequence[bool],
        round_: RoundTurns,
    ) -> None:
        # With those of other processes: together they take half the time.
        others = self._others(round_).pop(what, None)
        if others:
            all_rows = [rows, *(deed.rows for deed in others)]
            rows = WrittenRows(
                [pid for one in all_rows for pid in one.pids],
                np.concatenate([one.words for one in all_rows]),
                np.concatenate([one.flags for one in all_rows]),
            )
            owes = [*owes, *(owed for deed in others for owed in deed.owes)]
        super()._propose_rows(fleet, what, rows, owes, round_)

    def _others(self, round_: RoundTurns) -> dict[tuple[int, int], list[DeedTurns]]:
        """What machine code wrote elsewhere in this round, by kind and event.

        It is asked for when the turns that compiled robots make here are over.
        """
        if self._elsewhere is None:
            self._elsewhere = {}
            if self.collect is not None:
                turns = self.collect()
                round_.proposals.update(self._taken(turns.turned))
                for deed in turns.deeds:
                    self._elsewhere.setdefault((deed.kind, deed.event), []).append(deed)
        return self._elsewhere

    def _taken(self, turns: Sequence[Turned]) -> dict[int, Proposal]:
        """Let robots have the turns that they made elsewhere; return what they propose."""
        if turns:
            self._tell()
        self._took = tuple(self._robots[turn.proposal.robot] for turn in turns)
        self._turned_elsewhere = {turn.proposal.robot: turn for turn in turns}
        for robot, turn in zip(self._took, turns, strict=True):
            robot.take_over(turn.proposal.attempts, turn.tried)
        return {turn.proposal.robot: turn.proposal for turn in turns}

    def _take(self, columns: Columns, robot: Robot) -> None:
        turn = self._turned_elsewhere.get(robot.pid)
        if turn is None:
            columns.take(robot)
            return
        for attempt, tried in zip(turn.proposal.attempts, turn.tried, strict=True):
            if attempt.event == robot.ran:
                columns.take(robot, tried.changes)

    # --- the others -------------------------------------------------------------------------------

    def prepare(self, within_rounds: int) -> None:
        """Have machine code made now, if so few rounds from now it would be made anyway."""
        turns = self._turns
        if turns is not None and len(self._robots) * within_rounds >= turns.worth_turns:
            self.after = 0
            self._ready()

    def keep_to(self, pids: Sequence[int], collect: Callable[[], PartTurns] | None = None) -> None:
        """Make the turns of some robots here from now on, and have others' by ``collect``."""
        self._part, self.collect = tuple(pids), collect
        self._took = tuple(robot for robot in self._robots if robot.pid not in pids)
        if self.fleet is not None:
            self.fleet.keep_to(pids)
        elif self._turns is not None and collect is None:
            self._turns = self._turns.without_claims()

    def _made(self, turns: Turns) -> MachineFleet:
        fleet = super()._made(turns)
        if self._part is not None:
            fleet.keep_to(self._part)
        return fleet

    @property
    def present(self) -> list[Robot]:
        robots = self.robots
        if self._part is None or self.collect is not None:
            return robots
        return [robots[pid] for pid in self._part]

    def turns(self, *, as_deeds: bool) -> PartTurns:
        """Make the program turns of the open round. [SELECT]

        Those by machine code are told ``as_deeds`` to who has the same code.
        """
        assert self._part is not None
        round_ = self._made_turns = RoundTurns({}, {}, [])
        proposals, fleet = round_.proposals, self._ready()
        if fleet is None:
            proposals |= self._proposed(_PLAIN)
        else:
            for pid in self._had:
                self._robots[pid].rest()
            self._proposals(fleet, _PLAIN, round_)
            self._had = [pid for pid in proposals if self._robots[pid].had_an_event]
        deeds = [self._deeds(deed) for _, deed in round_.deeds if deed.pids] if as_deeds else []
        told = round_.rows if as_deeds else ()
        turned = [
            self._turned(one) for pid, one in proposals.items() if one.attempts and pid not in told
        ]
        return PartTurns(turned, deeds)

    def _deeds(self, deed: Deed) -> DeedTurns:
        owes = [self._made_turns.proposals[pid].urgent for pid in deed.pids]
        kind = self._kinds[deed.pids[0]]
        words, flags = deed.words.tobytes(), deed.flags.tobytes()
        return DeedTurns(kind, deed.event, deed.pids, owes, words, flags)

    def _turned(self, proposal: Proposal) -> Turned:
        row = self._made_turns.rows.get(proposal.robot)
        if row is not None:
            deed, number = row
            return Turned(proposal, (Tried(deed.changes[number]),))
        robot = self._robots[proposal.robot]
        return Turned(proposal, tuple(robot.tried(one.event) for one in proposal.attempts))

    def follow(self, decision: Decision) -> None:
        """Act on a decision without a fault. [SHARED-ASSIGN] [SKIP]"""
        assert self._part is not None
        mine = frozenset(self._part)
        ran = tuple(taken for taken in decision.ran if taken.robot in mine)
        skipped = tuple(mine.difference([taken.robot for taken in ran]))
        part = Decision(decision.round, ran, skipped, decision.writes)
        if self.fleet is None:
            self._act(part)
        else:
            self._conclude(self.fleet, self._made_turns, part)
        self.shown.clear()
