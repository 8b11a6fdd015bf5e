"""From states of the explored machine to structures of the model.

In each state of an explorer all that was ever said is known. That, and what robots acted on, is the
state of the model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import combinations
from typing import Any, NamedTuple

from koord.refinement.protocol_proof.logic import Sort
from koord.refinement.protocol_proof.model import CONSTANTS
from koord.refinement.protocol_proof.structures import Element, Structure
from koord.runtime.exploration.world import Explorer, Parcel, ProtocolState
from koord.runtime.protocol.messages import (
    COMMITTED,
    FIRST_INCARNATION,
    GENESIS,
    Acknowledge,
    Candidacy,
    Decide,
    LogEntry,
    Open,
    Position,
    Vote,
    digest,
)


class Life(NamedTuple):
    """An incarnation of a robot."""

    robot: int
    incarnation: int


class Said(NamedTuple):
    """What was said in a state, as far as the model speaks of it; histories are digests."""

    decides: frozenset[tuple[Life, int, bytes]]
    acknowledged: frozenset[tuple[Life, int, bytes]]
    stood: frozenset[tuple[Life, int, Position]]
    voted: frozenset[tuple[Life, int, Life]]
    opened: frozenset[tuple[Life, int, bytes]]
    acted: tuple[bytes, ...]  #: the entries first committed by anybody, in their order
    committed: frozenset[bytes]


class History(NamedTuple):
    """What a history is: its length, the one before, its last entry, and the roster after it."""

    round: int
    parent: bytes | None
    entry: LogEntry | None
    roster: tuple[int, ...]


class Abstraction:
    """The map from states of an explorer to structures of the model."""

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self._setup = explorer.setup
        first = next(explorer.states(explorer.initial()))
        self._root = first.chain
        self._histories = {first.chain: History(first.round - 1, None, None, first.roster)}
        self._facts: list[tuple[object, ...] | None] = []  #: by the number of the message
        self._telling = 0  #: the bits of the messages that are facts
        self._said: dict[tuple[int, int, frozenset[bytes]], Said] = {}

    @property
    def constants(self) -> tuple[Element, ...]:
        """The values of the model's constants."""
        values = {"root": self._root, "zero": 0, "ever": COMMITTED}
        return tuple(values[one.name] for one in CONSTANTS)

    def said(self, world: ProtocolState) -> Said:
        """What was said in a state of the machine, and what robots acted on."""
        for parcel in self._explorer.parcels[len(self._facts) :]:
            self._facts.append(self._fact(parcel))
            if self._facts[-1] is not None:
                self._telling |= 1 << (len(self._facts) - 1)
        sent = world.sent & self._telling
        chains = self._chains(world)
        key = (sent, world.acted, chains)
        if key not in self._said:
            self._said[key] = self._gathered(sent, world, chains)
        return self._said[key]

    def _chains(self, world: ProtocolState) -> frozenset[bytes]:
        """What robots have committed, by what they know and by their disks."""
        locals_ = [self._explorer.locals[local] for local in world.locals]
        disks = {one.disk.chain for one in locals_}
        states = {one.state.chain for one in locals_ if one.state is not None}
        return frozenset(disks | states) - {GENESIS}

    def _gathered(self, sent: int, world: ProtocolState, chains: frozenset[bytes]) -> Said:
        facts: dict[type, set[Any]] = {
            kind: set() for kind in (Decide, Acknowledge, Candidacy, Vote, Open)
        }
        for parcel in self._explorer.these(sent):
            facts[type(parcel.message)].add(self._fact(parcel))
        acted = tuple(one.digest for one in self._explorer.acted(world))
        at = acted.index(self._root) + 1 if self._root in acted else 0
        return Said(
            decides=frozenset(facts[Decide]),
            acknowledged=frozenset(facts[Acknowledge]),
            stood=frozenset(facts[Candidacy]),
            voted=frozenset(facts[Vote]),
            opened=frozenset(facts[Open]),
            acted=acted[at:],
            committed=frozenset((*chains, *acted[at:], self._root)),
        )

    def _fact(self, parcel: Parcel) -> tuple[object, ...] | None:
        life = Life(parcel.sender, parcel.incarnation)
        match parcel.message:
            case Decide(epoch=epoch, entry=entry):
                return life, epoch, self._learn(entry)
            case Acknowledge(epoch=epoch, digest=mark):
                return life, epoch, mark
            case Candidacy(epoch=epoch, position=position):
                return life, epoch, position
            case Vote(epoch=epoch, candidate=candidate):
                return life, epoch, Life(parcel.to, candidate)
            case Open(epoch=epoch, chain=chain):
                return life, epoch, chain
            case _:
                return None

    def _learn(self, entry: LogEntry) -> bytes:
        """The digest of a history that ends with an entry."""
        mark = digest(entry)
        if mark not in self._histories and entry.previous in self._histories:
            roster = list(self._histories[entry.previous].roster)
            for admission in entry.admitted:
                roster[admission.robot] = admission.incarnation
            self._histories[mark] = History(entry.round, entry.previous, entry, tuple(roster))
        return mark

    # --- to the model -----------------------------------------------------------------------------

    def structure(self, said: Said, largest: Said) -> Structure:
        """The model's state, with the elements of a state that is as large or larger."""
        histories = (self._root, *sorted({mark for _, _, mark in largest.decides}))
        epochs = (*range(2 + max((one[1] for one in _of_epochs(largest)), default=0)), COMMITTED)
        fixed = self._fixed(histories, epochs)
        domains = fixed.domains
        return Structure(domains, {**fixed.relations, **self._state(said, fixed)})

    @cache  # noqa: B019  (there are few, and as many as states of one exploration)
    def _fixed(self, histories: tuple[bytes, ...], epochs: tuple[int, ...]) -> Structure:
        """What does not change: histories, rosters, and majorities."""
        known = {mark: self._histories[mark] for mark in histories}
        setup = self._setup
        rosters = {
            mark: [Life(robot, one) for robot, one in enumerate(history.roster)]
            for mark, history in known.items()
        }
        lives = sorted({life for roster in rosters.values() for life in roster} | self._lives())
        quorums = sorted(
            {one for roster in rosters.values() for one in combinations(roster, setup.majority)}
        )
        majority = {
            (one, mark) for mark in known for one in quorums if set(one) <= {*rosters[mark]}
        }
        enough = set()
        for mark, history in known.items():
            if history.parent is None or history.entry is None:
                continue
            admitted = {admission.robot for admission in history.entry.admitted}
            enough |= {
                (one, mark)
                for one in quorums
                if (one, history.parent) in majority and not admitted & {life.robot for life in one}
            }
        prefixes = {(one, mark) for mark in known for one in self._up(mark)}
        return Structure(
            {
                Sort.LIFE.value: lives,
                Sort.EPOCH.value: epochs,
                Sort.HISTORY.value: histories,
                Sort.QUORUM.value: quorums,
            },
            {
                "earlier": {(one, two) for one in epochs for two in epochs if one < two},
                "prefix": prefixes,
                "no_longer": {
                    (one, two)
                    for one in known
                    for two in known
                    if known[one].round <= known[two].round
                },
                "parent": {(one.parent, mark) for mark, one in known.items() if one.parent},
                "among": {(life, one) for one in quorums for life in one},
                "on_roster": {(mark, life) for mark in known for life in rosters[mark]},
                "majority": majority,
                "enough": enough,
                "same_robot": {
                    (one, two) for one in lives for two in lives if one.robot == two.robot
                },
                "owns": {
                    (life, epoch)
                    for life in lives
                    for epoch in epochs
                    if epoch != COMMITTED and setup.coordinator(epoch) == life.robot
                },
                "lawful": {(mark,) for mark, one in known.items() if self._is_lawful(one)},
            },
        )

    def _lives(self) -> set[Life]:
        """All incarnations of the explorer so far."""
        states = (one.state for one in self._explorer.locals)
        return {Life(one.pid, one.incarnation) for one in states if one is not None}

    def _up(self, mark: bytes) -> Iterator[bytes]:
        """A history and its prefixes."""
        at: bytes | None = mark
        while at is not None:
            yield at
            at = self._histories[at].parent

    def _is_lawful(self, history: History) -> bool:
        """Return whether R-DECIDE makes this entry of what robots propose. (I-VALID)"""
        entry = history.entry
        if entry is None:
            return False
        propose = self._explorer.propose
        proposals = [
            None if robot in entry.late else propose(robot, entry.round)
            for robot in range(self._setup.robots)
        ]
        return self._setup.decide(entry.round, proposals) == entry.decision

    def _state(self, said: Said, fixed: Structure) -> Mapping[str, set[tuple[Element, ...]]]:
        epochs = fixed.domains[Sort.EPOCH.value]
        first = Life(self._setup.coordinator(0), FIRST_INCARNATION)
        candidates = {(life, epoch, self._com(at, said)) for life, epoch, at in said.stood}
        candidates.add((first, 0, self._root))
        voted = said.voted | {(life, epoch, life) for life, epoch, _ in said.stood}
        acknowledged = said.acknowledged | said.decides
        offices = set(self._offices(said, candidates)) | {(first, 0, *[self._root] * 3)}
        return {
            "decides": {*said.decides},
            "decided": {(epoch, mark) for _, epoch, mark in said.decides},
            "acknowledged": {*acknowledged},
            "candidate": candidates,
            "reached": {
                (life, epoch, mark, x)
                for life, epoch, at in said.stood
                for mark in fixed.domains[Sort.HISTORY.value]
                for x in epochs
                if Position(self._histories[mark].round, x) <= at
            },
            "voted": {*voted},
            "left": {(one[0], x) for one in (*voted, *acknowledged) for x in epochs if x < one[1]},
            "office": offices,
            "base": {(epoch, held, com) for _, epoch, held, com, _ in offices},
            "seated": {(life, epoch) for life, epoch, *_ in offices},
            "taken": {(epoch,) for _, epoch, *_ in offices},
            "chosen": set(_chosen(acknowledged, fixed)),
            "committed": {(mark,) for mark in said.committed},
        }

    def _com(self, at: Position, said: Said) -> bytes:
        """What a robot in a position had committed."""
        if at.epoch != COMMITTED:
            for _, epoch, mark in said.decides:
                parent = self._histories[mark].parent
                if (epoch, self._histories[mark].round) == (at.epoch, at.round) and parent:
                    return parent
        ways = (self._root, *said.acted)
        return next((one for one in ways if self._histories[one].round == at.round), self._root)

    def _offices(
        self, said: Said, candidates: Iterable[tuple[Life, int, bytes]]
    ) -> Iterator[tuple[Element, ...]]:
        """Who took office, by what it said there first: an Open, or a Decide of what it held."""
        for life, epoch in {(one[0], one[1]) for one in (*said.opened, *said.decides)}:
            opened = self._shortest(one[2] for one in said.opened if one[:2] == (life, epoch))
            decided = self._shortest(one[2] for one in said.decides if one[:2] == (life, epoch))
            stood = self._shortest(one[2] for one in candidates if one[:2] == (life, epoch))
            if epoch == 0 or stood is None:
                continue
            if opened is not None and (decided is None or self._is_before(opened, decided)):
                yield life, epoch, opened, opened, stood
            elif decided is not None:
                yield life, epoch, decided, self._histories[decided].parent, stood

    def _is_before(self, one: bytes, two: bytes) -> bool:
        return self._histories[one].round < self._histories[two].round

    def _shortest(self, histories: Iterable[bytes]) -> bytes | None:
        return min(histories, key=lambda mark: self._histories[mark].round, default=None)


def _of_epochs(said: Said) -> Iterator[tuple[Life, int, object]]:
    for facts in (said.decides, said.acknowledged, said.stood, said.voted, said.opened):
        yield from facts


def _chosen(
    acknowledged: Iterable[tuple[Life, int, bytes]], fixed: Structure
) -> Iterator[tuple[int, bytes]]:
    by: dict[tuple[int, bytes], set[Life]] = {}
    for life, epoch, mark in acknowledged:
        by.setdefault((epoch, mark), set()).add(life)
    for (epoch, mark), lives in by.items():
        if any(set(one) <= lives for one, of in fixed.relations["enough"] if of == mark):
            yield epoch, mark
