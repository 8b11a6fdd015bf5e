"""Model-predictive path following for cars. (paper, VI-A)

The kinematic bicycle is linearised about the path. The errors along it, across it and in heading,
``e = (e_s, e_l, e_θ)``, follow, with the speed of travel ``w``, the steering angle ``φ``, the
path's curvature ``κ`` and ``d = ±1`` for driving forwards or backwards::

    e_s' = κ w e_l + Δw
    e_l' = w e_θ − κ w e_s
    e_θ' = κ Δw + d w / (L cos² φ_ref) Δφ          with tan φ_ref = d L κ

The inputs over the horizon are the unknowns of a quadratic program (the states are put in), with
the limits of speed, steering, and how fast both change (Kong et al. 2015). It is solved by the
alternating direction method of multipliers, as OSQP does it, with its settings, and for all cars
side by side; each starts from its last answer (Stellato et al. 2020). Cars have no part in each
other's numbers: each sum is added up in one order, and who is done stays as it is.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from koord.runtime.motion.angles import arc_tangent
from koord.runtime.motion.arrays import Bools, Floats, Ints, bounded
from koord.runtime.motion.bodies import Car
from koord.runtime.motion.pursuit import Course, Horizon


class Weights(Struct, frozen=True):
    """The weights of errors and inputs in the cost function."""

    along: float = 0.05
    across: float = 6.0
    heading: float = 1.0
    speed: float = 1.0
    steering: float = 0.05
    speed_change: float = 0.1
    steering_change: float = 0.15


#: The step of the multipliers; σ, which keeps answers near to each other; and over-relaxation.
STEP, SIGMA, ALPHA = 0.1, 1e-6, 1.6

#: What leaves no room is held with a step so much larger, if its limits are as near.
FIRMER, NO_ROOM = 1e3, 1e-4

#: An answer is near enough at this, absolute and relative, which is looked at after so many steps.
ENOUGH, LOOK_EVERY, LOOKS = 1e-3, 5, 20

#: Rows of what a controller is told: errors, speeds, curvatures, the way, the inputs in effect.
ERROR_ROWS, INPUT_ROWS = 3, 2


class Problem(Struct, frozen=True):
    """The constants of the problems of cars of one kind."""

    car: Car
    horizon: Horizon
    weights: Weights

    @property
    def unknowns(self) -> int:
        return INPUT_ROWS * self.horizon.steps

    @property
    def told_rows(self) -> int:
        return ERROR_ROWS + 2 * self.horizon.steps + 1 + INPUT_ROWS

    @property
    def kept_rows(self) -> int:
        """Rows of what a solver keeps: unknowns; limited inputs and changes; their multipliers."""
        return 5 * self.unknowns

    @property
    def steepest(self) -> float:
        """The tangent of the greatest steering angle."""
        return float(np.tan(self.car.steering_rad))

    @property
    def error_weights(self) -> tuple[float, float, float]:
        return self.weights.along, self.weights.across, self.weights.heading

    @property
    def cost(self) -> tuple[float, float]:
        return self.weights.speed, self.weights.steering

    @property
    def steady(self) -> tuple[float, float]:
        return self.weights.speed_change, self.weights.steering_change

    @property
    def fastest(self) -> tuple[float, float]:
        """How much inputs change in a step at most."""
        car, step_s = self.car, self.horizon.step_s
        return car.accel_mps2 * step_s, car.steering_rate_radps * step_s


class Predictive:
    """The predictive controllers of ``count`` cars."""

    def __init__(
        self,
        count: int,
        car: Car,
        horizon: Horizon,
        weights: Weights = Weights(),
    ) -> None:
        self.problem = Problem(car, horizon, weights)
        #: the last answers, and what belongs to them: shape ``(rows, count)``
        self.kept: Floats = np.zeros((self.problem.kept_rows, count))

    def inputs(
        self, cars: Ints, error: Floats, course: Course, way: Floats, last: Floats
    ) -> Floats:
        """Speeds of travel and steering angles for the cars with these numbers, shape ``(m, 2)``.

        ``error`` is ``(m, 3)``, ``way`` is -1 for cars that drive backwards, ``last`` the inputs
        that are in effect, ``(m, 2)``.
        """
        told = np.concatenate(
            [error.T, course.speed_mps.T, course.curvature.T, way[None], last.T], axis=0
        )
        found, self.kept[:, cars] = self.solved(told, self.kept[:, cars], course.slowest_mps)
        return found.T

    def solved(self, told: Floats, kept: Floats, slowest_mps: float) -> tuple[Floats, Floats]:
        """The inputs ``(2, m)``, and what is kept now; arguments have a column for each car."""
        problem = self.problem
        task, reference = _task(problem, told, slowest_mps)
        kept = _solution(task, kept)
        highest = np.array([reference[0], np.full_like(reference[0], problem.car.steering_rad)])
        lowest = np.array([np.minimum(reference[0], slowest_mps), -highest[1]])
        return bounded(kept[:INPUT_ROWS] + reference[:INPUT_ROWS], lowest, highest), kept


class _Task(Struct, frozen=True):
    """Quadratic programs, with a column for each car: minimise ½xᵀPx + qᵀx, limits on inputs x.

    And on their changes ``x[i] − x[i−2]``; limits of inputs come first.
    """

    quadratic: Floats  #: P, (n, n, m)
    linear: Floats  #: q, (n, m)
    lower: Floats  #: (2n, m)
    upper: Floats


def _task(problem: Problem, told: Floats, slowest_mps: float) -> tuple[_Task, Floats]:
    """What is to be solved, and the inputs of the path, from which unknowns are measured."""
    n, steps, dt = problem.unknowns, problem.horizon.steps, problem.horizon.step_s
    error, way, last = told[0:3], told[-3], told[-2:]
    speed, bend = told[3 : 3 + steps], told[3 + steps : 3 + 2 * steps]
    base_m = problem.car.wheelbase_m
    slope = bounded(way * base_m * bend, -problem.steepest, problem.steepest)
    reference = np.empty((n, told.shape[1]))
    reference[0::2], reference[1::2] = speed, arc_tangent(slope)
    swing = way * speed / base_m * (1.0 + slope * slope)
    turn, advance = dt * bend * speed, dt * speed

    # Predicted errors at the ends of steps, and how they hang on the inputs until then.
    gain = np.zeros((3, n, told.shape[1]))
    quadratic, linear = np.zeros((n, n, told.shape[1])), np.zeros((n, told.shape[1]))
    for k in range(steps):
        error = np.array(
            [
                error[0] + turn[k] * error[1],
                error[1] - turn[k] * error[0] + advance[k] * error[2],
                error[2],
            ]
        )
        gain = np.array(
            [
                gain[0] + turn[k] * gain[1],
                gain[1] - turn[k] * gain[0] + advance[k] * gain[2],
                gain[2],
            ]
        )
        gain[0, 2 * k] = dt
        gain[1, 2 * k + 1] = advance[k] * (dt / 2) * swing[k]
        gain[2, 2 * k], gain[2, 2 * k + 1] = dt * bend[k], dt * swing[k]
        for weight, g, e in zip(problem.error_weights, gain, error, strict=True):
            weighed = weight * g
            quadratic += weighed[:, None] * g
            linear += weighed * e

    change = reference - np.concatenate([last, reference[:-2]])
    fastest = np.tile(problem.fastest, steps)[:, None]
    highest = np.tile([0.0, problem.car.steering_rad], steps)[:, None]
    low, high = -highest - reference, highest - reference
    low[0::2], high[0::2] = np.minimum(speed, slowest_mps) - speed, 0.0
    for k in range(n):
        cost, steady = problem.cost[k % 2], problem.steady[k % 2]
        more = k + 2 < n
        quadratic[k, k] += cost + steady + (steady if more else 0.0)
        pull = steady * change[k]
        if more:
            quadratic[k, k + 2] -= steady
            quadratic[k + 2, k] -= steady
            pull = pull - steady * change[k + 2]
        linear[k] += pull
    lower = np.concatenate([low, -fastest - change])
    upper = np.concatenate([high, fastest - change])
    return _Task(quadratic, linear, lower, upper), reference


def _solution(task: _Task, kept: Floats) -> Floats:
    """The answers and what belongs to them, from what was kept of the last ones."""
    n, lower, upper = len(task.linear), task.lower, task.upper
    x, z, y = kept[:n], kept[n : 3 * n], kept[3 * n :]
    tight = upper - lower < NO_ROOM
    step = np.where(tight, FIRMER * STEP, STEP)
    back = np.where(tight, 1 / (FIRMER * STEP), 1 / STEP)
    inverse = task.quadratic.copy()
    for k in range(n):
        more = step[n + k + 2] if k + 2 < n else 0.0
        inverse[k, k] += SIGMA + step[k] + step[n + k] + more
        if k + 2 < n:
            inverse[k, k + 2] -= step[n + k + 2]
            inverse[k + 2, k] -= step[n + k + 2]
    _invert(inverse)
    done = np.zeros(x.shape[1], np.bool_)
    for _ in range(LOOKS):
        for _ in range(LOOK_EVERY):
            reached = _product(inverse, SIGMA * x - task.linear + _gathered(step * z - y))
            between = ALPHA * _spread(reached) + (1 - ALPHA) * z
            limited = bounded(between + back * y, lower, upper)
            y = np.where(done, y, y + step * (between - limited))
            x = np.where(done, x, ALPHA * reached + (1 - ALPHA) * x)
            z = np.where(done, z, limited)
        done = done | _is_near(task, x, z, y)
        if done.all():
            break
    return np.concatenate([x, z, y])


def _is_near(task: _Task, x: Floats, z: Floats, y: Floats) -> Bools:
    """Where answers are near enough: in their limits, in what they cost, and in the gap of both."""
    put, pulled, held = _spread(x), _product(task.quadratic, x), _gathered(y)
    off = _most(put - z) < ENOUGH + ENOUGH * np.maximum(_most(put), _most(z))
    slope = _most(pulled + task.linear + held)
    sizes = np.maximum(np.maximum(_most(pulled), _most(held)), _most(task.linear))
    flat = slope < ENOUGH + ENOUGH * sizes
    cost, line = _sum(x * pulled), _sum(task.linear * x)
    support = _sum(task.upper * np.maximum(y, 0.0) + task.lower * np.minimum(y, 0.0))
    sizes = np.maximum(np.maximum(np.abs(cost), np.abs(line)), np.abs(support))
    level = np.abs(cost + line + support) < ENOUGH + ENOUGH * sizes
    found: Bools = off & flat & level
    return found


def _invert(matrix: Floats) -> None:
    """Replace positive definite matrices ``(n, n, m)`` by their inverses (Gauss, Jordan)."""
    for k in range(len(matrix)):
        row = matrix[k].copy()
        pivot = 1.0 / row[k]
        row[k] = 1.0
        row *= pivot
        column = matrix[:, k].copy()
        matrix[:, k] = 0.0
        matrix -= column[:, None] * row
        matrix[k] = row


def _product(matrix: Floats, x: Floats) -> Floats:
    """Products of matrices ``(n, n, m)`` and vectors ``(n, m)``, added up from left to right."""
    found: Floats = np.add.accumulate(matrix * x, axis=1)[:, -1]
    return found


def _spread(x: Floats) -> Floats:
    """Inputs, and their changes from each step to the next: shape ``(2n, m)``."""
    found = np.concatenate([x, x])
    found[len(x) + 2 :] -= x[:-2]
    return found


def _gathered(y: Floats) -> Floats:
    """The transpose of ``_spread``."""
    n = len(y) // 2
    changed = y[n:].copy()
    changed[:-2] -= y[n + 2 :]
    return y[:n] + changed


def _most(rows: Floats) -> Floats:
    found: Floats = np.maximum.reduce(np.abs(rows))
    return found


def _sum(rows: Floats) -> Floats:
    """Sums over rows, added up from the first to the last."""
    found: Floats = np.add.accumulate(rows)[-1]
    return found
