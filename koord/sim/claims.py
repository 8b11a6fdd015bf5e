"""Monitors of a program's claims in a simulated run.

Invariants are looked at after the robots' events and at the end of each round. Contracts are about
the world as it is, at every tick: not only about what robots are told at the end of a round. All
claims have the slack of the scene (:mod:`koord.runtime.compile.slack`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile.watching import Watched, WatchedClaim, WatchedKind
from koord.runtime.monitors import ContractMonitor, StateMonitor, SummaryMonitor, named, watch_type
from koord.runtime.motion.world import Point
from koord.runtime.ports import DONE, PLACES, port_name
from koord.runtime.robot import Host, Robot
from koord.runtime.shapes import Shape
from koord.runtime.watch import Watch
from koord.sim.reading import placed_in
from koord.sim.running import BrokenClaim, Simulation, WatchPoint

#: What is looked at when.
_SORTS = {
    WatchPoint.BEGUN: (WatchedKind.ASSUMPTION, WatchedKind.INVARIANT, WatchedKind.AT_ROUND),
    WatchPoint.EVENTS: (WatchedKind.INVARIANT,),
    WatchPoint.ROUND: (WatchedKind.INVARIANT, WatchedKind.AT_ROUND),
    WatchPoint.RELOADED: (WatchedKind.INVARIANT, WatchedKind.AT_ROUND),
}

#: Of more robots than this, so many at each tick, in turn, are held against their contracts.
_MOST_AT_A_TICK = 200


class Watching:
    """A monitor of the claims of a run."""

    def __init__(self, watched: Watched, run: Simulation) -> None:
        classes, watch = run.cast.classes, watch_of(watched, run)
        self._watched = watched
        self._states = StateMonitor(watch, watched.claims, run.cast.kinds)
        self._asked = {moment: self._states.of_sorts(sorts) for moment, sorts in _SORTS.items()}
        self._contracts = ContractMonitor(watch, watched.claims, len(classes))
        self._measured = [list(_measured(one)) for one in classes]
        self._next = 0
        #: whether there are contracts, which the world has to keep at every tick
        self.glances = any(map(self._contracts.has_any, range(len(classes))))

    @property
    def looked(self) -> dict[str, int]:
        """The number of checks of each claim."""
        return self._states.looked | self._contracts.looked

    def look(self, moment: WatchPoint, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield the invariants that do not hold now.
        [PROP-INVARIANT] [PROP-ROUND]
        """
        engine = run.engine
        if engine.ended is not None:
            return
        # Between the environment's turn and this moment only events change variables of robots.
        only = run.acted if moment is WatchPoint.EVENTS else None
        judge = engine.judge(self._watched) if isinstance(engine, ColumnEngine) else None
        if judge is not None and self._states.is_sure(self._asked[moment], judge):
            return
        held = engine.robots if judge is None else engine.told_robots
        self._states.see(held, engine.store.values, only, judge)
        time_s = run.fleet.now_s
        for claim, robots in self._states.broken(_SORTS[moment]):
            place = _place(run, robots[0]) if robots else None
            yield BrokenClaim(
                named(claim), time_s, robots, place, f"at {claim.span}", claim.sort.value
            )

    def calls(self, run: Simulation) -> list[tuple[Callable[..., int], tuple[int, ...]]] | None:
        """The machine code of all that is looked at in a round; None if there is no such code."""
        engine = run.engine
        judge = engine.judge(self._watched) if isinstance(engine, ColumnEngine) else None
        methods = dict.fromkeys(
            method
            for moment in (WatchPoint.EVENTS, WatchPoint.ROUND)
            for method in self._asked[moment].methods
        )
        if judge is None or not all(map(judge.knows, methods)):
            return None
        return [call for method in methods for call in judge.calls(method)]

    def note_sure(self, rounds: int, idle: int) -> None:
        """Note that everything that is looked at in a round held in so many.

        What is looked at after events has been, but in the last ``idle`` of them.
        """
        for moment, looks in ((WatchPoint.EVENTS, idle), (WatchPoint.ROUND, rounds)):
            self._states.note_sure(self._asked[moment], looks)

    def glance(self, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield the contracts that the world does not keep now. [PROP-CONTRACT]"""
        if not self.glances:
            return
        fleet = run.fleet
        positions, reached = fleet.positions(), fleet.reached().tolist()
        places = positions.tolist()
        #: What sensors of positions say of each robot, by which shapes these are.
        seen: dict[int, Sequence[Any]] = {}
        for robot in self._in_turn(run.engine.robots):
            if not self._contracts.has_any(robot.KIND):
                continue
            held = vars(robot)
            after = {name: held[name] for name in robot.PORTS}
            for name, shape in self._measured[robot.KIND]:
                if shape is None:
                    after[name] = reached[robot.pid]
                    continue
                if id(shape) not in seen:
                    seen[id(shape)] = placed_in(shape, positions, robot.numAgents)
                after[name] = seen[id(shape)][robot.pid]
            for claim in self._contracts.broken(robot, held, after):
                who, where = (robot.pid,), f"at {claim.span}"
                place: Point = tuple(places[robot.pid])
                yield BrokenClaim(named(claim), fleet.now_s, who, place, where, "contract")

    def _in_turn(self, robots: Sequence[Robot]) -> Sequence[Robot]:
        """The robots whose contracts are checked now."""
        count = len(robots)
        if count <= _MOST_AT_A_TICK:
            return robots
        first = self._next
        self._next = (first + _MOST_AT_A_TICK) % count
        return [robots[(first + k) % count] for k in range(_MOST_AT_A_TICK)]


class Checked(SummaryMonitor):
    """The monitor of the summaries of a simulated run; :meth:`hold` says of which."""

    glances = False  # summaries are not checked between rounds

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self._broken: list[BrokenClaim] = []

    def hold(self, watched: Watched, run: Simulation) -> None:
        """Check all answers against the summaries of a program, before a run begins."""

        def tell(claim: WatchedClaim, robot: int, values: str) -> None:
            words = f"at {claim.span}, {values}"
            now_s = run.fleet.now_s
            broken = BrokenClaim(named(claim), now_s, (robot,), None, words, claim.sort.value)
            self._broken.append(broken)

        self.check(watch_of(watched, run), watched.claims, tell)

    def look(self, moment: WatchPoint, run: Simulation) -> Iterator[BrokenClaim]:
        """The summaries violated since the last call. [EXTERNAL]"""
        broken, self._broken = self._broken, []
        yield from broken

    def glance(self, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield nothing."""
        yield from ()


def watch_of(watched: Watched, run: Simulation) -> Watch:
    """Make the monitor of a run's claims; the run's host answers its queries."""
    made = watch_type(watched, run.host)
    return made(run.cast.kinds, run.scene.delta_s, run.claims_host)


def _measured(one: type[Robot]) -> Iterator[tuple[str, Shape | None]]:
    """The sensors of a robot for its position or for ``reached``, each with its shape."""
    for name in one.SENSORS:
        port = port_name(name)
        if port in PLACES:
            yield name, one.PORTS[name]
        elif port in DONE:
            yield name, None


def _place(run: Simulation, robot: int) -> Point:
    x, y, z = run.fleet.positions()[robot].tolist()
    return x, y, z
