"""Machine code of the motion law of drones, and of the automata of a group of them.

What :class:`.Flying`, :func:`.automaton.step` and :meth:`.Routes.at` compute, drone by drone and in
the same order of operations, so that what is sent is equal to the last bit. Tests hold the two
together.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from koord.machine.code import BYTES, I64, Code, Ir, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import Lane, Lanes
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.flying import APPROACH_S, CREEP_MPS, LAG_M, Flying
from koord.runtime.motion.group import Group
from koord.sim.vehicles.compiled_automata import (
    AUTOMATA,
    VISIT,
    OneRobot,
    OwnAutomata,
    Table,
    arrays_of,
    numbers_of,
    size_of,
)

#: What the machine code is given the addresses of, in this order.
ARRAYS = (
    *("constants", "position", "rest", "sent", "s", "speed", *AUTOMATA),
    *("length", "size", "route_s", "speed2", "points", "tangent"),
)

#: Numbers that it is given, in this order.
CONSTANTS = (*(*VISIT, "dt_s", "gain_mps", "two_accel_mps2", "cruise_mps"),)

_SENT = 9  #: numbers for each drone: position, velocity and acceleration


class CompiledFlying(Flying):
    """The motion law of drones, by machine code that is made once in a process.

    It writes over the states of automata, which are the group's and nobody else's.
    """

    def __init__(self, group: Group, start: Floats) -> None:
        super().__init__(group, start)
        self._own = OwnAutomata(group)
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
        pace = self.group.routes.pace
        return (
            *(*self._own.visit(now_s), dt_s),
            *(pace.accel_mps2 * dt_s, 2 * pace.accel_mps2, pace.cruise_mps),
        )

    def arrays(self) -> tuple[Any, ...]:
        """The arrays of the group, in the order of their names from ``s`` on."""
        group, routes = self.group, self.group.routes
        return (
            *(group.s, group.speed, *self._own.arrays()),
            *(routes.length, routes.size, routes.s, routes.speed2, routes.points, routes.tangent),
        )


# --- the machine code -----------------------------------------------------------------------------


@cache
def flying_code() -> Callable[[int, int, int], int]:
    """Compile a tick of a group.

    The function takes the address of the table of arrays, the number of drones, and how many
    points there is room for in each route.
    """
    return kept("flying", (), _flying).function("step", 3)


def _flying() -> Ir:
    code = Code(new_module("flying"), "step", [BYTES, I64, I64], I64)
    table, count, room = code.arguments
    arrays = arrays_of(code, table, ARRAYS)
    lanes = Lanes(code, 1)
    numbers = numbers_of(lanes, arrays["constants"], CONSTANTS)
    with code.loop(word(0), count) as robot:
        one = OneDrone(lanes, arrays, numbers, robot, room, count)
        one.step_automaton()
        one.command()
    code.b.ret(word(0))
    return code.function.module


class _Spot(Struct, frozen=True):
    """A point of a route, as ``Routes.at`` has it."""

    position: list[Lane]
    tangent: list[Lane]
    speed_mps: Lane


class OneDrone(OneRobot):
    """What is computed for one drone."""

    def send(self, row: int, axis: int, value: Lane) -> None:
        """Send a number: of position, velocity or acceleration."""
        first = self.code.b.mul(self.robot, word(_SENT))
        self.put("sent", self.code.b.add(first, word(3 * row + axis)), value)

    # --- the reference --------------------------------------------------------------------------

    def command(self) -> None:
        """The reference at the end of a tick, as ``Flying.command``."""
        b, of = self.code.b, self.of
        routed, on = self.truth("has_route"), self.follows()
        s, speed, length = (self.number(x, self.robot) for x in ("s", "speed", "length"))
        here = self.at(s)
        faster = (speed + of["gain_mps"]).lesser(here.speed_mps)
        lag = size_of([here.position[k] - self.position[k] for k in range(3)])
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
