"""Cars: kinematic bicycles with limits, alone, in contact, or on wheels of MuJoCo.

For the middle of the rear axle: ẋ = v cos θ, ẏ = v sin θ, θ̇ = v tan φ / L (LaValle, Planning
Algorithms, 13.1.2.1). Speed and steering angle follow what is commanded at their limited rates.
Wheels of level ``mujoco`` are those of the F1TENTH vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, assert_never

import numpy as np

from koord.runtime.motion.arrays import Floats, bounded
from koord.runtime.motion.bodies import Car, Level, Steering
from koord.runtime.motion.course import Horizon
from koord.runtime.motion.driving import Driving
from koord.runtime.motion.geometry import wrapped
from koord.runtime.motion.planning import Touched
from koord.runtime.motion.world import Point
from koord.sim.squads import STEP_S, STEPS, SquadSetup, Wheeled, WheeledSquad
from koord.sim.vehicles import mjcf

if TYPE_CHECKING:
    from koord.sim.vehicles.contact import Hull
    from koord.sim.vehicles.physics import Arena

#: Predictive controllers take every second tick.
_PREDICTIVE_TICKS = 2


def squad(setup: SquadSetup) -> WheeledSquad:
    """Cars at rest, with pursuit or model-predictive control."""
    steering = setup.model.steering
    every = _PREDICTIVE_TICKS if steering is Steering.PREDICTIVE else 1
    tracker = Driving(setup.group, steering, Horizon(step_s=every * STEPS * STEP_S))
    return WheeledSquad(setup, _cars(setup), tracker, every)


def _cars(setup: SquadSetup) -> Wheeled:
    car, engines = setup.model.body, setup.engines
    assert isinstance(car, Car)
    bicycles = Bicycles(car, setup.start, setup.heading_rad)
    match setup.model.level:
        case Level.SIMPLE:
            return bicycles
        case Level.FULL | Level.FAST:
            from koord.sim.vehicles.contact import Colliding

            return Colliding(bicycles, hull(car), engines.floor)
        case Level.MUJOCO:
            return PhysicalCars(bicycles, engines.arena)
        case _:
            assert_never(setup.model.level)


def hull(car: Car) -> Hull:
    """The body of a car in the plane."""
    from koord.sim.vehicles.contact import Hull

    return Hull(car.mass_kg, car.length_m, car.width_m, car.middle_m)


class Bicycles:
    """Cars that do not meet anything. One entry for each car in every array."""

    def __init__(self, car: Car, start: Floats, heading_rad: Floats) -> None:
        """``start`` has shape ``(n, 3)``."""
        self.car = car
        self.position: Floats = start.copy()
        self.heading: Floats = heading_rad.copy()
        self.speed: Floats = np.zeros(len(start))
        self.steering: Floats = np.zeros(len(start))

    def touched(self, number: int) -> tuple[Touched, ...]:
        """What one of them touches: at this level nothing."""
        return ()

    def take(self, speed: Floats, turn: Floats) -> None:
        """Go on from other speeds; the wheels stay as they are."""
        self.speed = speed

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Go on for some steps with commanded speeds and steering angles, shape ``(n, 2)``."""
        for _ in range(steps):
            self.actuate(command, dt_s)
            turn = self.turning()
            course = self.heading + turn * (dt_s / 2)
            self.position[:, 0] += dt_s * self.speed * np.cos(course)
            self.position[:, 1] += dt_s * self.speed * np.sin(course)
            self.heading += dt_s * turn
        self.heading = wrapped(self.heading)

    def turning(self) -> Floats:
        """How fast the cars turn, rad/s."""
        rate: Floats = self.speed * np.tan(self.steering) / self.car.wheelbase_m
        return rate

    def actuate(self, command: Floats, dt_s: float) -> None:
        """Speed and steering angle a step later, within the limits."""
        car = self.car
        wanted = bounded(command[:, 0], -car.speed_mps, car.speed_mps)
        most = car.accel_mps2 * dt_s
        self.speed = self.speed + bounded(wanted - self.speed, -most, most)
        turned = bounded(command[:, 1], -car.steering_rad, car.steering_rad)
        most = car.steering_rate_radps * dt_s
        self.steering = self.steering + bounded(turned - self.steering, -most, most)


# --- on wheels of MuJoCo --------------------------------------------------------------------------

#: The servos that turn the front wheels, N m per rad.
_SERVO_NM = 5.0


class PhysicalCars:
    """Cars on four wheels, of which the rear ones are driven and the front ones steer."""

    flies = False

    def __init__(self, told: Bicycles, arena: Arena) -> None:
        """``told`` stand where the cars do, and are told what they are."""
        self.position: Floats = told.position.copy()
        self.heading: Floats = told.heading.copy()
        self.speed: Floats = np.zeros(len(told.speed))
        # What engine and servos are told changes as fast as it does in a bicycle.
        self._car, self._told, self._arena = told.car, told, arena
        self._command: Floats = np.zeros((len(told.speed), 2))
        self.names = arena.join(self, "car", len(told.speed))

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Go on for some steps with commanded speeds and steering angles, shape ``(n, 2)``."""
        self._command = command
        self._arena.advance(self, dt_s, steps)

    def touched(self, number: int) -> tuple[Touched, ...]:
        """What one of them touches."""
        return self._arena.touched(self.names[number])

    def described(self) -> Iterator[mjcf.Described]:
        for name, at, heading_rad in zip(self.names, self.position, self.heading, strict=True):
            yield car_described(name, self._car, at.tolist(), float(heading_rad))

    def settle(self, model: Any, data: Any) -> None:
        from koord.sim.vehicles.physics import coordinates

        self._qpos, self._qvel = coordinates(model, self.names)
        self._engines, self._left, self._right = (
            [model.actuator(f"{name} {what}").id for name in self.names]
            for what in ("engine", "left", "right")
        )

    def act(self, data: Any, dt_s: float) -> None:
        car, told = self._car, self._told
        told.actuate(self._command, dt_s)
        bend = np.tan(told.steering) / car.wheelbase_m
        data.ctrl[self._engines] = told.speed / mjcf.WHEEL_M
        # Both front wheels point along circles about one point (Ackermann).
        for servos, aside in ((self._left, 0.5), (self._right, -0.5)):
            inner = 1.0 - aside * track_m(car) * bend
            data.ctrl[servos] = np.arctan2(car.wheelbase_m * bend, inner)

    def look(self, data: Any) -> None:
        q = data.qpos[self._qpos[:, None] + np.arange(7)]
        v = data.qvel[self._qvel[:, None] + np.arange(2)]
        w, x, y, z = q[:, 3:].T
        self.heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.position = q[:, :3].copy()
        self.speed = np.cos(self.heading) * v[:, 0] + np.sin(self.heading) * v[:, 1]


def track_m(car: Car) -> float:
    """From the middle of a wheel to that of the other on its axle."""
    return car.width_m - mjcf.TYRE_M


def car_described(name: str, car: Car, at: Point, heading_rad: float) -> mjcf.Described:
    """A car whose frame lies on the ground below the middle of its rear axle."""
    mass_kg = car.mass_kg - 4 * mjcf.WHEEL_KG
    body = [*mjcf.chassis(name, at, heading_rad, mass_kg, car.outline_m)]
    for axle, x in (("rear", 0.0), ("front", car.wheelbase_m)):
        for side, sign in (("left", 1), ("right", -1)):
            y = sign * track_m(car) / 2
            body += mjcf.wheel(f"{name} {axle} {side}", x, y, steers=axle == "front")
    body.append("</body>")
    # The rear wheels are behind a differential: the engine turns both, in the mean.
    halves = (f'<joint joint="{name} rear {side}" coef="0.5"/>' for side in ("left", "right"))
    axle = f'<fixed name="{name} axle">{"".join(halves)}</fixed>'
    motor = mjcf.engine(f"{name} engine", f'tendon="{name} axle"', car.mass_kg, car.accel_mps2)
    servos = [
        f'<position name="{name} {side}" joint="{name} front {side} steering" '
        f'kp="{_SERVO_NM}" dampratio="1"/>'
        for side in ("left", "right")
    ]
    return mjcf.Described(body, [axle], [motor, *servos])
