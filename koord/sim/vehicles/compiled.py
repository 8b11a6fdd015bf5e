"""Machine code of :mod:`.quadrotors`: the arithmetic of its steps, many drones at once.

Operation by operation it is that of :class:`.Quadrotors`, in the same order; so states are equal to
the last bit, and which of the two flies is no matter of a run. Tests hold them together. Drones lie
side by side in the lanes of registers, whose width is the processor's.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from functools import cache
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Drone
from koord.runtime.motion.flying import GRAVITY, Gains, Reference
from koord.runtime.motion.libraries import missing
from koord.sim.vehicles.quadrotors import FlightState, Quadrotors

try:
    from koord.machine.code import BYTES, F64, I64, Code, Ir, new_module, word
    from koord.machine.kept import kept
    from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes, widest
except ImportError as error:
    raise missing("llvmlite", "fast") from error

#: Rows of the state, as in `FlightState`; and of what is told: goal, pace, push and wind.
STATE_ROWS, TOLD_ROWS = 17, 12

#: Names of the constants, in the order in which they are passed.
_CONSTANTS = (
    *("kp", "kv", "ka", "kr", "ki_dt", "windup"),
    *("most_accel", "tan_tilt", "most_thrust", "drag", "rise"),
    *("jx", "jy", "jz", "tx", "ty", "tz"),
    *("ground", "dt", "half_dt", "span"),
)

#: x, y and z; or p, q and r.
_Three = tuple[Lane, Lane, Lane]


class CompiledQuadrotors(Quadrotors):
    """Drones with attitude, by machine code that is made once in a process (some 30 ms)."""

    def __init__(
        self, drone: Drone, start: Floats, ground_m: float = 0.0, gains: Gains | None = None
    ) -> None:
        """``start`` has shape ``(n, 3)``."""
        super().__init__(drone, start, ground_m, gains)
        self._fly = flight(widest())
        self._told: Floats = np.empty((TOLD_ROWS, len(start)))
        self._told_at = address(self._told)
        self._constants: Floats = np.empty(len(_CONSTANTS))
        self._constants_at = address(self._constants)
        self._steps: tuple[float, int] | None = None
        self._known: tuple[Floats, ...] = ()
        self._known_at = 0

    def advance(self, reference: Reference, wind: Floats, dt_s: float, steps: int) -> None:
        """Fly for some steps. The reference moves on at its velocity; ``wind`` is ``(n, 3)``."""
        told = self._told
        told[0:3] = reference.position.T
        told[3:6] = reference.velocity.T
        told[6:9] = reference.acceleration.T
        told[9:12] = wind.T
        if self._steps != (dt_s, steps):
            self._steps = dt_s, steps
            self._constants[:] = constants(self.drone, self.gains, self.ground_m, dt_s, steps)
        count = told.shape[1]
        if not self._is_known():
            self._show(np.vstack(parts(self.state)))
        # As in the reference, arrays of before stay what they were.
        after: Floats = np.empty((STATE_ROWS, count))
        self._fly(self._known_at, self._told_at, self._constants_at, address(after), count, steps)
        self._show(after)

    def _is_known(self) -> bool:
        """Return whether the state is that of the last steps, and not one that somebody has set."""
        known = self._known
        return bool(known) and all(map(is_, parts(self.state), known))

    def _show(self, block: Floats) -> None:
        """Let the state be what is in a block."""
        s = self.state
        s.position, s.velocity, s.attitude = block[0:3], block[3:6], block[6:10]
        s.rates, s.thrust, s.steady = block[10:13], block[13], block[14:17]
        self._known, self._known_at = parts(s), address(block)


def address(array: NDArray[Any]) -> int:
    """Where the numbers of an array are; quicker than NumPy says it."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array.data))


def parts(s: FlightState) -> tuple[Floats, ...]:
    """The rows of a state, in their order in a block of it."""
    return s.position, s.velocity, s.attitude, s.rates, s.thrust, s.steady


def constants(drone: Drone, gains: Gains, ground_m: float, dt_s: float, steps: int) -> list[float]:
    """What the machine code is passed, in the order of its names."""
    named = {
        "kp": gains.position,
        "kv": gains.velocity,
        "ka": 2.0 * gains.attitude,
        "kr": gains.rate,
        "ki_dt": gains.integral * dt_s,
        "windup": gains.windup_mps2,
        "most_accel": drone.accel_mps2,
        "tan_tilt": math.tan(drone.tilt_rad),
        "most_thrust": drone.thrust_ratio * GRAVITY,
        "drag": drone.drag_kgps / drone.mass_kg,
        "rise": 1.0 - math.exp(-dt_s / drone.rotor_lag_s),
        "ground": ground_m,
        "dt": dt_s,
        "half_dt": 0.5 * dt_s,
        "span": dt_s * steps,
        **dict(zip(("jx", "jy", "jz"), drone.inertia_kgm2, strict=True)),
        **dict(zip(("tx", "ty", "tz"), drone.torque_nm, strict=True)),
    }
    return [named[name] for name in _CONSTANTS]


# --- the machine code -----------------------------------------------------------------------------


@cache
def flight(width: int) -> Callable[[int, int, int, int, int, int], int]:
    """Compile the steps of drones, ``width`` of them at a time.

    The function takes the addresses of the state, shape ``(17, n)``, of what drones are told,
    ``(12, n)``, of the constants, and of an array for the state that comes of it; then n, and the
    number of steps.
    """
    return kept("flight", (width,), lambda: _flight(width)).function("fly", 6)


def _flight(width: int) -> Ir:
    module = new_module("flight")
    block = block_code(module, width)
    code = Code(module, "fly", [BYTES] * 4 + [I64] * 2, I64)
    before, told, given, after, count, steps = code.arguments
    fly_all(code, block, width, (before, told, given, after), count, steps)
    code.b.ret(word(0))
    return module


def fly_all(
    code: Code, block: Ir, width: int, arrays: tuple[Ir, Ir, Ir, Ir], count: Ir, steps: Ir
) -> None:
    """Fly all drones, block by block: from the state, what is told and constants, to the state."""
    before, told, given, after = arrays
    b = code.b
    rest = b.urem(count, word(width))
    whole = b.sub(count, rest)
    pitch = b.mul(count, word(DOUBLE_BYTES))
    with code.loop(word(0), b.udiv(whole, word(width))) as k:
        shift = b.mul(k, word(width * DOUBLE_BYTES))
        at = [code.at(rows, shift) for rows in (before, told)]
        b.call(block, [*at, given, code.at(after, shift), pitch, steps])
    # The last ones fly in a block of their own. What is left of its lanes flies as the last one.
    with code.only_if(b.icmp_signed("!=", rest, word(0))):
        narrow = width * DOUBLE_BYTES
        states, orders = code.block(STATE_ROWS * narrow), code.block(TOLD_ROWS * narrow)
        ends = code.block(STATE_ROWS * narrow)
        with code.loop(word(0), word(width)) as lane:
            last = b.sub(rest, word(1))
            inside = b.select(b.icmp_signed("<", lane, last), lane, last)
            source = b.mul(b.add(whole, inside), word(DOUBLE_BYTES))
            target = b.mul(lane, word(DOUBLE_BYTES))
            _copied(code, (before, source, pitch), (states, target, word(narrow)), STATE_ROWS)
            _copied(code, (told, source, pitch), (orders, target, word(narrow)), TOLD_ROWS)
        b.call(block, [states, orders, given, ends, word(narrow), steps])
        with code.loop(word(0), rest) as lane:
            source = b.mul(lane, word(DOUBLE_BYTES))
            target = b.mul(b.add(whole, lane), word(DOUBLE_BYTES))
            _copied(code, (ends, source, word(narrow)), (after, target, pitch), STATE_ROWS)


def _copied(code: Code, source: Sequence[Ir], target: Sequence[Ir], rows: int) -> None:
    """Copy a column of doubles between blocks; each has a start, and a pitch of its rows."""
    (one, first, step), (other, start, pace) = source, target
    for row in range(rows):
        value = code.get(one, code.b.add(first, code.b.mul(step, word(row))), F64)
        code.put(other, code.b.add(start, code.b.mul(pace, word(row))), value)


def block_code(module: Ir, width: int) -> Ir:
    """The function that flies one block of drones; rows are ``pitch`` bytes from each other."""
    code = Code(module, "block", [BYTES] * 4 + [I64] * 2, I64)
    code.function.linkage = "internal"
    before, told, given, after, pitch, steps = code.arguments
    lanes = Lanes(code, width)
    numbers = {
        name: lanes.spread(code.get(given, DOUBLE_BYTES * k, F64))
        for k, name in enumerate(_CONSTANTS)
    }
    state = [lanes.get(before, code.b.mul(pitch, word(k))) for k in range(STATE_ROWS)]
    orders = [lanes.get(told, code.b.mul(pitch, word(k))) for k in range(TOLD_ROWS)]
    pace = orders[3:6]
    # The reference is for the end of these steps.
    goal = [orders[k] - pace[k] * numbers["span"] for k in range(3)]
    step = _Step(numbers, orders)

    def body(values: list[Ir]) -> list[Ir]:
        now = [Lane(lanes, value) for value in values]
        return [value.ir for value in step.after(now[:STATE_ROWS], now[STATE_ROWS:])]

    ends = code.repeated(steps, [value.ir for value in (*state, *goal)], body)
    for k in range(STATE_ROWS):
        lanes.put(after, code.b.mul(pitch, word(k)), Lane(lanes, ends[k]))
    code.b.ret(word(0))
    return code.function


class _Step:
    """A step of drones under what they are told."""

    def __init__(self, numbers: dict[str, Lane], orders: Sequence[Lane]) -> None:
        self.of = numbers
        self.pace, self.push, self.wind = orders[3:6], orders[6:9], orders[9:12]

    def after(self, state: Sequence[Lane], goal: Sequence[Lane]) -> list[Lane]:
        """The state after a step, and the goal then."""
        of = self.of
        position, velocity, attitude = state[0:3], state[3:6], state[6:10]
        rates, force, steady = state[10:13], state[13], state[14:17]
        goal = [goal[k] + self.pace[k] * of["dt"] for k in range(3)]
        gap = [goal[k] - position[k] for k in range(3)]
        windup = of["windup"]
        steady = [
            (steady[k] + of["ki_dt"] * gap[k]).at_least(-windup).at_most(windup) for k in range(3)
        ]
        axis, asked = self.axis_and_thrust(self.acceleration(gap, velocity, steady))
        rates = self.turning(rates, self.body_rates(axis, attitude))
        attitude = self.turned(attitude, rates)
        force = force + (asked - force) * of["rise"]
        position, velocity = self.moved(position, velocity, self.pull(force, attitude))
        return [*position, *velocity, *attitude, *rates, force, *steady, *goal]

    def acceleration(
        self, gap: Sequence[Lane], velocity: Sequence[Lane], steady: Sequence[Lane]
    ) -> _Three:
        of = self.of
        x, y, z = (
            of["kp"] * gap[k] + of["kv"] * (self.pace[k] - velocity[k]) + (steady[k] + self.push[k])
            for k in range(3)
        )
        size = _size(x, y, z)
        share = (of["most_accel"] / size.at_least(1e-9)).at_most(1.0)
        return x * share, y * share, z * share

    def axis_and_thrust(self, wanted: _Three) -> tuple[_Three, Lane]:
        up = (wanted[2] + GRAVITY).at_least(1.0)
        flat = (wanted[0] * wanted[0] + wanted[1] * wanted[1]).sqrt()
        share = (up * self.of["tan_tilt"] / flat.at_least(1e-9)).at_most(1.0)
        x, y = wanted[0] * share, wanted[1] * share
        size = _size(x, y, up)
        return (x / size, y / size, up / size), size.at_most(self.of["most_thrust"])

    def body_rates(self, axis: _Three, attitude: Sequence[Lane]) -> _Three:
        qw, qx, qy, qz = attitude
        c = (0.5 * (1.0 + axis[2])).sqrt()
        wx, wy = -axis[1] / (2.0 * c), axis[0] / (2.0 * c)
        gain = self.of["ka"].signed_as(qw * c + qx * wx + qy * wy)
        return (
            gain * (qw * wx - qx * c + qz * wy),
            gain * (qw * wy - qy * c - qz * wx),
            0.4 * gain * (qy * wx - qx * wy - qz * c),
        )

    def turning(self, rates: Sequence[Lane], asked: _Three) -> _Three:
        """The rates after a step, under torques that are limited."""
        of = self.of
        inertia, torque = (of["jx"], of["jy"], of["jz"]), (of["tx"], of["ty"], of["tz"])
        p, q, r = rates
        x, y, z = (inertia[k] * rates[k] for k in range(3))
        couple = q * z - r * y, r * x - p * z, p * y - q * x
        found = []
        for k in range(3):
            wanted = inertia[k] * (of["kr"] * (asked[k] - rates[k])) + couple[k]
            tau = wanted.at_least(-torque[k]).at_most(torque[k])
            found.append(rates[k] + of["dt"] * (tau - couple[k]) / inertia[k])
        p, q, r = found
        return p, q, r

    def turned(self, attitude: Sequence[Lane], rates: _Three) -> Sequence[Lane]:
        qw, qx, qy, qz = attitude
        p, q, r = (rate * self.of["half_dt"] for rate in rates)
        w = qw - (qx * p + qy * q + qz * r)
        x = qx + (qw * p + qy * r - qz * q)
        y = qy + (qw * q + qz * p - qx * r)
        z = qz + (qw * r + qx * q - qy * p)
        size = (w * w + x * x + y * y + z * z).sqrt()
        return w / size, x / size, y / size, z / size

    def pull(self, force: Lane, attitude: Sequence[Lane]) -> _Three:
        """The acceleration by thrust and gravity."""
        qw, qx, qy, qz = attitude
        return (
            force * (2.0 * (qx * qz + qw * qy)),
            force * (2.0 * (qy * qz - qw * qx)),
            force * (1.0 - 2.0 * (qx * qx + qy * qy)) - GRAVITY,
        )

    def moved(
        self, position: Sequence[Lane], velocity: Sequence[Lane], pull: _Three
    ) -> tuple[Sequence[Lane], Sequence[Lane]]:
        of = self.of
        vx, vy, vz = (
            velocity[k] + of["dt"] * (pull[k] - of["drag"] * (velocity[k] - self.wind[k]))
            for k in range(3)
        )
        x, y, z = (at + of["dt"] * v for at, v in zip(position, (vx, vy, vz), strict=True))
        low = z.is_at_most(of["ground"])
        # A zero that is added makes one zero of both.
        still = vx.lanes.constant(0.0)
        vx, vy, vz = (
            still.where(low, vx),
            still.where(low, vy),
            (vz.at_least(0.0) + 0.0).where(low, vz),
        )
        return (x, y, of["ground"].where(low, z)), (vx, vy, vz)


def _size(x: Lane, y: Lane, z: Lane) -> Lane:
    return (x * x + y * y + z * z).sqrt()
