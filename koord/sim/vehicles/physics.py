"""Cars and quadrotors as jointed bodies among all that is solid: the level ``mujoco``.

MuJoCo moves them: wheels that roll and slip, an engine behind a differential, rotors that lag,
contact of everybody with everybody and with the world. What they are told is what vehicles of the
other levels are told. All vehicles of a run share one world, an :class:`Arena`. This is the one
file that imports MuJoCo.
"""

from __future__ import annotations

import warnings
from typing import Any, Protocol

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Drone
from koord.runtime.motion.cascade import GRAVITY
from koord.runtime.motion.flying import Reference
from koord.runtime.motion.libraries import missing
from koord.runtime.motion.planning import Hindrance
from koord.runtime.motion.world import World
from koord.sim.vehicles import mjcf
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.quadrotors import Quadrotors
from koord.sim.vehicles.touching import Touched

try:
    import mujoco
except ImportError as error:
    raise missing("mujoco-core", "mujoco") from error

# Else it writes a file where it happens to be.
mujoco.set_mju_user_warning(warnings.warn)


class Part(Protocol):
    """Vehicles of one kind in an arena."""

    def settle(self, model: Any, data: Any) -> None:
        """The model is made: find out where in it the vehicles are."""
        ...

    def act(self, data: Any, dt_s: float) -> None:
        """Drive motors and rotors for the next step."""
        ...

    def look(self, data: Any) -> None:
        """Find out where the vehicles are."""
        ...

    def names(self) -> list[str]:
        """What their bodies are called."""
        ...


class Arena:
    """A world with vehicles of any kinds in it; time passes when all of them have been told."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.cars: list[tuple[Car, tuple[float, float, float], float]] = []
        self.drones: list[tuple[Drone, tuple[float, float, float]]] = []
        self._parts: list[Part] = []
        self._told: set[int] = set()
        self._made: tuple[Any, Any] | None = None

    def join(self, part: Part) -> None:
        """More vehicles; there are none when time begins to pass."""
        assert self._made is None
        self._parts.append(part)

    def advance(self, part: Part, dt_s: float, steps: int) -> None:
        """Vehicles know what to do in the next steps; with the last that know it they are made."""
        self._told.add(id(part))
        if len(self._told) < len(self._parts):
            return
        self._told.clear()
        model, data = self._running()
        within = round(dt_s / mjcf.SUBSTEP_S)
        for _ in range(steps):
            for one in self._parts:
                one.act(data, dt_s)
            mujoco.mj_step(model, data, within)
            for one in self._parts:
                one.look(data)

    def touched(self, name: str) -> tuple[Touched, ...]:
        """What the vehicle of that name touches, but for the floor."""
        model, data = self._running()
        known = {
            one: Touched(Hindrance.ROBOT, k, part)
            for part in self._parts
            for k, one in enumerate(part.names())
        }
        found: dict[Touched, None] = {}
        for pair in data.contact.geom[: data.ncon]:
            bodies = [model.body(model.body_rootid[model.geom_bodyid[geom]]).name for geom in pair]
            if name not in bodies:
                continue
            geom = pair[1 - bodies.index(name)]
            other = bodies[1 - bodies.index(name)]
            what = known.get(other) or _of_world(model.geom(geom).name)
            if what is not None:
                found[what] = None
        return tuple(found)

    def _running(self) -> tuple[Any, Any]:
        if self._made is None:
            model = mujoco.MjModel.from_xml_string(mjcf.model(self.world, self.cars, self.drones))
            data = mujoco.MjData(model)
            for part in self._parts:
                part.settle(model, data)
            self._made = model, data
        return self._made


def _of_world(name: str) -> Touched | None:
    """Something that stands in the world, by its name; None for the floor."""
    match name.split():
        case [mjcf.EDGE, _]:
            return Touched(Hindrance.EDGE)
        case [mjcf.OBSTACLE, number, *_]:
            return Touched(Hindrance.OBSTACLE, int(number))
    return None


class PhysicalCars:
    """Cars on four wheels, of which the rear ones are driven and the front ones steer."""

    def __init__(self, car: Car, start: Floats, heading_rad: Floats, arena: Arena) -> None:
        """``start`` has shape ``(n, 3)``."""
        self.position: Floats = start.copy()
        self.heading: Floats = heading_rad.copy()
        self.speed: Floats = np.zeros(len(start))
        self._car, self._arena = car, arena
        self._command: Floats = np.zeros((len(start), 2))
        # What engine and servos are told changes as fast as it does in a bicycle.
        self._told = Bicycles(car, start, heading_rad)
        self._first = len(arena.cars)
        for at, heading in zip(start.tolist(), heading_rad.tolist(), strict=True):
            arena.cars.append((car, (at[0], at[1], at[2]), heading))
        arena.join(self)

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Go on for some steps with commanded speeds and steering angles, shape ``(n, 2)``."""
        self._command = command
        self._arena.advance(self, dt_s, steps)

    def names(self) -> list[str]:
        return [f"car{self._first + k}" for k in range(len(self.speed))]

    def touched(self, car: int) -> tuple[Touched, ...]:
        """What one of them touches."""
        return self._arena.touched(self.names()[car])

    def settle(self, model: Any, data: Any) -> None:
        names = self.names()
        bodies = [model.body(name) for name in names]
        self._qpos = np.array([model.joint(body.jntadr[0]).qposadr[0] for body in bodies])
        self._qvel = np.array([body.dofadr[0] for body in bodies])
        # Engine, left and right servo stand one after the other, car by car.
        self._motors = 3 * (self._first + np.arange(len(names)))

    def act(self, data: Any, dt_s: float) -> None:
        car, told = self._car, self._told
        told.actuate(self._command, dt_s)
        bend = np.tan(told.steering) / car.wheelbase_m
        data.ctrl[self._motors] = told.speed / mjcf.WHEEL_M
        # Both front wheels point along circles about one point (Ackermann).
        for motor, aside in ((1, 0.5), (2, -0.5)):
            inner = 1.0 - aside * mjcf.track_m(car) * bend
            data.ctrl[self._motors + motor] = np.arctan2(car.wheelbase_m * bend, inner)

    def look(self, data: Any) -> None:
        q = data.qpos[self._qpos[:, None] + np.arange(7)]
        v = data.qvel[self._qvel[:, None] + np.arange(2)]
        w, x, y, z = q[:, 3:].T
        self.heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.position = q[:, :3].copy()
        self.speed = np.cos(self.heading) * v[:, 0] + np.sin(self.heading) * v[:, 1]


class PhysicalDrones(Quadrotors):
    """Quadrotors of four rotors, under the controllers of the level ``full``.

    Their position is the lowest point of a drone that hovers: on the ground it stands there.
    """

    def __init__(self, drone: Drone, start: Floats, arena: Arena) -> None:
        """``start`` has shape ``(n, 3)``."""
        super().__init__(drone, start, arena.world.ground)
        self._arena = arena
        self._first, self._number = len(arena.drones), len(start)
        for x, y, z in start.tolist():
            arena.drones.append((drone, (x, y, z + mjcf.DRONE_HEIGHT_M / 2)))
        arena.join(self)
        sense = np.array(mjcf.ROTORS, dtype=np.float64)
        arm, twist = mjcf.rotor_arm_m(drone), mjcf.rotor_twist_m(drone)
        # Rotor thrusts from the whole thrust and the torques about x, y and z.
        self._mixer = np.column_stack(
            [np.ones(4), sense[:, 1] / arm, -sense[:, 0] / arm, sense[:, 2] / twist]
        ) / len(sense)
        self._goal: tuple[Floats, Floats, Floats, Floats] | None = None

    def advance(self, reference: Reference, wind: Floats, dt_s: float, steps: int) -> None:
        """Fly for some steps. The reference moves on at its velocity; ``wind`` is ``(n, 3)``."""
        velocity = np.ascontiguousarray(reference.velocity.T)
        # The reference is for the end of these steps.
        position = reference.position.T - velocity * (dt_s * steps)
        self._goal = position, velocity, reference.acceleration.T, wind
        self._arena.advance(self, dt_s, steps)

    def names(self) -> list[str]:
        return [f"drone{self._first + k}" for k in range(self._number)]

    def touched(self, drone: int) -> tuple[Touched, ...]:
        return self._arena.touched(self.names()[drone])

    def settle(self, model: Any, data: Any) -> None:
        bodies = [model.body(name) for name in self.names()]
        self._bodies = np.array([body.id for body in bodies])
        self._qpos = np.array([model.joint(body.jntadr[0]).qposadr[0] for body in bodies])
        self._qvel = np.array([body.dofadr[0] for body in bodies])
        rotors = np.arange(self._number * 4).reshape(-1, 4)
        self._rotors = rotors + 3 * len(self._arena.cars) + 4 * self._first
        self._lags = rotors + 4 * self._first
        data.act[self._lags] = self.drone.mass_kg * GRAVITY / 4

    def act(self, data: Any, dt_s: float) -> None:
        assert self._goal is not None
        goal, pace, gain, wind = self._goal
        goal = goal + pace * dt_s
        self._goal = goal, pace, gain, wind
        thrust, tau, _ = self.control(goal, pace, gain, dt_s)
        asked = np.vstack([self.drone.mass_kg * thrust, tau])
        data.ctrl[self._rotors] = (self._mixer @ asked).T
        drag = self.drone.drag_kgps * (wind - self.state.velocity.T)
        data.xfrc_applied[self._bodies, :3] = drag

    def look(self, data: Any) -> None:
        q = data.qpos[self._qpos[:, None] + np.arange(7)].T
        v = data.qvel[self._qvel[:, None] + np.arange(6)].T
        s = self.state
        s.position = q[:3].copy()
        s.position[2] -= mjcf.DRONE_HEIGHT_M / 2
        s.attitude, s.velocity, s.rates = q[3:].copy(), v[:3].copy(), v[3:].copy()
