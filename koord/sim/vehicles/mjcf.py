"""Cars, quadrotors and worlds as MJCF, the text that MuJoCo makes its models of.

All that a device says of itself is in the model: outline, wheelbase, mass, inertia, the limits of
steering, engine and rotors. What a device does not say is a constant here: wheels are those of the
F1TENTH vehicle, rotors stand at the corners of a square within the footprint.

A car's frame lies on the ground below the middle of its rear axle, a quadrotor's in its middle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import assert_never

from koord.runtime.motion.bodies import Car, Drone
from koord.runtime.motion.cascade import GRAVITY
from koord.runtime.motion.world import Box, Disc, Flat, Obstacle, Point, Polygon, World
from koord.sim.vehicles.contact import convex_parts

#: MuJoCo's own steps: tyres and contacts are stiff.
SUBSTEP_S = 0.002

WHEEL_M, _TYRE_M = 0.05, 0.04
_WHEEL_KG = 0.12
_BODY_LOW_M, _BODY_HIGH_M = 0.03, 0.13

#: What tyres hold, dry rubber on a hall's floor, and what bodies do.
_TYRE_GRIP, _BODY_GRIP = 0.9, 0.4

#: The servo that turns the wheels (N m per rad), and how quickly the engine brings a speed about.
_SERVO_NM, _ENGINE_S = 5.0, 0.03

#: An engine that is to accelerate so fast can pull by so much more: wheels and losses need it, too.
_ENGINE_RESERVE = 1.5

DRONE_HEIGHT_M = 0.1

#: Rotors are so far from the axes, as a share of what the footprint reaches along them.
_ROTOR_SHARE = 0.63

#: x, y and the sense in which a rotor turns, for a quadrotor in the form of an X.
ROTORS = ((1, -1, 1), (-1, -1, -1), (-1, 1, 1), (1, 1, -1))

_WALL_M = 0.1

#: Who meets whom: the floor meets wheels and bodies, bodies meet bodies and walls, wheels only the
#: floor: a car's outline covers them.
_FLOOR = 'contype="3" conaffinity="0"'
_WHEEL = 'contype="0" conaffinity="1"'
_SOLID = 'contype="2" conaffinity="2"'


def track_m(car: Car) -> float:
    """From the middle of a wheel to that of the other on its axle."""
    return car.width_m - _TYRE_M


#: What solid things of the world are called, with a number behind: walls, and obstacles.
EDGE, OBSTACLE = "edge", "obstacle"


def rotor_arm_m(drone: Drone) -> float:
    """How far a rotor is from the axes through the middle."""
    return _ROTOR_SHARE * drone.radius_m / math.sqrt(2)


def rotor_twist_m(drone: Drone) -> float:
    """A rotor's torque about its axis, per thrust: hovering, it can just be what a drone has."""
    return drone.torque_nm[2] / (drone.mass_kg * GRAVITY)


def rotor_newtons(drone: Drone) -> float:
    """The greatest thrust of one rotor."""
    return drone.thrust_ratio * drone.mass_kg * GRAVITY / len(ROTORS)


def model(
    world: World,
    cars: Iterable[tuple[Car, Point, float]],
    drones: Iterable[tuple[Drone, Point]],
) -> str:
    """A world with cars (where, and where they point) and quadrotors in it."""
    bodies: list[str] = []
    tendons: list[str] = []
    actuators: list[str] = []
    for k, (car, at, heading_rad) in enumerate(cars):
        bodies += _car(f"car{k}", car, at, heading_rad)
        tendons += _axle(f"car{k}")
        actuators += _engine_and_servos(f"car{k}", car)
    for k, (drone, at) in enumerate(drones):
        bodies += _drone(f"drone{k}", drone, at)
        actuators += _rotors(f"drone{k}", drone)
    meshes, solids = _world(world)
    return "\n".join(
        [
            '<mujoco model="koord">',
            f'<option timestep="{SUBSTEP_S}" gravity="0 0 {-GRAVITY}"'
            ' cone="elliptic" impratio="10">',
            # Who touches nobody moves as if it were alone, to the last bit: each island is solved
            # for by itself. Where a solver starts would be decided for all islands together.
            '<flag island="enable" warmstart="disable"/></option>',
            "<asset>",
            *meshes,
            "</asset>",
            "<worldbody>",
            *solids,
            *bodies,
            "</worldbody>",
            "<tendon>",
            *tendons,
            "</tendon>",
            "<actuator>",
            *actuators,
            "</actuator>",
            "</mujoco>",
        ]
    )


# --- vehicles -------------------------------------------------------------------------------------


def _car(name: str, car: Car, at: Point, heading_rad: float) -> Iterator[str]:
    turn = _numbers(math.cos(heading_rad / 2), 0, 0, math.sin(heading_rad / 2))
    body = (car.length_m / 2, car.width_m / 2, (_BODY_HIGH_M - _BODY_LOW_M) / 2)
    middle = (car.middle_m, 0, (_BODY_HIGH_M + _BODY_LOW_M) / 2)
    yield f'<body name="{name}" pos="{_numbers(*at)}" quat="{turn}"><freejoint/>'
    yield (
        f'<geom type="box" size="{_numbers(*body)}" pos="{_numbers(*middle)}" '
        f'mass="{car.mass_kg - 4 * _WHEEL_KG!r}" friction="{_BODY_GRIP}" {_SOLID}/>'
    )
    for axle, x in (("rear", 0.0), ("front", car.wheelbase_m)):
        for side, sign in (("left", 1), ("right", -1)):
            place = _numbers(x, sign * track_m(car) / 2, WHEEL_M)
            wheel = f"{name} {axle} {side}"
            yield f'<body pos="{place}">'
            if axle == "front":
                yield f'<joint name="{wheel} steering" axis="0 0 1" armature="0.001"/>'
            yield f'<joint name="{wheel}" axis="0 1 0" armature="0.00005"/>'
            # An ellipsoid stands on one point, as a tyre does that does not lean.
            yield (
                f'<geom type="ellipsoid" size="{_numbers(WHEEL_M, _TYRE_M / 2, WHEEL_M)}" '
                f'mass="{_WHEEL_KG}" friction="{_TYRE_GRIP}" {_WHEEL}/>'
            )
            yield "</body>"
    yield "</body>"


def _axle(name: str) -> Iterator[str]:
    """The rear wheels behind a differential: the engine turns both, in the mean."""
    halves = (f'<joint joint="{name} rear {side}" coef="0.5"/>' for side in ("left", "right"))
    yield f'<fixed name="{name} axle">{"".join(halves)}</fixed>'


def _engine_and_servos(name: str, car: Car) -> Iterator[str]:
    most = _ENGINE_RESERVE * car.mass_kg * car.accel_mps2 * WHEEL_M
    gain = car.mass_kg * WHEEL_M**2 / _ENGINE_S
    yield f'<velocity tendon="{name} axle" kv="{gain!r}" forcerange="{-most!r} {most!r}"/>'
    for side in ("left", "right"):
        joint = f"{name} front {side} steering"
        yield f'<position joint="{joint}" kp="{_SERVO_NM}" dampratio="1"/>'


def _drone(name: str, drone: Drone, at: Point) -> Iterator[str]:
    x, y, z = at
    half = drone.radius_m / math.sqrt(2)
    yield f'<body name="{name}" pos="{_numbers(x, y, z)}"><freejoint/>'
    yield (
        f'<inertial pos="0 0 0" mass="{drone.mass_kg!r}" '
        f'diaginertia="{_numbers(*drone.inertia_kgm2)}"/>'
    )
    yield (
        f'<geom type="box" size="{_numbers(half, half, DRONE_HEIGHT_M / 2)}" '
        f'friction="{_BODY_GRIP}" {_SOLID}/>'
    )
    arm = rotor_arm_m(drone)
    for k, (ahead, aside, _) in enumerate(ROTORS):
        yield f'<site name="{name} rotor {k}" pos="{_numbers(ahead * arm, aside * arm, 0)}"/>'
    yield "</body>"


def _rotors(name: str, drone: Drone) -> Iterator[str]:
    most, twist = rotor_newtons(drone), rotor_twist_m(drone)
    for k, (_, _, sense) in enumerate(ROTORS):
        yield (
            f'<general site="{name} rotor {k}" gear="{_numbers(0, 0, 1, 0, 0, sense * twist)}" '
            f'ctrlrange="0 {most!r}" dyntype="filterexact" dynprm="{drone.rotor_lag_s!r}" '
            'gainprm="1"/>'
        )


# --- the world ------------------------------------------------------------------------------------


def _world(world: World) -> tuple[list[str], list[str]]:
    """Meshes, and what stands in the world: the floor, walls around it, obstacles."""
    (x0, y0, ground), (x1, y1, roof) = world.low, world.high
    meshes: list[str] = []
    solids = [
        f'<geom type="plane" size="0 0 1" pos="0 0 {ground!r}" friction="{_TYRE_GRIP}" {_FLOOR}/>'
    ]
    thick = _WALL_M
    walls = (
        ((x0 - thick, y0 - thick), (x0, y1 + thick)),
        ((x1, y0 - thick), (x1 + thick, y1 + thick)),
        ((x0, y0 - thick), (x1, y0)),
        ((x0, y1), (x1, y1 + thick)),
    )
    solids += [
        _block(f"{EDGE} {k}", low, high, ground, roof) for k, (low, high) in enumerate(walls)
    ]
    for k, obstacle in enumerate(world.obstacles):
        high = min(obstacle.high_z, roof)
        if obstacle.low_z >= high:
            continue
        more, parts = _solid(f"{OBSTACLE} {k}", obstacle, obstacle.low_z, high)
        meshes += more
        solids += parts
    return meshes, solids


def _solid(
    name: str, obstacle: Obstacle, low_z: float, high_z: float
) -> tuple[list[str], list[str]]:
    match obstacle:
        case Box(low=(x0, y0, _), high=(x1, y1, _)):
            return [], [_block(name, (x0, y0), (x1, y1), low_z, high_z)]
        case Disc(centre=(x, y), radius_m=radius):
            middle = _numbers(x, y, (low_z + high_z) / 2)
            size = _numbers(radius, (high_z - low_z) / 2)
            return [], [_geom(name, "cylinder", size, middle)]
        case Polygon(corners=corners):
            meshes, parts = [], []
            for k, part in enumerate(convex_parts(corners)):
                points = " ".join(_numbers(x, y, z) for z in (low_z, high_z) for x, y in part)
                # Without a position of its own a mesh stays where its vertices are.
                meshes.append(f'<mesh name="{name} {k}" vertex="{points}"/>')
                parts.append(
                    f'<geom name="{name} {k}" type="mesh" mesh="{name} {k}" '
                    f'friction="{_BODY_GRIP}" {_SOLID}/>'
                )
            return meshes, parts
        case _:
            assert_never(obstacle)


def _block(name: str, low: Flat, high: Flat, low_z: float, high_z: float) -> str:
    (x0, y0), (x1, y1) = low, high
    size = _numbers((x1 - x0) / 2, (y1 - y0) / 2, (high_z - low_z) / 2)
    return _geom(name, "box", size, _numbers((x0 + x1) / 2, (y0 + y1) / 2, (low_z + high_z) / 2))


def _geom(name: str, kind: str, size: str, middle: str) -> str:
    return (
        f'<geom name="{name}" type="{kind}" size="{size}" pos="{middle}" '
        f'friction="{_BODY_GRIP}" {_SOLID}/>'
    )


def _numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
