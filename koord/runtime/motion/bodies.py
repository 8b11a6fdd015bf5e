"""Vehicles as data: their types, sizes and limits.

``VEHICLES`` is the one table of them: configurations, planners, simulations and pages ask it, or a
body that it has. Sources of the numbers: specs/decisions/0015. No number here needs a library, so
a configuration can be read without any.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import ClassVar, Protocol

from msgspec import Struct
from msgspec.structs import replace


class PlannerName(Enum):
    """The planners' names in configurations. (paper, III-D and VI-C)"""

    STRAIGHT = "STRAIGHT"
    RRT_CAR = "RRT_CAR"
    RRT_STAR_CAR = "RRT_STAR_CAR"
    RRT_DUB_CAR = "RRT_DUB_CAR"  #: forwards alone (Dubins, 1957)
    RRT_DRONE = "RRT_DRONE"
    RRT_STAR_DRONE = "RRT_STAR_DRONE"
    RRT_DIFF = "RRT_DIFF"
    RRT_STAR_DIFF = "RRT_STAR_DIFF"

    @property
    def optimal(self) -> bool:
        """True if the planner goes on improving a path that it has found."""
        return "STAR" in self.value


class Level(Enum):
    """The level of detail in the simulation of a vehicle. (paper, IV-A)"""

    SIMPLE = "simple"  #: kinematics with limits, in contact with nothing; a drone without attitude
    FULL = "full"  #: what drives on the ground pushes and blocks; drones are rigid bodies
    FAST = "fast"  #: as ``full``, and drones by machine code or not at all
    MUJOCO = "mujoco"  #: wheels, tyres, rotors, and contact of all with all, by MuJoCo


class Steering(Enum):
    """The controllers of cars, by the names that configurations give them."""

    PREDICTIVE = "MPC"
    PURSUIT = "PURSUIT"


class Pace(Struct, frozen=True):
    """The speed profile of a vehicle along paths, and the angle at which these are cut."""

    cruise_mps: float
    accel_mps2: float
    lateral_mps2: float  #: greatest acceleration towards the side, in bends
    cusp_rad: float = (
        math.inf
    )  #: where a path's direction changes by more, it stops and turns about
    reverses: bool = False  #: whether it drives legs forwards and backwards in turn


class Look(Struct, frozen=True):
    """The appearance of a vehicle."""

    name: str  #: of its drawing in ``sim/page/glyphs.js``; of what has none, a disc is drawn
    is_box: bool = False  #: a box in other tools, else a cylinder
    flies: bool = False
    tilts: bool = False  #: as it moves


class Body(Protocol):
    """The interface of vehicles. All numbers are about the position that programs see."""

    LOOK: ClassVar[Look]
    ON_GROUND: ClassVar[bool]  #: it never leaves the ground
    IS_EXACT: ClassVar[bool]  #: it is exactly where it is to be

    @property
    def radius_m(self) -> float:
        """The radius of the disc about the position that covers the vehicle, in metres."""
        ...

    @property
    def inner_radius_m(self) -> float:
        """The radius of a disc that the vehicle covers, at any heading, in metres."""
        ...

    @property
    def outline_m(self) -> tuple[float, float, float]:
        """Length, width, and the distance from the position forward to the middle, in metres."""
        ...

    @property
    def turning_m(self) -> float:
        """The radius in metres of the tightest turn; 0: it can set out in any direction."""
        ...

    @property
    def above_ground_m(self) -> float:
        """The least height in metres above the ground of goals for flying robots."""
        ...

    @property
    def pace(self) -> Pace:
        """The speed profile along paths."""
        ...

    def cruising(self, speed_mps: float) -> Body:
        """The same vehicle, with another cruising speed."""
        ...


class Car(Struct, frozen=True):
    """A car of the size of the F1/10 and RACECAR platforms (paper, VI-A).

    Its position is the middle of its rear axle, as in those platforms: that point goes where the
    car points, so a path of positions says where the car points as well.
    """

    LOOK: ClassVar[Look] = Look("car", is_box=True)
    ON_GROUND: ClassVar[bool] = True
    IS_EXACT: ClassVar[bool] = False

    length_m: float = 0.58
    width_m: float = 0.31
    wheelbase_m: float = 0.33
    mass_kg: float = 3.5
    steering_rad: float = 0.4189  #: the furthest that the wheels turn, to either side
    steering_rate_radps: float = 3.2
    speed_mps: float = 2.0  #: the fastest it can go, either way
    accel_mps2: float = 2.5
    cruise_mps: float = 0.8
    cruise_accel_mps2: float = 1.2
    above_ground_m: ClassVar[float] = 0.0

    @property
    def middle_m(self) -> float:
        """The distance in metres from the position forward to the middle of the car."""
        return self.wheelbase_m / 2

    @property
    def turning_m(self) -> float:
        return self.wheelbase_m / math.tan(self.steering_rad)

    @property
    def radius_m(self) -> float:
        return math.hypot(self.length_m / 2 + self.middle_m, self.width_m / 2)

    @property
    def inner_radius_m(self) -> float:
        return self.width_m / 2

    @property
    def outline_m(self) -> tuple[float, float, float]:
        return self.length_m, self.width_m, self.middle_m

    @property
    def pace(self) -> Pace:
        return Pace(self.cruise_mps, self.cruise_accel_mps2, 2.0, math.radians(110), reverses=True)

    def cruising(self, speed_mps: float) -> Car:
        fastest = max(self.speed_mps, 1.5 * speed_mps)
        return replace(self, cruise_mps=speed_mps, speed_mps=fastest)


class RoundBody(Struct, frozen=True):
    """A vehicle that is a disc from above, at any heading."""

    radius_m: float

    @property
    def inner_radius_m(self) -> float:
        return self.radius_m

    @property
    def outline_m(self) -> tuple[float, float, float]:
        return 2 * self.radius_m, 2 * self.radius_m, 0.0


class DifferentialDrive(RoundBody, frozen=True):
    """A round robot on two driven wheels side by side, of the size of a Kobuki (TurtleBot 2).

    Its position is the middle of its axle, about which it turns on the spot.
    """

    LOOK: ClassVar[Look] = Look("rover")
    ON_GROUND: ClassVar[bool] = True
    IS_EXACT: ClassVar[bool] = False

    radius_m: float = 0.176
    track_m: float = 0.23  #: from the middle of a wheel to that of the other
    mass_kg: float = 2.35
    wheel_mps: float = 0.7  #: the fastest a wheel can go, either way
    wheel_accel_mps2: float = 1.5
    cruise_mps: float = 0.4
    cruise_accel_mps2: float = 0.6
    cruise_turn_radps: float = 1.9  #: at which it turns at most: its gyroscope's limit
    above_ground_m: ClassVar[float] = 0.0
    turning_m: ClassVar[float] = 0.0

    @property
    def pace(self) -> Pace:
        return Pace(self.cruise_mps, self.cruise_accel_mps2, 0.5, math.radians(20))

    def cruising(self, speed_mps: float) -> DifferentialDrive:
        fastest = max(self.wheel_mps, 1.5 * speed_mps)
        return replace(self, cruise_mps=speed_mps, wheel_mps=fastest)


class Drone(RoundBody, frozen=True):
    """A quadrotor with a footprint of 40 × 40 cm (paper, VI-A)."""

    LOOK: ClassVar[Look] = Look("drone", flies=True, tilts=True)
    ON_GROUND: ClassVar[bool] = False
    IS_EXACT: ClassVar[bool] = False

    radius_m: float = 0.29
    mass_kg: float = 1.2
    inertia_kgm2: tuple[float, float, float] = (0.012, 0.012, 0.022)
    thrust_ratio: float = 2.0  #: the greatest thrust, as a multiple of its weight
    tilt_rad: float = 0.5  #: the furthest that its controller tilts it
    torque_nm: tuple[float, float, float] = (0.6, 0.6, 0.15)
    drag_kgps: float = 0.25  #: force per speed against the air
    rotor_lag_s: float = 0.04
    speed_mps: float = 3.0
    accel_mps2: float = 4.0
    cruise_mps: float = 1.0
    cruise_accel_mps2: float = 1.2
    above_ground_m: float = 0.1
    turning_m: ClassVar[float] = 0.0

    @property
    def pace(self) -> Pace:
        return Pace(self.cruise_mps, self.cruise_accel_mps2, self.accel_mps2)

    def cruising(self, speed_mps: float) -> Drone:
        fastest = max(self.speed_mps, 1.5 * speed_mps)
        return replace(self, cruise_mps=speed_mps, speed_mps=fastest)


class IdealBody(RoundBody, frozen=True):
    """An ideal point robot that moves exactly along its path, at one speed."""

    LOOK: ClassVar[Look] = Look("point", flies=True)
    ON_GROUND: ClassVar[bool] = False
    IS_EXACT: ClassVar[bool] = True

    radius_m: float = 0.2
    cruise_mps: float = 1.0
    above_ground_m: ClassVar[float] = 0.0
    turning_m: ClassVar[float] = 0.0

    @property
    def pace(self) -> Pace:
        return Pace(self.cruise_mps, 1e6, 1e6)

    def cruising(self, speed_mps: float) -> IdealBody:
        return replace(self, cruise_mps=speed_mps)


class VehicleType(Struct, frozen=True):
    """A type of vehicle, as named in configurations."""

    body: Body  #: as it is where a configuration says nothing else
    planners: tuple[PlannerName, ...]  #: that find paths for it, the one to begin with first
    simulator: str  #: the module whose ``squad`` moves robots of this type
    levels: tuple[Level, ...] = tuple(Level)  #: at which that can


#: The types of vehicle, by what configurations say behind ``bot_type:``.
VEHICLES: dict[str, VehicleType] = {
    "CAR": VehicleType(
        Car(),
        (
            PlannerName.RRT_CAR,
            PlannerName.RRT_STAR_CAR,
            PlannerName.RRT_DUB_CAR,
            PlannerName.STRAIGHT,
        ),
        "koord.sim.vehicles.cars",
    ),
    "QUAD": VehicleType(
        Drone(),
        (PlannerName.RRT_DRONE, PlannerName.RRT_STAR_DRONE, PlannerName.STRAIGHT),
        "koord.sim.vehicles.drones",
    ),
    "DIFF": VehicleType(
        DifferentialDrive(),
        (PlannerName.RRT_DIFF, PlannerName.RRT_STAR_DIFF, PlannerName.STRAIGHT),
        "koord.sim.vehicles.differential",
    ),
    "IDEAL": VehicleType(
        IdealBody(),
        (PlannerName.STRAIGHT, PlannerName.RRT_DRONE, PlannerName.RRT_STAR_DRONE),
        "koord.sim.vehicles.points",
    ),
}


def type_of(body: Body) -> VehicleType:
    """The row of a body in the table. Raises StopIteration for an unknown body."""
    return next(row for row in VEHICLES.values() if type(row.body) is type(body))
