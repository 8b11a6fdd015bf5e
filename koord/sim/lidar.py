"""A planar lidar scanner: the end points of its beams in a world."""

from __future__ import annotations

from typing import assert_never

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.world import Box, Disc, Point, Polygon, World


class Lidar(Struct, frozen=True):
    """The parameters of a scanner: number of beams, range and noise in metres."""

    beams: int = 180
    range_m: float = 4.0
    noise_m: float = 0.0


class Scanner:
    """A scanner in a world: the edges of obstacles at its height, and the walls around."""

    def __init__(self, lidar: Lidar, world: World, height_m: float) -> None:
        self.lidar = lidar
        (x0, y0, _), (x1, y1, _) = world.low, world.high
        rings = [((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
        discs: list[tuple[float, float, float]] = []
        for obstacle in world.obstacles:
            if not obstacle.low_z <= height_m <= obstacle.high_z:
                continue
            match obstacle:
                case Disc(centre=(x, y), radius_m=radius):
                    discs.append((x, y, radius))
                case Box(corners=corners) | Polygon(corners=corners):
                    rings.append(corners)  # type: ignore[arg-type]
                case _:
                    assert_never(obstacle)
        self._starts: Floats = np.concatenate([np.array(ring) for ring in rings])
        ends = [np.roll(np.array(ring), -1, axis=0) for ring in rings]
        self._along: Floats = np.concatenate(ends) - self._starts
        self._discs: Floats = np.array(discs).reshape(-1, 3)
        turn = 2 * np.pi * np.arange(lidar.beams) / lidar.beams
        self._beams: Floats = np.column_stack([np.cos(turn), np.sin(turn)])

    def scan(
        self, position: Point, heading_rad: float, draw: np.random.Generator | None = None
    ) -> tuple[Point, ...]:
        """Scan: the scanner's position, then each beam's end point; the first beam points ahead.

        Beams that meet nothing end at the scanner's range.
        """
        here = np.array(position[:2])
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        beams = self._beams @ np.array([[cos, sin], [-sin, cos]])
        reach = np.minimum(self._edges(here, beams), self._rounds(here, beams))
        if self.lidar.noise_m > 0 and draw is not None:
            noise = self.lidar.noise_m * draw.standard_normal(len(reach))
            reach = np.where(reach < self.lidar.range_m, np.maximum(reach + noise, 0.0), reach)
        reach = np.minimum(reach, self.lidar.range_m)
        ends = here + reach[:, None] * beams
        z = position[2]
        return position, *((x, y, z) for x, y in ends.tolist())

    def _edges(self, here: Floats, beams: Floats) -> Floats:
        """The lengths of beams up to the first edge that they cross, in metres."""
        gap = self._starts - here
        cross = beams[:, :1] * self._along[:, 1] - beams[:, 1:] * self._along[:, 0]
        level = np.abs(cross) < 1e-12
        safe = np.where(level, 1.0, cross)
        far = (gap[:, 0] * self._along[:, 1] - gap[:, 1] * self._along[:, 0]) / safe
        where = (gap[:, 0] * beams[:, 1:] - gap[:, 1] * beams[:, :1]) / safe
        meets = ~level & (far >= 0) & (where >= 0) & (where <= 1)
        found: Floats = np.where(meets, far, np.inf).min(1)
        return found

    def _rounds(self, here: Floats, beams: Floats) -> Floats:
        """The lengths of beams up to the first disc that they meet, in metres."""
        gap = self._discs[:, :2] - here
        along = beams @ gap.T
        inside = self._discs[:, 2] ** 2 - (gap**2).sum(1) + along**2
        far = along - np.sqrt(np.maximum(inside, 0.0))
        meets = (inside >= 0) & (far >= 0)
        found: Floats = np.where(meets, far, np.inf).min(1, initial=np.inf)
        return found
