"""Compiled kernels of :mod:`.quadrotors`, drone by drone: the level ``fast``.

By numba, the one file that imports it. The arithmetic is the same, operation by operation; a test
holds both to equal results.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Drone
from koord.runtime.motion.flying import GRAVITY, Gains, Reference
from koord.runtime.motion.libraries import missing
from koord.sim.vehicles.quadrotors import Quadrotors

try:
    from numba import njit
except ImportError as error:
    raise missing("numba", "fast") from error


class CompiledQuadrotors(Quadrotors):
    """Drones with attitude, compiled when they first fly (some seconds; cached on disk)."""

    def advance(self, reference: Reference, wind: Floats, dt_s: float, steps: int) -> None:
        """Fly for some steps. The reference moves on at its velocity; ``wind`` is ``(n, 3)``."""
        s = self.state
        _fly(
            s.position,
            s.velocity,
            s.attitude,
            s.rates,
            s.thrust,
            s.steady,
            reference.position,
            reference.velocity,
            reference.acceleration,
            wind,
            _constants(self.drone, self.gains),
            self.ground_m,
            dt_s,
            steps,
        )


def _constants(drone: Drone, gains: Gains) -> Floats:
    """The constants in the order in which the kernel unpacks them."""
    return np.array(
        [
            gains.position,
            gains.velocity,
            gains.attitude,
            gains.rate,
            gains.integral,
            gains.windup_mps2,
            drone.accel_mps2,
            math.tan(drone.tilt_rad),
            drone.thrust_ratio * GRAVITY,
            drone.drag_kgps / drone.mass_kg,
            drone.rotor_lag_s,
            *drone.inertia_kgm2,
            *drone.torque_nm,
        ]
    )


def _kernel(
    position: Any,
    velocity: Any,
    attitude: Any,
    rates: Any,
    thrust: Any,
    steady: Any,
    goal: Any,
    pace: Any,
    push: Any,
    wind: Any,
    constants: Any,
    ground: float,
    dt: float,
    steps: int,
) -> None:
    kp, kv, ka, kr, ki, windup, most_accel, most_tilt, most_thrust, drag, lag = constants[:11]
    jx, jy, jz, tx, ty, tz = constants[11:17]
    rise = 1.0 - math.exp(-dt / lag)
    for n in range(thrust.shape[0]):
        gx = goal[n, 0] - pace[n, 0] * (dt * steps)
        gy = goal[n, 1] - pace[n, 1] * (dt * steps)
        gz = goal[n, 2] - pace[n, 2] * (dt * steps)
        px, py, pz = position[0, n], position[1, n], position[2, n]
        vx, vy, vz = velocity[0, n], velocity[1, n], velocity[2, n]
        qw, qx, qy, qz = attitude[0, n], attitude[1, n], attitude[2, n], attitude[3, n]
        p, q, r = rates[0, n], rates[1, n], rates[2, n]
        force = thrust[n]
        ix, iy, iz = steady[0, n], steady[1, n], steady[2, n]
        for _ in range(steps):
            gx += pace[n, 0] * dt
            gy += pace[n, 1] * dt
            gz += pace[n, 2] * dt
            # position control
            dx, dy, dz = gx - px, gy - py, gz - pz
            ix = min(max(ix + (ki * dt) * dx, -windup), windup)
            iy = min(max(iy + (ki * dt) * dy, -windup), windup)
            iz = min(max(iz + (ki * dt) * dz, -windup), windup)
            ax = kp * dx + kv * (pace[n, 0] - vx) + (ix + push[n, 0])
            ay = kp * dy + kv * (pace[n, 1] - vy) + (iy + push[n, 1])
            az = kp * dz + kv * (pace[n, 2] - vz) + (iz + push[n, 2])
            size = math.sqrt(ax * ax + ay * ay + az * az)
            share = min(1.0, most_accel / max(size, 1e-9))
            ax, ay, az = ax * share, ay * share, az * share
            # axis and thrust
            up = max(az + GRAVITY, 1.0)
            flat = math.sqrt(ax * ax + ay * ay)
            share = min(1.0, up * most_tilt / max(flat, 1e-9))
            fx, fy = ax * share, ay * share
            size = math.sqrt(fx * fx + fy * fy + up * up)
            bx, by, bz = fx / size, fy / size, up / size
            asked = min(size, most_thrust)
            # attitude control
            c = math.sqrt(0.5 * (1.0 + bz))
            wx, wy = -by / (2 * c), bx / (2 * c)
            ew = qw * c + qx * wx + qy * wy
            gain = math.copysign(2.0 * ka, ew)
            rp = gain * (qw * wx - qx * c + qz * wy)
            rq = gain * (qw * wy - qy * c - qz * wx)
            rr = 0.4 * gain * (qy * wx - qx * wy - qz * c)
            # rate control and rotation
            sx, sy, sz = jx * p, jy * q, jz * r
            cx, cy, cz = q * sz - r * sy, r * sx - p * sz, p * sy - q * sx
            ux = min(max(jx * (kr * (rp - p)) + cx, -tx), tx)
            uy = min(max(jy * (kr * (rq - q)) + cy, -ty), ty)
            uz = min(max(jz * (kr * (rr - r)) + cz, -tz), tz)
            p += dt * (ux - cx) / jx
            q += dt * (uy - cy) / jy
            r += dt * (uz - cz) / jz
            hp, hq, hr = p * (0.5 * dt), q * (0.5 * dt), r * (0.5 * dt)
            aw = qw - (qx * hp + qy * hq + qz * hr)
            ex = qx + (qw * hp + qy * hr - qz * hq)
            ey = qy + (qw * hq + qz * hp - qx * hr)
            ez = qz + (qw * hr + qx * hq - qy * hp)
            size = math.sqrt(aw * aw + ex * ex + ey * ey + ez * ez)
            qw, qx, qy, qz = aw / size, ex / size, ey / size, ez / size
            # thrust and movement
            force += (asked - force) * rise
            lx = force * (2.0 * (qx * qz + qw * qy))
            ly = force * (2.0 * (qy * qz - qw * qx))
            lz = force * (1.0 - 2.0 * (qx * qx + qy * qy)) - GRAVITY
            vx += dt * (lx - drag * (vx - wind[n, 0]))
            vy += dt * (ly - drag * (vy - wind[n, 1]))
            vz += dt * (lz - drag * (vz - wind[n, 2]))
            px += dt * vx
            py += dt * vy
            pz += dt * vz
            if pz <= ground:
                pz, vx, vy, vz = ground, 0.0, 0.0, max(vz, 0.0)
        position[0, n], position[1, n], position[2, n] = px, py, pz
        velocity[0, n], velocity[1, n], velocity[2, n] = vx, vy, vz
        attitude[0, n], attitude[1, n], attitude[2, n], attitude[3, n] = qw, qx, qy, qz
        rates[0, n], rates[1, n], rates[2, n] = p, q, r
        thrust[n] = force
        steady[0, n], steady[1, n], steady[2, n] = ix, iy, iz


_fly = njit(cache=True)(_kernel)
