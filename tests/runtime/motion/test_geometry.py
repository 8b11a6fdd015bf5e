"""Distances, against a library that was written by others and against plain sampling."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion import geometry
from koord.runtime.motion.arrays import Floats

GRID = st.integers(-6, 6).map(lambda k: k / 2)
NUMBER = st.one_of(GRID, st.floats(-5, 5, allow_subnormal=False))
POINT = st.tuples(NUMBER, NUMBER, NUMBER)
PATH = st.lists(POINT, min_size=1, max_size=5)


def sampled(one: Floats, other: Floats) -> float:
    """The least distance between points of two segments, 60 on each: never too short."""
    share = np.linspace(0, 1, 60)[:, None]
    a = one[0] + share * (one[1] - one[0])
    b = other[0] + share * (other[1] - other[0])
    return float(np.linalg.norm(a[:, None] - b[None], axis=2).min())


@given(st.tuples(POINT, POINT), st.tuples(POINT, POINT))
def test_segments_are_as_far_apart_as_sampling_says(
    one: tuple[object, ...], other: tuple[object, ...]
) -> None:
    a, b = np.array(one), np.array(other)
    exact = float(np.sqrt(geometry.segment_segment(a[0], a[1], b[0], b[1])))
    found = sampled(a, b)
    spacing = (np.linalg.norm(a[1] - a[0]) + np.linalg.norm(b[1] - b[0])) / 59
    assert exact <= found + 1e-9
    assert found <= exact + spacing


@given(PATH, PATH)
def test_flat_paths_are_as_far_apart_as_shapely_says(
    one: list[tuple[float, float, float]], other: list[tuple[float, float, float]]
) -> None:
    first, second = geometry.as_path(one), geometry.as_path(other)
    first[:, 2] = second[:, 2] = 0.0
    shapes = [
        shapely.Point(p[0]) if len(p) == 1 else shapely.LineString(p)
        for p in (first[:, :2], second[:, :2])
    ]
    assert geometry.path_distance(first, second) == pytest.approx(
        shapely.distance(*shapes), abs=1e-7
    )


@given(POINT, PATH)
def test_a_point_is_as_far_from_a_path_as_the_path_of_it(
    p: tuple[float, float, float], path: list[tuple[float, float, float]]
) -> None:
    points = geometry.as_path(path)
    alone = geometry.as_path([p])
    assert geometry.point_path(alone[0], points) == pytest.approx(
        geometry.path_distance(alone, points), abs=1e-9
    )


def test_of_no_points_nothing_is_near() -> None:
    nothing, something = geometry.as_path([]), geometry.as_path([(0, 0, 0)])
    assert geometry.path_distance(nothing, something) == np.inf
    assert geometry.point_path(something[0], nothing) == np.inf


def test_the_length_of_a_path() -> None:
    assert geometry.length(geometry.as_path([(0, 0, 0), (3, 4, 0), (3, 4, 2)])) == 7.0


@given(st.floats(-50, 50))
def test_wrapped_angles_point_the_same_way(angle: float) -> None:
    found = float(geometry.wrapped(np.array([angle]))[0])
    assert -np.pi <= found < np.pi
    assert np.cos(found) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(found) == pytest.approx(np.sin(angle), abs=1e-9)
