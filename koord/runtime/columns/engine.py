"""The engine of fleets as columns: turns by machine code, and by compiled robots where it doubts.

It has the face of :class:`.RoundEngine`, and every decision is the one that engine would make: of
each robot machine code says that nothing is enabled, or which event is and what it writes, or that
it is in doubt, and then the compiled robot makes the whole turn (decision record 0102).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from koord.runtime.columns.columns import Columns
from koord.runtime.columns.counts import Counts
from koord.runtime.columns.deciding import decided
from koord.runtime.columns.effects import Deed, EventCode, WrittenRows
from koord.runtime.columns.judging import CodeJudge
from koord.runtime.compile.machine.layout import Column
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.machine.made import Effect, Turns
from koord.runtime.compile.watching import Watched
from koord.runtime.engine import Deployed, Measurement, RoundEngine, Schedule
from koord.runtime.motion.arrays import Bools, Ints
from koord.runtime.proposals import Decision, Proposal
from koord.runtime.robot import Host, Robot, Status
from koord.runtime.shapes import Shape, element_of
from koord.syntax.core import Home

#: Instead of an event that a robot runs: it is not known which, or it owes one or several.
_IN_DOUBT, _OWED = -1, -2


class RoundTurns(Struct):
    """What is proposed in a round: by all, and of it by machine code, whose rows these are."""

    proposals: dict[int, Proposal]
    rows: dict[int, tuple[Deed, int]]
    deeds: list[tuple[EventCode, Deed]]


class MachineFleet:
    """What machine code works on, of one run."""

    def __init__(
        self, turns: Turns, columns: Columns, classes: Sequence[type[Robot]], kinds: Sequence[int]
    ) -> None:
        count, of = len(kinds), np.array(kinds)
        self.turns, self.columns = turns, columns
        enabled: Ints = np.zeros(count, np.int64)
        doubtful: Ints = np.zeros(count, np.int64)
        some: Ints = np.zeros(count, np.int64)
        #: Bits of events of each robot, where it has any that is enabled, or may be.
        self.enabled, self.doubtful = enabled.data, doubtful.data
        self._some = some.data
        self._outs = tuple(array.ctypes.data for array in (enabled, doubtful, some))
        self._kinds = [np.flatnonzero(of == kind) for kind in range(len(turns.kinds))]
        self.is_stopped: Bools = np.zeros(count, np.bool_)
        self.stopped = 0
        self.codes = [
            [None if e is None else _code(e, program) for e in (() if one is None else one.effects)]
            for one, program in zip(turns.kinds, classes, strict=True)
        ]
        self.settle()

    def settle(self) -> None:
        """Take note of who has stopped, and has no turns any more."""
        self.stopped = int(self.is_stopped.sum())
        going = [pids[~self.is_stopped[pids]] for pids in self._kinds]
        pairs = [*zip(self.turns.kinds, going, strict=True)]
        self.alone = [pid for of, pids in pairs if of is None for pid in pids.tolist()]
        self._going = [
            (of.guards, pids, (pids.ctypes.data, len(pids)))
            for of, pids in pairs
            if of is not None and len(pids)
        ]

    def guard_calls(self) -> list[tuple[Callable[..., int], tuple[int, ...]]] | None:
        """The functions that look at guards, and what each is given behind the state.

        None if there are robots of which no guard has code.
        """
        if self.alone:
            return None
        return [(guards, (*robots, *self._outs)) for guards, _, robots in self._going]

    def keep_to(self, pids: Sequence[int]) -> None:
        """Look at the guards of some robots alone."""
        self._kinds = [np.intersect1d(of_kind, pids) for of_kind in self._kinds]
        self.settle()

    def look(self) -> list[int]:
        """Look at all guards; return the robots that have a turn to make, in order."""
        state, found = self.columns.state, [*self.alone]
        for guards, _, robots in self._going:
            count = guards(*state, *robots, *self._outs)
            found += self._some[:count].tolist()
        if len(self._going) + bool(self.alone) > 1:
            found.sort()
        return found


def _code(effect: Effect, program: type[Robot]) -> EventCode:
    names = [variable.name for variable in program.SHARED.variables]
    return EventCode(
        effect,
        [
            (
                column,
                _shape(program, column),
                names.index(column.name) if column.kind is None else -1,
            )
            for column in effect.columns
        ],
    )


class ColumnEngine(RoundEngine):
    """An engine that runs robots by machine code where it is sure of them.

    ``turns`` makes it, if it is not made yet, when so many turns have gone by that it is worth its
    time (``after``; None: as many as it says itself). Where there is none (None), compiled robots
    make all turns.
    """

    def __init__(
        self,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        delta_s: float,
        host: Host,
        turns: LazyTurns | None,
        *,
        after: int | None = None,
    ) -> None:
        super().__init__(classes, kinds, delta_s, host)
        self.counts = Counts()
        self._classes, self._kinds, self._delta_s = tuple(classes), tuple(kinds), delta_s
        self._turns = turns
        self.after = after
        self._gone = 0
        self.fleet: MachineFleet | None = None
        self._judge: tuple[Watched | None, CodeJudge] | None = None
        #: Lets robots have what was measured; None where they have it.
        self._write: Callable[[], None] | None = None
        #: Shared variables that robots have not been told.
        self._late: dict[str, Any] = {}
        self._touched: set[int] | None = None
        self._decided: Decision | None = None
        #: Robots that have events in buffers, and those that ran one, since the last round.
        self._had: list[int] = []
        self._ran: list[int] = []
        self._running = len(kinds)  #: robots that have not asked to stop, nor stopped
        self._ranks: Ints = np.tile(np.arange(len(kinds)), 2)
        self._names = [variable.name for variable in classes[0].SHARED.variables]

    @property
    def robots(self) -> list[Robot]:
        """The robots, with all that they hold now; where columns have more, they are told."""
        self._tell()
        return self._robots

    def _tell(self) -> None:
        if self._write is not None:
            self._write()
            self._write = None
        for name, value in self._late.items():
            for robot in self._robots:
                robot.__dict__[name] = value
        self._late.clear()

    def program_turns(self, schedule: Schedule) -> Decision:
        """Run every robot's program turn. [SELECT] [ATOMIC] [END-PROG]"""
        fleet = self._ready()
        if fleet is None:
            return super().program_turns(schedule)
        if not _is_plain(schedule):
            self._tell()  # it may ask robots
        for pid in self._had:
            self._robots[pid].rest()
        round_ = RoundTurns({}, {}, [])
        plain = _is_plain(schedule)
        ranks = self._rotated() if plain else schedule.order(self.round, len(self._robots))
        self._proposals(fleet, schedule, round_)
        self.proposed = proposals = heard = round_.proposals
        self._had = [pid for pid in proposals if self._robots[pid].had_an_event]
        if not plain:
            heard = {i: p for i, p in proposals.items() if p.urgent or schedule.hears(p)}
        decision = decided(self.round, heard, ranks)
        self._conclude(fleet, round_, decision)
        if self.ended is None and self._running == 0:
            # [STOP]: everybody has asked, or stopped.
            for robot in self._robots:
                robot.status = Status.STOPPED
            fleet.is_stopped[:] = True
            fleet.settle()
        self._decided = decision
        return decision

    def _rotated(self) -> Ints:
        """The rotating order of the round, as :func:`.rotating` has it."""
        count = len(self._robots)
        first = self.round % count if count else 0
        return self._ranks[first : first + count]

    def environment_turn(self) -> None:
        """Take the environment's turn: sensors and models; a new round begins. [ENV-TRANS]"""
        super().environment_turn()
        if self.fleet is None:
            return
        columns = self.fleet.columns
        if self.measured is None:
            self._touched = None
            for robot in self._robots:
                columns.take(robot)
        else:
            self._sense(columns, self.measured)

    def _sense(self, columns: Columns, measured: Measurement) -> None:
        """Let columns have what was measured, and note of whom more than where they are."""
        columns.measure(measured.changed)
        for pid in measured.asked:
            columns.take(self._robots[pid])
        if self._touched is not None:
            self._touched.update(measured.asked)
            for one in measured.changed:
                if one.values.ndim == 1:
                    self._touched.update(one.robots.tolist())

    def _hand_out(self, measured: Measurement) -> None:
        """Let robots have what was measured, or keep it until somebody looks at them."""
        if self.fleet is None:
            measured.write()
        else:
            self._write = measured.write

    # --- what has changed -------------------------------------------------------------------------

    def touched(self) -> list[int] | None:
        """The robots of which more may have changed since the last call than where they are.

        None: any. One observer may ask.
        """
        found, self._touched = self._touched, None if self.fleet is None else set()
        return None if found is None else sorted(found)

    def idle(self, decision: Decision) -> tuple[list[int], Bools] | None:
        """The robots that had an event in the program turns of a decision, and who has stopped.

        None where the robots have to be asked.
        """
        if self.fleet is None or decision is not self._decided or decision.fault is not None:
            return None
        return self._had, self.fleet.is_stopped

    def is_idle(self, decision: Decision) -> bool:
        """Return whether it is known that nobody had an event in a decision, nor has stopped."""
        return self.all_go_on(decision) and not (self._had or self._ran)

    def all_go_on(self, decision: Decision) -> bool:
        """Return whether it is known that after a decision nobody has stopped, nor faulted."""
        return (
            self.fleet is not None
            and decision is self._decided
            and not (self.fleet.stopped or decision.fault)
        )

    def rest(self) -> None:
        """Let nobody have an event any more, as in a round in which none is enabled. [SKIP]"""
        for pid in self._had:
            self._robots[pid].rest()
        for pid in self._ran:
            self._robots[pid].ran = None
        self._had, self._ran = [], []

    def pass_round(self, measured: Measurement) -> None:
        """Take note that time has passed after robots acted: a new round begins. [ENV-TRANS]

        Columns know where robots are then. What else sensors read was ``measured``.
        """
        assert self.fleet is not None
        self.round += 1
        self._sense(self.fleet.columns, measured)
        self._write = measured.write

    def pass_idle(self, decision: Decision, rounds: int, measured: Measurement) -> None:
        """Take note of rounds in which nobody did anything, the last by this decision.

        Columns know where robots are then. What else sensors read was ``measured`` in the last.
        """
        assert self.fleet is not None
        self.rest()
        self.round += rounds
        self.counts.by_code += rounds * len(self._robots)
        self._decided = decision
        self._sense(self.fleet.columns, measured)
        self._write = measured.write

    def judge(self, watched: Watched) -> CodeJudge | None:
        """A judge of claims about the state as it is now, if machine code has been made for it."""
        if self._judge is None or self._judge[0] is not watched:
            return None
        return self._judge[1]

    # --- going over to machine code ---------------------------------------------------------------

    def _ready(self) -> MachineFleet | None:
        """What machine code works on, if it is time for it, and there is any."""
        if self.fleet is None and self._turns is not None:
            turns = self._turns
            after = turns.worth_turns if self.after is None else self.after
            if self._gone + len(self._robots) <= after and not turns.is_made:
                self._gone += len(self._robots)
                return None
            self._turns = None
            made = turns()
            if made is not None:
                self.fleet = self._made(made)
        return self.fleet

    def _made(self, turns: Turns) -> MachineFleet:
        columns = Columns(turns.layout, self._kinds, self._delta_s)
        columns.take_all(self._robots, self.store.values)
        fleet = MachineFleet(turns, columns, self._classes, self._kinds)
        for robot in self._robots:
            fleet.is_stopped[robot.pid] = robot.status is Status.STOPPED
            self._running -= robot.status is not Status.RUNNING
        fleet.settle()
        judge = CodeJudge(turns.claims, self._kinds, columns.state, self._tell)
        self._judge = turns.watched, judge
        self._had = self._ran = list(range(len(self._robots)))
        return fleet

    # --- proposing --------------------------------------------------------------------------------

    def _proposals(self, fleet: MachineFleet, schedule: Schedule, round_: RoundTurns) -> None:
        """Make the proposals of a round; with a plain schedule only of those who do something."""
        found, robots = fleet.look(), self._robots
        plain = _is_plain(schedule)
        if plain:
            self.counts.by_code += len(robots) - len(found) - fleet.stopped
            if not found:
                return
        chosen: dict[tuple[int, int], list[int]] = {}
        orders: dict[int, tuple[int, ...] | None] = {}
        for pid in found if plain else range(len(robots)):
            robot, order, willing = robots[pid], None, True
            if not plain:
                asked = schedule.events(robot)
                order = None if asked is None else tuple(asked)
                willing = schedule.willing(robot)
                round_.proposals[pid] = Proposal(pid, self.round)
                if robot.status is Status.STOPPED:
                    continue
            kind = self._kinds[pid]
            of_kind = fleet.turns.kinds[kind]
            if of_kind is None:
                self.counts.by_robots += 1
                round_.proposals[pid] = self._by_itself(pid, order, willing=willing)
                continue
            yes, unsure = fleet.enabled[pid], fleet.doubtful[pid]
            event = _chosen(yes, unsure, of_kind.urgent, order, willing=willing)
            if event is None:
                self.counts.by_code += 1
            elif event >= 0 and fleet.codes[kind][event] is not None:
                chosen.setdefault((kind, event), []).append(pid)
                orders[pid] = order
            else:
                if event == _IN_DOUBT and unsure & ~of_kind.without:
                    self.counts.in_doubt += 1
                else:
                    self.counts.by_robots += 1
                round_.proposals[pid] = self._by_itself(pid, order, willing=willing)
        for (kind, event), pids in chosen.items():
            code = fleet.codes[kind][event]
            assert code is not None
            rows, in_doubt = code.run(fleet.columns.state, pids)
            of_kind = fleet.turns.kinds[kind]
            assert of_kind is not None
            owes = [bool(fleet.enabled[pid] & of_kind.urgent) for pid in rows.pids]
            self._propose_rows(fleet, (kind, event), rows, owes, round_)
            for pid in in_doubt:
                self.counts.in_doubt += 1
                round_.proposals[pid] = self._by_itself(pid, orders[pid])

    def _by_itself(
        self, pid: int, order: Sequence[int] | None, *, willing: bool = True
    ) -> Proposal:
        """The proposal of a robot that makes its turn itself."""
        self._tell()
        return self._robots[pid].propose(self.round, order, willing=willing)

    def _propose_rows(
        self,
        fleet: MachineFleet,
        what: tuple[int, int],
        rows: WrittenRows,
        owes: Sequence[bool],
        round_: RoundTurns,
    ) -> None:
        """Propose what machine code has written of an event of a kind of robots (``what``)."""
        kind, event = what
        code = fleet.codes[kind][event]
        assert code is not None
        deed = code.deed(event, rows, self._robots)
        self.counts.by_code += len(deed.pids)
        round_.deeds.append((code, deed))
        for row, (pid, attempt) in enumerate(zip(deed.pids, deed.attempts, strict=True)):
            round_.proposals[pid] = Proposal(pid, self.round, (attempt,), owes[row])
            round_.rows[pid] = (deed, row)
            self._robots[pid].run_elsewhere(deed.event)

    def _take(self, columns: Columns, robot: Robot) -> None:
        """Let columns have what has become of a robot that made its turn itself."""
        columns.take(robot)

    # --- acting -----------------------------------------------------------------------------------

    def _conclude(self, fleet: MachineFleet, round_: RoundTurns, decision: Decision) -> None:
        """Act on a decision: commit or discard each robot's turn. [SHARED-ASSIGN] [SKIP]"""
        if decision.fault is not None:
            self._touched = None
            self._act(decision)
            return
        robots, rows, columns = self._robots, round_.rows, fleet.columns
        for pid in self._ran:
            robots[pid].ran = None
        self._ran = [taken.robot for taken in decision.ran]
        if not (self._ran or decision.writes):
            return
        changed = self.store.apply(decision.writes)
        self._late |= changed
        if self._touched is not None:
            self._touched.update(self._ran)
        settle = False
        for taken in decision.ran:
            pid = taken.robot
            robot = robots[pid]
            before = robot.status
            if pid in rows:
                deed, row = rows[pid]
                robot.keep(deed.event, taken.asked, deed.changes[row])
            else:
                written = robot.commit(taken.event, changed)
                self._show(decision.round, pid, written)
                self._take(columns, robot)
            if robot.status is not before:
                self._running -= before is Status.RUNNING
                if robot.status is Status.STOPPED:
                    fleet.is_stopped[pid] = settle = True
        ran = set(self._ran) if round_.deeds else set()
        for code, deed in round_.deeds:
            kept = [row for row, pid in enumerate(deed.pids) if pid in ran]
            columns.take_deed(code.effect, deed, kept)
        columns.take_writes(decision.writes, self._names, self.store.values, rows)
        if settle:
            fleet.settle()


def _is_plain(schedule: Schedule) -> bool:
    """Whether a schedule leaves all to the program: nobody skips, and all is heard."""
    return type(schedule) is Deployed


def _chosen(
    enabled: int, doubtful: int, urgent: int, order: Sequence[int] | None, *, willing: bool
) -> int | None:
    """The event that a robot runs; None if it runs none. [SELECT]

    Robots that owe other events besides, or may owe some, choose themselves (``_OWED``).
    """
    some, owed = enabled | doubtful, enabled & urgent
    if doubtful & urgent:
        return _OWED
    if not some or not (willing or owed):
        return None
    if order is None:
        first = some & -some
    else:
        first = next((bit for event in order if some & (bit := 1 << event)), 0)
    if not first:
        return None
    if first & doubtful:
        return _IN_DOUBT
    return _OWED if owed & ~first else first.bit_length() - 1


def _shape(program: type[Robot], column: Column) -> Shape:
    """The shape of what one robot has of a column."""
    if column.home in (Home.LOCAL, Home.PORT):
        return {**program.LOCALS, **program.PORTS}[column.name]
    (shape,) = [v.shape for v in program.SHARED.variables if v.name == column.name]
    return element_of(shape) if column.home is Home.ALLREAD else shape
