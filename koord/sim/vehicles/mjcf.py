"""Parts of vehicles as MJCF, the text that MuJoCo makes its models of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Ints
from koord.runtime.motion.world import Point

#: Wheels: their radius, the width of their tyres, their mass.
WHEEL_M, TYRE_M = 0.05, 0.04
WHEEL_KG = 0.12

#: What tyres hold, dry rubber on a hall's floor, and what bodies do.
TYRE_GRIP, BODY_GRIP = 0.9, 0.4

#: A body on wheels reaches from here to there above the ground.
_BODY_LOW_M, _BODY_HIGH_M = 0.03, 0.13

#: How quickly an engine brings a speed about.
_ENGINE_S = 0.03

#: An engine that is to accelerate so fast can pull by so much more: wheels and losses need it, too.
_ENGINE_RESERVE = 1.5

#: Who meets whom: the floor meets wheels and bodies, bodies meet bodies and walls, wheels only the
#: floor: a car's outline covers them.
FLOOR = 'contype="3" conaffinity="0"'
_WHEEL = 'contype="0" conaffinity="1"'
SOLID = 'contype="2" conaffinity="2"'


class Described(Struct, frozen=True):
    """The MJCF of a vehicle: its body, tendons and actuators."""

    body: list[str]
    tendons: list[str]
    actuators: list[str]


def coordinates(model: Any, names: Iterable[str]) -> tuple[Ints, Ints]:
    """The addresses, in MuJoCo's arrays, of the positions and velocities of free bodies."""
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
    """The beginning of a body on wheels: length, width, and the offset of its middle, in metres."""
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
    """The MJCF of a wheel in the frame of its vehicle."""
    yield f'<body pos="{numbers(x, y, WHEEL_M)}">'
    if steers:
        yield f'<joint name="{name} steering" axis="0 0 1" armature="0.001"/>'
    yield f'<joint name="{name}" axis="0 1 0" armature="0.00005"/>'
    # An ellipsoid stands on one point, as a tyre does that does not lean.
    yield (
        f'<geom type="ellipsoid" size="{numbers(WHEEL_M, TYRE_M / 2, WHEEL_M)}" '
        f'mass="{WHEEL_KG}" friction="{TYRE_GRIP}" {_WHEEL}/>'
    )
    yield "</body>"


def ball(x: float, radius_m: float) -> str:
    """The MJCF of a caster: a ball in the frame of its vehicle, which rolls any way."""
    # As it has priority, its friction counts and not the floor's.
    return (
        f'<geom type="sphere" size="{radius_m!r}" pos="{numbers(x, 0, radius_m)}" mass="0.01" '
        f'priority="1" friction="0.001" {_WHEEL}/>'
    )


def engine(name: str, on: str, mass_kg: float, accel_mps2: float) -> str:
    """A motor that accelerates a mass to the commanded speed; ``on`` is what it turns."""
    most = _ENGINE_RESERVE * mass_kg * accel_mps2 * WHEEL_M
    gain = mass_kg * WHEEL_M**2 / _ENGINE_S
    return f'<velocity name="{name}" {on} kv="{gain!r}" forcerange="{-most!r} {most!r}"/>'


def numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
