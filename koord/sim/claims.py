"""Monitors of a program's claims in a simulated run.

Invariants are looked at after the robots' events and at the end of each round. Contracts are about
the world as it is, at every tick: not only about what robots are told at the end of a round. All
claims have the slack of the scene (:mod:`koord.runtime.compile.slack`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, compress, product
from operator import is_not
from typing import Any

from msgspec import Struct, field

from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import Watched, WatchedClaim, WatchedKind
from koord.runtime.motion.world import Point
from koord.runtime.operations import FaultError
from koord.runtime.ports import DONE, PLACES, placed, port_name
from koord.runtime.robot import Forwarding, Host, Key, Robot, Turn
from koord.runtime.shapes import Shape, from_plain
from koord.runtime.watch import Watch
from koord.sim.running import BrokenClaim, Simulation, WatchPoint

#: What is looked at when.
_SORTS = {
    WatchPoint.BEGUN: (WatchedKind.ASSUMPTION, WatchedKind.INVARIANT, WatchedKind.AT_ROUND),
    WatchPoint.EVENTS: (WatchedKind.INVARIANT,),
    WatchPoint.ROUND: (WatchedKind.INVARIANT, WatchedKind.AT_ROUND),
}


#: So many looks back it is known what has changed; a claim is looked at at least every other time.
_LOOKS = 4

#: Of more robots than this, so many at each tick, in turn, are held against their contracts.
_MOST_AT_A_TICK = 200


class _Stated(Struct):
    """A claim about robots, and the robots for which it is known not to hold."""

    claim: WatchedClaim
    robots: tuple[Sequence[int], ...]
    broken: set[tuple[int, ...]] = field(default_factory=set)
    looked: int = -1  #: when it was looked at last


class _Changes:
    """Changes of robots and shared variables between checks.

    Values of compiled programs never change (decision record 0012), so what is the same object as
    before is the same value.
    """

    def __init__(self, claims: Iterable[WatchedClaim]) -> None:
        known = {claim.method: claim.looks for claim in claims if claim.looks is not None}
        looks = known.values()
        self.own = sorted({name for one in looks for name in chain(*one.own)})
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

    def note(self, robots: Sequence[Robot], values: Mapping[str, Any]) -> None:
        """Record the present values of robots and shared variables."""
        self.look += 1
        held = [vars(robot) for robot in robots]
        for name in self.own:
            self._note(name, [of_robot.get(name) for of_robot in held])
        for name in self.entries:
            self._note(f"{name}[]", values[name])
        for name in self.shared:
            self._note(f"{name}.", (values[name],))

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
        for name in of_all:
            if any([*self._changed[name]][-count:]):
                return None
        found = set[int]()
        for name in of_robots:
            found.update(*[*self._changed[name]][-count:])
        return found


class Watching:
    """A monitor of the claims of a run. ``looked`` counts the checks of each claim."""

    def __init__(self, watched: Watched, run: Simulation) -> None:
        kinds = run.cast.kinds
        self.watch = watch_of(watched, run)
        self.looked: dict[str, int] = {}
        self._names = {claim.method: _named(claim) for claim in watched.claims}
        self._changes = _Changes(watched.claims)
        self._measured = [list(_measured(one)) for one in run.cast.classes]
        self._next = 0
        self._stated: dict[WatchedKind, list[_Stated]] = {sort: [] for sort in WatchedKind}
        self._contracts: list[list[WatchedClaim]] = [[] for _ in run.cast.classes]
        for claim in watched.claims:
            if claim.sort is WatchedKind.CONTRACT:
                (kind,) = claim.agents
                assert kind is not None
                self._contracts[kind].append(claim)
            elif claim.sort is not WatchedKind.SUMMARY:
                whose = tuple(_robots(kinds, agent) for agent in claim.agents)
                self._stated[claim.sort].append(_Stated(claim, whose))

    def look(self, moment: WatchPoint, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield the invariants that do not hold now.
        [PROP-INVARIANT] [PROP-ROUND]
        """
        engine = run.engine
        if engine.ended is not None:
            return
        self.watch.look(engine.robots, engine.store.values)
        self._changes.note(engine.robots, engine.store.values)
        time_s = run.fleet.now_s
        for sort in _SORTS[moment]:
            for stated in self._stated[sort]:
                claim = stated.claim
                self._count(claim)
                for robots in self._broken(stated):
                    place = _place(run, robots[0]) if robots else None
                    yield BrokenClaim(
                        _named(claim), time_s, robots, place, f"at {claim.span}", sort.value
                    )

    def glance(self, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield the contracts that the world does not keep now. [PROP-CONTRACT]"""
        if not any(self._contracts):
            return
        fleet = run.fleet
        positions, reached = fleet.positions().tolist(), fleet.reached().tolist()
        for robot in self._in_turn(run.engine.robots):
            contracts = self._contracts[robot.KIND]
            if not contracts:
                continue
            x, y, z = positions[robot.pid]
            held = vars(robot)
            after = {name: held[name] for name in robot.PORTS}
            for name, shape in self._measured[robot.KIND]:
                if shape is None:
                    after[name] = reached[robot.pid]
                else:
                    after[name] = from_plain(shape, placed(shape, (x, y, z)), robot.numAgents)
            self.watch.look_at(robot, after)
            for claim in contracts:
                self._count(claim)
                if not self.watch.holds(claim.method):
                    who = (robot.pid,)
                    where = f"at {claim.span}"
                    yield BrokenClaim(_named(claim), fleet.now_s, who, (x, y, z), where, "contract")

    # --- inside ---------------------------------------------------------------------------------

    def _in_turn(self, robots: Sequence[Robot]) -> Sequence[Robot]:
        """The robots whose contracts are checked now."""
        count = len(robots)
        if count <= _MOST_AT_A_TICK:
            return robots
        first = self._next
        self._next = (first + _MOST_AT_A_TICK) % count
        return [robots[(first + k) % count] for k in range(_MOST_AT_A_TICK)]

    def _count(self, claim: WatchedClaim) -> None:
        name = self._names[claim.method]
        self.looked[name] = self.looked.get(name, 0) + 1

    def _broken(self, stated: _Stated) -> list[tuple[int, ...]]:
        """The robots for which a claim does not hold; none for a claim that holds for all.

        What nothing has changed of since it was last looked at is as it was.
        """
        claim, broken = stated.claim, stated.broken
        changed = self._changes.since(stated.looked, claim)
        stated.looked = self._changes.look
        holds = getattr(self.watch, claim.method)
        for robots in _tuples(stated.robots, changed):
            try:
                is_so = holds(*robots)
            except FaultError:  # [PROP-FAULT]
                is_so = False
            if not is_so:
                broken.add(robots)
            elif broken:
                broken.discard(robots)
        return sorted(broken) if broken else []


class Checked(Forwarding):
    """A host that checks every answer against the function's summary in the program.

    It may stand between a program and its host from the beginning; :meth:`hold` says against what.
    """

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.looked: dict[str, int] = {}
        self._summaries: dict[str, WatchedClaim] = {}
        self._watch: Watch | None = None
        self._broken: list[BrokenClaim] = []
        self._now_s: Callable[[], float] = lambda: 0.0

    def hold(self, watched: Watched, run: Simulation) -> None:
        """Check all answers against the summaries of a program, before a run begins."""
        self._watch = watch_of(watched, run)
        self._summaries = {c.function: c for c in watched.claims if c.sort is WatchedKind.SUMMARY}
        self._now_s = lambda: run.fleet.now_s

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        answer = self.host.ask(turn, robot, key, function, arguments)
        claim, watch = self._summaries.get(function), self._watch
        if claim is None or watch is None or not key:  # only the rules ask without a key
            return answer
        name = _named(claim)
        self.looked[name] = self.looked.get(name, 0) + 1
        made = from_plain(watch.EXTERNALS[function], answer, watch.numAgents)
        watch.pid = robot
        if not watch.meets(claim.method, arguments, made):
            told = f"at {claim.span}, of {_shown(arguments)}: {_shown(made)}"
            self._broken.append(
                BrokenClaim(name, self._now_s(), (robot,), None, told, WatchedKind.SUMMARY.value)
            )
        return answer

    def look(self, moment: WatchPoint, run: Simulation) -> Iterator[BrokenClaim]:
        """The summaries violated since the last call. [EXTERNAL]"""
        broken, self._broken = self._broken, []
        yield from broken

    def glance(self, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield nothing: summaries are not checked between rounds."""
        yield from ()


def watch_of(watched: Watched, run: Simulation) -> Watch:
    """Make the monitor of a run's claims; the run's host answers its queries."""
    (made,) = loaded(watched.text)
    assert issubclass(made, Watch)
    run.host.watches = (*run.host.watches, made)
    return made(run.cast.kinds, run.scene.delta_s, run.claims_host)


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 120 else f"{text[:117]}..."


def _measured(one: type[Robot]) -> Iterator[tuple[str, Shape | None]]:
    """The sensors of a robot for its position or for ``reached``, each with its shape."""
    for name in one.SENSORS:
        port = port_name(name)
        if port in PLACES:
            yield name, one.PORTS[name]
        elif port in DONE:
            yield name, None


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
        yield from ((one,) for one in robots[0] if one in changed)
    elif len(robots) == 2:
        first, second = robots
        for one in first:
            if one in changed:
                yield from ((one, other) for other in second)
            else:
                yield from ((one, other) for other in second if other in changed)
    else:
        yield from (several for several in product(*robots) if not changed.isdisjoint(several))


def _named(claim: WatchedClaim) -> str:
    return f"{claim.sort.value} {claim.name}"


def _place(run: Simulation, robot: int) -> Point:
    x, y, z = run.fleet.positions()[robot].tolist()
    return x, y, z
