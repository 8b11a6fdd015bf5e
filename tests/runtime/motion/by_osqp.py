"""The problems of predictive controllers, stated in matrices and solved by OSQP: an oracle."""

from __future__ import annotations

from typing import Any

import numpy as np
import osqp
from scipy import sparse

from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.motion.bodies import Car
from koord.runtime.motion.predictive import Weights
from koord.runtime.motion.pursuit import Course, Horizon, steering


class ByOsqp:
    """The predictive controllers of ``count`` cars. A car's solver is made on first use."""

    def __init__(
        self,
        count: int,
        car: Car,
        horizon: Horizon,
        weights: Weights = Weights(),
    ) -> None:
        self.car, self.horizon, self.weights = car, horizon, weights
        self.solvers: list[Any] = [None] * count
        self.found = [""] * count  #: what is said of the last answers
        n = 2 * horizon.steps
        self._upper = np.tril_indices(n)  # of the transpose: by columns, as OSQP has it
        change = np.eye(n) - np.eye(n, k=-2)
        self._limits = sparse.csc_matrix(np.vstack([np.eye(n), change]))
        cost = np.tile([weights.speed, weights.steering], horizon.steps)
        steady = np.tile([weights.speed_change, weights.steering_change], horizon.steps)
        self._input_cost = np.diag(cost) + change.T @ np.diag(steady) @ change
        self._change_cost = change.T @ np.diag(steady)
        rates = np.array([car.accel_mps2, car.steering_rate_radps])
        self._fastest = rates * horizon.step_s

    def inputs(
        self, cars: Ints, error: Floats, course: Course, way: Floats, last: Floats
    ) -> Floats:
        """Speeds of travel and steering angles for the cars with these numbers, shape ``(m, 2)``.

        ``error`` is ``(m, 3)``, ``way`` is -1 for cars that drive backwards, ``last`` the inputs
        that are in effect, ``(m, 2)``.
        """
        reference = self._reference(course, way)
        free, forced = self._predicted(error, course, way, reference)
        weigh = np.tile(
            [self.weights.along, self.weights.across, self.weights.heading], self.horizon.steps
        )
        quadratic = np.swapaxes(forced, 1, 2) @ (weigh[None, :, None] * forced)
        quadratic += self._input_cost
        flat = reference.reshape(len(cars), -1)
        change = flat - np.concatenate([last, flat[:, :-2]], axis=1)
        linear = np.einsum("mij,mi->mj", forced, weigh * free)
        # Not `@`: its last bit hangs on how many robots there are.
        linear += np.einsum("mi,ji->mj", change, self._change_cost)
        highest = np.empty_like(reference)
        highest[:, :, 0], highest[:, :, 1] = reference[:, :, 0], self.car.steering_rad
        lowest = -highest
        lowest[:, :, 0] = np.minimum(reference[:, :, 0], course.slowest_mps)
        low, high = lowest.reshape(flat.shape), highest.reshape(flat.shape)
        fastest = np.tile(self._fastest, self.horizon.steps)
        lower = np.concatenate([low - flat, -fastest - change], axis=1)
        upper = np.concatenate([high - flat, fastest - change], axis=1)
        # OSQP reads memory as it lies, and such a selection may lie by columns.
        packed = np.ascontiguousarray(quadratic[:, self._upper[1], self._upper[0]])
        linear, lower, upper = (np.ascontiguousarray(a) for a in (linear, lower, upper))
        answer = np.empty((len(cars), 2))
        for row, car in enumerate(cars.tolist()):
            answer[row] = self._solve(car, packed[row], linear[row], lower[row], upper[row])
        return np.clip(answer + reference[:, 0], low[:, :2], high[:, :2])

    def _reference(self, course: Course, way: Floats) -> Floats:
        angle = steering(course.curvature, way[:, None], self.car)
        return np.stack([course.speed_mps, angle], axis=2)

    def _predicted(
        self, error: Floats, course: Course, way: Floats, reference: Floats
    ) -> tuple[Floats, Floats]:
        """Predicted errors at the ends of the steps: the free response, and the gain per input.

        Shapes ``(m, 3 steps)`` and ``(m, 3 steps, 2 steps)``.
        """
        m, steps, dt = len(error), self.horizon.steps, self.horizon.step_s
        free, forced = np.empty((m, steps, 3)), np.zeros((m, steps, 3, 2 * steps))
        w, bend = course.speed_mps, course.curvature
        swing = way[:, None] * w / (self.car.wheelbase_m * np.cos(reference[:, :, 1]) ** 2)
        turn, advance = dt * bend * w, dt * w
        e = error
        for k in range(steps):
            moved = np.empty((m, 3))
            moved[:, 0] = e[:, 0] + turn[:, k] * e[:, 1]
            moved[:, 1] = e[:, 1] - turn[:, k] * e[:, 0] + advance[:, k] * e[:, 2]
            moved[:, 2] = e[:, 2]
            free[:, k] = e = moved
            if k:
                g, known = forced[:, k - 1], slice(0, 2 * k)
                forced[:, k, 0, known] = g[:, 0, known] + turn[:, k, None] * g[:, 1, known]
                forced[:, k, 1, known] = (
                    g[:, 1, known]
                    - turn[:, k, None] * g[:, 0, known]
                    + advance[:, k, None] * g[:, 2, known]
                )
                forced[:, k, 2, known] = g[:, 2, known]
            forced[:, k, 0, 2 * k] = dt
            forced[:, k, 1, 2 * k + 1] = advance[:, k] * dt * swing[:, k] / 2
            forced[:, k, 2, 2 * k] = dt * bend[:, k]
            forced[:, k, 2, 2 * k + 1] = dt * swing[:, k]
        return free.reshape(m, -1), forced.reshape(m, 3 * steps, -1)

    def _solve(
        self, car: int, packed: Floats, linear: Floats, lower: Floats, upper: Floats
    ) -> Floats:
        solver = self.solvers[car]
        if solver is None:
            n = 2 * self.horizon.steps
            matrix = np.zeros((n, n))
            matrix[self._upper[1], self._upper[0]] = packed
            solver = osqp.OSQP()
            # The step size stays what it is: OSQP would adapt it by the clock.
            solver.setup(
                sparse.csc_matrix((packed, *_pattern(n)), shape=(n, n)),
                linear,
                self._limits,
                lower,
                upper,
                verbose=False,
                adaptive_rho=False,
                rho=0.1,
                eps_abs=1e-3,
                eps_rel=1e-3,
                max_iter=100,
                check_termination=5,
                polishing=False,
                scaling=0,
            )
            # The extension itself: what Python wraps around it costs more than the solution.
            solver = self.solvers[car] = solver._solver
        else:
            solver.update_data_vec(q=linear, l=lower, u=upper)
            solver.update_data_mat(P_x=packed, P_i=None, A_x=None, A_i=None)
        solver.solve()
        self.found[car] = solver.info.status
        answer: Floats = solver.solution.x[:2]
        return answer


def _pattern(n: int) -> tuple[Ints, Ints]:
    """Row numbers and column starts of a full upper triangle, by columns."""
    rows = np.concatenate([np.arange(k + 1) for k in range(n)])
    starts = np.append(0, np.cumsum(np.arange(1, n + 1)))
    return rows, starts
