"""The watch on the claims of a deployed run. (P-WATCH)

A robot watches what it can judge by itself: the contracts of its modules, in each turn of its
environment; the summaries of the functions that it asks; invariants about shared variables alone.
Who hears of all robots watches the other invariants. A broken claim stops nobody: it is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from operator import is_not
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.compile.watching import Watched, WatchedClaim, WatchedKind
from koord.runtime.deploy.attributes import own_shapes, own_values
from koord.runtime.deploy.journal import Attributes
from koord.runtime.monitors import (
    ContractMonitor,
    KnownAnswers,
    StateMonitor,
    SummaryMonitor,
    UnknownRobot,
    named,
    watch_type,
)
from koord.runtime.proposals import INIT_ROUND, Plain
from koord.runtime.robot import AnsweringHost, Robot, Status
from koord.runtime.shapes import from_plain
from koord.runtime.store import AgreedStore
from koord.syntax.source import Span

#: What is looked at when a round begins.
_STATES = (WatchedKind.INVARIANT, WatchedKind.AT_ROUND)

#: So many different breaches are kept; more nobody reads.
_MOST = 64

#: No value.
_NOTHING: Any = object()

#: So many rounds wait for a robot that tells nothing at all.
_WAITING = 5_000


class Breach(Struct, frozen=True):
    """A claim that did not hold, for some robots. Rounds count from 0; -1 is INIT."""

    claim: str  #: its kind and its name
    span: Span  #: where it stands
    robots: tuple[int, ...]
    round: int  #: the first time
    times: int = 1
    detail: str = ""

    @staticmethod
    def of(claim: WatchedClaim, robots: tuple[int, ...], round_: int, detail: str = "") -> Breach:
        """The breach of a claim in a round."""
        return Breach(named(claim), claim.span, robots, round_, detail=detail)

    @property
    def key(self) -> tuple[str, tuple[int, ...]]:
        """What tells breaches apart."""
        return self.claim, self.robots


class Breaches:
    """The breaches of a run, each once: with the first round, and how often there were."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, tuple[int, ...]], Breach] = {}

    def add(self, breach: Breach) -> None:
        """Note a breach."""
        before = self._found.get(breach.key)
        if before is not None:
            self._found[breach.key] = replace(before, times=before.times + breach.times)
        elif len(self._found) < _MOST:
            self._found[breach.key] = breach

    @property
    def all(self) -> tuple[Breach, ...]:
        """The breaches, in the order in which they were found."""
        return tuple(self._found.values())


def continued(before: Iterable[Breach], now: Iterable[Breach]) -> tuple[Breach, ...]:
    """The breaches that a robot found before it was started again, and since."""
    breaches = Breaches()
    for one in (*before, *now):
        breaches.add(one)
    return breaches.all


def joined(*found: Iterable[Breach]) -> tuple[Breach, ...]:
    """The breaches that several robots have found, which may be the same ones; oldest first."""
    breaches: dict[object, Breach] = {}
    for one in chain.from_iterable(found):
        other = breaches.get(one.key, one)
        first, times = min(one.round, other.round), max(one.times, other.times)
        breaches[one.key] = replace(one, round=first, times=times)
    return tuple(sorted(breaches.values(), key=lambda one: one.round))


# --- of one robot -------------------------------------------------------------------------------


class RobotMonitor:
    """The monitor of one deployed robot. ``breaches`` are what it has found."""

    def __init__(self, watched: Watched, robot: Robot, host: AnsweringHost, kinds: int) -> None:
        """Watch a robot of one of so many kinds; ``host`` answers what claims ask.

        The robot asks its own host through the monitor from now on.
        """
        self.breaches = Breaches()
        self._robot = robot
        self._round = 0
        self._kept: list[Any] = []  #: what robots shared when all of that was kept last
        claims, made, answers = watched.claims, watch_type(watched, host), KnownAnswers(host)
        watch, of_summaries = (made(robot.kinds, robot.delta, answers) for _ in range(2))
        self._contracts = ContractMonitor(watch, claims, kinds)
        self._states = StateMonitor(watch, filter(_is_of_store, claims), robot.kinds)
        self._unknown = [UnknownRobot()] * robot.numAgents
        self._summaries = SummaryMonitor(robot.host)
        self._summaries.check(of_summaries, claims, self._broken_summary)
        robot.host = self._summaries

    @property
    def has_contracts(self) -> bool:
        """True if the robot's modules have contracts."""
        return self._contracts.has_any(self._robot.KIND)

    @property
    def unknown(self) -> set[str]:
        """The claims that were never judged, as they asked for what nobody knows."""
        return self._contracts.unknown | self._states.unknown | self._summaries.unknown

    def evolved(self, held: Mapping[str, Any], round_: int) -> None:
        """Check the contracts after the environment's turn of a round; ``held``: before it."""
        robot = self._robot
        after = {name: vars(robot)[name] for name in robot.PORTS}
        for claim in self._contracts.broken(robot, held, after):
            self.breaches.add(Breach.of(claim, (robot.pid,), round_))

    def begun(self, round_: int, shared: Mapping[str, Any]) -> None:
        """Check what is about shared variables alone, when a round begins."""
        self._round = round_
        values = [*shared.values()]
        if len(values) == len(self._kept) and not any(map(is_not, values, self._kept)):
            return  # values never change (decision record 0012): what held of these holds of them
        self._states.see(self._unknown, shared)
        is_kept = True
        for claim, robots in self._states.broken(_STATES):
            self.breaches.add(Breach.of(claim, robots, round_))
            is_kept = False
        self._kept = values if is_kept else []

    def _broken_summary(self, claim: WatchedClaim, robot: int, values: str) -> None:
        self.breaches.add(Breach.of(claim, (robot,), self._round, values))


def _is_of_store(claim: WatchedClaim) -> bool:
    """Return whether a claim is about shared variables alone."""
    return claim.sort in _STATES and claim.looks is not None and not any(claim.looks.own)


def _of_several(watched: Watched) -> list[WatchedClaim]:
    """The claims that no robot can judge by itself."""
    return [one for one in watched.claims if one.sort in _STATES and not _is_of_store(one)]


# --- of all robots ------------------------------------------------------------------------------


class RobotState(Struct, frozen=True):
    """The state of a robot when a round begins, as plain values."""

    round: int
    own: Attributes  #: its variables and ports
    ran: int | None  #: the event of its last turn
    status: int
    shared: tuple[Plain, ...] | None  #: the store, of some robots in some rounds

    @staticmethod
    def of(robot: Robot, round_: int, store: AgreedStore, *, is_alone: bool = False) -> RobotState:
        """The present state of a robot. If it is not alone, robots tell of the store in turn."""
        is_next = is_alone or round_ % robot.numAgents == robot.pid
        shared = store.snapshot() if is_next else None
        own = own_values(robot, vars(robot))
        return RobotState(round_, own, robot.ran, robot.status.value, shared)

    def is_same(self, other: RobotState) -> bool:
        """Return whether the robot itself was in the same state."""
        is_so = (self.ran, self.status) == (other.ran, other.status)
        return is_so and self.own == other.own


class LastingState(Struct):
    """A state of a robot in which it itself was for so many ``rounds``, one after another."""

    state: RobotState
    rounds: int = 1

    def goes_on_with(self, state: RobotState) -> bool:
        """Count a state as one more round of this one; False if it is another one.

        One that tells of the store stands for itself.
        """
        first = self.state
        is_next = state.shared is None and state.round == first.round + self.rounds
        if not (is_next and state.is_same(first)):
            return False
        self.rounds += 1
        return True


class FleetMonitor:
    """The monitor of all robots, in the process that hears of them. (P-WATCH)

    It looks at invariants that no robot can judge by itself, when a round begins. Robots that tell
    nothing are unknown. ``seen`` hears of each round that was looked at; ``robots`` and ``store``
    are in its state then, those that are unknown in their last one.
    """

    def __init__(
        self,
        watched: Watched,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        delta_s: float,
        host: AnsweringHost,
    ) -> None:
        """Watch robots that are ``classes[kinds[pid]]``; ``host`` answers what claims ask."""
        self.breaches = Breaches()
        self.robots = [classes[kind](pid, kinds, delta_s, host) for pid, kind in enumerate(kinds)]
        self.store = AgreedStore(classes[0].SHARED, len(kinds))
        watch = watch_type(watched, host)(kinds, delta_s, KnownAnswers(host))
        self._states = StateMonitor(watch, _of_several(watched), kinds)
        self._told: dict[int, dict[int, RobotState]] = {}
        self._last = [INIT_ROUND] * len(kinds)  #: the round that each told of last
        self._own: list[Attributes] = [() for _ in kinds]  #: what robots told last
        self._shared: tuple[Plain, ...] | None = None
        self._held: list[RobotState | None] = []  #: in these states all claims held
        self.seen: Callable[[int], None] = _ignored

    @property
    def unknown(self) -> set[str]:
        """The claims that were never judged, as they asked for what nobody knows."""
        return self._states.unknown

    @staticmethod
    def claims_of(watched: Watched) -> set[str]:
        """The claims that no robot can judge by itself."""
        return set(map(named, _of_several(watched)))

    def hear(self, pid: int, state: RobotState, rounds: int = 1) -> None:
        """Take note of a robot's state when a round began, and so many ``rounds`` in all."""
        for round_ in range(state.round, state.round + rounds):
            self._told.setdefault(round_, {})[pid] = state
        self._last[pid] = state.round + rounds - 1

    def look(self, there: Iterable[int]) -> None:
        """Look at the rounds of which all robots have told that are ``there``, or of later ones."""
        last = [self._last[pid] for pid in there]
        known = min(last, default=max(self._told, default=0))
        rounds = sorted(self._told)
        for position, round_ in enumerate(rounds):
            if round_ <= known or len(rounds) - position > _WAITING:
                self._look(round_, self._told.pop(round_))

    def _look(self, round_: int, told: Mapping[int, RobotState]) -> None:
        stores = (one.shared for one in told.values() if one.round == round_)
        shared = next((one for one in stores if one is not None), None)
        if shared is None:
            return
        states = [told.get(pid) for pid in range(len(self.robots))]
        if shared != self._shared:
            self.store.restore(shared)
            self._shared = shared
        elif self._held and all(map(_is_same, states, self._held)):
            self.seen(round_)
            return
        robots = [self._at(pid, told.get(pid)) for pid in range(len(self.robots))]
        self._states.see(robots, self.store.values)
        is_held = True
        for claim, who in self._states.broken(_STATES):
            self.breaches.add(Breach.of(claim, who, round_))
            is_held = False
        self._held = states if is_held else []
        self.seen(round_)

    def _at(self, pid: int, state: RobotState | None) -> Robot | UnknownRobot:
        """A robot in the state that it told."""
        if state is None:
            return UnknownRobot()
        robot = self.robots[pid]
        own = own_shapes(robot)
        were = self._own[pid] or (_NOTHING,) * len(own)
        for (name, shape), value, was in zip(own.items(), state.own, were, strict=True):
            if value != was:  # what is as it was stays the same object, which is quick to judge
                vars(robot)[name] = from_plain(shape, value, robot.numAgents, unset=True)
        self._own[pid] = state.own
        robot.ran, robot.status = state.ran, Status(state.status)
        return robot


def _is_same(one: RobotState | None, other: RobotState | None) -> bool:
    """Return whether a robot is in the same state, as far as it has told."""
    if one is None or other is None:
        return one is other
    return one is other or one.is_same(other)


def _ignored(round_: int) -> None:
    """Ignore that a round was looked at: the default listener."""
