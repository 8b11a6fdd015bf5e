"""What controllers of cars are to follow, and how far they look."""

from __future__ import annotations

from msgspec import Struct

from koord.runtime.motion.arrays import Floats


class Horizon(Struct, frozen=True):
    """How far a controller looks: so many steps of so long."""

    steps: int = 8
    step_s: float = 0.1


class Course(Struct, frozen=True):
    """What cars are to follow, from now on: arrays ``(m, steps)``.

    They may go more slowly than told, to keep to the path, but not more slowly than ``slowest``.
    """

    speed_mps: Floats
    curvature: Floats
    slowest_mps: float
