"""The handshake before a run: who takes part, and which run this is. (R-JOIN) … (R-START)

A run has an identity that nobody can repeat: a digest of a nonce of each robot. Nothing here knows
of sockets, clocks or files. See specs/protocol/README.md.
"""

from __future__ import annotations

from enum import Enum
from hashlib import blake2b
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.encoding import encode
from koord.runtime.proposals import Flat
from koord.runtime.protocol.state import put

NONCE_BYTES = 16
RUN_BYTES = 16

#: The ``run`` of a robot that is in none.
NO_RUN = b""

#: What all robots of a run have in common, by name, as texts that can be shown.
Fingerprint = tuple[tuple[str, str], ...]


class Join(Flat, frozen=True):
    """Message: the sender is here. (R-JOIN)

    ``heard`` is the nonce in the leader's latest Join, ``run`` that of the sender's journal.
    """

    nonce: bytes
    heard: bytes
    run: bytes
    fingerprint: Fingerprint


class Roll(Flat, frozen=True):
    """Message: all robots are here, with these nonces. (R-ROLL)"""

    nonces: tuple[bytes, ...]


class Running(Flat, frozen=True):
    """Message: the answer to the Join with this nonce. (R-RUNNING)

    The sender is in ``run``, or in none. ``incarnation`` and ``start`` are what it knows of the
    robot that joins.
    """

    nonce: bytes
    run: bytes
    incarnation: int = 0
    start: int = 0


class RefusalReason(Enum):
    """The reasons for refusing a Join."""

    DIFFERS = "differs"  #: another fingerprint
    TWICE = "twice"  #: another process is heard that is this robot


class Refused(Flat, frozen=True):
    """Message: the Join with this nonce is refused. (R-NAME)"""

    nonce: bytes
    reason: RefusalReason
    fingerprint: Fingerprint = ()


HandshakeMessage = Join | Roll | Running | Refused


class Party(Struct, frozen=True):
    """One robot's part in a handshake: the fixed facts. ``nonce`` is drawn at each start."""

    pid: int
    robots: int
    leader: int
    nonce: bytes
    fingerprint: Fingerprint
    fleet_key: bytes
    insists: bool = False  #: on a new run (``--fresh``)
    encrypts: bool = False  #: what it says

    @property
    def is_leader(self) -> bool:
        return self.pid == self.leader

    @property
    def enough(self) -> int:
        """The number of robots in a run that make a late one believe in it. (R-LATE)"""
        return min(self.robots // 2 + 1, self.robots - 1)

    def identity(self, nonces: tuple[bytes, ...]) -> bytes:
        """The identity of the run of a roll. (R-ROLL)"""
        digest = blake2b(encode((self.fingerprint, nonces)), key=self.fleet_key[:64])
        return digest.digest()[:RUN_BYTES]


class Waiting(Struct, frozen=True):
    """The state of a robot that is in no run, or in that of its journal.

    ``nonces`` are those of the robots that answered the leader; ``told`` are the answers to this
    robot's own Join. ``gone`` are nonces that a later one of their robot has replaced.
    """

    run: bytes = NO_RUN
    heard: bytes = NO_RUN
    nonces: tuple[bytes | None, ...] = ()
    told: tuple[Running | None, ...] = ()
    gone: frozenset[bytes] = frozenset()


# --- outcomes -------------------------------------------------------------------------------------


class Say(Struct, frozen=True):
    """Outcome: send a message to one robot, or to all (None)."""

    to: int | None
    message: HandshakeMessage


class Enter(Struct, frozen=True):
    """Outcome: the robot is in a run from its beginning. (R-ROLL) (R-ENTER)"""

    run: bytes
    nonces: tuple[bytes, ...]


class EnterLate(Struct, frozen=True):
    """Outcome: the robot is in a run that is under way, and has no journal of it. (R-LATE)

    ``incarnation`` is the highest that the others know of it.
    """

    run: bytes
    incarnation: int
    start: int


class TurnedAway(Struct, frozen=True):
    """Outcome: the robot runs something else, or insists on a new run. (R-NAME) (R-LATE)"""

    by: int
    fingerprint: Fingerprint | None  #: theirs; None: there is a run to go on with


class Differs(Struct, frozen=True):
    """Outcome: another robot runs something else. (R-NAME)"""

    robot: int
    fingerprint: Fingerprint


class StartedTwice(Struct, frozen=True):
    """Outcome: two processes are one robot. (R-NAME)"""

    robot: int


class Higher(Struct, frozen=True):
    """Outcome: a start as high as this one has been heard. (R-START)"""

    start: int


class OutOfStep(Struct, frozen=True):
    """Outcome: another robot is in a run that this one is not in. (R-NAME)"""

    robot: int
    run: bytes


Outcome = Say | Enter | EnterLate | TurnedAway | Differs | StartedTwice | Higher | OutOfStep


def waiting(party: Party, run: bytes = NO_RUN) -> Waiting:
    """The state at the beginning. ``run`` is that of the journal."""
    nobody = (None,) * party.robots
    return Waiting(run, nonces=nobody, told=nobody)


def join(party: Party, state: Waiting) -> Join:
    """The Join to be said now. (R-JOIN)"""
    return Join(party.nonce, state.heard, state.run, party.fingerprint)


def receive(
    party: Party, state: Waiting, sender: int, message: HandshakeMessage
) -> tuple[Waiting, tuple[Outcome, ...]]:
    """Return the state after a message, and the outcomes in order. Pure."""
    if not 0 <= sender < party.robots:
        return state, ()
    match message:
        case Join():
            if sender != party.pid:
                return _on_join(party, state, sender, message)
            twin = message.nonce != party.nonce
            return state, (StartedTwice(sender),) if twin else ()
        case Roll(nonces=nonces):
            ours = len(nonces) == party.robots and nonces[party.pid] == party.nonce
            # Not of a leader that has started anew since.
            if state.run != NO_RUN or not ours or nonces[party.leader] != state.heard:
                return state, ()
            run = party.identity(nonces)
            return replace(state, run=run), (Enter(run, nonces),)
        case Running():
            if sender == party.pid or message.nonce != party.nonce:
                return state, ()
            return _on_running(party, state, sender, message)
        case Refused(nonce=nonce, reason=reason):
            if sender == party.pid or nonce != party.nonce:
                return state, ()
            if reason is RefusalReason.TWICE:
                return state, (StartedTwice(party.pid),)
            return state, (TurnedAway(sender, message.fingerprint),)
        case _:
            assert_never(message)


def _on_join(
    party: Party, state: Waiting, sender: int, message: Join
) -> tuple[Waiting, tuple[Outcome, ...]]:
    answers: tuple[Outcome, ...] = ()
    before, state = state, followed(party, state, sender, message)
    if state.heard != before.heard:
        answers = (Say(sender, join(party, state)),)
    is_fresh = party.is_leader and message.heard == party.nonce
    if message.fingerprint != party.fingerprint:
        outcomes: tuple[Outcome, ...] = (Differs(sender, message.fingerprint), *answers)
        if is_fresh:
            refused = Refused(message.nonce, RefusalReason.DIFFERS, party.fingerprint)
            outcomes = (*outcomes, Say(sender, refused))
        return state, outcomes
    if message.run not in (NO_RUN, state.run):
        # It goes on with the run of its journal, and has to know who is not in it.
        answered = Say(sender, Running(message.nonce, state.run))
        return state, (answered, OutOfStep(sender, message.run)) if is_fresh else (answered,)
    if is_fresh and state.run == NO_RUN:
        return _gathered(party, state, sender, message.nonce)
    return state, answers


def followed(party: Party, state: Waiting, sender: int, message: Join) -> Waiting:
    """The state after a Join: own Joins show from now on that the leader's start was heard.

    (R-JOIN)
    """
    if sender == party.leader and message.run == NO_RUN:
        return replace(state, heard=message.nonce)
    return state


def _gathered(
    party: Party, state: Waiting, sender: int, nonce: bytes
) -> tuple[Waiting, tuple[Outcome, ...]]:
    """Gather a Join, and make the roll if it was the last. (R-ROLL)"""
    outcomes: tuple[Outcome, ...] = ()
    before = state.nonces[sender]
    if nonce in state.gone:
        outcomes = (StartedTwice(sender),)
    elif before not in (None, nonce):
        assert before is not None
        state = replace(state, gone=state.gone | {before})
    state = replace(state, nonces=put(state.nonces, sender, nonce))
    done, roll = call_the_roll(party, state)
    return done, (*outcomes, *roll)


def call_the_roll(party: Party, state: Waiting) -> tuple[Waiting, tuple[Outcome, ...]]:
    """Make the roll of a run, if all robots are here. (R-ROLL)

    It is said to the others once the leader itself has noted that it is in the run.
    """
    if not party.is_leader or state.run != NO_RUN:
        return state, ()
    there = put(state.nonces, party.pid, party.nonce)
    nonces = tuple(nonce for nonce in there if nonce is not None)
    if len(nonces) < party.robots:
        return state, ()
    run = party.identity(nonces)
    return replace(state, run=run), (Enter(run, nonces),)


def _on_running(
    party: Party, state: Waiting, sender: int, message: Running
) -> tuple[Waiting, tuple[Outcome, ...]]:
    """Learn of a run that is under way. (R-LATE)"""
    state = replace(state, told=put(state.told, sender, message))
    if message.run == NO_RUN:
        return state, (OutOfStep(sender, NO_RUN),)
    if message.run == state.run:
        return state, (Higher(message.start),)
    said = [one for one in state.told if one is not None and one.run == message.run]
    if len(said) < party.enough:
        return state, (OutOfStep(sender, message.run),)
    if party.insists:
        return state, (TurnedAway(sender, None),)
    incarnation = max(one.incarnation for one in said)
    late = EnterLate(message.run, incarnation, max(one.start for one in said))
    return replace(state, run=message.run), (late,)


# --- in a run -------------------------------------------------------------------------------------


class Known(Struct, frozen=True):
    """What a robot in a run knows of another. (R-RUNNING)"""

    incarnation: int
    start: int
    is_heard: bool  #: in this run, since the Join's start was first heard


def answer(
    party: Party, run: bytes, nonces: tuple[bytes, ...], sender: int, message: Join, known: Known
) -> tuple[Outcome, ...]:
    """Answer the Join of a robot, as one that is in a run. (R-RUNNING) (R-NAME)"""
    if message.fingerprint != party.fingerprint:
        refused = Refused(message.nonce, RefusalReason.DIFFERS, party.fingerprint)
        return (Differs(sender, message.fingerprint), Say(sender, refused))
    if nonces and nonces[sender] == message.nonce:
        leads = nonces[party.leader]
        roll = Say(sender, Roll(nonces))
        if not party.is_leader or message.heard == leads:
            return (roll,)
        # It has heard another leader since, perhaps one of an earlier run, and would drop the roll.
        again = Join(leads, b"", NO_RUN, party.fingerprint)
        return (Say(sender, again), roll)
    if known.is_heard and message.run != run:
        twice = Refused(message.nonce, RefusalReason.TWICE)
        return (StartedTwice(sender), Say(sender, twice))
    running = Running(message.nonce, run, known.incarnation, known.start)
    return (Say(sender, running),)


def differing(mine: Fingerprint, theirs: Fingerprint) -> tuple[str, ...]:
    """What differs between two fingerprints, for people to read."""
    here, there = dict(mine), dict(theirs)
    names = [name for name in {**here, **there} if here.get(name) != there.get(name)]
    if any(name.startswith("param ") for name in names):
        names = [name for name in names if name != "program"]  # it follows from the param
    return tuple(
        f"{name}: {here.get(name, 'none')} here, {there.get(name, 'none')} there" for name in names
    )
