"""Ideal points, which are at their reference: the same at every level."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.flying import Flying
from koord.runtime.motion.planning import Touched
from koord.sim.squads import STEP_S, STEPS, Seed, SquadSetup, upright


def squad(setup: SquadSetup) -> PointSquad:
    """Make a squad of points at rest."""
    return PointSquad(setup)


class PointSquad:
    """A squad of points, which pass through everything."""

    def __init__(self, setup: SquadSetup) -> None:
        self.group, self.vehicles = setup.group, self
        self.flying = Flying(setup.group, setup.start, waits=False)
        self._heading: Floats = setup.heading_rad.copy()

    def tick(self, now_s: float) -> None:
        position = self.flying.rest
        self.group.plan(position, self._heading, now_s)
        self.group.update(position, now_s)
        velocity = self.flying.command(position, STEPS * STEP_S).velocity
        moving = (velocity[:, 0] != 0) | (velocity[:, 1] != 0)
        course = np.arctan2(velocity[:, 1], velocity[:, 0])
        self._heading = np.where(moving, course, self._heading)

    def put(self, position: Floats) -> None:
        """Place the points, shape ``(n, 3)``."""
        self.flying.rest = position.copy()

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self.truth()

    def truth(self) -> tuple[Floats, Floats]:
        return self.flying.rest, self._heading

    def attitude(self) -> Floats:
        return upright(self._heading)

    def reseed(self, noise: Sequence[Seed], wind: Sequence[Seed]) -> None:
        """Nothing disturbs points."""

    def touched(self, number: int) -> tuple[Touched, ...]:
        return ()
