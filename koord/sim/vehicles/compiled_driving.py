"""Machine code of :mod:`koord.runtime.motion.predictive`: many cars side by side.

Operation by operation it is that of :class:`.Predictive`, in the same order; so inputs are equal to
the last bit, and which of the two drives is no matter of a run. Tests hold them together. Matrices
lie in memory of the call, a register of cars after the other; sums of products stay in registers.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache, reduce

import numpy as np

from koord.runtime.motion.angles import arc_tangent
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.libraries import missing
from koord.runtime.motion.predictive import (
    ALPHA,
    ENOUGH,
    FIRMER,
    INPUT_ROWS,
    LOOK_EVERY,
    LOOKS,
    NO_ROOM,
    SIGMA,
    STEP,
    Predictive,
    Problem,
)

try:
    from koord.machine.code import BYTES, F64, I64, Code, Ir, new_module, word
    from koord.machine.kept import kept
    from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes, widest
except ImportError as error:
    raise missing("llvmlite", "fast") from error


class CompiledPredictive(Predictive):
    """Predictive controllers by machine code, which is made once in a process, when it is used."""

    def solved(self, told: Floats, kept: Floats, slowest_mps: float) -> tuple[Floats, Floats]:
        count, width = told.shape[1], _width()
        # Lanes that are left over are copies of the first car.
        wide = np.arange(-(-count // width) * width)
        wide[count:] = 0
        orders = np.ascontiguousarray(told[:, wide])
        after = np.ascontiguousarray(kept[:, wide])
        found = np.empty((INPUT_ROWS, len(wide)))
        slowest = np.array([slowest_mps])
        told_at, kept_at = orders.ctypes.data, after.ctypes.data
        sizes = len(wide), len(wide)
        solve = _solver(self.problem, width)
        solve(slowest.ctypes.data, told_at, kept_at, found.ctypes.data, *sizes)
        return found[:, :count], after[:, :count]


_width = cache(widest)


@cache
def _solver(problem: Problem, width: int) -> Callable[..., int]:
    """Compile the solver of problems of a kind, ``width`` of them at a time."""

    def module() -> Ir:
        made = new_module("driving")
        write_solver(made, problem, width)
        return made

    return kept("driving", (problem, width), module).function("solve", 6)


def write_solver(module: Ir, problem: Problem, width: int) -> Ir:
    """Write the solver of problems of a kind, ``width`` of them at a time.

    The function takes the addresses of the slowest speed, of what cars are told, of what is kept of
    their last answers, which it replaces, and of an array for their inputs; then their number, a
    multiple of ``width``, and the columns of the arrays, of which it takes the first ones.
    """
    code = Code(module, "solve", [BYTES] * 4 + [I64] * 2, I64)
    slowest, told, kept, found, count, columns = code.arguments
    b, lanes = code.b, Lanes(code, width)
    pitch = b.mul(columns, word(DOUBLE_BYTES))
    made = _Solver(code, lanes, problem, lanes.spread(code.get(slowest, 0, F64)))
    with code.loop(word(0), b.udiv(count, word(width))) as block:
        shift = b.mul(block, word(width * DOUBLE_BYTES))
        rows = [_Rows(code, lanes, code.at(part, shift), pitch) for part in (told, kept, found)]
        made.solve(*rows)
    b.ret(word(0))
    return code.function


class _Rows:
    """Rows of numbers: in arrays that have a row for each, or in memory of the call."""

    def __init__(self, code: Code, lanes: Lanes, start: Ir, pitch: Ir) -> None:
        self._code, self._lanes, self._start, self._pitch = code, lanes, start, pitch

    def __getitem__(self, row: Ir | int) -> Lane:
        return self._lanes.get(self._start, self._offset(row))

    def __setitem__(self, row: Ir | int, value: Lane) -> None:
        self._lanes.put(self._start, self._offset(row), value)

    def _offset(self, row: Ir | int) -> Ir:
        return self._code.b.mul(self._pitch, word(row) if isinstance(row, int) else row)


class _Memory:
    """Registers in memory of the call, one after the other."""

    def __init__(self, code: Code, lanes: Lanes, count: int) -> None:
        self._code, self._lanes = code, lanes
        self._start = code.block(count * lanes.bytes)

    def __getitem__(self, place: Ir | int) -> Lane:
        return self._lanes.get(self._start, self._offset(place))

    def __setitem__(self, place: Ir | int, value: Lane) -> None:
        self._lanes.put(self._start, self._offset(place), value)

    def _offset(self, place: Ir | int) -> Ir | int:
        if isinstance(place, int):
            return place * self._lanes.bytes
        return self._code.b.mul(place, word(self._lanes.bytes))


class _Solver:
    """The code for one register of cars. Matrices are kept by columns.

    Where rows before the first or behind the last are asked for, there are two of zeros.
    """

    def __init__(self, code: Code, lanes: Lanes, problem: Problem, slowest: Lane) -> None:
        self.code, self.lanes, self.problem, self.slowest = code, lanes, problem, slowest
        n = self.n = problem.unknowns
        self.quadratic, self.inverse = (_Memory(code, lanes, n * n) for _ in range(2))
        self.linear, self.sent, self.pulled = (_Memory(code, lanes, n) for _ in range(3))
        self.lower, self.upper, self.back, self.z = (_Memory(code, lanes, 2 * n) for _ in range(4))
        self.step, self.y, self.pull = (_Memory(code, lanes, 2 * n + 2) for _ in range(3))
        self.gain, self.error = _Memory(code, lanes, 3 * n), _Memory(code, lanes, 3)
        self.change, self.done = _Memory(code, lanes, n + 2), _Memory(code, lanes, 1)
        # The first rows of these are before the first: zeros, and of references what is in effect.
        self.x, self.reached, self.reference = (_Memory(code, lanes, n + 2) for _ in range(3))

    def solve(self, told: _Rows, kept: _Rows, found: _Rows) -> None:
        n, b = self.n, self.code.b
        zero = self.lanes.constant(0.0)
        for k in range(2):
            for memory in (self.x, self.reached):
                memory[k] = zero
            for memory in (self.step, self.y, self.pull):
                memory[2 * n + k] = zero
            self.change[n + k] = zero
        with self._each(n) as k:
            self.x[self._plus(k, 2)] = kept[k]
        with self._each(2 * n) as k:
            self.z[k], self.y[k] = kept[self._plus(k, n)], kept[self._plus(k, 3 * n)]
        self._add_errors(told)
        self._add_inputs(told)
        self._set_up()
        self._invert()
        self.done[0] = zero
        looks = self.code.slot(I64)
        b.store(word(0), looks)
        with self.code.while_(lambda: b.and_(self._is_some_left(), self._is_less(looks, LOOKS))):
            with self._each(LOOK_EVERY):
                self._move()
            near = self._is_near()
            self.done[0] = self.lanes.constant(1.0).where(near, self.done[0])
            b.store(b.add(b.load(looks), word(1)), looks)
        with self._each(n) as k:
            kept[k] = self.x[self._plus(k, 2)]
        with self._each(2 * n) as k:
            kept[self._plus(k, n)], kept[self._plus(k, 3 * n)] = self.z[k], self.y[k]
        most = self.lanes.constant(self.problem.car.steering_rad)
        speed = self.reference[2]
        low, high = (speed.lesser(self.slowest), -most), (speed, most)
        for row in range(INPUT_ROWS):
            inputs = self.x[row + 2] + self.reference[row + 2]
            found[row] = inputs.greater(low[row]).lesser(high[row])

    # --- the problem ----------------------------------------------------------------------------

    def _add_errors(self, told: _Rows) -> None:
        """Work out what errors after each step have to do with the inputs, and what they cost."""
        problem, n, steps = self.problem, self.n, self.problem.horizon.steps
        zero, dt = self.lanes.constant(0.0), problem.horizon.step_s
        b, plus = self.code.b, self._plus
        for memory, count in ((self.quadratic, n * n), (self.linear, n), (self.gain, 3 * n)):
            with self._each(count) as place:
                memory[place] = zero
        for row in range(3):
            self.error[row] = told[row]
        way = told[3 + 2 * steps]
        with self._each(steps) as k:
            speed, bend = told[plus(k, 3)], told[plus(k, 3 + steps)]
            base_m = problem.car.wheelbase_m
            slope = (way * base_m * bend).greater(-problem.steepest).lesser(problem.steepest)
            first = b.mul(k, word(2))
            second = plus(first, 1)
            self.reference[plus(first, 2)] = speed
            self.reference[plus(first, 3)] = arc_tangent(slope)
            swing = way * speed / base_m * (1.0 + slope * slope)
            turn, advance = dt * bend * speed, dt * speed
            along, across, heading = (self.error[row] for row in range(3))
            self.error[0] = along + turn * across
            self.error[1] = across - turn * along + advance * heading
            with self._each(n) as i:
                g = [self.gain[plus(i, row * n)] for row in range(3)]
                self.gain[i] = g[0] + turn * g[1]
                self.gain[plus(i, n)] = g[1] - turn * g[0] + advance * g[2]
            self.gain[first] = self.lanes.constant(dt)
            self.gain[plus(second, n)] = advance * (dt / 2) * swing
            self.gain[plus(first, 2 * n)] = dt * bend
            self.gain[plus(second, 2 * n)] = dt * swing
            # Inputs of later steps have nothing to do with it: of these zeros would be added.
            inputs = plus(first, 2)
            with self.code.loop(word(0), inputs) as i:
                self._add_error(i, plus(k, 1))

    def _add_error(self, i: Ir, steps: Ir) -> None:
        """Add what input i of so many steps has to do with the errors then: row i of P, and q."""
        n, b = self.n, self.code.b
        weighed = [
            weight * self.gain[self._plus(i, row * n)]
            for row, weight in enumerate(self.problem.error_weights)
        ]
        with self.code.loop(word(0), steps) as step:
            for k in range(2):
                j = self._plus(b.mul(step, word(2)), k)
                place = b.add(i, b.mul(j, word(n)))
                sums = self.quadratic[place]
                for row in range(3):
                    sums = sums + weighed[row] * self.gain[self._plus(j, row * n)]
                self.quadratic[place] = sums
        sums = self.linear[i]
        for row in range(3):
            sums = sums + weighed[row] * self.error[row]
        self.linear[i] = sums

    def _add_inputs(self, told: _Rows) -> None:
        """Add what inputs and their changes cost, and their limits."""
        problem, n, steps = self.problem, self.n, self.problem.horizon.steps
        most, plus = problem.car.steering_rad, self._plus
        none = self.lanes.constant(0.0)
        for k in range(INPUT_ROWS):
            self.reference[k] = told[4 + 2 * steps + k]
        with self._each(n) as k:
            self.change[k] = self.reference[plus(k, 2)] - self.reference[k]
        costs = tuple(zip(problem.cost, problem.steady, problem.fastest, strict=True))
        with self._each(steps) as step:
            first = self.code.b.mul(step, word(2))
            for row, (_, steady, fast) in enumerate(costs):
                k = plus(first, row)
                change, reference = self.change[k], self.reference[plus(k, 2)]
                pull = steady * change - steady * self.change[plus(k, 2)]
                self.linear[k] = self.linear[k] + pull
                low, high = -most - reference, most - reference
                if row == 0:
                    low, high = reference.lesser(self.slowest) - reference, none
                self.lower[k], self.upper[k] = low, high
                changed = plus(k, n)
                self.lower[changed], self.upper[changed] = -fast - change, fast - change
        for row, (cost, steady, _) in enumerate(costs):
            with self._each(steps - 1) as step:
                k = plus(self.code.b.mul(step, word(2)), row)
                self._add(self.quadratic, k, k, cost + steady + steady)
                self._add(self.quadratic, k, plus(k, 2), -steady)
                self._add(self.quadratic, plus(k, 2), k, -steady)
            last = word(n - 2 + row)
            self._add(self.quadratic, last, last, cost + steady)

    def _add(self, matrix: _Memory, row: Ir, column: Ir, number: Lane | float) -> None:
        place = self.code.b.add(self.code.b.mul(column, word(self.n)), row)
        matrix[place] = matrix[place] + number

    # --- its solution ---------------------------------------------------------------------------

    def _set_up(self) -> None:
        """Set up the sizes of steps, and the matrix that each step takes the inverse of."""
        n, plus = self.n, self._plus
        with self._each(n * n) as place:
            self.inverse[place] = self.quadratic[place]
        with self._each(2 * n) as k:
            tight = (self.upper[k] - self.lower[k]).is_below(NO_ROOM)
            number = self.lanes.constant
            self.step[k] = number(FIRMER * STEP).where(tight, STEP)
            self.back[k] = number(1 / (FIRMER * STEP)).where(tight, 1 / STEP)
        with self._each(n) as k:
            held = self.step[plus(k, n)]
            self._add(self.inverse, k, k, SIGMA + self.step[k] + held + self.step[plus(k, n + 2)])
        with self._each(n - 2) as k:
            more = self.step[plus(k, n + 2)]
            self._add(self.inverse, k, plus(k, 2), -more)
            self._add(self.inverse, plus(k, 2), k, -more)

    def _invert(self) -> None:
        n, b = self.n, self.code.b
        row = _Memory(self.code, self.lanes, n)
        with self._each(n) as k:
            column = b.mul(k, word(n))
            pivot = 1.0 / self.inverse[b.add(column, k)]
            self.inverse[b.add(column, k)] = self.lanes.constant(1.0)
            for j in range(n):
                row[j] = self.inverse[self._plus(k, j * n)] * pivot
            with self._each(n) as i, self.code.only_if(b.icmp_signed("!=", i, k)):
                factor = self.inverse[b.add(column, i)]
                self.inverse[b.add(column, i)] = self.lanes.constant(0.0)
                for j in range(n):
                    place = self._plus(i, j * n)
                    self.inverse[place] = self.inverse[place] - factor * row[j]
            for j in range(n):
                self.inverse[self._plus(k, j * n)] = row[j]

    def _move(self) -> None:
        """Make one step of all cars that are not done."""
        n, plus = self.n, self._plus
        with self._each(2 * n) as k:
            self.pull[k] = self.step[k] * self.z[k] - self.y[k]
        with self._each(n) as k:
            changed = self.pull[plus(k, n)] - self.pull[plus(k, n + 2)]
            nearby = SIGMA * self.x[plus(k, 2)] - self.linear[k]
            self.sent[k] = nearby + (self.pull[k] + changed)
        self._multiply(self.inverse, (self.sent, 0), (self.reached, 2))
        done = self.lanes.constant(0.5).is_below(self.done[0])
        with self._each(n) as k:
            reached, x = self.reached[plus(k, 2)], self.x[plus(k, 2)]
            for row, put in ((k, reached), (plus(k, n), reached - self.reached[k])):
                z, y = self.z[row], self.y[row]
                between = ALPHA * put + (1 - ALPHA) * z
                limited = between + self.back[row] * y
                limited = limited.greater(self.lower[row]).lesser(self.upper[row])
                self.y[row] = y.where(done, y + self.step[row] * (between - limited))
                self.z[row] = z.where(done, limited)
            self.x[plus(k, 2)] = x.where(done, ALPHA * reached + (1 - ALPHA) * x)

    def _is_near(self) -> Ir:
        """A mask of the cars whose answers are near enough."""
        n, b, plus = self.n, self.code.b, self._plus
        self._multiply(self.quadratic, (self.x, 2), (self.pulled, 0))
        most = {name: _Memory(self.code, self.lanes, 1) for name in _MOST}
        sums = {name: _Memory(self.code, self.lanes, 1) for name in ("cost", "line", "support")}
        for memory in (*most.values(), *sums.values()):
            memory[0] = self.lanes.constant(0.0)

        def note(**values: Lane) -> None:
            for name, value in values.items():
                if name in most:
                    most[name][0] = most[name][0].greater(_size(value))
                else:
                    sums[name][0] = sums[name][0] + value

        def held(row: Ir, put: Lane) -> None:
            z, y = self.z[row], self.y[row]
            support = self.upper[row] * y.greater(0.0) + self.lower[row] * y.lesser(0.0)
            note(off=put - z, put=put, z=z, support=support)

        with self._each(n) as k:
            x, linear, pulled = self.x[plus(k, 2)], self.linear[k], self.pulled[k]
            pull = self.y[k] + (self.y[plus(k, n)] - self.y[plus(k, n + 2)])
            note(slope=pulled + linear + pull, pulled=pulled, held=pull, linear=linear)
            note(cost=x * pulled, line=linear * x)
            held(k, x)
        with self._each(n) as k:
            held(plus(k, n), self.x[plus(k, 2)] - self.x[k])
        size = {name: memory[0] for name, memory in most.items()}
        cost, line, support = (memory[0] for memory in sums.values())
        near = size["off"].is_below(ENOUGH + ENOUGH * size["put"].greater(size["z"]))
        sizes = size["pulled"].greater(size["held"]).greater(size["linear"])
        flat = size["slope"].is_below(ENOUGH + ENOUGH * sizes)
        sizes = _size(cost).greater(_size(line)).greater(_size(support))
        level = _size(cost + line + support).is_below(ENOUGH + ENOUGH * sizes)
        return b.and_(b.and_(near, flat), level)

    # --- parts ----------------------------------------------------------------------------------

    def _each(self, count: int) -> AbstractContextManager[Ir]:
        return self.code.loop(word(0), word(count))

    def _plus(self, place: Ir, number: int) -> Ir:
        return self.code.b.add(place, word(number))

    def _multiply(
        self, matrix: _Memory, vector: tuple[_Memory, int], to: tuple[_Memory, int]
    ) -> None:
        """Multiply, from a row on and into a row on; numbers are added up from left to right."""
        n, b = self.n, self.code.b
        (given, first), (found, start) = vector, to
        column = self.code.slot(I64)
        b.store(word(1), column)

        def body(sums: list[Ir]) -> list[Ir]:
            k = b.load(column)
            factor, at = given[self._plus(k, first)], b.mul(k, word(n))
            b.store(self._plus(k, 1), column)
            return [
                (Lane(self.lanes, sums[i]) + matrix[self._plus(at, i)] * factor).ir
                for i in range(n)
            ]

        begun = [(matrix[i] * given[first]).ir for i in range(n)]
        for i, end in enumerate(self.code.repeated(word(n - 1), begun, body)):
            found[start + i] = Lane(self.lanes, end)

    def _is_some_left(self) -> Ir:
        """Whether a car is not done."""
        b, done = self.code.b, self.done[0].ir
        counts = [b.extract_element(done, word(k)) for k in range(self.lanes.width)]
        return b.fcmp_ordered("<", reduce(b.fadd, counts), F64(self.lanes.width - 0.5))

    def _is_less(self, slot: Ir, bound: int) -> Ir:
        return self.code.b.icmp_signed("<", self.code.b.load(slot), word(bound))


_MOST = ("off", "put", "z", "slope", "pulled", "held", "linear")


def _size(value: Lane) -> Lane:
    return value.signed_as(value.lanes.constant(1.0))
