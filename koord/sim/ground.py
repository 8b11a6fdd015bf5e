"""What all vehicles of a run share: they touch one another whatever devices they are of.

Each level that has contact has an engine for it. It is made when the first vehicle wants it.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from koord.runtime.motion.world import World

if TYPE_CHECKING:
    from koord.sim.vehicles.contact import Floor
    from koord.sim.vehicles.physics import Arena


class Ground:
    """The world as engines have it. Raises KoordError for one whose library is missing."""

    def __init__(self, world: World) -> None:
        self.world = world

    @cached_property
    def floor(self) -> Floor:
        """Of the cars of level ``full``."""
        from koord.sim.vehicles.contact import Floor

        return Floor(self.world)

    @cached_property
    def arena(self) -> Arena:
        """Of cars and drones of level ``mujoco``."""
        from koord.sim.vehicles.physics import Arena

        return Arena(self.world)
