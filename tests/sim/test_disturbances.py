"""Noise, rates, delay and wind: what they are said to be, and of each robot by itself."""

from __future__ import annotations

import numpy as np
import pytest

from koord.sim.disturbances import Delay, Fixes, Gusts, Normals, Positioning, Wind, spawned

ZERO = np.zeros((2, 3))


def seeds(count: int, seed: int = 1) -> list[np.random.SeedSequence]:
    return np.random.SeedSequence(seed).spawn(count)


def test_a_robots_numbers_do_not_hang_on_how_many_others_there_are() -> None:
    few, many = Normals(seeds(2), 3), Normals(seeds(5), 3)
    for _ in range(150):
        assert np.array_equal(few.draw(), many.draw()[:2])


def test_a_spawned_seed_is_that_which_numpy_spawns() -> None:
    whole = np.random.SeedSequence(7)
    for number, child in enumerate(seeds(3, 7)):
        mine = spawned(whole, number)
        assert mine.generate_state(4).tolist() == child.generate_state(4).tolist()
        again, theirs = spawned(mine, 1), child.spawn(2)[1]
        assert again.generate_state(4).tolist() == theirs.generate_state(4).tolist()


def test_exact_positioning_is_exact() -> None:
    fixes = Fixes(Positioning(), seeds(2), flat=False)
    position, heading = fixes.read(ZERO + 1.5, np.array([0.1, 0.2]), 0.0)
    assert np.array_equal(position, ZERO + 1.5)
    assert heading.tolist() == [0.1, 0.2]


def test_noise_has_its_spread_and_cars_stay_on_the_ground() -> None:
    fixes = Fixes(Positioning(noise_m=0.05, heading_noise_rad=0.02), seeds(2), flat=True)
    read = [fixes.read(ZERO, np.zeros(2), 0.1 * k) for k in range(2000)]
    positions = np.array([position for position, _ in read])
    assert positions[:, :, :2].std() == pytest.approx(0.05, rel=0.05)
    assert np.array([heading for _, heading in read]).std() == pytest.approx(0.02, rel=0.05)
    assert (positions[:, :, 2] == 0).all()
    assert abs(np.corrcoef(positions[:, 0, 0], positions[:, 1, 0])[0, 1]) < 0.1


def test_positions_come_at_their_rate() -> None:
    fixes = Fixes(Positioning(rate_hz=5.0), seeds(2), flat=False)
    told = [float(fixes.read(ZERO + 0.05 * k, np.zeros(2), 0.05 * k)[0][0, 0]) for k in range(13)]
    assert [round(x / 0.05) for x in told] == [0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12]


def test_wind_has_its_mean_spread_and_memory() -> None:
    gusts = Gusts(Wind((2.0, 0.0, 0.0), gust_mps=0.5, calm_s=1.0), seeds(2))
    blown = np.array([gusts.blow(0.1) for _ in range(12000)])
    assert blown[:, :, 0].mean() == pytest.approx(2.0, abs=0.08)
    assert blown[200:].std(axis=0) == pytest.approx(np.full((2, 3), 0.5), rel=0.15)
    gust = blown[200:, 0, 1]
    assert np.corrcoef(gust[:-10], gust[10:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.1)


def test_no_wind_is_none() -> None:
    assert np.array_equal(Gusts(Wind(), seeds(2)).blow(0.1), ZERO)


def test_commands_wait_their_time() -> None:
    delay = Delay(2, np.array([0.0]))
    assert [float(delay.pass_on(np.array([float(k)]))[0]) for k in (1, 2, 3, 4)] == [0, 0, 1, 2]
    at_once = Delay(0, np.array([0.0]))
    assert float(at_once.pass_on(np.array([7.0]))[0]) == 7.0
