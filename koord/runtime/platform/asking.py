"""Planners that programs ask, and vehicles that do not wait for them. (P-PLAN)"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.planning import Planner, Pose
from koord.runtime.motion.world import Point


class AskedPlanner:
    """A planner that thinks in a thread of its own, while who asked does what it has to."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._meanwhile: Callable[[], float] | None = None
        self._thread: ThreadPoolExecutor | None = None
        self._answer: Future[Floats | None] | None = None

    def wait_with(self, meanwhile: Callable[[], float]) -> None:
        """Let whoever waits do this, which returns after how many seconds it is due again."""
        self._meanwhile = meanwhile

    @property
    def is_busy(self) -> bool:
        """True while it thinks: it can be asked by one only."""
        return self._answer is not None and not self._answer.done()

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        """Plan a path. Raises what the planner raises, and what is done meanwhile."""
        if self._meanwhile is None:
            return self._planner.plan(start, goal, seed, avoid)
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, "planner")
        self._answer = self._thread.submit(self._planner.plan, start, goal, seed, avoid)
        while not self._answer.done():
            wait((self._answer,), timeout=self._meanwhile())
        return self._answer.result()
