"""The motion sensors of a robot, as its program reads them."""

from __future__ import annotations

from typing import NamedTuple

from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import PlannerName
from koord.runtime.motion.planning import Plight
from koord.runtime.motion.world import Point
from koord.runtime.plugins.calls import PlugIn


class MotionSensors(NamedTuple):
    """The readings of the motion sensors of a robot."""

    psn: Point
    heading_rad: float
    reached: bool
    planner: PlannerName | PlugIn
    state: MotionState
    plight: Plight | None = None  #: why it cannot do what it was told last
    short_m: float = 0.0  #: how far it is from where it would count as there
