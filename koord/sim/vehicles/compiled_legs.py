"""Machine code of what all that drives does along its route, and squads whose ticks it makes.

What :class:`.Legs` and :class:`.Routes` compute, robot by robot and in the same order of
operations, so that it is equal to the last bit. Laws of motion are put on top of it: those of cars
in :mod:`.compiled_tracking`, that of differential drives in :mod:`.compiled_turning`. Tests hold
them together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np
from msgspec import Struct

from koord.machine.code import I1, I64, Ir, constant, word
from koord.machine.lanes import DOUBLE_BYTES, Lane
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.bodies import Pace
from koord.runtime.motion.driving import CREEP_MPS, DONE_M, LEAST_M, MISSED_S
from koord.runtime.motion.routes import WINDOW
from koord.sim.squads import SquadSetup, Tracker, Wheeled, WheeledSquad
from koord.sim.vehicles.compiled_automata import AUTOMATA, VISIT, OneRobot, OwnAutomata, Table

#: What machine code is given the addresses of: what is measured, and what it writes over of legs;
#: in between is what its law keeps. Behind it are routes, and what only it reads and writes.
MEASURED = ("constants", "position", "heading", "velocity", "command")
LEGS = ("legs_way", "waited", "missed", "s", "speed", *AUTOMATA)
ROUTES = (
    *("length", "size", "route_s", "speed2", "points", "tangent", "course", "turn"),
    *("curvature", "leg_end", "way", "going"),
)

#: Numbers that it is given, in this order; the last is how slowly courses are followed at least.
CONSTANTS = (*VISIT, "slowest")
SLOWEST_AT = DOUBLE_BYTES * (len(CONSTANTS) - 1)


class DrivenSquad(WheeledSquad):
    """A squad of vehicles on the ground by machine code that is made once in a process.

    It writes over the states of automata and laws, which are the squad's and nobody else's.
    """

    #: Names of what the law keeps, which machine code writes over; and of what nobody else sees.
    OWN: ClassVar[tuple[str, ...]]
    MORE: ClassVar[tuple[str, ...]] = ()

    columns = 0  #: for so many there is room side by side

    def __init__(
        self,
        setup: SquadSetup,
        vehicles: Wheeled,
        law: Tracker,
        code: Callable[..., int],
        every: int = 1,
    ) -> None:
        super().__init__(setup, vehicles, law, every)
        count = len(setup.start)
        self.code = code
        self.disturbances = setup.model.disturbances
        self._own = OwnAutomata(setup.group)
        self.names = arrays_in(self.OWN, self.MORE)
        self._table = Table(len(self.names))
        self._constants: Floats = np.full(len(CONSTANTS), CREEP_MPS)
        self._missed: Bools = np.zeros(count, np.bool_)
        self._going: Bools = np.zeros(count, np.bool_)
        self._written = range(self.names.index("command"), self.names.index(ROUTES[0]))

    def _track(self, position: Floats, heading: Floats, now_s: float, *, acts: bool) -> None:
        group = self.group
        state = map(np.ascontiguousarray, (position, heading, self.vehicles.speed))
        self._table.point_to(0, *self.arrays(now_s, *state))
        sizes = group.count, group.routes.s.shape[1], self.columns
        missed = self.code(self._table.address, *sizes, acts)
        if missed:
            group.replan(np.flatnonzero(self._missed).tolist())

    @property
    def every(self) -> int:
        """The law acts at each so many-th tick."""
        return self._every

    @property
    def phase(self) -> int:
        """The number of ticks since the law has acted first, if one counts from there each time."""
        return self._ticks % self._every

    @property
    def command(self) -> Floats:
        """What vehicles are commanded, shape ``(n, 2)``; it is written over."""
        return self._command

    def pass_ticks(self, ticks: int) -> None:
        """Note ticks that were made."""
        self._ticks += ticks

    def arrays(
        self, now_s: float, position: Floats, heading: Floats, speed: Floats
    ) -> tuple[Any, ...]:
        """The arrays that a tick is given, in the order of their names."""
        group, routes, legs = self.group, self.group.routes, self.tracker.legs
        self._constants[: len(VISIT)] = self._own.visit(now_s)
        return (
            *(self._constants, position, heading, speed, self._command, *self.own()),
            *(legs.way, legs.waited, self._missed, group.s, group.speed, *self._own.arrays()),
            *(routes.length, routes.size, routes.s, routes.speed2, routes.points, routes.tangent),
            *(routes.course, routes.turn, routes.curvature, routes.leg_end, routes.way),
            *(self._going, *self.more()),
        )

    def written(self, arrays: Sequence[Any]) -> tuple[Any, ...]:
        """Those of the arrays that a tick writes over, besides what nobody else sees."""
        return tuple(arrays[k] for k in self._written)

    def own(self) -> tuple[Any, ...]:
        """The arrays of the law."""
        raise NotImplementedError

    def more(self) -> tuple[Any, ...]:
        """The arrays that nobody else sees."""
        return ()


def arrays_in(own: Sequence[str], more: Sequence[str]) -> tuple[str, ...]:
    """The names of the arrays of a tick, in order."""
    return (*MEASURED, *own, *LEGS, *ROUTES, *more)


# --- the machine code -----------------------------------------------------------------------------


class Spot(Struct, frozen=True):
    """A point of a route, as ``Routes.at`` has it, in the plane."""

    x: Lane
    y: Lane
    course: Lane
    curvature: Lane
    speed_mps: Lane


class OneDriver(OneRobot):
    """What is computed for one vehicle: of this pace and acceleration, from command to command."""

    pace: Pace
    accel_mps2: float
    every_s: float

    # --- its legs, as ``Legs`` --------------------------------------------------------------------

    @contextmanager
    def on_its_leg(self) -> Iterator[tuple[Lane, Ir, Lane]]:
        """Advance along the route, as ``Legs.advance``; what is done there if something is left.

        Yields the length, the segment, and what is left of the leg.
        """
        b = self.code.b
        self.keep("going", constant(I1, 0))
        with self.code.only_if(self.drives()):
            s = self.number("s", self.robot)
            # As in ``np.maximum``, neither need be a number; the difference is 0, or none.
            s = self._nearest(s).greater(s) + (s - s)
            k = self.segment(s, word(0))
            end, slow = self.of_route("leg_end", k), self.stands()
            near = (end - s).is_at_most(DONE_M)
            done = b.and_(b.and_(near, end.is_below(self.number("length", self.robot))), slow)
            s = end.where(done, s.lesser(end - LEAST_M))
            k = self.segment(s, word(0))
            self.put("s", self.robot, s)
            self.put("legs_way", self.robot, self.of_route("way", k))
            left = self.of_route("leg_end", k) - s
            with self.code.only_if(self.lanes.constant(DONE_M).is_below(left)):
                yield s, k, left

    def paced(self, s: Lane, k: Ir, left: Lane, last: Lane) -> Lane:
        """The target speed a moment ahead, as ``Legs.pace``; the ``last`` was commanded before."""
        there = (s + last * self.every_s).lesser(s + left)
        speed = self.at(there, self.segment(there, k)).speed_mps
        return speed.lesser(last + self.pace.accel_mps2 * self.every_s).greater(CREEP_MPS)

    def watch(self, going: Ir) -> Ir:
        """Note that the end of the route is missed, as ``Legs.watch``, and say whether it is."""
        b, zero = self.code.b, self.lanes.constant(0.0)
        measured = self.number("since_s", self.robot).is_at_most(math.inf)
        there = b.or_(self.truth("reached"), measured)
        stuck = b.and_(b.and_(self.drives(), b.not_(going)), b.not_(there))
        waited = self.number("waited", self.robot) + self.every_s
        waited = self.either(stuck, waited, zero)
        missed = self.lanes.constant(MISSED_S).is_at_most(waited)
        self.put("waited", self.robot, self.either(missed, zero, waited))
        self.keep("missed", missed)
        return missed

    def speed_of(self, going: Ir, speed: Lane) -> Lane:
        """The speed of who goes, and of others, who brake, as ``Legs.speeds``."""
        slowest = self._pace_now() - self.accel_mps2 * self.every_s
        self.put("speed", self.robot, self.either(going, speed, self.lanes.constant(0.0)))
        return self.either(going, speed, slowest.greater(0.0))

    def drives(self) -> Ir:
        """Whether it is to move along a route that is longer than a point."""
        b = self.code.b
        return b.and_(self.follows(), b.icmp_signed(">", self.whole("size"), word(0)))

    def stands(self) -> Ir:
        return self._pace_now().is_below(CREEP_MPS)

    def _pace_now(self) -> Lane:
        return unsigned(self.number("velocity", self.robot))

    # --- its route, as ``Routes`` -----------------------------------------------------------------

    def segment(self, s: Lane, first: Ir) -> Ir:
        """The segment at a length, as ``Routes.segment``; it is not before the ``first``."""
        b = self.code.b
        found = self.code.slot(I64)
        b.store(first, found)
        last = b.sub(self.whole("size"), word(1))

        def is_behind() -> Ir:
            following = b.add(b.load(found), word(1))
            inside = b.icmp_signed("<=", following, last)
            there = b.select(inside, following, word(0))
            return b.and_(inside, self.of_route("route_s", there).is_at_most(s))

        with self.code.while_(is_behind):
            b.store(b.add(b.load(found), word(1)), found)
        return b.load(found)

    def _nearest(self, s: Lane) -> Lane:
        """The length at which the route is nearest, as ``Routes.nearest``."""
        b = self.code.b
        here, size = self.segment(s, word(0)), self.whole("size")
        leg_end, last = self.of_route("leg_end", here), b.sub(size, word(1))
        first = b.sub(here, word(2))
        first = b.select(b.icmp_signed("<", first, word(0)), word(0), first)

        def looked(number: Ir) -> tuple[Lane, Lane]:
            """How far a segment is, as a square, and the length of its nearest point."""
            k = b.add(first, number)
            k = b.select(b.icmp_signed("<", k, last), k, last)
            a, z = (
                self.three("points", self.row_of(k)),
                self.three("points", self.row_of(b.add(k, word(1)))),
            )
            along = [one - other for one, other in zip(z, a, strict=True)]
            off = [one - other for one, other in zip(self.position, a, strict=True)]
            square, share = _dot(along, along), _dot(off, along)
            one = self.lanes.constant(1.0)
            whole = square.where(self.lanes.constant(0.0).is_below(square), one)
            share = (share / whole).greater(0.0).lesser(1.0)
            gap = [o - share * w for o, w in zip(off, along, strict=True)]
            same = b.fcmp_ordered("==", self.of_route("leg_end", k).ir, leg_end.ir)
            apart = self.either(same, _dot(gap, gap), self.lanes.constant(math.inf))
            return apart, self.of_route("route_s", k) + share * square.sqrt()

        def nearer(values: list[Ir]) -> list[Ir]:
            least, found, number = values
            apart, there = looked(number)
            # As ``np.argmin``: of several the first, and what is no number is the least.
            is_less = b.fcmp_unordered("<", apart.ir, least)
            is_less = b.and_(is_less, b.fcmp_ordered("ord", least, least))
            return [
                b.select(is_less, apart.ir, least),
                b.select(is_less, there.ir, found),
                b.add(number, word(1)),
            ]

        begun = [*(one.ir for one in looked(word(0))), word(1)]
        _, found, _ = self.code.repeated(word(WINDOW - 1), begun, nearer)
        return Lane(self.lanes, found)

    def at(self, s: Lane, k: Ir) -> Spot:
        """A point of the route on a segment, as ``Routes.at``."""
        one, pace = self.lanes.constant(1.0), self.pace
        then = self.code.b.add(k, word(1))
        begun, end = self.of_route("route_s", k), self.of_route("route_s", then)
        length = end - begun
        whole = length.where(self.lanes.constant(0.0).is_below(length), one)
        share = ((s - begun) / whole).greater(0.0).lesser(1.0)
        at_end = one.is_at_most(share)  # it is not greater
        place: list[Lane] = []
        first, last = (self.three("points", self.row_of(there)) for there in (k, then))
        for a, z in zip(first[:2], last[:2], strict=True):
            between = (a + share * (z - a)).greater(a.lesser(z)).lesser(a.greater(z))
            place.append(z.where(at_end, between))
        bent, bends = self.of_route("curvature", k), self.of_route("curvature", then)
        ahead = self.of_route("speed2", then) + 2 * pace.accel_mps2 * (end - s).greater(0.0)
        return Spot(
            place[0],
            place[1],
            self.of_route("course", k) + share * self.of_route("turn", k),
            bent + share * (bends - bent),
            ahead.sqrt().lesser(pace.cruise_mps),
        )

    def row_of(self, k: Ir) -> Ir:
        """Where in arrays of routes a point of this robot's stands."""
        return self.code.b.add(self.code.b.mul(self.robot, self.room), k)

    def of_route(self, name: str, k: Ir) -> Lane:
        return self.number(name, self.row_of(k))

    def pair(self, row: int) -> Ir:
        """Where in arrays of two numbers for each robot one of this robot's stands."""
        return self.code.b.add(self.code.b.mul(self.robot, word(2)), word(row))


def _dot(one: list[Lane], other: list[Lane]) -> Lane:
    x, y, z = (a * b for a, b in zip(one, other, strict=True))
    return x + y + z


def unsigned(number: Lane) -> Lane:
    """A number without its sign."""
    return number.signed_as(number.lanes.constant(1.0))
