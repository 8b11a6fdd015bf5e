"""Kinds of simulated robots, as configurations describe them."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct, field

from koord.runtime.motion.automaton import Visit
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.driving import Steering
from koord.runtime.motion.names import PlannerName
from koord.runtime.motion.planning import Effort
from koord.sim.disturbances import Disturbances


class Level(Enum):
    """How much of a vehicle is modelled. (paper, IV-A)"""

    SIMPLE = "simple"  #: a bicycle that meets nothing; a drone without attitude
    FULL = "full"  #: cars push and block each other; drones are rigid bodies
    FAST = "fast"  #: as ``full``, drones compiled by numba
    MUJOCO = "mujoco"  #: wheels, tyres, rotors, and contact of all with all, by MuJoCo


class Kind(Struct, frozen=True):
    """A device as a configuration describes it: robots of one kind make a squad."""

    body: Body
    planner: PlannerName
    level: Level = Level.FULL
    steering: Steering = Steering.PREDICTIVE
    visit: Visit = field(default_factory=Visit)
    disturbances: Disturbances = field(default_factory=Disturbances)
    effort: Effort = field(default_factory=Effort)
