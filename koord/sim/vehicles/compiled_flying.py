"""Machine code of the motion law of drones, and of the automata of a group of them.

What :class:`.Flying`, :func:`.automaton.step` and :meth:`.Routes.at` compute, drone by drone and in
the same order of operations, so that what is sent is equal to the last bit. Tests hold the two
together.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from koord.machine.code import BYTES, I1, I8, I64, Code, Ir, Loaded, constant, new_module, word
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import ROUNDING_S, Automata, MotionState, Orders
from koord.runtime.motion.flying import APPROACH_S, CREEP_MPS, LAG_M, Flying
from koord.runtime.motion.group import Group
from koord.sim.vehicles.compiled import address

#: What the machine code is given the addresses of, in this order.
ARRAYS = (
    *("constants", "position", "rest", "sent", "s", "speed", "orders"),
    *("state", "since_s", "reached", "has_route", "resumes"),
    *("length", "size", "route_s", "speed2", "points", "tangent"),
)

#: Numbers that it is given, in this order.
CONSTANTS = (
    *("now_s", "epsilon_m", "leave_m", "least_dwell_s"),
    *("dt_s", "gain_mps", "two_accel_mps2", "cruise_mps"),
)

_SENT = 9  #: numbers for each drone: position, velocity and acceleration


class Table:
    """A table of the addresses of arrays, for machine code. It keeps them."""

    def __init__(self, size: int) -> None:
        self._words = (ctypes.c_int64 * size)()
        self._known: list[Any] = [None] * size
        self.address = ctypes.addressof(self._words)

    def point_to(self, first: int, *arrays: Any) -> None:
        """Let entries from the ``first`` on be these arrays."""
        for k, array in enumerate(arrays, first):
            if self._known[k] is not array:
                self._words[k], self._known[k] = address(array), array


class CompiledFlying(Flying):
    """The motion law of drones, by machine code that is made once in a process.

    It writes over the states of automata, which are the group's and nobody else's.
    """

    def __init__(self, group: Group, start: Floats) -> None:
        super().__init__(group, start)
        self._automata: Automata | None = None
        self._table = Table(len(ARRAYS))
        self._constants: Floats = np.empty(len(CONSTANTS))

    def step(self, position: Floats, now_s: float, dt_s: float) -> Floats:
        """Step the automata, and then the references. Shape ``(n, 9)``."""
        sent: Floats = np.empty((self.group.count, _SENT))
        self._constants[:] = self.constants(now_s, dt_s)
        arrays = self._constants, np.ascontiguousarray(position), self.rest, sent, *self.arrays()
        self._table.point_to(0, *arrays)
        flying_code()(self._table.address, self.group.count, self.group.routes.s.shape[1])
        return sent

    def constants(self, now_s: float, dt_s: float) -> tuple[float, ...]:
        """What the machine code is given in numbers, in the order of their names."""
        visit, pace = self.group.visit, self.group.routes.pace
        return (
            *(now_s, visit.epsilon_m, visit.leave_m, visit.dwell_s - ROUNDING_S, dt_s),
            *(pace.accel_mps2 * dt_s, 2 * pace.accel_mps2, pace.cruise_mps),
        )

    def arrays(self) -> tuple[Any, ...]:
        """The arrays of the group, in the order of their names from ``s`` on."""
        self.own()
        group, routes, automata = self.group, self.group.routes, self.group.automata
        return (
            *(group.s, group.speed, group.orders, automata.state, automata.since_s),
            *(automata.reached, automata.has_route, automata.resumes),
            *(routes.length, routes.size, routes.s, routes.speed2, routes.points, routes.tangent),
        )

    def own(self) -> None:
        """Let the states of automata be arrays of their own, if they are not yet."""
        if self.group.automata is self._automata:
            return
        given = self.group.automata
        self._automata = Automata(
            *(given.state.copy(), given.since_s.copy(), given.reached.copy()),
            *(given.has_route.copy(), given.resumes.copy()),
        )
        self.group.automata = self._automata


# --- the machine code -----------------------------------------------------------------------------


@cache
def flying_code() -> Callable[[int, int, int], int]:
    """Compile a tick of a group.

    The function takes the address of the table of arrays, the number of drones, and how many
    points there is room for in each route.
    """
    code = Code(new_module("flying"), "step", [BYTES, I64, I64], I64)
    table, count, room = code.arguments
    arrays = arrays_of(code, table, ARRAYS)
    lanes = Lanes(code, 1)
    numbers = numbers_of(lanes, arrays["constants"])
    with code.loop(word(0), count) as robot:
        one = OneDrone(lanes, arrays, numbers, robot, room, count)
        one.step_automaton()
        one.command()
    code.b.ret(word(0))
    return Loaded(code.function.module).function("step", 3)


def arrays_of(code: Code, table: Ir, names: Sequence[str]) -> dict[str, Ir]:
    """The arrays of a table, by name."""
    return {
        name: code.b.inttoptr(code.get(table, DOUBLE_BYTES * k, I64), BYTES)
        for k, name in enumerate(names)
    }


def numbers_of(lanes: Lanes, block: Ir) -> dict[str, Lane]:
    """The constants in a block, by name."""
    return {name: lanes.get(block, DOUBLE_BYTES * k) for k, name in enumerate(CONSTANTS)}


#: What robots become that were given a target, a route, or found no way.
_BECOMES = MotionState.PLANNING, MotionState.MOVING, MotionState.IDLE


class _Spot(Struct, frozen=True):
    """A point of a route, as ``Routes.at`` has it."""

    position: list[Lane]
    tangent: list[Lane]
    speed_mps: Lane


class OneDrone:
    """What is computed for one drone."""

    def __init__(
        self,
        lanes: Lanes,
        arrays: dict[str, Ir],
        numbers: dict[str, Lane],
        robot: Ir,
        room: Ir,
        count: Ir,
    ) -> None:
        self.code, self.lanes, self.arrays, self.of = lanes.code, lanes, arrays, numbers
        self.robot, self.room, self.count = robot, room, count
        self.position = self.where()

    def where(self) -> list[Lane]:
        """Where the drone is measured to be."""
        return self.three("position", self.robot)

    def send(self, row: int, axis: int, value: Lane) -> None:
        """Send a number: of position, velocity or acceleration."""
        first = self.code.b.mul(self.robot, word(_SENT))
        self.put("sent", self.code.b.add(first, word(3 * row + axis)), value)

    # --- arrays ---------------------------------------------------------------------------------

    def number(self, name: str, index: Ir) -> Lane:
        return self.lanes.get(self.arrays[name], self.code.b.mul(index, word(DOUBLE_BYTES)))

    def three(self, name: str, index: Ir) -> list[Lane]:
        first = self.code.b.mul(index, word(3))
        return [self.number(name, self.code.b.add(first, word(k))) for k in range(3)]

    def row(self, name: str, row: int) -> Lane:
        """What a row of an array says of the drone."""
        return self.lanes.get(self.arrays[name], self.place(row))

    def place(self, row: int) -> Ir:
        """Where in an array a row says something of the drone."""
        b = self.code.b
        index = b.add(b.mul(self.count, word(row)), self.robot)
        return b.mul(index, word(DOUBLE_BYTES))

    def put(self, name: str, index: Ir, value: Lane) -> None:
        self.lanes.put(self.arrays[name], self.code.b.mul(index, word(DOUBLE_BYTES)), value)

    def whole(self, name: str) -> Ir:
        at = self.code.b.mul(self.robot, word(DOUBLE_BYTES))
        return self.code.get(self.arrays[name], at, I64)

    def keep(self, name: str, value: Ir) -> None:
        """Store a whole number, or a truth value."""
        if value.type == I1:
            self.code.put(self.arrays[name], self.robot, self.code.b.zext(value, I8))
        else:
            at = self.code.b.mul(self.robot, word(DOUBLE_BYTES))
            self.code.put(self.arrays[name], at, value)

    def truth(self, name: str, index: Ir | None = None) -> Ir:
        held = self.code.get(self.arrays[name], self.robot if index is None else index, I8)
        return self.code.b.icmp_signed("!=", held, constant(I8, 0))

    def is_in(self, state: Ir, which: MotionState) -> Ir:
        return self.code.b.icmp_signed("==", state, word(which))

    # --- the automaton --------------------------------------------------------------------------

    def step_automaton(self) -> None:
        """A step on orders and the measurement, as ``automaton.step``."""
        b, of = self.code.b, self.of
        state, has_route, told = self.with_orders()
        size = self.whole("size")
        end = self.three("points", b.add(b.mul(self.robot, self.room), size))
        distance = _size([self.position[k] - end[k] for k in range(3)])
        runs = b.not_(self.is_in(state, MotionState.STOPPED))
        near = distance.is_at_most(of["epsilon_m"])
        inside = b.and_(b.and_(has_route, near), runs)
        none = self.lanes.constant(math.nan)
        before = self.either(told, none, self.number("since_s", self.robot))
        begun = before.where(before.is_at_most(math.inf), of["now_s"])
        since = self.either(inside, begun, none)
        dwelt = of["least_dwell_s"].is_at_most(of["now_s"] - since)
        dwelt = b.and_(inside, dwelt)
        here = b.or_(b.not_(has_route), distance.is_at_most(of["leave_m"]))
        was_there = b.and_(self.truth("reached"), b.not_(told))
        reached = b.and_(b.and_(b.or_(was_there, dwelt), here), runs)
        arrives = b.and_(self.is_in(state, MotionState.MOVING), reached)
        state = b.select(arrives, word(MotionState.IDLE), state)
        leaves = b.and_(b.and_(self.is_in(state, MotionState.IDLE), has_route), b.not_(reached))
        state = b.select(leaves, word(MotionState.MOVING), state)
        self.keep("state", state)
        self.put("since_s", self.robot, since)
        self.keep("reached", reached)

    def with_orders(self) -> tuple[Ir, Ir, Ir]:
        """The state under orders, whether there is a route, and whether there is another goal."""
        b = self.code.b
        state, resumes, has_route = (
            self.whole("state"),
            self.whole("resumes"),
            self.truth("has_route"),
        )
        ways, (held, released, stopped) = self.taken_orders()
        alive = b.not_(self.is_in(state, MotionState.STOPPED))
        holding = self.is_in(state, MotionState.HOLDING)
        any_way = constant(I1, 0)
        for asked, becomes in zip(ways, _BECOMES, strict=True):
            told = b.and_(asked, alive)
            state = b.select(b.and_(told, b.not_(holding)), word(becomes), state)
            resumes = b.select(b.and_(told, holding), word(becomes), resumes)
            has_route = b.select(told, constant(I1, becomes is MotionState.MOVING), has_route)
            any_way = b.or_(any_way, told)
        begins = b.and_(b.and_(held, alive), b.not_(holding))
        resumes = b.select(begins, state, resumes)
        state = b.select(begins, word(MotionState.HOLDING), state)
        goes_on = b.and_(b.and_(released, self.is_in(state, MotionState.HOLDING)), b.not_(held))
        state = b.select(goes_on, resumes, state)
        state = b.select(stopped, word(MotionState.STOPPED), state)
        self.keep("resumes", resumes)
        self.keep("has_route", has_route)
        return state, has_route, any_way

    def taken_orders(self) -> tuple[list[Ir], list[Ir]]:
        """The orders since the last step: for another way, and others; they are none any more."""
        found, b = [], self.code.b
        for row in range(len(Orders.__struct_fields__)):
            place = b.add(b.mul(self.count, word(row)), self.robot)
            found.append(self.truth("orders", place))
            self.code.put(self.arrays["orders"], place, constant(I8, 0))
        return found[:3], found[3:]

    # --- the reference --------------------------------------------------------------------------

    def command(self) -> None:
        """The reference at the end of a tick, as ``Flying.command``."""
        b, of = self.code.b, self.of
        state, routed = self.whole("state"), self.truth("has_route")
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
        third = b.mul(self.robot, word(3))
        for k in range(3):
            at = self.either(routed, spot.position[k], rest[k])
            tangent = self.either(routed, spot.tangent[k], zero)
            self.put("rest", b.add(third, word(k)), at)
            for row, value in enumerate((at, wanted * tangent, gain * tangent)):
                self.send(row, k, value)

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
