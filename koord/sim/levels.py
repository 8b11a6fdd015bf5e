"""How nearly a claim is broken in a simulated run, watched round by round."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import assert_never

from koord.runtime.compile.levels import Both, Difference, Level, LevelCode, OfRobots, Truth
from koord.runtime.operations import FaultError
from koord.sim.claims import watch_of
from koord.sim.running import BrokenClaim, Simulation, WatchPoint
from koord.sim.separation import nearest


class LevelMonitor:
    """A monitor that breaks nothing: ``highest`` is the highest level so far, −∞ before any.

    It looks where invariants are looked at: after INIT, after the robots' events, and at the end of
    a round. What is no number is no level.
    """

    glances = False

    def __init__(self, gauge: Callable[[Simulation], float]) -> None:
        self.highest, self._gauge = -math.inf, gauge

    @property
    def looked(self) -> dict[str, int]:
        return {}

    def look(self, moment: WatchPoint, run: Simulation) -> Iterator[BrokenClaim]:
        """Look at the level; nothing is broken by it."""
        if run.engine.ended is None:
            level = self._gauge(run)
            if level > self.highest:
                self.highest = level
        yield from ()

    def glance(self, run: Simulation) -> Iterator[BrokenClaim]:
        """Yield nothing."""
        yield from ()


def closeness(run: Simulation) -> float:
    """By how many metres the two nearest robots are nearer than is safe; mostly less than 0."""
    found = nearest(run.fleet.positions())
    return -math.inf if found is None else run.scene.safety_m - found.distance_m


class ClaimGauge:
    """The level of an invariant in a run."""

    def __init__(self, code: LevelCode, run: Simulation) -> None:
        self._level, kinds = code.level, run.cast.kinds
        self._watch = watch_of(code.watched, run)
        self._of_agent: dict[int | None, list[int]] = {None: [*range(len(kinds))]}
        for robot, kind in enumerate(kinds):
            self._of_agent.setdefault(kind, []).append(robot)

    def __call__(self, run: Simulation) -> float:
        self._watch.look(run.engine.robots, run.engine.store.values)
        return self._of(self._level, ())

    def _of(self, level: Level, robots: tuple[int, ...]) -> float:
        """A level, for these robots. What faults is far from it: it brings no break near."""
        match level:
            case Difference(method=method):
                try:
                    return float(getattr(self._watch, method)(*robots))
                except FaultError:
                    return -math.inf
            case Truth(method=method, negated=negated):
                try:
                    holds = bool(getattr(self._watch, method)(*robots))
                except FaultError:
                    return -math.inf
                return -math.inf if holds is not negated else math.inf
            case Both(parts=parts, greatest=greatest):
                # The first decides where it is infinite, as it guards the second.
                first = self._of(parts[0], robots)
                if first == (math.inf if greatest else -math.inf):
                    return first
                second = self._of(parts[1], robots)
                return max(first, second) if greatest else min(first, second)
            case OfRobots(agent=agent, body=body, greatest=greatest):
                each = (self._of(body, (*robots, one)) for one in self._of_agent.get(agent, ()))
                if greatest:
                    return max(each, default=-math.inf)
                return min(each, default=math.inf)
            case _:
                assert_never(level)
