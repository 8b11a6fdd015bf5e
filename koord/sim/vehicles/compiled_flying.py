"""Machine code of the motion law of drones, and of the automata of a group of them.

What :class:`.Flying`, :func:`.automaton.step` and :meth:`.Routes.at` compute, drone by drone and in
the same order of operations, so that what is sent is equal to the last bit. A tick in which orders
came is left to NumPy as far as the automata go. Tests hold the two together.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from koord.machine.code import BYTES, I8, I64, Code, Ir, Loaded, constant, new_module, word
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import ROUNDING_S, Automata, MotionState
from koord.runtime.motion.flying import APPROACH_S, CREEP_MPS, LAG_M, Flying
from koord.runtime.motion.group import Group
from koord.sim.vehicles.compiled import address

#: What the machine code is given the addresses of, in this order.
_ARRAYS = (
    *("constants", "position", "rest", "sent"),
    *("s", "speed", "has_route", "state", "since_s", "reached"),
    *("next_state", "next_since_s", "next_reached"),
    *("length", "size", "route_s", "speed2", "points", "tangent"),
)

#: Numbers that it is given, in this order.
_CONSTANTS = (
    *("now_s", "epsilon_m", "leave_m", "least_dwell_s"),
    *("dt_s", "gain_mps", "two_accel_mps2", "cruise_mps"),
)

_SENT = 9  #: numbers for each drone: position, velocity and acceleration


class CompiledFlying(Flying):
    """The motion law of drones, by machine code that is made once in a process."""

    def __init__(self, group: Group, start: Floats) -> None:
        super().__init__(group, start)
        self._fly = flying_code()
        self._table = (ctypes.c_int64 * len(_ARRAYS))()
        self._known: list[Any] = [None] * len(_ARRAYS)
        self._constants: Floats = np.empty(len(_CONSTANTS))

    def step(self, position: Floats, now_s: float, dt_s: float) -> Floats:
        """Step the automata, and then the references. Shape ``(n, 9)``."""
        group, routes, pace = self.group, self.group.routes, self.group.routes.pace
        told = group.is_told()
        if told:
            group.update(position, now_s)
        visit, automata, count = group.visit, group.automata, group.count
        self._constants[:] = (
            now_s,
            visit.epsilon_m,
            visit.leave_m,
            visit.dwell_s - ROUNDING_S,
            dt_s,
            pace.accel_mps2 * dt_s,
            2 * pace.accel_mps2,
            pace.cruise_mps,
        )
        sent: Floats = np.empty((count, _SENT))
        after = Automata(
            np.empty(count, np.int64),
            np.empty(count),
            np.empty(count, np.bool_),
            automata.has_route,
            automata.resumes,
        )
        self._point_to(
            *(self._constants, np.ascontiguousarray(position), self.rest, sent),
            *(group.s, group.speed, automata.has_route),
            *(automata.state, automata.since_s, automata.reached),
            *(after.state, after.since_s, after.reached),
            *(routes.length, routes.size, routes.s, routes.speed2, routes.points, routes.tangent),
        )
        self._fly(ctypes.addressof(self._table), count, routes.s.shape[1], not told)
        if not told:
            group.automata = after
        return sent

    def _point_to(self, *arrays: Any) -> None:
        for k, (known, array) in enumerate(zip(self._known, arrays, strict=True)):
            if known is not array:
                self._table[k] = address(array)
        self._known[:] = arrays


# --- the machine code -----------------------------------------------------------------------------


@cache
def flying_code() -> Callable[[int, int, int, int], int]:
    """Compile a tick of a group.

    The function takes the address of the table of arrays, the number of drones, how many points
    there is room for in each route, and whether automata are to be stepped.
    """
    module = new_module("flying")
    code = Code(module, "step", [BYTES, I64, I64, I64], I64)
    table, count, room, steps = code.arguments
    b = code.b
    arrays = {
        name: b.inttoptr(code.get(table, DOUBLE_BYTES * k, I64), BYTES)
        for k, name in enumerate(_ARRAYS)
    }
    lanes = Lanes(code, 1)
    numbers = {
        name: lanes.get(arrays["constants"], DOUBLE_BYTES * k) for k, name in enumerate(_CONSTANTS)
    }
    with code.loop(word(0), count) as robot:
        one = _Drone(code, lanes, arrays, numbers, robot, room)
        with code.only_if(b.icmp_signed("!=", steps, word(0))):
            one.step_automaton()
        with code.only_if(b.icmp_signed("==", steps, word(0))):
            one.keep_automaton()
        one.command()
    b.ret(word(0))
    return Loaded(module).function("step", 4)


class _Spot(Struct, frozen=True):
    """A point of a route, as ``Routes.at`` has it."""

    position: list[Lane]
    tangent: list[Lane]
    speed_mps: Lane


class _Drone:
    """What is computed for one drone."""

    def __init__(
        self,
        code: Code,
        lanes: Lanes,
        arrays: dict[str, Ir],
        numbers: dict[str, Lane],
        robot: Ir,
        room: Ir,
    ) -> None:
        self.code, self.lanes, self.arrays, self.of = code, lanes, arrays, numbers
        self.robot, self.room = robot, room
        self.position = self.three("position", robot)

    # --- arrays ---------------------------------------------------------------------------------

    def number(self, name: str, index: Ir) -> Lane:
        return self.lanes.get(self.arrays[name], self.code.b.mul(index, word(DOUBLE_BYTES)))

    def three(self, name: str, index: Ir) -> list[Lane]:
        first = self.code.b.mul(index, word(3))
        return [self.number(name, self.code.b.add(first, word(k))) for k in range(3)]

    def put(self, name: str, index: Ir, value: Lane) -> None:
        self.lanes.put(self.arrays[name], self.code.b.mul(index, word(DOUBLE_BYTES)), value)

    def whole(self, name: str) -> Ir:
        at = self.code.b.mul(self.robot, word(DOUBLE_BYTES))
        return self.code.get(self.arrays[name], at, I64)

    def truth(self, name: str) -> Ir:
        held = self.code.get(self.arrays[name], self.robot, I8)
        return self.code.b.icmp_signed("!=", held, constant(I8, 0))

    def is_in(self, state: Ir, which: MotionState) -> Ir:
        return self.code.b.icmp_signed("==", state, word(which))

    # --- the automaton --------------------------------------------------------------------------

    def step_automaton(self) -> None:
        """A step without orders, as ``automaton.step``."""
        b, of = self.code.b, self.of
        state, has_route = self.whole("state"), self.truth("has_route")
        size = self.whole("size")
        end = self.three("points", b.add(b.mul(self.robot, self.room), size))
        distance = _size([self.position[k] - end[k] for k in range(3)])
        runs = b.not_(self.is_in(state, MotionState.STOPPED))
        near = distance.is_at_most(of["epsilon_m"])
        inside = b.and_(b.and_(has_route, near), runs)
        before = self.number("since_s", self.robot)
        begun = before.where(before.is_at_most(math.inf), of["now_s"])
        none = self.lanes.constant(math.nan)
        since = Lane(self.lanes, b.select(inside, begun.ir, none.ir))
        dwelt = of["least_dwell_s"].is_at_most(of["now_s"] - since)
        dwelt = b.and_(inside, dwelt)
        here = b.or_(b.not_(has_route), distance.is_at_most(of["leave_m"]))
        reached = b.and_(b.and_(b.or_(self.truth("reached"), dwelt), here), runs)
        arrives = b.and_(self.is_in(state, MotionState.MOVING), reached)
        state = b.select(arrives, word(MotionState.IDLE), state)
        leaves = b.and_(b.and_(self.is_in(state, MotionState.IDLE), has_route), b.not_(reached))
        state = b.select(leaves, word(MotionState.MOVING), state)
        self._keep(state, since, b.zext(reached, I8))

    def keep_automaton(self) -> None:
        """What a step with orders has found stays."""
        reached = self.code.b.zext(self.truth("reached"), I8)
        self._keep(self.whole("state"), self.number("since_s", self.robot), reached)

    def _keep(self, state: Ir, since: Lane, reached: Ir) -> None:
        at = self.code.b.mul(self.robot, word(DOUBLE_BYTES))
        self.code.put(self.arrays["next_state"], at, state)
        self.put("next_since_s", self.robot, since)
        self.code.put(self.arrays["next_reached"], self.robot, reached)

    # --- the reference --------------------------------------------------------------------------

    def command(self) -> None:
        """The reference at the end of a tick, as ``Flying.command``."""
        b, of = self.code.b, self.of
        state, routed = self.whole("next_state"), self.truth("has_route")
        idle = b.and_(self.is_in(state, MotionState.IDLE), routed)
        on = b.or_(self.is_in(state, MotionState.MOVING), idle)
        s, speed, length = (self.number(x, self.robot) for x in ("s", "speed", "length"))
        here = self.at(s)
        faster = (speed + of["gain_mps"]).lesser(here.speed_mps)
        lag = _size([here.position[k] - self.position[k] for k in range(3)])
        faster = faster * (2.0 - 2.0 * lag / LAG_M).greater(0.0).lesser(1.0)
        faster = faster.lesser(CREEP_MPS + (length - s) / APPROACH_S)
        slower = (speed - of["gain_mps"]).greater(0.0)
        wanted = self.either(on, faster, slower)
        zero = self.lanes.constant(0.0)
        goes = b.and_(routed, s.is_below(length))
        wanted = self.either(goes, wanted, zero)
        gain = (wanted - speed) / of["dt_s"]
        s = (s + wanted * of["dt_s"]).lesser(length)
        self.put("speed", self.robot, wanted)
        self.put("s", self.robot, s)
        spot, rest = self.at(s), self.three("rest", self.robot)
        first, third = b.mul(self.robot, word(_SENT)), b.mul(self.robot, word(3))
        for k in range(3):
            at = self.either(routed, spot.position[k], rest[k])
            tangent = self.either(routed, spot.tangent[k], zero)
            self.put("rest", b.add(third, word(k)), at)
            for row, value in enumerate((at, wanted * tangent, gain * tangent)):
                self.put("sent", b.add(first, word(3 * row + k)), value)

    def either(self, condition: Ir, one: Lane, other: Lane) -> Lane:
        return Lane(self.lanes, self.code.b.select(condition, one.ir, other.ir))

    def at(self, s: Lane) -> _Spot:
        """The point of the route at a length, as ``Routes.at``."""
        b = self.code.b
        size, row = self.whole("size"), b.mul(self.robot, self.room)

        def passed(now: list[Ir]) -> list[Ir]:
            found, place = now
            is_behind = self.number("route_s", b.add(row, place)).is_at_most(s)
            return [b.add(found, b.zext(is_behind, I64)), b.add(place, word(1))]

        found, _ = self.code.repeated(self.room, [word(0), word(0)], passed)
        last, k = b.sub(size, word(1)), b.sub(found, word(1))
        k = b.select(b.icmp_signed("<", k, last), k, last)
        k = b.select(b.icmp_signed("<", k, word(0)), word(0), k)
        here = b.add(row, k)
        there = b.add(here, b.zext(b.icmp_signed(">", size, word(0)), I64))
        begun, end = self.number("route_s", here), self.number("route_s", there)
        length = end - begun
        one = self.lanes.constant(1.0)
        whole = length.where(self.lanes.constant(0.0).is_below(length), one)
        share = ((s - begun) / whole).greater(0.0).lesser(1.0)
        at_end = one.is_at_most(share)  # it is not greater
        position = []
        for a, z in zip(self.three("points", here), self.three("points", there), strict=True):
            between = (a + share * (z - a)).greater(a.lesser(z)).lesser(a.greater(z))
            position.append(z.where(at_end, between))
        ahead = self.number("speed2", there) + self.of["two_accel_mps2"] * (end - s).greater(0.0)
        speed = ahead.sqrt().lesser(self.of["cruise_mps"])
        return _Spot(position, self.three("tangent", here), speed)


def _size(way: list[Lane]) -> Lane:
    x, y, z = way
    return (x * x + y * y + z * z).sqrt()
