"""Staged runs: a recorded run replayed in the world, with robots placed as recorded."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from koord.runtime.engine import Schedule
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import IdealBody, PlannerName
from koord.runtime.motion.clearance import Clearance
from koord.runtime.motion.world import Point, World
from koord.runtime.proposals import Decision
from koord.runtime.robot import Host
from koord.sim.fleet import Fleet, Placed
from koord.sim.running import Cast, Ending, Simulation
from koord.sim.scene import POINT_SLACK_M, Scene
from koord.sim.squads import DeviceModel

#: Around all places that robots come to, so much of the world is shown.
_MARGIN_M = 1.0


class Staged(Simulation):
    """A run in which robots are placed from round to round, and do not move by themselves.

    ``places[k]`` are those before round k, shape ``(n, 3)``; the last are those at the end.
    ``turned`` is told which round is open. A run that is ``cut`` ends before the environment's turn
    of its last round.
    """

    def __init__(
        self,
        cast: Cast,
        places: Sequence[Sequence[Point]],
        delta_s: float,
        schedule: Schedule,
        heard: Callable[[Host], Host],
        turned: Callable[[int], None],
        *,
        cut: bool,
    ) -> None:
        super().__init__(cast, _scene(places, delta_s), schedule, keep_going=True, heard=heard)
        self.claims_host = self.engine.host
        self._places: list[Floats] = [np.array(one, dtype=np.float64) for one in places]
        self._turned, self._cut = turned, cut

    @property
    def goes_on(self) -> bool:
        return not (self._cut and self._is_last)

    @property
    def _is_last(self) -> bool:
        return self.engine.round >= len(self._places) - 2

    def begin(self) -> Decision:
        decision = super().begin()
        if len(self._places) == 1:
            self.end(Ending.PLAYED)
        return decision

    def round(self) -> Decision:
        self._turned(self.engine.round)
        is_last = self._is_last
        decision = super().round()
        if is_last and self.ending is None:
            self.end(Ending.PLAYED)
        return decision

    def tick(self, fleet: Fleet) -> None:
        """Observe a tick without checking claims: positions between rounds are not recorded."""
        near = self.gauge.tick(fleet.now_s, fleet.positions())
        self.observer.tick(fleet, near.distance_m if near is not None else math.nan)

    def pass_time(self) -> None:
        number = self.engine.round
        last = len(self._places) - 1
        before, after = self._places[min(number, last)], self._places[min(number + 1, last)]
        until_s = (number + 1) * self.scene.delta_s
        since_s = self.fleet.now_s

        def move(share: float) -> Floats:
            return before + share * (after - before)

        self.fleet.stage(until_s, lambda t: move((t - since_s) / (until_s - since_s)), self.tick)


def _scene(places: Sequence[Sequence[Point]], delta_s: float) -> Scene:
    """An empty world, as large as needed, with point robots."""
    every = np.array([point for one in places for point in one])
    low, high = every.min(0) - _MARGIN_M, every.max(0) + _MARGIN_M
    (x0, y0, z0), (x1, y1, z1) = low.tolist(), high.tolist()
    ground = min(0.0, z0 + _MARGIN_M)
    model = DeviceModel(IdealBody(), PlannerName.STRAIGHT)
    count = len(places[0])
    return Scene(
        World((x0, y0, ground), (x1, y1, max(z1, ground + 1.0))),
        tuple(Placed(model, start) for start in places[0]),
        ("point",) * count,
        (None,) * count,
        {},
        Clearance(safety_m=0.0),
        POINT_SLACK_M,
        delta_s,
        0,
    )
