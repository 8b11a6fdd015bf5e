"""Machine code of motion automata, and what is common to machine code of groups of robots.

What :func:`.automaton.step` computes, robot by robot and in the same order of operations, so that
states are equal to the last bit.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any

from koord.machine.code import BYTES, I1, I8, I64, Code, Ir, constant, word
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.automaton import ROUNDING_S, Automata, MotionState, Orders
from koord.runtime.motion.group import Group
from koord.sim.vehicles.compiled import address

#: The arrays of automata, and the numbers that they are given, in the order of :func:`automata_of`
#: and :func:`visit_of`.
AUTOMATA = ("orders", "state", "since_s", "reached", "has_route", "resumes")
VISIT = ("now_s", "epsilon_m", "leave_m", "least_dwell_s")


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

    def shift(self, which: int, size: int) -> None:
        """Let an entry that was pointed to another array be so many bytes behind its start."""
        self._words[which] += size


class OwnAutomata:
    """Automata that machine code writes over, which are a group's and nobody else's."""

    def __init__(self, group: Group) -> None:
        self._group = group
        self._automata: Automata | None = None

    def arrays(self) -> tuple[Any, ...]:
        """The orders of the group and the states of its automata, in the order of their names."""
        group, given = self._group, self._group.automata
        if given is not self._automata:
            self._automata = group.automata = given = Automata(
                *(given.state.copy(), given.since_s.copy(), given.reached.copy()),
                *(given.has_route.copy(), given.resumes.copy()),
            )
        states = given.state, given.since_s, given.reached, given.has_route, given.resumes
        return (group.orders, *states)

    def visit(self, now_s: float) -> tuple[float, ...]:
        """What automata are given in numbers, in the order of their names."""
        visit = self._group.visit
        return now_s, visit.epsilon_m, visit.leave_m, visit.dwell_s - ROUNDING_S


# --- the machine code -----------------------------------------------------------------------------


def arrays_of(code: Code, table: Ir, names: Sequence[str]) -> dict[str, Ir]:
    """The arrays of a table, by name."""
    return {
        name: code.b.inttoptr(code.get(table, DOUBLE_BYTES * k, I64), BYTES)
        for k, name in enumerate(names)
    }


def numbers_of(lanes: Lanes, block: Ir, names: Sequence[str]) -> dict[str, Lane]:
    """The constants in a block, by name."""
    return {name: lanes.get(block, DOUBLE_BYTES * k) for k, name in enumerate(names)}


#: What robots become that were given a target, a route, or found no way.
_BECOMES = MotionState.PLANNING, MotionState.MOVING, MotionState.IDLE


class OneRobot:
    """What is computed for one robot."""

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
        """Where the robot is measured to be."""
        return self.three("position", self.robot)

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
        distance = size_of([self.position[k] - end[k] for k in range(3)])
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

    def follows(self) -> Ir:
        """Whether it follows its route now, as ``automaton.moves``."""
        b, state = self.code.b, self.whole("state")
        idle = b.and_(self.is_in(state, MotionState.IDLE), self.truth("has_route"))
        return b.or_(self.is_in(state, MotionState.MOVING), idle)

    def either(self, condition: Ir, one: Lane, other: Lane) -> Lane:
        return Lane(self.lanes, self.code.b.select(condition, one.ir, other.ir))


def size_of(way: list[Lane]) -> Lane:
    x, y, z = way
    return (x * x + y * y + z * z).sqrt()
