"""The round engine: a fleet in one process, without messages, loss or delay. [EVENT-TRANS]

Every robot proposes, one decision is made of all proposals, everybody acts on it, and then the
environment has its turn: the steps of a deployed round, without the messages. No clock is looked
at: a round takes as long as it takes, and δ is a number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from random import Random
from typing import TYPE_CHECKING, Any, Protocol

from msgspec import Struct, field

from koord.runtime.buffers import Written
from koord.runtime.operations import FaultError
from koord.runtime.proposals import INIT_ROUND, Decision, EventFault, Proposal, decide, rotating
from koord.runtime.robot import Host, Robot, Status
from koord.runtime.store import AgreedStore

if TYPE_CHECKING:  # NumPy is there where worlds are
    from koord.runtime.motion.arrays import Bools, Floats, Ints
else:
    Bools = Floats = Ints = Any


class Ended(Struct, frozen=True):
    """The fault that ended a run; ``robot`` is None for a fault in a shared variable's start."""

    robot: int | None
    fault: EventFault


class Shown(Struct, frozen=True):
    """The output of a robot in one turn; ``round`` is INIT_ROUND for INIT."""

    round: int
    robot: int
    written: tuple[Written, ...]


class Resumed(Struct, frozen=True, eq=False):
    """What robots hold when another program goes on from where they are. [RELOAD]

    Values are in the shapes of that program's attributes: ``robots[i]`` are those of robot i but
    for what is shared. ``ran`` is what each ran in the last round.
    """

    round: int
    shared: Mapping[str, Any]
    robots: Sequence[Mapping[str, Any]]
    statuses: Sequence[Status]
    ran: Sequence[int | None]
    shown: Sequence[Shown]


class Measured(Struct, frozen=True, eq=False):
    """What a sensor of robots of one kind reads, where that may be another value than before.

    ``values`` are in the order of ``robots``, and what these have then: Booleans, where they are
    others than before, or coordinates, shape ``(k, m)``.
    """

    name: str
    robots: Ints
    values: Floats | Bools


class Measurement(Struct, frozen=True):
    """What sensors read, and the robots that were asked one by one.

    ``write`` lets robots have what they have not got yet of all that has been measured so far.
    """

    changed: tuple[Measured, ...]
    asked: tuple[int, ...]
    write: Callable[[], None]


class RoundEngine:
    """An engine that runs the robots of a compiled program, with their store.

    :meth:`begin` comes first; then :meth:`program_turns` and :meth:`environment_turn` take turns.
    After a fault (``ended``) there are no more turns.
    """

    def __init__(
        self,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        delta_s: float,
        host: Host,
    ) -> None:
        """Make an engine; ``kinds[i]`` is the position of robot i's class in ``classes``."""
        self._robots = [classes[kind](pid, kinds, delta_s, host) for pid, kind in enumerate(kinds)]
        self.has_models = any(robot.has_model for robot in self._robots)
        self.host = host
        #: Reads the sensors of all robots at once, where nobody listens to what each of them reads.
        self.reader: Callable[[Sequence[Robot]], Measurement] | None = None
        #: What it has read in the last environment's turn.
        self.measured: Measurement | None = None
        self.store = AgreedStore(classes[0].SHARED, len(kinds))
        self.round = 0  #: the one that is open or comes next
        self.ended: Ended | None = None
        self.shown: list[Shown] = []
        #: What was proposed in the last round; who is not in it proposed nothing to do.
        self.proposed: Mapping[int, Proposal] = {}

    @property
    def robots(self) -> list[Robot]:
        """The robots, with all that they hold now."""
        return self._robots

    @property
    def told_robots(self) -> list[Robot]:
        """The robots, which may not have been told where they are, and what they share."""
        return self._robots

    def is_idle(self, decision: Decision) -> bool:
        """Return whether it is known that nobody had an event in a decision, nor has stopped."""
        return False

    @property
    def present(self) -> list[Robot]:
        """The robots that take the environment's turn here, with all that they hold now."""
        return self.robots

    @property
    def all_stopped(self) -> bool:
        """True if all robots have stopped."""
        return all(robot.status is Status.STOPPED for robot in self._robots)

    def begin(self, order: Sequence[int] | None = None) -> Decision:
        """Run INIT, with the robots' writes in an order. [INIT]"""
        first = self.robots[0]
        try:
            first.declare()
        except FaultError as error:
            self.ended = Ended(None, first.located(error.fault))
            return Decision(INIT_ROUND, (), (), ())
        self.store.declare(vars(first))
        for robot in self.robots:
            vars(robot).update(self.store.values)
        ranks = order if order is not None else range(len(self.robots))
        self.proposed = proposals = {robot.pid: robot.propose_init() for robot in self.robots}
        decision = decide(INIT_ROUND, proposals, ranks)
        self._act(decision)
        return decision

    def proposals_of(self, decision: Decision) -> Mapping[int, Proposal]:
        """What was proposed in one of the last rounds; in those behind the first nobody acted.

        Who is not in it proposed nothing to do.
        """
        proposals = self.proposed
        of = next(iter(proposals.values()), None)
        return proposals if of is not None and of.round == decision.round else {}

    def resume(self, resumed: Resumed) -> None:
        """Go on from where another engine's robots are, instead of INIT. [RELOAD]"""
        self.round, self.shown = resumed.round, list(resumed.shown)
        self.store.declare(resumed.shared)
        for robot, held in zip(self._robots, resumed.robots, strict=True):
            vars(robot).update(held)
            vars(robot).update(self.store.values)
            robot.status, robot.ran = resumed.statuses[robot.pid], resumed.ran[robot.pid]

    def program_turns(self, schedule: Schedule) -> Decision:
        """Run every robot's program turn. [SELECT] [ATOMIC] [END-PROG]"""
        ranks = schedule.order(self.round, len(self.robots))
        self.proposed = proposals = self._proposed(schedule)
        heard = {i: p for i, p in proposals.items() if p.urgent or schedule.hears(p)}
        decision = decide(self.round, heard, ranks)
        self._act(decision)
        if self.ended is None and all(r.status is not Status.RUNNING for r in self.robots):
            # [STOP]: everybody has asked, or stopped.
            for robot in self.robots:
                robot.status = Status.STOPPED
        return decision

    def _proposed(self, schedule: Schedule) -> Mapping[int, Proposal]:
        """The proposals of a round; who has none skips. [SELECT]"""
        return {
            robot.pid: robot.propose(
                self.round, schedule.events(robot), willing=schedule.willing(robot)
            )
            for robot in self.robots
        }

    def environment_turn(self) -> None:
        """Take the environment's turn: sensors and models; a new round begins. [ENV-TRANS]

        Where a model faults, no robot's ports change. [FAULT]
        """
        if self.reader is not None and not self.has_models:
            self.measured = self.reader(self._robots)
            self._hand_out(self.measured)
            self.round += 1
            return
        robots = self.present
        readings = [self.host.read(robot) for robot in robots]
        before = [robot.ports() for robot in robots] if self.has_models else []
        for robot, of_robot in zip(robots, readings, strict=True):
            fault = robot.evolve(of_robot)
            if fault is not None and self.ended is None:
                self.ended = Ended(robot.pid, robot.located(fault))
        if self.ended is None:
            self.round += 1
            return
        for robot, ports in zip(robots, before, strict=True):
            vars(robot).update(ports)  # values never change, so these are as they were

    def _hand_out(self, measured: Measurement) -> None:
        """Let robots have what was measured."""
        measured.write()

    def _act(self, decision: Decision) -> None:
        """Act on a decision: commit or discard each robot's turn. [SHARED-ASSIGN] [SKIP]"""
        if decision.fault is not None:
            faulted = decision.fault
            self.ended = Ended(faulted.robot, faulted.fault)
            for robot, event in [
                *((taken.robot, taken.event) for taken in decision.ran),
                (faulted.robot, faulted.event),
            ]:
                self._show(decision.round, robot, self.robots[robot].outcome(event))
            return
        changed = self.store.apply(decision.writes)
        for taken in decision.ran:
            written = self.robots[taken.robot].commit(taken.event, changed)
            self._show(decision.round, taken.robot, written)
        for robot in decision.skipped:
            self.robots[robot].discard(changed)

    def _show(self, round_: int, robot: int, written: Sequence[Written]) -> None:
        if written:
            self.shown.append(Shown(round_, robot, tuple(written)))


# --- schedules ------------------------------------------------------------------------------------


class Schedule(Protocol):
    """A schedule: the nondeterministic choices of the rounds of a run."""

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        """The order of robots in a round, each once."""
        ...

    def events(self, robot: Robot) -> Iterable[int] | None:
        """The order in which a robot tries its events; None: program order."""
        ...

    def willing(self, robot: Robot) -> bool:
        """Return whether a robot runs an event if it may."""
        ...

    def hears(self, proposal: Proposal) -> bool:
        """Return whether a proposal arrives before the round is decided; urgent ones always do."""
        ...


class Deployed:
    """The schedule of deployed robots: rotating order, first enabled event, no skips."""

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        return rotating(round_, robots)

    def events(self, robot: Robot) -> Iterable[int] | None:
        return None

    def willing(self, robot: Robot) -> bool:
        return True

    def hears(self, proposal: Proposal) -> bool:
        return True


class AtRandom(Struct, frozen=True):
    """A random schedule: any order, any enabled event, now and then a skip."""

    rng: Random
    skips_percent: int = 15

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        ranks = list(range(robots))
        self.rng.shuffle(ranks)
        return tuple(ranks)

    def events(self, robot: Robot) -> Iterable[int] | None:
        positions = list(range(len(robot.EVENTS)))
        self.rng.shuffle(positions)
        return positions

    def willing(self, robot: Robot) -> bool:
        return self.rng.randrange(100) >= self.skips_percent

    def hears(self, proposal: Proposal) -> bool:
        return True


#: With crashes, a robot goes in so many percent of its rounds, for so many rounds at most.
_GOES_PERCENT, _LONGEST_AWAY = 10, 5


class Unheard(Struct):
    """A schedule as on a bad network: proposals are lost, and robots are away for some rounds."""

    inner: Schedule
    rng: Random
    loss: float
    crashes: bool
    _away: dict[int, int] = field(default_factory=dict)

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        return self.inner.order(round_, robots)

    def events(self, robot: Robot) -> Iterable[int] | None:
        return self.inner.events(robot)

    def willing(self, robot: Robot) -> bool:
        return self.inner.willing(robot)

    def hears(self, proposal: Proposal) -> bool:
        robot = proposal.robot
        if proposal.round < self._away.get(robot, 0):
            return False
        if self.crashes and self.rng.randrange(100) < _GOES_PERCENT:
            self._away[robot] = proposal.round + self.rng.randint(1, _LONGEST_AWAY)
            return False
        return self.rng.random() >= self.loss
