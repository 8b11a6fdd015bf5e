"""Squads of drones under cascaded control, at every level; and those that MuJoCo moves.

Rotors of level ``mujoco`` stand at the corners of a square within the footprint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, assert_never

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Drone, Level
from koord.runtime.motion.flying import GRAVITY, Flying, Reference
from koord.runtime.motion.planning import Touched
from koord.runtime.motion.world import Point
from koord.sim.disturbances import Fixes, Gusts
from koord.sim.squads import STEP_S, STEPS, Seed, Squad, SquadSetup, VehicleSetup, is_compiled
from koord.sim.vehicles import mjcf
from koord.sim.vehicles.quadrotors import PointDrones, Quadrotors

if TYPE_CHECKING:
    from koord.sim.vehicles.physics import Arena


def squad(setup: SquadSetup) -> Squad:
    """Make a squad of drones that stand, or hover.

    At level ``full`` they fly by machine code where there is llvmlite, and the same without.
    """
    if is_compiled(setup.model):
        from koord.sim.squad_kernel import FusedDrones, is_undisturbed
        from koord.sim.vehicles.compiled_flying import CompiledFlying

        if is_undisturbed(setup.model.disturbances):
            return FusedDrones(setup)
        return DroneSquad(setup, _compiled(setup), CompiledFlying(setup.group, setup.start))
    return DroneSquad(setup, vehicles(setup), Flying(setup.group, setup.start))


def vehicles(setup: VehicleSetup) -> Quadrotors:
    """Make drones that stand, or hover; by machine code at level ``fast`` alone."""
    drone, start, engines = setup.model.body, setup.start, setup.engines
    assert isinstance(drone, Drone)
    match setup.model.level:
        case Level.SIMPLE:
            return PointDrones(drone, start, engines.world.ground)
        case Level.FULL:
            return Quadrotors(drone, start, engines.world.ground)
        case Level.FAST:
            return _compiled(setup)
        case Level.MUJOCO:
            return PhysicalDrones(drone, start, engines.arena)
        case _:
            assert_never(setup.model.level)


def _compiled(setup: VehicleSetup) -> Quadrotors:
    from koord.sim.vehicles.compiled import CompiledQuadrotors

    drone = setup.model.body
    assert isinstance(drone, Drone)
    return CompiledQuadrotors(drone, setup.start, setup.engines.world.ground)


class DroneSquad:
    """A squad of drones that follow a reference."""

    def __init__(self, setup: SquadSetup, vehicles: Quadrotors, flying: Flying) -> None:
        self.group, self.vehicles, self.flying = setup.group, vehicles, flying
        start, disturbances = setup.start, setup.model.disturbances
        self._fixes = Fixes(disturbances.positioning, setup.noise, flat=False)
        self._gusts = Gusts(disturbances.wind, setup.wind)
        self._delay = setup.delay(np.concatenate([start, 0 * start, 0 * start], axis=1))
        self._heading = np.zeros(len(start))  # drones keep their noses along x

    def tick(self, now_s: float) -> None:
        position, heading = self.fixes(now_s)
        if self.group.targets:
            self.group.plan(self.flying.origin(position), heading, now_s)
        due = self._delay.pass_on(self.flying.step(position, now_s, STEPS * STEP_S))
        # What the drone is told may be off or late: its controller aims beside by as much.
        aim = due[:, :3] - (position - self.truth()[0])
        wind = self._gusts.blow(STEPS * STEP_S)
        self.vehicles.advance(Reference(aim, due[:, 3:6], due[:, 6:]), wind, STEP_S, STEPS)

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self._fixes.read(self.vehicles.state.position.T, self._heading, now_s)

    def truth(self) -> tuple[Floats, Floats]:
        return self.vehicles.state.position.T, self._heading

    def attitude(self) -> Floats:
        return self.vehicles.state.attitude.T

    def reseed(self, noise: Sequence[Seed], wind: Sequence[Seed]) -> None:
        self._fixes.reseed(noise)
        self._gusts.reseed(wind)


# --- with rotors of MuJoCo ------------------------------------------------------------------------

HEIGHT_M = 0.1

#: Rotors are so far from the axes, as a share of what the footprint reaches along them.
_ROTOR_SHARE = 0.63

#: x, y and the sense in which a rotor turns, for a quadrotor in the form of an X.
_ROTORS = ((1, -1, 1), (-1, -1, -1), (-1, 1, 1), (1, 1, -1))


class PhysicalDrones(Quadrotors):
    """Quadrotors of four rotors, under the controllers of the level ``full``.

    Their position is the lowest point of a drone that hovers: on the ground it stands there.
    """

    flies = True

    def __init__(self, drone: Drone, start: Floats, arena: Arena) -> None:
        """``start`` has shape ``(n, 3)``."""
        super().__init__(drone, start, arena.world.ground)
        self._arena = arena
        self.names = arena.join(self, "drone", len(start))
        sense = np.array(_ROTORS, dtype=np.float64)
        arm, twist = _rotor_arm_m(drone), _rotor_twist_m(drone)
        # Rotor thrusts from the whole thrust and the torques about x, y and z.
        self._mixer = np.column_stack(
            [np.ones(4), sense[:, 1] / arm, -sense[:, 0] / arm, sense[:, 2] / twist]
        ) / len(sense)
        self._unmixer: Floats = np.linalg.inv(self._mixer).astype(np.float64)
        self._goal: tuple[Floats, Floats, Floats, Floats] | None = None

    def advance(self, reference: Reference, wind: Floats, dt_s: float, steps: int) -> None:
        """Fly for some steps. The reference moves on at its velocity; ``wind`` is ``(n, 3)``."""
        velocity = np.ascontiguousarray(reference.velocity.T)
        # The reference is for the end of these steps.
        position = reference.position.T - velocity * (dt_s * steps)
        self._goal = position, velocity, reference.acceleration.T, wind
        self._arena.advance(self, dt_s, steps)

    def touched(self, number: int) -> tuple[Touched, ...]:
        return self._arena.touched(self.names[number])

    def described(self) -> Iterator[mjcf.Described]:
        for name, (x, y, z) in zip(self.names, self.state.position.T.tolist(), strict=True):
            yield drone_described(name, self.drone, (x, y, z + HEIGHT_M / 2))

    def settle(self, model: Any, data: Any) -> None:
        qpos, qvel = mjcf.coordinates(model, self.names)
        # Their bodies follow each other in the model, so these are parts of MuJoCo's own arrays.
        n, at, first = len(self.names), qpos[0], qvel[0]
        self._pose = data.qpos[at : at + 7 * n].reshape(n, 7).T
        self._motion = data.qvel[first : first + 6 * n].reshape(n, 6).T
        self._forces = data.qfrc_applied[first : first + 6 * n].reshape(n, 6).T
        self._share = 1.0 - math.exp(-model.opt.timestep / self.drone.rotor_lag_s)
        self._lift: Floats = np.zeros((4, n))
        self._lift[0] = self.drone.mass_kg * GRAVITY
        self._asked: Floats = self._lift.copy()

    def act(self, data: Any, dt_s: float) -> None:
        assert self._goal is not None
        goal, pace, gain, wind = self._goal
        goal = goal + pace * dt_s
        self._goal = goal, pace, gain, wind
        thrust, tau, _ = self.control(goal, pace, gain, dt_s)
        asked = self._mixer @ np.vstack([self.drone.mass_kg * thrust, tau])
        # A rotor pulls neither down nor more than it can. All lag alike, so their sums do, too.
        able = np.minimum(np.maximum(asked, 0.0), _most_thrust_n(self.drone))
        self._asked = self._unmixer @ able
        self._drag = self.drone.drag_kgps * (wind.T - self.state.velocity)

    def push(self) -> None:
        """Pull along the axis of each drone, as it points now; torques are in its own frame."""
        w, x, y, z = self._pose[3:]
        lift, forces = self._lift, self._forces
        pull = 2.0 * lift[0]
        forces[0] = pull * (x * z + w * y)
        forces[1] = pull * (y * z - w * x)
        forces[2] = pull * (0.5 - x * x - y * y)
        forces[:3] += self._drag
        forces[3:] = lift[1:]
        lift += (self._asked - lift) * self._share

    def look(self, data: Any) -> None:
        q, v, s = self._pose, self._motion, self.state
        s.position = q[:3].copy()
        s.position[2] -= HEIGHT_M / 2
        s.attitude, s.velocity, s.rates = q[3:].copy(), v[:3].copy(), v[3:].copy()


def _rotor_arm_m(drone: Drone) -> float:
    """The distance in metres of a rotor from the axes through the middle."""
    return _ROTOR_SHARE * drone.radius_m / math.sqrt(2)


def _rotor_twist_m(drone: Drone) -> float:
    """A rotor's torque per thrust, in metres: the drone's yaw torque when hovering."""
    return drone.torque_nm[2] / (drone.mass_kg * GRAVITY)


def drone_described(name: str, drone: Drone, at: Point) -> mjcf.Described:
    """The MJCF of a quadrotor, whose frame is in its middle."""
    half = drone.radius_m / math.sqrt(2)
    box = mjcf.numbers(half, half, HEIGHT_M / 2)
    body = [
        f'<body name="{name}" pos="{mjcf.numbers(*at)}"><freejoint/>',
        f'<inertial pos="0 0 0" mass="{drone.mass_kg!r}" '
        f'diaginertia="{mjcf.numbers(*drone.inertia_kgm2)}"/>',
        f'<geom type="box" size="{box}" friction="{mjcf.BODY_GRIP}" {mjcf.SOLID}/>',
    ]
    return mjcf.Described([*body, "</body>"], [], [])


def _most_thrust_n(drone: Drone) -> float:
    """What one rotor pulls at most, in newtons."""
    return drone.thrust_ratio * drone.mass_kg * GRAVITY / len(_ROTORS)
