"""Frames: known attitudes and directions, in koord's frames and in those of others."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.drivers.frames import (
    LEVEL,
    Quaternion,
    attitude_from_ned,
    attitude_to_ned,
    from_xyzw,
    heading_to_ned,
    ned_to_enu,
    product,
    to_xyzw,
    turned,
    yaw_of,
)
from koord.runtime.motion.world import Point


def rotated(attitude: Quaternion, vector: Point) -> Point:
    """A vector of the body, in the world."""
    w, x, y, z = attitude
    _, *turned_ = product(product(attitude, (0.0, *vector)), (w, -x, -y, -z))
    a, b, c = turned_
    return a, b, c


def about(axis: Point, degrees: float) -> Quaternion:
    half = math.radians(degrees) / 2
    x, y, z = (c * math.sin(half) for c in axis)
    return math.cos(half), x, y, z


ANGLES = st.floats(-math.pi, math.pi)


@st.composite
def attitudes(draw: st.DrawFn) -> Quaternion:
    yaw, pitch, roll = draw(ANGLES), draw(ANGLES), draw(ANGLES)
    around_y = about((0.0, 1.0, 0.0), math.degrees(pitch))
    around_x = about((1.0, 0.0, 0.0), math.degrees(roll))
    return product(product(turned(yaw), around_y), around_x)


def test_a_level_body_that_looks_north_has_no_turn_in_ned_and_a_quarter_in_enu() -> None:
    assert yaw_of(attitude_from_ned(LEVEL)) == pytest.approx(math.pi / 2)


def test_a_body_that_looks_east_has_a_quarter_turn_in_ned_and_none_in_enu() -> None:
    east = attitude_from_ned(about((0.0, 0.0, 1.0), 90))
    assert yaw_of(east) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("axis", "degrees", "lifted"),
    [((1.0, 0.0, 0.0), 30, (0.0, 1.0, 0.0)), ((0.0, 1.0, 0.0), 30, (1.0, 0.0, 0.0))],
    ids=["roll to the right lifts the left", "nose up lifts the nose"],
)
def test_what_is_lifted_in_ned_is_lifted_in_enu(axis: Point, degrees: float, lifted: Point) -> None:
    """Angles of FRD bodies count clockwise from behind, from the right, and from above."""
    x, y, z = rotated(attitude_from_ned(about(axis, degrees)), lifted)
    assert z == pytest.approx(math.sin(math.radians(degrees)))
    assert math.hypot(x, y) == pytest.approx(math.cos(math.radians(degrees)))


@given(attitudes(), st.tuples(ANGLES, ANGLES, ANGLES))
def test_a_vector_of_the_body_is_the_same_arrow_in_both_frames(
    attitude: Quaternion, vector: Point
) -> None:
    forward, left, up = vector
    in_ned = rotated(attitude_to_ned(attitude), (forward, -left, -up))
    assert ned_to_enu(in_ned) == pytest.approx(rotated(attitude, vector), abs=1e-9)


@given(attitudes())
def test_there_and_back_is_the_same_attitude(attitude: Quaternion) -> None:
    back = attitude_from_ned(attitude_to_ned(attitude))
    sign = math.copysign(1.0, sum(a * b for a, b in zip(attitude, back, strict=True)))
    assert tuple(sign * c for c in back) == pytest.approx(attitude, abs=1e-9)
    assert from_xyzw(*to_xyzw(attitude)) == attitude


@given(ANGLES)
def test_a_heading_is_the_yaw_of_its_attitude(heading_rad: float) -> None:
    there = yaw_of(turned(heading_rad))
    assert math.cos(there) == pytest.approx(math.cos(heading_rad))
    assert math.sin(there) == pytest.approx(math.sin(heading_rad))


@pytest.mark.parametrize(("of_enu", "of_ned"), [(0, 90), (90, 0), (180, -90), (-90, 180)])
def test_headings_count_from_east_and_yaws_from_north(of_enu: float, of_ned: float) -> None:
    yaw = math.degrees(heading_to_ned(math.radians(of_enu)))
    assert (yaw - of_ned + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)


@given(ANGLES)
def test_a_yaw_is_that_of_the_attitude_in_ned(heading_rad: float) -> None:
    there = yaw_of(attitude_to_ned(turned(heading_rad))) - heading_to_ned(heading_rad)
    assert math.cos(there) == pytest.approx(1.0)
