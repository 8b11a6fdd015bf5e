"""Exploration of handshakes: robots that start, crash and start again, and all old datagrams.

The network is the set of what was ever said, in all runs: so a datagram of an earlier run, or of an
earlier start, may arrive at any time. The machine is that of ``koord.runtime.protocol.handshake``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.exploration.claims import BrokenInvariant, InvariantViolation
from koord.runtime.protocol.handshake import (
    NO_RUN,
    NONCE_BYTES,
    Enter,
    EnterLate,
    Fingerprint,
    HandshakeMessage,
    Join,
    Known,
    Outcome,
    Party,
    Roll,
    Running,
    Say,
    TurnedAway,
    Waiting,
    answer,
    call_the_roll,
    join,
    receive,
    waiting,
)
from koord.runtime.protocol.state import put

_KEY = b"the key of an exploration"


class HandshakeBounds(Struct, frozen=True):
    """The bounds of an exploration. Within them it is exhaustive."""

    robots: int = 2
    starts: int = 4  #: of all robots together, the first ones included
    other: bool = False  #: the last robot may be started with another program
    states: int = 200_000  #: give up after so many


class Life(Struct, frozen=True):
    """A robot from a start to its crash. ``start`` counts those of all robots."""

    start: int
    state: Waiting
    fingerprint: Fingerprint
    roll: tuple[bytes, ...] = ()  #: of its run, if it was there at its beginning


class Parcel(Struct, frozen=True):
    """A message, as one robot may get it."""

    sender: int
    to: int
    message: HandshakeMessage


class Handshakes(Struct, frozen=True):
    """A global state: lives (None: down), disks, everything ever said, and what was entered.

    ``disks`` are the runs in journals, with their rolls; ``old`` are those of earlier journals.
    ``entered`` says which start of which robot has entered which run from its beginning.
    """

    lives: tuple[Life | None, ...]
    disks: tuple[tuple[bytes, tuple[bytes, ...]], ...]
    old: tuple[tuple[bytes, tuple[bytes, ...]], ...]
    said: frozenset[Parcel] = frozenset()
    starts: int = 0
    entered: frozenset[tuple[bytes, int, int]] = frozenset()


class HandshakesExplored(Struct, frozen=True):
    """The result: counts, and the first violation, with what led to it."""

    states: int
    transitions: int
    depth: int
    complete: bool
    runs: int  #: different ones that were entered
    late: int  #: ways in which a robot came late
    violation: InvariantViolation | None = None


def nonce_of(start: int) -> bytes:
    """The nonce of a start: nobody draws one twice."""
    return start.to_bytes(NONCE_BYTES, "big")


class HandshakeExplorer:
    """A breadth-first search through all interleavings."""

    def __init__(self, bounds: HandshakeBounds) -> None:
        self.bounds = bounds
        self._runs: set[bytes] = set()
        self._late = 0
        self._transitions = 0

    def run(self) -> HandshakesExplored:
        """Explore until an invariant is broken, or all is seen. (I-ONE-RUN) (I-FRESH)"""
        robots = self.bounds.robots
        nothing: tuple[tuple[bytes, tuple[bytes, ...]], ...] = ((NO_RUN, ()),) * robots
        first = Handshakes((None,) * robots, nothing, nothing)
        came: dict[Handshakes, tuple[Handshakes, str] | None] = {first: None}
        queue, depth = deque([(first, 0)]), 0
        violation: InvariantViolation | None = None
        while queue and violation is None and len(came) <= self.bounds.states:
            at, depth = queue.popleft()
            for story, after, broken in self._steps(at):
                self._transitions += 1
                if broken is not None:
                    violation = InvariantViolation(broken, (*_way(came, at), story))
                    break
                if after not in came:
                    came[after] = (at, story)
                    queue.append((after, depth + 1))
        return HandshakesExplored(
            len(came),
            self._transitions,
            depth,
            not queue and violation is None,
            len(self._runs),
            self._late,
            violation,
        )

    # --- transitions ----------------------------------------------------------------------------

    def _steps(self, at: Handshakes) -> Iterator[tuple[str, Handshakes, BrokenInvariant | None]]:
        for robot, life in enumerate(at.lives):
            if life is None:
                if at.starts < self.bounds.starts:
                    yield from self._starts(at, robot)
                continue
            yield f"{robot} crashes", replace(at, lives=put(at.lives, robot, None)), None
            yield (f"{robot} says Join", *self._joined(at, robot, life))
            for parcel in at.said:
                if parcel.to == robot:
                    story = f"{robot} gets from {parcel.sender}: {parcel.message}"
                    yield (story, *self._received(at, robot, life, parcel))

    def _starts(
        self, at: Handshakes, robot: int
    ) -> Iterator[tuple[str, Handshakes, BrokenInvariant | None]]:
        """Yield the ways to switch a robot on: with its disk, an old one, or none."""
        disks = {at.disks[robot]: "its disk", at.old[robot]: "an old disk", (NO_RUN, ()): "no disk"}
        last = robot == self.bounds.robots - 1
        programs = ("one", "another") if self.bounds.other and last else ("one",)
        for disk, name in disks.items():
            for program in programs:
                start = at.starts + 1
                prints: Fingerprint = (("program", program),)
                state = waiting(self._party(robot, start, prints), disk[0])
                life = Life(start, state, prints, disk[1])
                lives = put(at.lives, robot, life)
                disks_ = put(at.disks, robot, disk)
                after = replace(at, lives=lives, disks=disks_, starts=start)
                yield f"{robot} is switched on with {name}, running {program}", after, None

    def _joined(
        self, at: Handshakes, robot: int, life: Life
    ) -> tuple[Handshakes, BrokenInvariant | None]:
        party = self._party(robot, life.start, life.fingerprint)
        state, outcomes = call_the_roll(party, life.state)
        said: tuple[Outcome, ...] = (Say(None, join(party, life.state)),)
        return self._after(at, robot, replace(life, state=state), (*said, *outcomes))

    def _received(
        self, at: Handshakes, robot: int, life: Life, parcel: Parcel
    ) -> tuple[Handshakes, BrokenInvariant | None]:
        party = self._party(robot, life.start, life.fingerprint)
        message = parcel.message
        if life.state.run != NO_RUN and isinstance(message, Join):
            known = Known(0, 0, is_heard=False)
            outcomes = answer(party, life.state.run, life.roll, parcel.sender, message, known)
            return self._after(at, robot, life, outcomes)
        state, outcomes = receive(party, life.state, parcel.sender, message)
        return self._after(at, robot, replace(life, state=state), outcomes)

    def _after(
        self, at: Handshakes, robot: int, life: Life, outcomes: tuple[Outcome, ...]
    ) -> tuple[Handshakes, BrokenInvariant | None]:
        """The state after a step; what a robot enters it notes at once."""
        broken: BrokenInvariant | None = None
        said = set(at.said)
        after = at
        for outcome in outcomes:
            match outcome:
                case Say(to=to, message=message):
                    said |= self._parcels(robot, to, message)
                case Enter(run=run, nonces=nonces):
                    broken = next(iter(self._wrong(after, robot, life, run, nonces)), None)
                    self._runs.add(run)
                    life = replace(life, roll=nonces)
                    after = self._noted(after, robot, (run, nonces))
                    entered = after.entered | {(run, robot, life.start)}
                    after = replace(after, entered=entered)
                    if robot == 0:
                        said |= self._parcels(robot, None, Roll(nonces))
                case EnterLate(run=run):
                    broken = next(iter(self._wrongly_late(after, robot, run)), None)
                    self._late += 1
                    life = replace(life, roll=())
                    after = self._noted(after, robot, (run, ()))
                case TurnedAway():
                    lives = put(at.lives, robot, None)
                    return replace(after, lives=lives, said=frozenset(said)), broken
        lives = put(after.lives, robot, life)
        return replace(after, lives=lives, said=frozenset(said)), broken

    def _noted(
        self, at: Handshakes, robot: int, disk: tuple[bytes, tuple[bytes, ...]]
    ) -> Handshakes:
        old = put(at.old, robot, at.disks[robot])
        return replace(at, disks=put(at.disks, robot, disk), old=old)

    def _parcels(self, sender: int, to: int | None, message: HandshakeMessage) -> set[Parcel]:
        whom = range(self.bounds.robots) if to is None else (to,)
        return {Parcel(sender, one, message) for one in whom if one != sender}

    def _party(self, robot: int, start: int, fingerprint: Fingerprint) -> Party:
        return Party(robot, self.bounds.robots, 0, nonce_of(start), fingerprint, _KEY)

    # --- invariants -----------------------------------------------------------------------------

    def _wrong(
        self, at: Handshakes, robot: int, life: Life, run: bytes, nonces: tuple[bytes, ...]
    ) -> Iterable[BrokenInvariant]:
        """Yield what is wrong with entering a run from its beginning. (I-ONE-RUN) (I-FRESH)"""
        if nonces[robot] != nonce_of(life.start):
            yield BrokenInvariant("I-FRESH", f"{robot} enters a run for which it drew no nonce")
        again = [one for one in at.entered if one[:2] == (run, robot)]
        if again:
            yield BrokenInvariant("I-ONE-RUN", f"{robot} enters {run.hex()} twice")
        for other, nonce in enumerate(nonces):
            if other == 0:
                continue
            heard = any(
                parcel.sender == other
                and isinstance(join_ := parcel.message, Join)
                and (join_.nonce, join_.heard) == (nonce, nonces[0])
                and join_.fingerprint == life.fingerprint
                and join_.run == NO_RUN
                for parcel in at.said
            )
            if not heard:
                story = f"{other} is on the roll, and did not answer the leader's start"
                yield BrokenInvariant("I-FRESH", story)
        if robot != 0 and not any(one[:2] == (run, 0) for one in at.entered):
            yield BrokenInvariant("I-ONE-RUN", f"{robot} enters a run that its leader is not in")

    def _wrongly_late(self, at: Handshakes, robot: int, run: bytes) -> Iterable[BrokenInvariant]:
        """Yield what is wrong with coming late to a run. (I-ONE-RUN)"""
        tellers = {
            parcel.sender
            for parcel in at.said
            if parcel.to == robot and isinstance(parcel.message, Running)
            if parcel.message.run == run
        }
        there = {one[1] for one in at.entered if one[0] == run}
        enough = min(self.bounds.robots // 2 + 1, self.bounds.robots - 1)
        if len(tellers) < enough or not there:
            yield BrokenInvariant("I-ONE-RUN", f"{robot} comes late to a run that there is not")


def _way(
    came: Mapping[Handshakes, tuple[Handshakes, str] | None], at: Handshakes
) -> tuple[str, ...]:
    """The steps that lead to a state."""
    lines = []
    while (before := came[at]) is not None:
        at, story = before
        lines.append(story)
    return tuple(reversed(lines))
