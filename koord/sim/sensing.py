"""What the robots of a fleet know of themselves, as columns; rows are robots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import PlannerName
from koord.runtime.motion.planning import Plight
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.plugins.calls import PlugIn

#: By number; to look one up here is quicker than to make it.
_STATES = tuple(MotionState)


class FleetSensors(Struct, frozen=True, dict=True):
    """The motion sensors of a fleet at one time; those of a robot are made when somebody asks.

    The arrays are nobody else's, so that what was sensed stays as it was.
    """

    position: Floats  #: in metres, shape ``(n, 3)``
    heading_rad: Floats
    reached: Bools
    state: Ints  #: of the motion automaton, by number
    short_m: Floats  #: how far each is from where it would count as there
    planners: Sequence[PlannerName | PlugIn]
    plights: Mapping[int, Plight]  #: of the robots that have one

    @classmethod
    def of(cls, rows: Sequence[MotionSensors]) -> FleetSensors:
        """The columns of sensors that are known robot by robot."""
        return cls(
            np.array([row.psn for row in rows], np.float64).reshape(-1, 3),
            np.array([row.heading_rad for row in rows], np.float64),
            np.array([row.reached for row in rows], np.bool_),
            np.array([row.state for row in rows], np.int64),
            np.array([row.short_m for row in rows], np.float64),
            tuple(row.planner for row in rows),
            {robot: row.plight for robot, row in enumerate(rows) if row.plight is not None},
        )

    def __len__(self) -> int:
        return len(self.planners)

    def __getitem__(self, robot: int) -> MotionSensors:
        x, y, z = self.position[robot].tolist()
        return MotionSensors(
            (x, y, z),
            float(self.heading_rad[robot]),
            bool(self.reached[robot]),
            self.planners[robot],
            _STATES[self.state[robot]],
            self.plights.get(robot),
            float(self.short_m[robot]),
        )

    def __iter__(self) -> Iterator[MotionSensors]:
        return map(self.__getitem__, range(len(self)))

    @cached_property
    def on_the_way(self) -> Bools:
        """A mask of the robots that move, or plan how to."""
        found: Bools = (self.state == MotionState.MOVING) | (self.state == MotionState.PLANNING)
        return found
