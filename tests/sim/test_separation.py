"""The nearest pair, by both ways of looking for it."""

from __future__ import annotations

import numpy as np
import pytest

from koord.sim.separation import Nearby, Nearest, nearest


@pytest.mark.parametrize("count", [2, 10, 64, 65, 300])
def test_the_nearest_pair_is_found(count: int) -> None:
    positions = np.random.default_rng(count).uniform(-9, 9, (count, 3))
    found = nearest(positions)
    assert found is not None
    gaps = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    gaps[np.diag_indices(count)] = np.inf
    assert found.distance_m == pytest.approx(gaps.min())
    assert gaps[found.one, found.other] == pytest.approx(gaps.min())
    assert found.one < found.other


@pytest.mark.parametrize(("count", "step_m"), [(10, 0.2), (65, 0.1), (300, 0.05), (300, 1.0)])
def test_robots_that_move_have_the_same_nearest_pair(count: int, step_m: float) -> None:
    draw, nearby = np.random.default_rng(count), Nearby()
    positions = draw.uniform(-9, 9, (count, 3))
    pairs = set()
    for _ in range(100):
        found = nearby.nearest(positions)
        assert found == nearest(positions)
        assert found is not None
        pairs.add((found.one, found.other))
        positions = positions + draw.normal(0, step_m, (count, 3))
    assert len(pairs) > 2


def test_of_pairs_that_are_equally_near_the_first_is_named() -> None:
    grid = np.array([(2.0 * (k % 10), 2.0 * (k // 10), 0.0) for k in range(100)])
    assert nearest(grid) == nearest(grid[:20]) == Nearby().nearest(grid) == Nearest(2.0, 0, 1)


def test_robots_at_one_place_are_near() -> None:
    found = nearest(
        np.concatenate([np.random.default_rng(0).uniform(1, 9, (80, 3)), np.zeros((2, 3))])
    )
    assert found is not None
    assert (found.distance_m, found.one, found.other) == (0.0, 80, 81)


def test_one_robot_has_nobody_near() -> None:
    assert nearest(np.zeros((1, 3))) is None
    assert nearest(np.zeros((0, 3))) is None
