"""Worlds and places that several tests use."""

from __future__ import annotations

import numpy as np

from koord.runtime.motion.field import Field
from koord.runtime.motion.world import Box, Disc, Point, Polygon, World

#: One obstacle of each kind, in the arena of the paper.
CLUTTERED = World(
    obstacles=(
        Disc((0.0, 0.0), 0.6),
        Box((1.0, 1.0, 0.0), (1.6, 3.0, 2.0)),
        Polygon(((-2.0, 1.0), (-1.0, 1.0), (-1.0, 2.5))),
    )
)
EMPTY = World()


def places(free: Field, count: int, seed: int, height_m: float, room_m: float) -> list[Point]:
    """Places with room around them."""
    draw = np.random.default_rng(seed)
    found: list[Point] = []
    while len(found) < count:
        x, y = draw.uniform(-3.3, 3.3, 2).tolist()
        if free.clearance(x, y, height_m) > room_m:
            found.append((x, y, height_m))
    return found
