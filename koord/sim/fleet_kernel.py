"""Machine code of ticks of fleets of several squads: drones, and what drives, that nothing is near.

What :meth:`.Fleet.advance_to` does for squads one after the other, in one call a round. It calls
the machine code that each squad has, and joins what comes of it to arrays of the whole fleet. What
squads on the ground do around it in Python (:meth:`.WheeledSquad.tick`, :meth:`.Floor.advance`,
:class:`.Room`) is written a second time here, in the same order of operations; tests hold the two
together. *Sure, or in doubt*: where a car has missed its way, or may touch something, it says so,
and the round is Python's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from operator import is_
from typing import Any

import numpy as np

from koord.machine.code import BYTES, I1, I64, WORD_BYTES, Code, Ir, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.group import Group
from koord.runtime.plugins.calls import PlugInError
from koord.sim.fleet import Fleet
from koord.sim.squad_kernel import TABLE as SQUAD_TABLE
from koord.sim.squad_kernel import FusedDrones, SquadArrays, is_undisturbed
from koord.sim.squads import STEP_S, STEPS
from koord.sim.stride_kernel import address_of
from koord.sim.vehicles.compiled import address
from koord.sim.vehicles.compiled_automata import Table
from koord.sim.vehicles.compiled_contact import CompiledWheels
from koord.sim.vehicles.compiled_legs import DrivenSquad
from koord.sim.vehicles.contact import GRIP_MPS2
from koord.sim.vehicles.room import FURTHEST_M, SLACK_M

#: What the machine code is given in a table, before a block of words for each squad.
_FLEET = ("times", "places", "short", "state", "reached", "heading", "tilts")

#: What it is given of a squad of drones, and of one of cars.
_DRONES = (
    *("tick", "table", "count", "room", "numbers", "places", "short"),
    *("state", "reached", "tilts"),
)
_CARS = (
    *("track", "table", "count", "room", "columns", "numbers", "roam", "dt", "bodies"),
    *("command", "steering", "shown", "position", "heading", "speed", "constants", "phase"),
    *("left", "walls", "wall_count", "radius", "state", "reached", "points", "size", "epsilon"),
    "every",
)

_PLACE = 3 * DOUBLE_BYTES
_TIMES_AT = WORD_BYTES * SQUAD_TABLE.index("times")

#: In so long vehicles may move so far besides what their velocity takes them.
_SPAN_S = STEP_S * STEPS

#: Of so many cars at most it is looked here which are near to each other: all pairs are.
_MOST_CARS = 1_500


class _Part:
    """A squad, with the numbers of its robots in the fleet."""

    def __init__(self, group: Group, numbers: Ints) -> None:
        self.group, self.numbers = group, np.ascontiguousarray(numbers)
        self.written: tuple[Any, ...] = ()
        self._known: tuple[Any, ...] = ()
        self._words: Ints = np.zeros(0, np.int64)

    def _is_known(self, arrays: Sequence[Any]) -> bool:
        """Return whether arrays are those of the last block; remember them."""
        known, self._known = self._known, tuple(arrays)
        return len(known) == len(arrays) and all(map(is_, arrays, known))


class DronesPart(_Part):
    """A squad of drones."""

    kind = "drones"

    def __init__(self, squad: FusedDrones, numbers: Ints) -> None:
        super().__init__(squad.group, numbers)
        self.squad = squad
        count = len(numbers)
        self._short: Floats = np.empty(count)
        self._places: Floats = np.empty(0)
        self._table = Table(len(SQUAD_TABLE))

    def room_for(self, ticks: int) -> None:
        """Make room for so many ticks in a round."""
        self._places = np.empty((ticks, len(self.numbers), 3))

    @property
    def is_settled(self) -> bool:
        return self.squad.is_settled

    def block(self, now_s: float) -> Ints:
        arrays, group = self.squad.arrays(now_s), self.group
        own = self._places, self._short
        if self._is_known((*arrays.whole, *own)):
            return self._words
        self.written = arrays.written
        self._table.point_to(0, *arrays.whole)
        self._table.point_to(SQUAD_TABLE.index("places"), *own)
        self._words = np.array(
            [
                *(address_of(self.squad.code), self._table.address, len(self.numbers)),
                *(group.routes.s.shape[1], *map(address, (self.numbers, *own))),
                *map(address, (group.automata.state, group.automata.reached, arrays.tilts)),
            ],
            np.int64,
        )
        return self._words

    def pass_ticks(self, ticks: int, places: Floats, short: Floats) -> None:
        self.squad.pass_ticks(ticks, places[self.numbers], short[self.numbers])


class CarsPart(_Part):
    """A squad of vehicles on the ground, which has the floor for itself."""

    kind = "cars"

    def __init__(self, squad: DrivenSquad, numbers: Ints) -> None:
        super().__init__(squad.group, numbers)
        assert isinstance(squad.vehicles, CompiledWheels)
        self.squad, self.cars = squad, squad.vehicles
        self._table = Table(len(squad.names))
        self._dt: Floats = np.full(1, STEP_S)
        self._shown: Floats = np.empty((len(numbers), 4))
        self._left: Floats = np.zeros(1)
        self._phase: Ints = np.zeros(1, np.int64)
        self._limits: Floats = np.array([self.cars.floor.radius_m, self.group.visit.epsilon_m])

    @staticmethod
    def fits(squad: DrivenSquad) -> bool:
        """Return whether the ticks of a squad can be made so."""
        cars = squad.vehicles
        is_alone = isinstance(cars, CompiledWheels) and cars.floor.is_of(cars)
        is_small = squad.group.count <= _MOST_CARS
        return is_alone and is_small and is_undisturbed(squad.disturbances)

    @property
    def is_settled(self) -> bool:
        return True

    def block(self, now_s: float) -> Ints:
        squad, floor, group = self.squad, self.cars.floor, self.group
        self._left[0], self._phase[0] = floor.room.left_m, squad.phase
        model, steering = self.cars.own_model(), self.cars.steering
        given = squad.arrays(now_s, model.position, model.heading, model.speed)
        moved = model.position, model.heading, model.speed, floor.bodies, steering, self._left
        if self._is_known((*given, *moved)):
            return self._words
        self.written = (*moved, *squad.written(given))
        self._table.point_to(0, *given)
        constants, routes, automata = given[0], group.routes, group.automata
        shapes = len(self.numbers), routes.s.shape[1], squad.columns
        of_cars = (
            *(self._dt, floor.bodies, squad.command, steering, self._shown),
            *(model.position, model.heading, model.speed, constants, self._phase),
            *(self._left, floor.room.walls),
        )
        self._words = np.array(
            [
                *(address_of(squad.code), self._table.address, *shapes, address(self.numbers)),
                *(address_of(self.cars.code), *map(address, of_cars), len(floor.room.walls)),
                *(address(self._limits), address(automata.state), address(automata.reached)),
                *(address(routes.points), address(routes.size), address(self._limits) + WORD_BYTES),
                squad.every,
            ],
            np.int64,
        )
        return self._words

    def pass_ticks(self, ticks: int, places: Floats, short: Floats) -> None:
        self.squad.pass_ticks(ticks)
        self.cars.roamed(self.squad.command, float(self._left[0]))


class FusedFleet:
    """The squads of a fleet, whose ticks are made in one call a round."""

    #: Where in the table what is another array in each round stands.
    moving = tuple(map(_FLEET.index, ("times", "places", "short")))
    route_room = 0  #: each squad has its own

    @staticmethod
    def of(fleet: Fleet) -> FusedFleet | None:
        """The squads of a fleet; None if one of them is of another kind."""
        parts: list[DronesPart | CarsPart] = []
        for squad, numbers in fleet.squads:
            if isinstance(squad, FusedDrones):
                parts.append(DronesPart(squad, numbers))
            elif isinstance(squad, DrivenSquad) and CarsPart.fits(squad):
                parts.append(CarsPart(squad, numbers))
            else:
                return None
        return FusedFleet(parts, len(fleet.robots)) if fleet.is_whole else None

    def __init__(self, parts: Sequence[DronesPart | CarsPart], count: int) -> None:
        self._parts = parts
        self.groups = [part.group for part in parts]
        self.state: Ints = np.zeros(count, np.int64)
        self.reached: Bools = np.zeros(count, np.bool_)
        self.heading: Floats = np.zeros(count)
        #: Of what roll and pitch are worked out; who drives is upright.
        self._tilts: Floats = np.zeros((3, count))
        self._tilts[1] = 1.0
        self.table_size = len(_FLEET) + len(parts)
        self.code = _fleet_code(tuple(part.kind for part in parts))

    def room_for(self, ticks: int) -> None:
        """Make room for so many ticks in a round."""
        for part in self._parts:
            if isinstance(part, DronesPart):
                part.room_for(ticks)

    @property
    def is_settled(self) -> bool:
        """Whether states are those of the last tick."""
        return all(part.is_settled for part in self._parts)

    def arrays(self, now_s: float) -> SquadArrays:
        """The arrays that ticks are given; the first ones are others at each tick."""
        blocks = [part.block(now_s) for part in self._parts]
        own = self.state, self.reached, self.heading, self._tilts
        written = [array for part in self._parts for array in part.written]
        whole = (*[self.heading] * len(self.moving), *own, *blocks)
        return SquadArrays(whole, (*written, *own), self._tilts)

    def plan(self, now_s: float) -> None:
        """Plan ways to targets, as the next tick does first."""
        for part in self._parts:
            try:
                part.squad.plan(now_s)
            except PlugInError as error:
                raise error.of(int(part.numbers[error.row])) from error

    def pass_ticks(self, ticks: int, places: Floats, short: Floats) -> None:
        """Note an even number of ticks that were made."""
        for part in self._parts:
            part.pass_ticks(ticks, places, short)


# --- the machine code -----------------------------------------------------------------------------


@cache
def _fleet_code(kinds: tuple[str, ...]) -> Callable[..., int]:
    """Compile ticks of a fleet of squads of some kinds.

    The function takes the address of the table, the number of robots, nothing, how many ticks there
    are, and how many steps in each. It returns 0, and 1 in doubt: then states are no longer what
    they were.
    """
    return kept("fleets", (kinds,), lambda: _fleet(kinds)).function("fleet", 5)


def _fleet(kinds: tuple[str, ...]) -> Ir:
    code = Code(new_module("fleets"), "fleet", [BYTES, *[I64] * 4], I64)
    table, count, _, ticks, steps = code.arguments
    of = {name: code.get(table, WORD_BYTES * k, I64) for k, name in enumerate(_FLEET)}
    for k, kind in enumerate(kinds, len(_FLEET)):
        block = code.pointer(code.get(table, WORD_BYTES * k, I64))
        if kind == "drones":
            _DronesCode(code, of, block, _DRONES, count).ticks(ticks, steps)
        else:
            _CarsCode(code, of, block, _CARS, count).ticks(ticks, steps)
    code.b.ret(word(0))
    return code.function.module


class _PartCode:
    """What is computed for a squad; each robot's results go to its place in the fleet's arrays."""

    def __init__(
        self, code: Code, fleet: dict[str, Ir], block: Ir, names: Sequence[str], robots: Ir
    ) -> None:
        self.code, self.b, self.lanes = code, code.b, Lanes(code, 1)
        self.fleet, self.robots = fleet, robots
        self.of = {name: code.get(block, WORD_BYTES * k, I64) for k, name in enumerate(names)}
        self.count = self.of["count"]

    def times(self, number: Ir, size: Ir | int) -> Ir:
        return self.b.mul(number, word(size) if isinstance(size, int) else size)

    def at(self, base: Ir, number: Ir, size: int = DOUBLE_BYTES) -> Ir:
        """The address of a number of an array, of so many bytes each."""
        return self.code.pointer(self.b.add(base, self.times(number, size)))

    def get(self, name: str, number: Ir) -> Lane:
        """A double of the squad."""
        return self.lanes.get(self.at(self.of[name], number), 0)

    def put(self, name: str, number: Ir, value: Lane) -> None:
        self.lanes.put(self.at(self.of[name], number), 0, value)

    def three(self, base: Ir, number: Ir) -> list[Lane]:
        place = self.at(base, number, _PLACE)
        return [self.lanes.get(place, DOUBLE_BYTES * axis) for axis in range(3)]

    def number(self, robot: Ir) -> Ir:
        """The number in the fleet of a robot."""
        return self.code.get(self.at(self.of["numbers"], robot), 0, I64)

    def show_place(self, tick: Ir, robot: Ir, place: Sequence[Lane]) -> None:
        """Store where a robot is after a tick."""
        row = self.b.add(self.times(tick, self.robots), self.number(robot))
        there = self.at(self.fleet["places"], row, _PLACE)
        for axis, value in enumerate(place):
            self.lanes.put(there, DOUBLE_BYTES * axis, value)

    def show(self, robot: Ir, short_m: Lane) -> None:
        """Store the state of an automaton, and how far its robot is from its goal."""
        number = self.number(robot)
        self.lanes.put(self.at(self.fleet["short"], number), 0, short_m)
        for name, type_, size in (("state", I64, WORD_BYTES), ("reached", I1, 1)):
            value = self.code.get(self.at(self.of[name], robot, size), 0, type_)
            self.code.put(self.at(self.fleet[name], number, size), 0, value)


class _DronesCode(_PartCode):
    def ticks(self, ticks: Ir, steps: Ir) -> None:
        """Make the ticks of a round: the states of drones are where they were."""
        of, code = self.of, self.code
        code.put(code.pointer(of["table"]), _TIMES_AT, self.fleet["times"])
        code.called(of["tick"], [of["table"], self.count, of["room"], ticks, steps])
        with code.loop(word(0), ticks) as tick, code.loop(word(0), self.count) as robot:
            row = self.b.add(self.times(tick, self.count), robot)
            self.show_place(tick, robot, self.three(of["places"], row))
        with code.loop(word(0), self.count) as robot:
            self.show(robot, self.get("short", robot))
            number = self.number(robot)
            for row in range(3):
                here = self.b.add(self.times(self.count, row), robot)
                there = self.b.add(self.times(self.robots, row), number)
                tilt = self.get("tilts", here)
                self.lanes.put(self.at(self.fleet["tilts"], there), 0, tilt)


class _CarsCode(_PartCode):
    def ticks(self, ticks: Ir, steps: Ir) -> None:
        """Make the ticks of a round, as ``WheeledSquad.tick`` and ``Floor.advance``."""
        of, code, b = self.of, self.code, self.b
        phase = code.get(code.pointer(of["phase"]), 0, I64)
        with code.loop(word(0), ticks) as tick:
            now_s = self.lanes.get(self.at(self.fleet["times"], tick), 0)
            self.put("constants", word(0), now_s)
            acts = b.srem(b.add(phase, tick), of["every"])
            acts = b.zext(b.icmp_signed("==", acts, word(0)), I64)
            sizes = [self.count, of["room"], of["columns"], acts]
            missed = code.called(of["track"], [of["table"], *sizes])
            self._doubt(b.icmp_signed("!=", missed, word(0)))
            self._use_room()
            arrays = [of[name] for name in ("dt", "bodies", "command", "steering", "shown")]
            code.called(of["roam"], [*arrays, self.count, steps])
            with code.loop(word(0), self.count) as robot:
                self._move(tick, robot)
        with code.loop(word(0), self.count) as robot:
            width = code.get(self.at(of["size"], robot), 0, I64)
            end = self.three(of["points"], b.add(self.times(robot, of["room"]), width))
            here = self.three(of["position"], robot)
            x, y, z = (one - other for one, other in zip(here, end, strict=True))
            left = (x * x + y * y + z * z).sqrt() - self.get("epsilon", word(0))
            self.show(robot, left.greater(0.0))
            there = self.at(self.fleet["heading"], self.number(robot))
            self.lanes.put(there, 0, self.get("heading", robot))

    def _doubt(self, condition: Ir) -> None:
        with self.code.only_if(condition):
            self.b.ret(word(1))

    def _move(self, tick: Ir, robot: Ir) -> None:
        """Take over where a car is shown to be."""
        first = self.times(robot, 4)
        x, y, heading, speed = (self.get("shown", self.b.add(first, word(k))) for k in range(4))
        there = self.times(robot, 3)
        self.put("position", there, x)
        self.put("position", self.b.add(there, word(1)), y)
        self.put("heading", robot, heading)
        self.put("speed", robot, speed)
        self.show_place(tick, robot, self.three(self.of["position"], robot))

    # --- as Room --------------------------------------------------------------------------------

    def _body(self, robot: Ir, number: int) -> Lane:
        return self.get("bodies", self.b.add(self.times(robot, 6), word(number)))

    def _use_room(self) -> None:
        """Count that cars move, as ``Room.suffices``; in doubt where they may touch something."""
        code, b, zero = self.code, self.b, self.lanes.constant(0.0)

        def quicker(values: list[Ir]) -> list[Ir]:
            most, robot = Lane(self.lanes, values[0]), values[1]
            x, y = self._body(robot, 3), self._body(robot, 4)
            return [(x * x + y * y).greater(most).ir, b.add(robot, word(1))]

        most, _ = code.repeated(self.count, [zero.ir, word(0)], quicker)
        speed = Lane(self.lanes, most).sqrt()
        far_m = (speed + GRIP_MPS2 * _SPAN_S) * _SPAN_S + SLACK_M
        with code.only_if(b.not_(far_m.is_at_most(self.get("left", word(0))))):
            self._look()
        left = self.get("left", word(0)) - far_m
        self.put("left", word(0), left)
        self._doubt(b.not_(zero.is_at_most(left)))

    def _look(self) -> None:
        """Find how far cars may move, as ``room_m``."""
        code, b, radius = self.code, self.b, self.get("radius", word(0))
        zero, far = self.lanes.constant(0.0), self.lanes.constant(math.inf)

        def place(robot: Ir) -> tuple[Lane, Lane]:
            return self._body(robot, 0), self._body(robot, 1)

        nearest, apart = self._slot(far), self._slot(far)
        with code.loop(word(0), self.count) as robot:
            x, y = place(robot)
            with code.loop(word(0), self.of["wall_count"]) as wall:
                first = self.times(wall, 4)
                west, south, east, north = (
                    self.get("walls", b.add(first, word(k))) for k in range(4)
                )
                aside = (west - x).greater(x - east).greater(zero)
                above = (south - y).greater(y - north).greater(zero)
                self._keep(nearest, aside * aside + above * above)
            with code.loop(b.add(robot, word(1)), self.count) as other:
                gap_x, gap_y = (one - two for one, two in zip(place(other), (x, y), strict=True))
                self._keep(apart, gap_x * gap_x + gap_y * gap_y)
        room = (self._of(nearest).sqrt() - radius).lesser(FURTHEST_M)
        # Both of them move.
        self.put("left", word(0), room.lesser(self._of(apart).sqrt() / 2.0 - radius))

    def _slot(self, value: Lane) -> Ir:
        found = self.code.slot(value.ir.type)
        self.b.store(value.ir, found)
        return found

    def _of(self, slot: Ir) -> Lane:
        return Lane(self.lanes, self.b.load(slot))

    def _keep(self, slot: Ir, value: Lane) -> None:
        """Keep the lesser of two numbers."""
        self.b.store(value.lesser(self._of(slot)).ir, slot)
