"""Routes of cars that machine code measures: to the last bit those of NumPy."""

from __future__ import annotations

import math
from unittest.mock import Mock

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Pace
from koord.runtime.motion.routes import Routes

compiled = pytest.importorskip("koord.runtime.motion.compiled_routes")

PACE = Car().pace
#: Of each robot; of each point, behind the last one too; and of points or segments up to it.
ROBOTS = ("size", "length", "given")
POINTS = ("points", "s", "speed2", "leg_end")
SEGMENTS = ("tangent", "course", "turn", "curvature", "way")


def same(one: Routes, other: Routes) -> bool:
    """Whether routes are equal, as far as somebody looks at them."""
    room = min(one.s.shape[1], other.s.shape[1])
    pairs = [(getattr(one, name), getattr(other, name)) for name in ROBOTS]
    pairs += [(getattr(one, name)[:, :room], getattr(other, name)[:, :room]) for name in POINTS]
    for name in SEGMENTS:
        for robot, size in enumerate(one.size.tolist()):
            end = size + (name == "curvature")
            pairs.append((getattr(one, name)[robot, :end], getattr(other, name)[robot, :end]))
    return one.changes == other.changes and all(np.array_equal(*pair) for pair in pairs)


def drawn(rng: np.random.Generator) -> Floats:
    """A path: any points, a curve with cusps, corners of a grid; some points twice."""
    count, kind = int(rng.integers(1, 40)), rng.integers(3)
    if kind == 0:
        path = rng.normal(size=(count, 3))
    elif kind == 1:
        course = np.cumsum(rng.normal(size=count) * 0.1)
        way = np.where(rng.random(count) < 0.1, -1.0, 1.0).cumprod() * 0.15
        path = np.column_stack([way * np.cos(course), way * np.sin(course), np.zeros(count)])
        path = path.cumsum(0)
    else:
        path = np.round(rng.normal(size=(count, 3)))
    path[:, 2] = 0.0
    return np.repeat(path, 2, axis=0) if rng.random() < 0.3 else path


@pytest.mark.parametrize("pace", [PACE, replace(PACE, reverses=False)])
def test_routes_are_those_of_numpy(pace: Pace) -> None:
    rng = np.random.default_rng(5)
    by_numpy, by_code = Routes(3, pace), compiled.CompiledRoutes(3, pace)
    for _ in range(400):
        path, robot, heading = drawn(rng), int(rng.integers(3)), float(rng.uniform(-4, 4))
        for routes in (by_numpy, by_code):
            routes.put(robot, path, heading)
        assert same(by_numpy, by_code)


def test_what_hangs_on_the_last_bit_is_numpys() -> None:
    """A corner as sharp as one where a car turns about, and a way that begins square to it."""
    about = PACE.cusp_rad
    corner = np.array([(0, 0, 0), (1, 0, 0), (1 + math.cos(about), math.sin(about), 0)])
    for path, heading in ((corner, 0.0), (corner[:2], math.pi / 2), (corner[:2], -math.pi / 2)):
        by_numpy, by_code = Routes(1, PACE), compiled.CompiledRoutes(1, PACE)
        begin, measure = by_code._code
        measured = Mock(wraps=measure)
        by_code._code = begin, measured
        for routes in (by_numpy, by_code):
            routes.put(0, path, heading)
        room = by_code.s.shape[1]
        assert measure(by_code._table_at, 0, room, len(path) - 1) == 0
        measured.assert_called_once()
        assert same(by_numpy, by_code)
        assert by_code.given[0] == 1


def test_without_the_library_routes_are_numpys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "library", lambda: None)
    assert type(compiled.routes_of_cars(2, PACE)) is Routes
