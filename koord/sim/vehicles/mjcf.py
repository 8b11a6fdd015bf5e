"""Worlds, and parts of vehicles, as MJCF: the text that MuJoCo makes its models of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, assert_never

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Ints
from koord.runtime.motion.cascade import GRAVITY
from koord.runtime.motion.world import Box, Disc, Flat, Obstacle, Point, Polygon, World

#: MuJoCo's own steps: tyres and contacts are stiff.
SUBSTEP_S = 0.002

#: Wheels: their radius, the width of their tyres, their mass.
WHEEL_M, TYRE_M = 0.05, 0.04
WHEEL_KG = 0.12

#: What tyres hold, dry rubber on a hall's floor, and what bodies do.
_TYRE_GRIP, BODY_GRIP = 0.9, 0.4

#: A body on wheels reaches from here to there above the ground.
_BODY_LOW_M, _BODY_HIGH_M = 0.03, 0.13

#: How quickly an engine brings a speed about.
_ENGINE_S = 0.03

#: An engine that is to accelerate so fast can pull by so much more: wheels and losses need it, too.
_ENGINE_RESERVE = 1.5

_WALL_M = 0.1

#: Who meets whom: the floor meets wheels and bodies, bodies meet bodies and walls, wheels only the
#: floor: a car's outline covers them.
_FLOOR = 'contype="3" conaffinity="0"'
_WHEEL = 'contype="0" conaffinity="1"'
SOLID = 'contype="2" conaffinity="2"'


#: What solid things of the world are called, with a number behind: walls, and obstacles.
EDGE, OBSTACLE = "edge", "obstacle"


class Described(Struct, frozen=True):
    """A vehicle in the words of MJCF."""

    body: list[str]
    tendons: list[str]
    actuators: list[str]


def model(world: World, vehicles: Iterable[Described]) -> str:
    """A world with vehicles in it."""
    bodies: list[str] = []
    tendons: list[str] = []
    actuators: list[str] = []
    for vehicle in vehicles:
        bodies += vehicle.body
        tendons += vehicle.tendons
        actuators += vehicle.actuators
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


def coordinates(model: Any, names: Iterable[str]) -> tuple[Ints, Ints]:
    """Where in a model of MuJoCo the coordinates and velocities of free bodies begin."""
    bodies = [model.body(name) for name in names]
    qpos = [model.joint(body.jntadr[0]).qposadr[0] for body in bodies]
    return np.array(qpos), np.array([body.dofadr[0] for body in bodies])


# --- what drives ----------------------------------------------------------------------------------


def chassis(
    name: str,
    at: Point,
    heading_rad: float,
    mass_kg: float,
    outline_m: tuple[float, float, float],
    is_disc: bool = False,
) -> Iterator[str]:
    """The beginning of a body on wheels: length, width, and from its frame to its middle."""
    length, width, middle = outline_m
    turn = numbers(math.cos(heading_rad / 2), 0, 0, math.sin(heading_rad / 2))
    half = (length / 2, width / 2, (_BODY_HIGH_M - _BODY_LOW_M) / 2)
    centre = (middle, 0, (_BODY_HIGH_M + _BODY_LOW_M) / 2)
    yield f'<body name="{name}" pos="{numbers(*at)}" quat="{turn}"><freejoint/>'
    shape, size = ("cylinder", half[1:]) if is_disc else ("box", half)
    yield (
        f'<geom type="{shape}" size="{numbers(*size)}" pos="{numbers(*centre)}" '
        f'mass="{mass_kg!r}" friction="{BODY_GRIP}" {SOLID}/>'
    )


def wheel(name: str, x: float, y: float, steers: bool = False) -> Iterator[str]:
    """A wheel in the frame of its vehicle."""
    yield f'<body pos="{numbers(x, y, WHEEL_M)}">'
    if steers:
        yield f'<joint name="{name} steering" axis="0 0 1" armature="0.001"/>'
    yield f'<joint name="{name}" axis="0 1 0" armature="0.00005"/>'
    # An ellipsoid stands on one point, as a tyre does that does not lean.
    yield (
        f'<geom type="ellipsoid" size="{numbers(WHEEL_M, TYRE_M / 2, WHEEL_M)}" '
        f'mass="{WHEEL_KG}" friction="{_TYRE_GRIP}" {_WHEEL}/>'
    )
    yield "</body>"


def ball(x: float, radius_m: float) -> str:
    """A ball in the frame of its vehicle, on which that stands and which rolls any way."""
    # As it has priority, its friction counts and not the floor's.
    return (
        f'<geom type="sphere" size="{radius_m!r}" pos="{numbers(x, 0, radius_m)}" mass="0.01" '
        f'priority="1" friction="0.001" {_WHEEL}/>'
    )


def engine(name: str, on: str, mass_kg: float, accel_mps2: float) -> str:
    """A motor that brings so much mass to the speed commanded; ``on`` is what it turns."""
    most = _ENGINE_RESERVE * mass_kg * accel_mps2 * WHEEL_M
    gain = mass_kg * WHEEL_M**2 / _ENGINE_S
    return f'<velocity name="{name}" {on} kv="{gain!r}" forcerange="{-most!r} {most!r}"/>'


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
            middle = numbers(x, y, (low_z + high_z) / 2)
            size = numbers(radius, (high_z - low_z) / 2)
            return [], [_geom(name, "cylinder", size, middle)]
        case Polygon(corners=corners):
            from koord.sim.vehicles.contact import convex_parts

            meshes, parts = [], []
            for k, part in enumerate(convex_parts(corners)):
                points = " ".join(numbers(x, y, z) for z in (low_z, high_z) for x, y in part)
                # Without a position of its own a mesh stays where its vertices are.
                meshes.append(f'<mesh name="{name} {k}" vertex="{points}"/>')
                parts.append(
                    f'<geom name="{name} {k}" type="mesh" mesh="{name} {k}" '
                    f'friction="{BODY_GRIP}" {SOLID}/>'
                )
            return meshes, parts
        case _:
            assert_never(obstacle)


def _block(name: str, low: Flat, high: Flat, low_z: float, high_z: float) -> str:
    (x0, y0), (x1, y1) = low, high
    size = numbers((x1 - x0) / 2, (y1 - y0) / 2, (high_z - low_z) / 2)
    return _geom(name, "box", size, numbers((x0 + x1) / 2, (y0 + y1) / 2, (low_z + high_z) / 2))


def _geom(name: str, kind: str, size: str, middle: str) -> str:
    return (
        f'<geom name="{name}" type="{kind}" size="{size}" pos="{middle}" '
        f'friction="{BODY_GRIP}" {SOLID}/>'
    )


def numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
