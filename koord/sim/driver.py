"""The driver ``sim``: a vehicle model of the simulator, moved as real time goes by; and ``ideal``.

What it is told is carried out by the controllers that vehicles have below a driver: servos and
motors of what drives, the position controller of what flies. It stops by itself, as a good vehicle
does, if it is told nothing for a while.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
from msgspec import Struct

from koord.runtime.drivers.driver import Device, Driver, NoOptions
from koord.runtime.drivers.frames import Quaternion, turned
from koord.runtime.drivers.setpoints import (
    Arm,
    Capabilities,
    Disarm,
    Drive,
    Hold,
    Land,
    Position,
    Sensed,
    Setpoint,
    Takeoff,
    Track,
    Velocity,
)
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, DifferentialDrive, Drone, type_of
from koord.runtime.motion.flying import GRAVITY, Reference
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Point
from koord.sim.disturbances import Fixes, Gusts
from koord.sim.scene import device_model
from koord.sim.squads import STEP_S, STEPS, DeviceModel, Engines, VehicleSetup, Wheeled
from koord.sim.vehicles.quadrotors import Quadrotors

#: A vehicle that was told nothing for so long holds.
DEAD_MAN_S = 0.5

#: Who was not asked for so long is not moved on by more.
_MOST_S = 2.0

#: Drones rise and sink at these speeds, and are in the air above this height.
_RISING_MPS, _SINKING_MPS, _AIRBORNE_M = 0.5, 0.4, 0.05


class SimulatedVehicle(Driver, ABC):
    """A vehicle of the simulator as a driver."""

    OPTIONS: ClassVar[type[Struct]] = NoOptions

    def __init__(self, device: Device, model: DeviceModel) -> None:
        """Make a vehicle that stands where the device begins. Nothing moves before it is armed."""
        self.capabilities = Capabilities(
            kinds=(device.vehicle.type_name,),
            wishes=self.WISHES,
            rate_hz=1 / TICK_S,
            pose_age_s=TICK_S,
            dead_man_s=DEAD_MAN_S,
            tells_airborne=True,
        )
        self.device, self.model = device, model
        self.armed = False
        noise, wind = np.random.SeedSequence((device.seed, device.pid)).spawn(2)
        disturbances = model.disturbances
        self._fixes = Fixes(disturbances.positioning, [noise], flat=model.body.ON_GROUND)
        self._gusts = Gusts(disturbances.wind, [wind])
        self._told: deque[tuple[float, Setpoint]] = deque()
        self._setpoint: Setpoint = Hold()
        self._told_at_s = -math.inf  #: when the set-point in force arrived
        self._now_s: float | None = None
        self._left_s = 0.0
        self._measured: tuple[Floats, Floats, float] | None = None

    WISHES: ClassVar[tuple[type[Any], ...]]

    def open(self, now_s: float) -> None:
        self._now_s = now_s

    def sense(self, now_s: float) -> Sensed | None:
        self._pass_time(now_s)
        position, heading = self.truth()
        fix, course = self._fixes.read(position, heading, now_s)
        if self._measured is None or self._measured[0] is not fix:
            self._measured = fix, course, now_s
        x, y, z = fix[0].tolist()
        return Sensed(
            (x, y, z),
            self.attitude(float(course[0])),
            self.velocity(),
            self._measured[2],
            armed=self.armed,
            airborne=self.airborne,
        )

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        self._told.append((now_s + self.model.disturbances.actuation_delay_s, setpoint))

    def close(self) -> None:
        self._setpoint = Hold()

    # --- time -----------------------------------------------------------------------------------

    def _pass_time(self, now_s: float) -> None:
        """Move as far as time has gone by."""
        if self._now_s is None:
            return
        elapsed_s = self._left_s + min(max(0.0, now_s - self._now_s), _MOST_S)
        steps = int(elapsed_s / STEP_S + 1e-9)
        self._left_s = elapsed_s - steps * STEP_S
        at_s = now_s - self._left_s - steps * STEP_S
        self._now_s = now_s
        while steps > 0:
            some = min(steps, STEPS)
            self._hear(at_s)
            self.move(self._setpoint if self.armed else Disarm(), some)
            at_s, steps = at_s + some * STEP_S, steps - some

    def _hear(self, at_s: float) -> None:
        while self._told and self._told[0][0] <= at_s + TICK_S / 2:
            self._told_at_s, said = self._told.popleft()
            if isinstance(said, Arm):
                self.armed = True
            else:
                self.armed = self.armed and not isinstance(said, Disarm)
                self._take(said)
        if at_s - self._told_at_s > DEAD_MAN_S:
            self._take(Land() if isinstance(self._setpoint, Land) else Hold())

    def _take(self, setpoint: Setpoint) -> None:
        if setpoint != self._setpoint:
            self.begin(setpoint)
        self._setpoint = setpoint

    # --- the vehicle ----------------------------------------------------------------------------

    def begin(self, setpoint: Setpoint) -> None:
        """Take note of a set-point that differs from the last one."""
        return

    @abstractmethod
    def move(self, setpoint: Setpoint, steps: int) -> None:
        """Move for some steps."""

    @abstractmethod
    def truth(self) -> tuple[Floats, Floats]:
        """The position ``(1, 3)`` and heading ``(1,)``."""

    @abstractmethod
    def attitude(self, heading_rad: float) -> Quaternion:
        """The attitude, with the heading that was measured."""

    @abstractmethod
    def velocity(self) -> Point:
        """The velocity in m/s."""

    @property
    @abstractmethod
    def airborne(self) -> bool:
        """True if it has left the ground."""


class SimulatedWheels(SimulatedVehicle):
    """A car or a differential drive."""

    WISHES = (Drive, Velocity)

    def __init__(self, device: Device, model: DeviceModel, vehicles: Wheeled) -> None:
        super().__init__(device, model)
        self._vehicles = vehicles
        self._steering_rad = 0.0

    def move(self, setpoint: Setpoint, steps: int) -> None:
        speed, rate = 0.0, 0.0
        match setpoint:
            case Drive(speed_mps=speed, yaw_rate_radps=rate):
                pass
            case Velocity(velocity_mps=(x, y, _), yaw_rate_radps=rate):
                heading = float(self._vehicles.heading[0])
                speed = x * math.cos(heading) + y * math.sin(heading)
            case _:
                pass
        self._vehicles.advance(self._command(setpoint, speed, rate), STEP_S, steps)

    def _command(self, setpoint: Setpoint, speed: float, rate: float) -> Floats:
        """What the motors are told, shape ``(1, 2)``."""
        body = self.model.body
        if isinstance(body, DifferentialDrive):
            half = rate * body.track_m / 2
            return np.array([[speed - half, speed + half]])
        assert isinstance(body, Car)
        if isinstance(setpoint, Drive) and setpoint.steering_rad is not None:
            self._steering_rad = setpoint.steering_rad
        elif speed:
            self._steering_rad = math.atan(rate * body.wheelbase_m / speed)
        return np.array([[speed, self._steering_rad]])

    def truth(self) -> tuple[Floats, Floats]:
        return self._vehicles.position, self._vehicles.heading

    def attitude(self, heading_rad: float) -> Quaternion:
        return turned(heading_rad)

    def velocity(self) -> Point:
        speed, heading = float(self._vehicles.speed[0]), float(self._vehicles.heading[0])
        return speed * math.cos(heading), speed * math.sin(heading), 0.0

    @property
    def airborne(self) -> bool:
        return False


class SimulatedDrone(SimulatedVehicle):
    """A drone with an autopilot, which follows a reference, rises and lands."""

    WISHES = (Position, Track, Takeoff)

    def __init__(self, device: Device, model: DeviceModel, vehicles: Quadrotors) -> None:
        super().__init__(device, model)
        self._vehicles = vehicles
        self._aim = device.position_m  #: where it is to be
        self._ground_m = device.world.ground

    def begin(self, setpoint: Setpoint) -> None:
        if isinstance(setpoint, Hold | Land | Takeoff) and not isinstance(
            self._setpoint, Hold | Land | Takeoff
        ):
            self._aim = self._position

    def move(self, setpoint: Setpoint, steps: int) -> None:
        if isinstance(setpoint, Disarm):
            self._fall(steps * STEP_S)
            return
        lasts_s = steps * STEP_S
        velocity, acceleration = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        match setpoint:
            case Track(position_m=position, velocity_mps=velocity, acceleration_mps2=acceleration):
                self._aim = position
            case Position(position_m=position, speed_mps=speed):
                velocity = self._approach(position, speed, lasts_s)
            case Takeoff(height_m=height):
                x, y, _ = self._aim
                velocity = self._approach((x, y, self._ground_m + height), _RISING_MPS, lasts_s)
            case Land():
                x, y, _ = self._aim
                velocity = self._approach((x, y, self._ground_m), _SINKING_MPS, lasts_s)
            case _:
                pass
        still = not self.airborne and isinstance(setpoint, Hold | Land)
        aim = self._position if still else self._aim
        reference = Reference(np.array([aim]), np.array([velocity]), np.array([acceleration]))
        self._vehicles.advance(reference, self._gusts.blow(lasts_s), STEP_S, steps)

    def _approach(self, goal: Point, speed_mps: float, lasts_s: float) -> Point:
        """Let the aim go on towards a goal; return at which velocity it does."""
        far_m = math.dist(self._aim, goal)
        if far_m <= speed_mps * lasts_s:
            self._aim = goal
            return 0.0, 0.0, 0.0
        x, y, z = ((b - a) / far_m * speed_mps for a, b in zip(self._aim, goal, strict=True))
        ax, ay, az = self._aim
        self._aim = ax + x * lasts_s, ay + y * lasts_s, az + z * lasts_s
        return x, y, z

    def _fall(self, lasts_s: float) -> None:
        state = self._vehicles.state
        if not self.airborne:
            state.velocity[:] = 0.0
            return
        state.velocity[2] -= GRAVITY * lasts_s
        state.position = state.position + state.velocity * lasts_s
        state.position[2] = np.maximum(state.position[2], self._ground_m)

    @property
    def _position(self) -> Point:
        x, y, z = self._vehicles.state.position[:, 0].tolist()
        return x, y, z

    def truth(self) -> tuple[Floats, Floats]:
        return self._vehicles.state.position.T, np.zeros(1)

    def attitude(self, heading_rad: float) -> Quaternion:
        w, x, y, z = self._vehicles.state.attitude[:, 0].tolist()
        return w, x, y, z

    def velocity(self) -> Point:
        x, y, z = self._vehicles.state.velocity[:, 0].tolist()
        return x, y, z

    @property
    def airborne(self) -> bool:
        return bool(self._vehicles.state.position[2, 0] > self._ground_m + _AIRBORNE_M)


class SimulatedPoint(SimulatedVehicle):
    """An ideal point, which is where it is told to be, and turns at once."""

    WISHES = (Track, Position, Velocity, Takeoff)

    def __init__(self, device: Device, model: DeviceModel) -> None:
        super().__init__(device, model)
        self._position, self._velocity = device.position_m, (0.0, 0.0, 0.0)
        self._heading_rad = device.heading_rad
        self._ground_m = device.world.ground

    def move(self, setpoint: Setpoint, steps: int) -> None:
        lasts_s, here = steps * STEP_S, self._position
        x, y, _ = here
        match setpoint:
            case Track(position_m=position, velocity_mps=velocity):
                self._position, self._velocity = position, velocity
                return
            case Position(position_m=goal, speed_mps=speed):
                self._position = _towards(here, goal, speed * lasts_s)
            case Velocity(velocity_mps=velocity, yaw_rate_radps=rate):
                self._heading_rad += rate * lasts_s
                ends = (a + v * lasts_s for a, v in zip(here, velocity, strict=True))
                end_x, end_y, end_z = ends
                self._position = end_x, end_y, end_z
            case Takeoff(height_m=height):
                goal = (x, y, self._ground_m + height)
                self._position = _towards(here, goal, _RISING_MPS * lasts_s)
            case Land() if not self.model.body.ON_GROUND:
                goal = (x, y, self._ground_m)
                self._position = _towards(here, goal, _SINKING_MPS * lasts_s)
            case _:
                pass
        vx, vy, vz = ((b - a) / lasts_s for a, b in zip(here, self._position, strict=True))
        self._velocity = vx, vy, vz

    def truth(self) -> tuple[Floats, Floats]:
        return np.array([self._position]), np.array([self._heading_rad])

    def attitude(self, heading_rad: float) -> Quaternion:
        return turned(heading_rad)

    def velocity(self) -> Point:
        return self._velocity

    @property
    def airborne(self) -> bool:
        is_high = self._position[2] > self._ground_m + _AIRBORNE_M
        return is_high and not self.model.body.ON_GROUND


def _towards(here: Point, goal: Point, far_m: float) -> Point:
    """The point so far on the way to a goal, or the goal if that is nearer."""
    left_m = math.dist(here, goal)
    if left_m <= far_m:
        return goal
    x, y, z = (a + (b - a) * far_m / left_m for a, b in zip(here, goal, strict=True))
    return x, y, z


def vehicle(device: Device) -> SimulatedVehicle:
    """The simulated vehicle of a device. Raises KoordError for libraries that are missing."""
    model = device_model(device.vehicle)
    setup = VehicleSetup(
        model,
        np.array([device.position_m]),
        np.array([device.heading_rad]),
        Engines(device.world),
    )
    if model.body.IS_EXACT:
        return SimulatedPoint(device, model)
    vehicles = import_module(type_of(model.body).simulator).vehicles(setup)
    if isinstance(model.body, Drone):
        return SimulatedDrone(device, model, vehicles)
    return SimulatedWheels(device, model, vehicles)


def point(device: Device) -> SimulatedVehicle:
    """A point in place of the vehicle of a device: it goes where that is sent, and as fast."""
    return SimulatedPoint(device, device_model(device.vehicle))


class _Simulated(Struct, frozen=True):
    """What makes simulated vehicles."""

    make: Callable[[Device], SimulatedVehicle]

    OPTIONS: ClassVar[type[Struct]] = NoOptions

    def __call__(self, device: Device) -> SimulatedVehicle:
        return self.make(device)


#: The driver ``sim``, and the driver ``ideal``.
SIMULATED, IDEAL = _Simulated(vehicle), _Simulated(point)
