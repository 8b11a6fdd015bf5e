"""`pathsClear`, `onPath`, `apart`: they meet the summaries that are verified with."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.bodies import Car, Drone
from koord.runtime.motion.clearance import Clearance, Path, clearance_of
from koord.runtime.motion.geometry import path_distance
from koord.runtime.motion.world import Point

COORDINATE = st.one_of(st.integers(-4, 4).map(float), st.floats(-4, 4, allow_subnormal=False))
POINT = st.tuples(COORDINATE, COORDINATE, st.sampled_from([0.0, 0.5, 1.0]))
PATH = st.lists(POINT, min_size=1, max_size=5).map(tuple)
CLEAR = Clearance(safety_m=0.6, tracking_m=0.3, resting_m=0.1)


def beside(path: Path, share: float, aside: float, angle: float) -> Point:
    """A point so far beside a path."""
    k = min(int(share * len(path)), len(path) - 1)
    a, b = path[k], path[min(k + 1, len(path) - 1)]
    t = share * len(path) - k
    x, y, z = (p + (q - p) * t for p, q in zip(a, b, strict=True))
    return x + aside * math.cos(angle), y + aside * math.sin(angle), z


PLACE = st.tuples(st.floats(0, 1), st.floats(0, 0.35), st.floats(0, 6.3))


@given(PATH, PATH)
def test_clear_is_symmetric_to_the_bit(a: Path, b: Path) -> None:
    assert CLEAR.paths_clear(a, b) == CLEAR.paths_clear(b, a)


@given(PATH, PATH)
def test_clear_is_a_matter_of_distance(a: Path, b: Path) -> None:
    reach = sum(CLEAR.tracking_m if len(set(p)) > 1 else CLEAR.resting_m for p in (a, b))
    distance = path_distance(np.array(a), np.array(b))
    least = CLEAR.safety_m + reach
    if abs(distance - least) > 1e-6:
        assert CLEAR.paths_clear(a, b) == (distance > least)


@given(PATH, PATH, PLACE, PLACE)
def test_the_summaries_of_task_and_delivery(
    a: Path, b: Path, here: tuple[float, float, float], there: tuple[float, float, float]
) -> None:
    """Robots on clear paths keep clear, and so does one that waits somewhere on its path."""
    p, q = beside(a, *here), beside(b, *there)
    if not CLEAR.paths_clear(a, b):
        return
    if CLEAR.on_path(p, a):
        assert CLEAR.paths_clear((p,), b)
    if CLEAR.on_path(q, b):
        assert CLEAR.paths_clear(a, (q,))
    if CLEAR.on_path(p, a) and CLEAR.on_path(q, b):
        assert CLEAR.paths_clear((p,), (q,))
        assert CLEAR.apart(p, q)


@given(PATH, PATH, PLACE, PLACE)
def test_robots_that_are_off_by_all_that_they_may_are_apart(
    a: Path, b: Path, here: tuple[float, float, float], there: tuple[float, float, float]
) -> None:
    p, q = beside(a, *here), beside(b, *there)
    slack = CLEAR.resting_m
    if CLEAR.paths_clear(a, b) and CLEAR.on_path(p, a, slack) and CLEAR.on_path(q, b, slack):
        assert math.dist(p, q) > CLEAR.safety_m - 1e-6


@given(POINT)
def test_a_robot_is_on_the_path_that_it_is_at(p: Point) -> None:
    assert CLEAR.on_path(p, (p,))
    assert not CLEAR.on_path(p, ())


@given(PATH)
def test_no_path_is_in_nobodys_way(a: Path) -> None:
    assert CLEAR.paths_clear(a, ())
    assert CLEAR.paths_clear((), a)


def test_bodies_do_not_touch_at_their_clearance() -> None:
    pair = clearance_of([Car(), Car(), Drone()], tracking_m=0.1)
    assert pair.safety_m == 2 * Car().radius_m
    assert clearance_of([Car(), Drone()], 0.1).safety_m == Car().radius_m + Drone().radius_m
