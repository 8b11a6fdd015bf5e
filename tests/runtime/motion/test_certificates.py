"""Barrier certificates: what keeps robots apart is as near as can be to what they want."""

from __future__ import annotations

import numpy as np
import osqp
import pytest
import z3
from scipy import sparse

import koord
from koord.runtime.configuration.checking import load
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.certificates import certified
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

DISTANCE_M, GAIN = 0.4, 2.0


def crowd(count: int, rng: np.random.Generator, apart_m: float = DISTANCE_M) -> Floats:
    """Places of which no two are nearer than that, shape ``(n, 2)``."""
    side_m = apart_m * (1.0 + np.sqrt(count))
    found = np.empty((0, 2))
    while len(found) < count:
        place = rng.uniform(0, side_m, 2)
        if (np.hypot(*(found - place).T) >= apart_m).all():
            found = np.vstack([found, place])
    return found


def least(places: Floats) -> float:
    """The least distance of two places."""
    one, other = np.triu_indices(len(places), 1)
    return float(np.hypot(*(places[one] - places[other]).T).min())


def by_osqp(places: Floats, wanted: Floats, fixed: Bools) -> Floats:
    """The same program, with all pairs in it, by another solver."""
    count = len(places)
    rows, limits = [], []
    for i in range(count):
        for j in range(i):
            gap = places[i] - places[j]
            row = np.zeros((count, 2))
            row[i], row[j] = 2 * gap, -2 * gap
            rows.append(row.ravel())
            limits.append(-GAIN * (gap @ gap - DISTANCE_M**2))
    held = np.repeat(fixed, 2)
    rows += [*np.eye(2 * count)[held]]
    lower = np.array([*limits, *np.zeros(held.sum())])
    upper = np.array([*np.full(len(limits), np.inf), *np.zeros(held.sum())])
    solver = osqp.OSQP()
    solver.setup(
        sparse.eye(2 * count, format="csc"),
        -np.where(held, 0.0, wanted.ravel()),
        sparse.csc_matrix(np.array(rows)),
        lower,
        upper,
        verbose=False,
        eps_abs=1e-9,
        eps_rel=1e-9,
        max_iter=100_000,
        polishing=True,
    )
    return np.asarray(solver.solve(raise_error=True).x).reshape(count, 2)


@pytest.mark.parametrize("seed", range(12))
def test_velocities_are_the_nearest_that_keep_robots_apart(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = crowd(int(rng.integers(2, 9)), rng)
    wanted = rng.uniform(-1.0, 1.0, places.shape)
    fixed = rng.random(len(places)) < 0.25
    found = certified(places, wanted, fixed, DISTANCE_M, GAIN)
    assert np.allclose(found, by_osqp(places, wanted, fixed), atol=1e-5)
    assert (found[fixed] == 0.0).all()


def test_who_meets_nobody_goes_as_it_wants() -> None:
    places = np.array([(0.0, 0.0), (5.0, 0.0), (0.0, 5.0)])
    wanted = np.array([(0.3, 0.1), (-0.2, 0.0), (0.0, -0.4)])
    nobody = np.zeros(3, np.bool_)
    assert (certified(places, wanted, nobody, DISTANCE_M, GAIN) == wanted).all()


def test_points_that_move_as_they_are_told_never_come_too_near() -> None:
    """Also with the greatest gain that there is for a step: the barrier is used up in one."""
    rng = np.random.default_rng(7)
    for dt_s, gain in [(0.05, 20.0), (0.05, 2.0), (0.2, 5.0)]:
        places = crowd(8, rng)
        nobody = np.zeros(8, np.bool_)
        nearest = []
        for _ in range(60):
            wanted = rng.uniform(-1, 1, 2) - (places - places.mean(0))  # all to the middle
            places = places + dt_s * certified(places, wanted, nobody, DISTANCE_M, gain)
            nearest.append(least(places))
        assert min(nearest) >= DISTANCE_M - 1e-9
        assert min(nearest) < DISTANCE_M + 0.01  # they came as near as they may


def test_a_step_keeps_the_barrier_whatever_the_numbers_are() -> None:
    """What the module says of one step: h' >= (1 - gain t) h >= 0, proved of all reals."""
    x, y, u, w, t, gain, distance = z3.Reals("x y u w t gain distance")
    before = x * x + y * y - distance * distance
    after = (x + t * u) * (x + t * u) + (y + t * w) * (y + t * w) - distance * distance
    as_sum = before + t * (2 * (x * u + y * w)) + t * t * (u * u + w * w)
    assert str(z3.simplify(after - as_sum, som=True)) == "0"
    barrier, rate, square = z3.Reals("barrier rate square")
    solver = z3.Solver()
    solver.add(t > 0, gain > 0, gain * t <= 1, barrier >= 0, square >= 0)
    solver.add(rate >= -gain * barrier)
    solver.add(barrier + t * rate + t * t * square < (1 - gain * t) * barrier)
    assert solver.check() == z3.unsat


def test_who_is_too_near_already_goes_apart() -> None:
    places = np.array([(0.0, 0.0), (0.2, 0.0)])
    nobody = np.zeros(2, np.bool_)
    found = certified(places, np.zeros((2, 2)), nobody, DISTANCE_M, GAIN)
    assert found[0, 0] < 0 < found[1, 0]


def test_where_nothing_keeps_them_apart_nobody_moves() -> None:
    """Three that stand too near in a row, of which only the middle one can move."""
    places = np.array([(-0.1, 0.0), (0.0, 0.0), (0.1, 0.0)])
    fixed = np.array([True, False, True])
    wanted = np.array([(0.0, 0.0), (0.3, 0.0), (0.0, 0.0)])
    assert (certified(places, wanted, fixed, DISTANCE_M, GAIN) == 0.0).all()


# --- what configurations say ----------------------------------------------------------------------

FLEET = """\
agents:
    - {pid: 0, on_device: one, position: [0, 0]}
    - {pid: 1, on_device: %s, position: [1, 0]}
devices:
    one: {bot_type: %s, planner: %s, controller: barrier, controller_options: {%s}}
    two: {bot_type: DIFF, planner: STRAIGHT}
world: {bounds: {low: [-2, -2, 0], high: [2, 2, 2]}}
"""

PROGRAM = """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target

Go:
    eff: Motion.target = pos3d(1, 1)
"""


@pytest.mark.parametrize(
    ("other", "type_", "planner", "options", "words", "line"),
    [
        ("one", "CAR", "RRT_CAR", "", "the controller barrier is for robots that turn on", 5),
        ("one", "DIFF", "STRAIGHT", "distance: -1", "Expected `float` > 0.0", 5),
        ("one", "DIFF", "STRAIGHT", "gain: 21", "Expected `float` <= 20.0", 5),
        ("two", "DIFF", "STRAIGHT", "", "the controller barrier does not know the robots that", 5),
    ],
)
def test_what_is_wrong_with_certificates_is_told(
    other: str, type_: str, planner: str, options: str, words: str, line: int
) -> None:
    text = FLEET % (other, type_, planner, options)
    with pytest.raises(KoordError) as refused:
        koord.simulate(Source("go.krd", PROGRAM), load(Source("fleet.yaml", text)), rounds=1)
    (diagnostic, *_) = refused.value.diagnostics
    assert words in diagnostic.message
    assert diagnostic.span.line == line


def test_certificates_are_not_for_robots_by_themselves() -> None:
    text = (FLEET % ("one", "DIFF", "STRAIGHT", "")).replace(
        "controller: barrier", "driver: sim, controller: barrier"
    )
    with pytest.raises(KoordError) as refused:
        koord.deploy(
            Source("go.krd", PROGRAM), load(Source("fleet.yaml", text)), rounds=1, dry_run=True
        )
    (diagnostic, *_) = refused.value.diagnostics
    assert "the controller barrier has to know where all robots are" in diagnostic.message


def test_certificates_are_listed() -> None:
    (barrier,) = [one for one in koord.installed_plug_ins()["controller"] if one.name == "barrier"]
    assert barrier.options == ("distance", "gain", "ahead", "aside")
    assert barrier.missing is None
