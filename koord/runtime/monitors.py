"""Monitors of a run's claims: what is looked at, for which robots, and what does not hold.

They are those of simulated and of deployed runs. Who has the monitor says when it looks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import chain, compress, product
from operator import is_not, itemgetter
from typing import Any, Protocol

from msgspec import Struct, field

from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import Watched, WatchedClaim, WatchedKind
from koord.runtime.operations import FaultError
from koord.runtime.robot import AnsweringHost, Forwarding, Host, Key, Robot, Turn
from koord.runtime.shapes import from_plain
from koord.runtime.watch import Watch

#: So many looks back it is known what has changed; a claim is looked at at least every other time.
_LOOKS = 4

#: The look of a claim of which nothing is known of what has changed since.
_NEVER = -_LOOKS

#: Of values, so much is shown.
_LONGEST = 120


class UnknownError(Exception):
    """Raised where a claim asks for what nobody knows: it is not judged then."""


class UnknownRobot:
    """A robot of which nothing is known: whatever is asked of it raises UnknownError."""

    def __getattribute__(self, name: str) -> Any:
        raise UnknownError


class KnownAnswers(Forwarding):
    """A host that raises UnknownError for functions that its own one does not answer."""

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        try:
            return self.host.ask(turn, robot, key, function, arguments)
        except LookupError:
            raise UnknownError from None


def watch_type(watched: Watched, host: AnsweringHost) -> type[Watch]:
    """The class that judges claims, whose questions a host answers from now on."""
    made = _watch_class(watched.text)
    host.also_answer(made)
    return made


@lru_cache(maxsize=8)
def _watch_class(text: str) -> type[Watch]:
    """The class of a text; runs that follow each other have the same one."""
    (made,) = loaded(text)
    assert issubclass(made, Watch)
    return made


def named(claim: WatchedClaim) -> str:
    """A claim as people are told of it: its kind and its name."""
    return f"{claim.sort.value} {claim.name}"


# --- claims about robots ------------------------------------------------------------------------


class _Stated(Struct):
    """A claim about robots, and the robots for which it is known not to hold."""

    claim: WatchedClaim
    name: str
    robots: tuple[Sequence[int], ...]
    broken: set[tuple[int, ...]] = field(default_factory=set)
    looked: int = _NEVER  #: when it was looked at last


class _Changes:
    """Changes of robots and shared variables between checks.

    Values of compiled programs never change (decision record 0012), so what is the same object as
    before is the same value.
    """

    def __init__(self, claims: Iterable[WatchedClaim]) -> None:
        known = {claim.method: claim.looks for claim in claims if claim.looks is not None}
        looks = known.values()
        self.own = sorted({name for one in looks for name in chain(*one.own)})
        #: The values of all names of a robot, as a tuple, whose first stands there twice: of a
        #: single name ``itemgetter`` makes no tuple.
        self._read = itemgetter(self.own[0], *self.own) if self.own else None
        self.entries = sorted({name for one in looks for name in chain(*one.entries)})
        self.shared = sorted({name for one in looks for name in one.shared})
        #: Of what a claim looks at, the names here: of what robots have, and of what they share.
        self._names = {
            method: (
                {*chain(*one.own), *(f"{entry}[]" for entry in chain(*one.entries))},
                {f"{name}." for name in one.shared},
            )
            for method, one in known.items()
        }
        self.look = 0
        self._last: dict[str, Sequence[Any]] = {}
        self._changed: dict[str, deque[set[int]]] = {}

    def note(self, held: Sequence[Mapping[str, Any]], values: Mapping[str, Any]) -> None:
        """Record the present values of robots and shared variables."""
        self.look += 1
        for name, column in zip(self.own, self._columns(held), strict=True):
            self._note(name, column)
        self._note_shared(values)

    def note_some(self, held: Mapping[int, Mapping[str, Any]], values: Mapping[str, Any]) -> None:
        """The same where all others have what they had before."""
        self.look += 1
        for name in self.own:
            column, changed = self._last[name], set[int]()
            assert isinstance(column, list)
            for pid, of_robot in held.items():
                value = of_robot.get(name)
                if value is not column[pid]:
                    column[pid] = value
                    changed.add(pid)
            self._changed[name].append(changed)
        self._note_shared(values)

    def _note_shared(self, values: Mapping[str, Any]) -> None:
        for name in self.entries:
            self._note(f"{name}[]", values[name])
        for name in self.shared:
            self._note(f"{name}.", (values[name],))

    def _columns(self, held: Sequence[Mapping[str, Any]]) -> list[list[Any]]:
        """The values of each name; None of robots that have none of it.

        Each robot is visited once: of thousands most of the time goes into fetching what they have.
        """
        if not self._read or not held:
            return [[] for _ in self.own]
        try:
            rows = [*map(self._read, held)]
            return [[row[k] for row in rows] for k in range(1, len(self.own) + 1)]
        except KeyError:
            return [[of_robot.get(name) for of_robot in held] for name in self.own]

    def _note(self, name: str, now: Sequence[Any]) -> None:
        last = self._last.get(name)
        if last is None:
            changed = set(range(len(now)))
        elif last is now:
            changed = set()
        else:
            changed = set(compress(range(len(now)), map(is_not, now, last)))
        self._last[name] = now
        self._changed.setdefault(name, deque(maxlen=_LOOKS)).append(changed)

    def since(self, look: int, claim: WatchedClaim) -> set[int] | None:
        """The robots whose reads of a claim changed since a check; None: it may be any."""
        count = self.look - look
        if count > _LOOKS or claim.looks is None:
            return None
        of_robots, of_all = self._names[claim.method]
        if count == 1:  # as it mostly is
            if any([self._changed[name][-1] for name in of_all]):
                return None
            return set[int]().union(*[self._changed[name][-1] for name in of_robots])
        for name in of_all:
            if any([*self._changed[name]][-count:]):
                return None
        found = set[int]()
        for name in of_robots:
            found.update(*[*self._changed[name]][-count:])
        return found


class Judge(Protocol):
    """Who says of claims, without them, of whom it is sure that they hold."""

    def unsure(self, method: str) -> Sequence[tuple[int, ...]] | None:
        """The robots of which it is not sure that a claim holds; None: it may be any."""
        ...

    def knows(self, method: str) -> bool:
        """Return whether it may be sure of a claim at all."""
        ...

    def is_sure(self, method: str) -> bool:
        """Return whether it is sure that a claim that it knows holds."""
        ...


class SomeClaims(Struct, frozen=True):
    """Some claims that a monitor looks at, and the methods that say whether they hold."""

    stated: list[_Stated]
    methods: list[str]


class StateMonitor:
    """A monitor of invariants and assumptions.

    ``looked`` counts the checks of each; ``unknown`` are those that were never judged, as they
    asked for what nobody knows.
    """

    def __init__(self, watch: Watch, claims: Iterable[WatchedClaim], kinds: Sequence[int]) -> None:
        """Monitor those of the claims that are about states."""
        self.watch = watch
        self.looked: dict[str, int] = {}
        self._judged: set[str] = set()
        self._unknown: set[str] = set()
        self._stated: dict[WatchedKind, list[_Stated]] = {sort: [] for sort in WatchedKind}
        chosen = []
        for claim in claims:
            if claim.sort not in (WatchedKind.CONTRACT, WatchedKind.SUMMARY):
                whose = tuple(_robots(kinds, agent) for agent in claim.agents)
                self._stated[claim.sort].append(_Stated(claim, named(claim), whose))
                chosen.append(claim)
        self._changes = _Changes(chosen)
        self._judge: Judge | None = None
        #: What is seen and not noted yet, as it may be that nobody asks what has changed.
        self._seen: Callable[[], None] | None = None
        self._is_noted = True  #: whether changes are those since the last look

    @property
    def unknown(self) -> set[str]:
        return self._unknown - self._judged

    def see(
        self,
        robots: Sequence[Robot | UnknownRobot],
        values: Mapping[str, Any],
        only: Iterable[int] | None = None,
        judge: Judge | None = None,
    ) -> None:
        """Take the present state: of the robots, and the values that they share.

        ``only`` are those whose variables may have changed since, if that is known. ``judge`` knows
        the same state.
        """
        self.watch.look(robots, values)
        self._judge = judge
        note = partial(self._note, robots, values, only if self._is_noted else None)
        if judge is None:
            note()
        else:
            self._seen, self._is_noted = note, False

    def of_sorts(self, sorts: Iterable[WatchedKind]) -> SomeClaims:
        """The claims of some sorts."""
        asked = [stated for sort in sorts for stated in self._stated[sort]]
        return SomeClaims(asked, [stated.claim.method for stated in asked])

    def is_sure(self, some: SomeClaims, judge: Judge) -> bool:
        """Return whether a judge is sure of some claims in its state.

        Then they have been looked at; else nothing has happened.
        """
        if not (all(map(judge.knows, some.methods)) and all(map(judge.is_sure, some.methods))):
            return False
        self.note_sure(some)
        return True

    def note_sure(self, some: SomeClaims, looks: int = 1) -> None:
        """Take note that some claims held for sure, when they were looked at so many times."""
        for stated in some.stated:
            self.looked[stated.name] = self.looked.get(stated.name, 0) + looks
            self._judged.add(stated.name)
            stated.looked = _NEVER
            stated.broken.clear()
        self._is_noted = False

    def _note(
        self,
        robots: Sequence[Robot | UnknownRobot],
        values: Mapping[str, Any],
        only: Iterable[int] | None,
    ) -> None:
        """Note what has changed since the last note."""
        self._seen, self._is_noted = None, True
        if only is not None and self._changes.look:
            self._changes.note_some({pid: vars(robots[pid]) for pid in only}, values)
            return
        try:
            held = [*map(vars, robots)]
        except UnknownError:
            held = [{} if _is_unknown(one) else vars(one) for one in robots]
        self._changes.note(held, values)

    def broken(
        self, sorts: Iterable[WatchedKind]
    ) -> Iterator[tuple[WatchedClaim, tuple[int, ...]]]:
        """Yield the claims of some sorts that do not hold in the state, each with its robots."""
        for sort in sorts:
            for stated in self._stated[sort]:
                name = stated.name
                self.looked[name] = self.looked.get(name, 0) + 1
                for robots in self._broken(stated):
                    yield stated.claim, robots

    def _broken(self, stated: _Stated) -> list[tuple[int, ...]]:
        """The robots for which a claim does not hold; none for a claim that holds for all.

        What nothing has changed of since it was last looked at is as it was.
        """
        claim, broken = stated.claim, stated.broken
        unsure = None if self._judge is None else self._judge.unsure(claim.method)
        if unsure is not None:
            stated.looked = _NEVER
            broken.clear()
            if not unsure:
                self._judged.add(stated.name)
                return []
            self._hold(stated, unsure)
            return sorted(broken)
        if self._seen is not None:
            self._seen()
        changed = self._changes.since(stated.looked, claim)
        stated.looked = self._changes.look
        self._hold(stated, _tuples(stated.robots, changed))
        return sorted(broken) if broken else []

    def _hold(self, stated: _Stated, several: Iterable[tuple[int, ...]]) -> None:
        """Look at a claim for some robots."""
        claim, broken = stated.claim, stated.broken
        holds, is_judged = getattr(self.watch, claim.method), False
        for robots in several:
            try:
                is_so = holds(*robots)
            except FaultError:  # [PROP-FAULT]
                is_so = False
            except UnknownError:
                self._unknown.add(stated.name)
                continue
            is_judged = True
            if not is_so:
                broken.add(robots)
            elif broken:
                broken.discard(robots)
        if is_judged:
            self._judged.add(stated.name)


def _is_unknown(one: object) -> bool:
    return type(one) is UnknownRobot


def _robots(kinds: Sequence[int], agent: int | None) -> Sequence[int]:
    if agent is None:
        return range(len(kinds))
    return [pid for pid, kind in enumerate(kinds) if kind == agent]


def _tuples(
    robots: tuple[Sequence[int], ...], changed: set[int] | None
) -> Iterator[tuple[int, ...]]:
    """The tuples of robots; only those with a changed robot, if the changes are known."""
    if changed is None or not robots:
        yield from product(*robots)
    elif len(robots) == 1:
        yield from zip(filter(changed.__contains__, robots[0]))
    elif len(robots) == 2:
        first, second = robots
        for one in first:
            if one in changed:
                yield from ((one, other) for other in second)
            else:
                yield from ((one, other) for other in second if other in changed)
    else:
        yield from (several for several in product(*robots) if not changed.isdisjoint(several))


# --- contracts ----------------------------------------------------------------------------------


class ContractMonitor:
    """A monitor of the contracts of robots' modules.

    ``looked`` counts the checks of each; ``unknown`` are those that asked for what nobody knows.
    """

    def __init__(self, watch: Watch, claims: Iterable[WatchedClaim], kinds: int) -> None:
        """Monitor those of the claims that are contracts, of so many kinds of robots."""
        self.watch = watch
        self.looked: dict[str, int] = {}
        self.unknown: set[str] = set()
        self._of_kind: list[list[tuple[str, WatchedClaim]]] = [[] for _ in range(kinds)]
        for claim in claims:
            if claim.sort is WatchedKind.CONTRACT:
                (kind,) = claim.agents
                assert kind is not None
                self._of_kind[kind].append((named(claim), claim))

    def has_any(self, kind: int) -> bool:
        """Return whether robots of a kind have contracts."""
        return bool(self._of_kind[kind])

    def broken(
        self, robot: Robot, held: Mapping[str, Any], after: Mapping[str, Any]
    ) -> Iterator[WatchedClaim]:
        """Yield the contracts that a robot's environment has not kept. [PROP-CONTRACT]

        ``held`` are the robot's variables and ports before its turn, ``after`` the ports after it.
        """
        self.watch.look_at(robot.pid, held, after)
        for name, claim in self._of_kind[robot.KIND]:
            self.looked[name] = self.looked.get(name, 0) + 1
            try:
                is_kept = self.watch.holds(claim.method)
            except UnknownError:
                self.unknown.add(name)
                continue
            if not is_kept:
                yield claim


# --- summaries ----------------------------------------------------------------------------------


class SummaryMonitor(Forwarding):
    """A host that checks every answer against the function's summary in the program. [EXTERNAL]

    ``looked`` counts the checks of each summary; ``unknown`` are those that asked for what nobody
    knows. It may stand between a program and its host from the beginning; :meth:`check` says
    against what.
    """

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.looked: dict[str, int] = {}
        self.unknown: set[str] = set()
        self._summaries: dict[str, WatchedClaim] = {}
        self._watch: Watch | None = None
        self._tell: Callable[[WatchedClaim, int, str], None] = _tell_nobody

    def check(
        self,
        watch: Watch,
        claims: Iterable[WatchedClaim],
        tell: Callable[[WatchedClaim, int, str], None],
    ) -> None:
        """Check all answers from now on; ``tell`` hears of a summary, a robot and the values."""
        self._watch, self._tell = watch, tell
        self._summaries = {c.function: c for c in claims if c.sort is WatchedKind.SUMMARY}

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        answer = self.host.ask(turn, robot, key, function, arguments)
        claim, watch = self._summaries.get(function), self._watch
        if claim is None or watch is None or not key:  # only the rules ask without a key
            return answer
        name = named(claim)
        self.looked[name] = self.looked.get(name, 0) + 1
        made = from_plain(watch.EXTERNALS[function], answer, watch.numAgents)
        watch.pid = robot
        try:
            is_met = watch.meets(claim.method, arguments, made)
        except UnknownError:
            self.unknown.add(name)
            return answer
        if not is_met:
            self._tell(claim, robot, f"of {_shown(arguments)}: {_shown(made)}")
        return answer


def _tell_nobody(claim: WatchedClaim, robot: int, values: str) -> None:
    """Tell nobody of a broken summary: the default listener."""


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
