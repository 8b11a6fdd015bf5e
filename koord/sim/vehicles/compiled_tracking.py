"""Machine code of the laws by which cars follow routes, automata and all.

What :func:`.automaton.step`, :class:`.Legs` and :class:`.Driving` compute, car by car and in the
same order of operations, so that commands are equal to the last bit. Under predictive control who
is to be steered is put to the solver of :mod:`.compiled_driving`, many side by side; in pursuit
each is steered by itself. So a tick of a squad is one call. Tests hold the two together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from koord.machine.code import BYTES, F64, I1, I64, Code, Ir, constant, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes, widest
from koord.runtime.motion.angles import arc_tangent, sine_cosine, unwound
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.bodies import Car, Pace
from koord.runtime.motion.driving import (
    BEGUN_M,
    CREEP_MPS,
    DONE_M,
    LEAST_M,
    MISSED_S,
    PREDICTIVE_TICKS,
    SHORT_M,
    WHEELS_RAD,
    Driving,
)
from koord.runtime.motion.predictive import ERROR_ROWS, INPUT_ROWS, Problem
from koord.runtime.motion.pursuit import AHEAD_M, AHEAD_S
from koord.runtime.motion.routes import WINDOW
from koord.sim.squads import STEP_S, STEPS, SquadSetup, Wheeled, WheeledSquad
from koord.sim.vehicles.compiled_automata import (
    AUTOMATA,
    VISIT,
    OneRobot,
    OwnAutomata,
    Table,
    arrays_of,
    numbers_of,
)
from koord.sim.vehicles.compiled_driving import CompiledPredictive, write_solver

#: What the machine code is given the addresses of, in this order.
ARRAYS = (
    *("constants", "position", "heading", "velocity", "command", "inputs", "kept"),
    *("legs_way", "waited", "missed", "s", "speed", *AUTOMATA),
    *("length", "size", "route_s", "speed2", "points", "tangent", "course", "turn"),
    *("curvature", "leg_end", "way", "going", "told", "held", "found", "who"),
)

#: Those that it writes over, besides what it needs within a tick.
WRITTEN = (*("command", "inputs", "kept", "legs_way", "waited", "missed", "s", "speed", *AUTOMATA),)

#: Numbers that it is given, in this order; the last is the solver's.
_CONSTANTS = (*VISIT, "slowest")
_SLOWEST_AT = DOUBLE_BYTES * (len(_CONSTANTS) - 1)


class TrackedSquad(WheeledSquad):
    """A squad of cars by machine code that is made once in a process.

    It writes over the states of automata and controllers, which are the squad's and nobody else's.
    """

    def __init__(self, setup: SquadSetup, vehicles: Wheeled, law: Driving) -> None:
        super().__init__(setup, vehicles, law, ticks_of(law))
        controller = law.controller
        assert controller is None or isinstance(controller, CompiledPredictive)
        count, width = len(setup.start), widest()
        problem = None if controller is None else controller.problem
        self._law = law
        self._kept: Floats = np.zeros(1) if controller is None else controller.kept
        self.disturbances = setup.model.disturbances
        self._own = OwnAutomata(setup.group)
        self.code = tracking_code(_Kind(law.car, problem, setup.group.routes.pace), width)
        self._table = Table(len(ARRAYS))
        self._constants: Floats = np.full(len(_CONSTANTS), CREEP_MPS)
        self._missed: Bools = np.zeros(count, np.bool_)
        self._going: Bools = np.zeros(count, np.bool_)
        # Of those who are steered, side by side; lanes of the last register may be left over.
        self.columns = room = -(-count // width) * width
        told, held = (1, 1) if problem is None else (problem.told_rows, problem.kept_rows)
        self._steered = (
            *(np.empty((told, room)), np.empty((held, room))),
            *(np.empty((INPUT_ROWS, room)), np.empty(room, np.int64)),
        )

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
        """What cars are commanded, shape ``(n, 2)``; it is written over."""
        return self._command

    def pass_ticks(self, ticks: int) -> None:
        """Note ticks that were made."""
        self._ticks += ticks

    def arrays(
        self, now_s: float, position: Floats, heading: Floats, speed: Floats
    ) -> tuple[Any, ...]:
        """The arrays that a tick is given, in the order of their names."""
        self._constants[: len(VISIT)] = self._own.visit(now_s)
        return self._constants, position, heading, speed, *self._arrays()

    def _arrays(self) -> tuple[Any, ...]:
        """The arrays of the squad, in the order of their names from commands on."""
        group, routes, law = self.group, self.group.routes, self._law
        legs = law.legs
        return (
            *(self._command, law.inputs, self._kept, legs.way, legs.waited, self._missed),
            *(group.s, group.speed, *self._own.arrays()),
            *(routes.length, routes.size, routes.s, routes.speed2, routes.points, routes.tangent),
            *(routes.course, routes.turn, routes.curvature, routes.leg_end, routes.way),
            *(self._going, *self._steered),
        )


# --- the machine code -----------------------------------------------------------------------------


def ticks_of(law: Driving) -> int:
    """The number of ticks from one command of a law to the next."""
    return 1 if law.controller is None else PREDICTIVE_TICKS


class _Kind(Struct, frozen=True):
    """The constants of cars of one kind, and of their routes; those in pursuit have no problem."""

    car: Car
    problem: Problem | None
    pace: Pace

    @property
    def every_s(self) -> float:
        """From one command to the next."""
        return (1 if self.problem is None else PREDICTIVE_TICKS) * STEPS * STEP_S


@cache
def tracking_code(kind: _Kind, width: int) -> Callable[..., int]:
    """Compile a tick of a squad of cars, of which ``width`` are steered at a time.

    The function takes the address of the table of arrays, the number of cars, how many points there
    is room for in each route, for how many cars there is room side by side, and whether the law
    acts at this tick. It returns how many have missed the ends of their routes.
    """
    return kept("tracking", (kind, width), lambda: _tracking(kind, width)).function("track", 5)


def _tracking(kind: _Kind, width: int) -> Ir:
    module = new_module("tracking")
    problem = kind.problem
    solver = None if problem is None else write_solver(module, problem, width)
    code = Code(module, "track", [BYTES, *[I64] * 4], I64)
    table, count, room, columns, acts = code.arguments
    b = code.b
    arrays = arrays_of(code, table, ARRAYS)
    lanes = Lanes(code, 1)
    numbers = numbers_of(lanes, arrays["constants"], _CONSTANTS)
    acts = b.icmp_signed("!=", acts, word(0))
    steered, missed = code.slot(I64), code.slot(I64)
    b.store(word(0), steered)
    b.store(word(0), missed)

    def one(robot: Ir) -> _OneCar:
        made = _OneCar(lanes, arrays, numbers, robot, room, count)
        made.kind, made.columns = kind, columns
        return made

    with code.loop(word(0), count) as robot:
        now = one(robot)
        now.step_automaton()
        with code.only_if(acts):
            now.decide(steered)
    with code.only_if(acts):
        if problem is not None:
            some = b.load(steered)
            with code.only_if(b.icmp_signed(">", some, word(0))):
                last = b.sub(some, word(1))
                wide = b.mul(b.udiv(b.add(last, word(width)), word(width)), word(width))
                # Lanes that are left over are the first car's.
                with code.loop(some, wide) as column:
                    for name in ("told", "held"):
                        _copy_first(code, arrays[name], columns, column, _rows(problem, name))
                blocks = (arrays[name] for name in ("told", "held", "found"))
                slowest = code.at(arrays["constants"], _SLOWEST_AT)
                b.call(solver, [slowest, *blocks, wide, columns])
            with code.loop(word(0), some) as column:
                who = code.get(arrays["who"], b.mul(column, word(DOUBLE_BYTES)), I64)
                one(who).take(column, problem)
        with code.loop(word(0), count) as robot:
            b.store(b.add(b.load(missed), one(robot).send()), missed)
    b.ret(b.load(missed))
    return module


def _rows(problem: Problem, name: str) -> int:
    return problem.told_rows if name == "told" else problem.kept_rows


def _copy_first(code: Code, block: Ir, columns: Ir, column: Ir, rows: int) -> None:
    """Copy the first column of an array to another."""
    b = code.b
    with code.loop(word(0), word(rows)) as row:
        first = b.mul(row, columns)
        value = code.get(block, b.mul(first, word(DOUBLE_BYTES)), F64)
        code.put(block, b.mul(b.add(first, column), word(DOUBLE_BYTES)), value)


class _Spot(Struct, frozen=True):
    """A point of a route, as ``Routes.at`` has it, in the plane."""

    x: Lane
    y: Lane
    course: Lane
    curvature: Lane
    speed_mps: Lane


class _OneCar(OneRobot):
    """What is computed for one car; ``columns`` are those of arrays of cars side by side."""

    kind: _Kind
    columns: Ir

    # --- what it does ---------------------------------------------------------------------------

    def decide(self, steered: Ir) -> None:
        """Advance along the route, as ``Legs.advance``, and say whether wheels turn first."""
        b = self.code.b
        self.keep("going", constant(I1, 0))
        with self.code.only_if(self._drives()):
            s = self.number("s", self.robot)
            # As in ``np.maximum``, neither need be a number; the difference is 0, or none.
            s = self._nearest(s).greater(s) + (s - s)
            k = self._segment(s, word(0))
            end, slow = self._of("leg_end", k), self._stands()
            near = (end - s).is_at_most(DONE_M)
            done = b.and_(b.and_(near, end.is_below(self.number("length", self.robot))), slow)
            s = end.where(done, s.lesser(end - LEAST_M))
            k = self._segment(s, word(0))
            self.put("s", self.robot, s)
            self.put("legs_way", self.robot, self._of("way", k))
            left = self._of("leg_end", k) - s
            with self.code.only_if(self.lanes.constant(DONE_M).is_below(left)):
                turning, right = self._turns_wheels(s, k)
                with self.code.only_if(turning):
                    self.put("inputs", self._input(1), right)
                with self.code.only_if(b.not_(turning)):
                    self.keep("going", constant(I1, 1))
                    problem = self.kind.problem
                    if problem is None:
                        self._pursue(s, k, left)
                    else:
                        column = b.load(steered)
                        b.store(b.add(column, word(1)), steered)
                        self._put_beside(column, problem)
                        self._predict(column, s, k, left, problem)

    def take(self, column: Ir, problem: Problem) -> None:
        """Take the inputs that the solver has found, and keep what belongs to them."""
        for row in range(INPUT_ROWS):
            self.put("inputs", self._input(row), self._beside("found", word(row), column))
        with self.code.loop(word(0), word(problem.kept_rows)) as row:
            self.put("kept", self._kept_at(row), self._beside("held", row, column))

    def send(self) -> Ir:
        """Command, as ``Driving.command``; 1 where the end of the route is missed, else 0."""
        b, zero = self.code.b, self.lanes.constant(0.0)
        going = self.truth("going")
        measured = self.number("since_s", self.robot).is_at_most(math.inf)
        there = b.or_(self.truth("reached"), measured)
        stuck = b.and_(b.and_(self._drives(), b.not_(going)), b.not_(there))
        every_s = self.kind.every_s
        waited = self.number("waited", self.robot) + every_s
        waited = self.either(stuck, waited, zero)
        missed = self.lanes.constant(MISSED_S).is_at_most(waited)
        self.put("waited", self.robot, self.either(missed, zero, waited))
        self.keep("missed", missed)
        slowest = self._pace_now() - self.kind.car.accel_mps2 * every_s
        speed = self.number("inputs", self._input(0))
        self.put("speed", self.robot, self.either(going, speed, zero))
        speed = self.either(going, speed, slowest.greater(0.0))
        self.put("inputs", self._input(0), speed)
        self.put("command", self._input(0), self.number("legs_way", self.robot) * speed)
        self.put("command", self._input(1), self.number("inputs", self._input(1)))
        return b.zext(missed, I64)

    # --- its parts ------------------------------------------------------------------------------

    def _drives(self) -> Ir:
        """Whether it is to move along a route that is longer than a point."""
        b = self.code.b
        return b.and_(self.follows(), b.icmp_signed(">", self.whole("size"), word(0)))

    def _pace_now(self) -> Lane:
        return self.number("velocity", self.robot).signed_as(self.lanes.constant(1.0))

    def _stands(self) -> Ir:
        return self._pace_now().is_below(CREEP_MPS)

    def _turns_wheels(self, s: Lane, k: Ir) -> tuple[Ir, Lane]:
        """Whether the wheels are turned first, and how far, as ``Driving._turn_wheels``."""
        b = self.code.b
        is_first = b.icmp_signed("==", k, word(0))
        before = b.select(is_first, k, b.sub(k, word(1)))
        begins = self._of("leg_end", before).is_below(self._of("leg_end", k))
        first = b.or_(is_first, begins)
        still = b.and_(self._stands(), (s - self._of("route_s", k)).is_below(BEGUN_M))
        right = self._steering(self._at(s, k).curvature)
        off = (self.number("inputs", self._input(1)) - right).signed_as(self.lanes.constant(1.0))
        wrong = self.lanes.constant(WHEELS_RAD).is_below(off)
        return b.and_(b.and_(first, still), wrong), right

    def _steering(self, bend: Lane) -> Lane:
        """The steering angle for a curvature, as ``pursuit.steering``."""
        car = self.kind.car
        most = math.tan(car.steering_rad)
        slope = self.number("legs_way", self.robot) * car.wheelbase_m * bend
        angle: Lane = arc_tangent(slope.greater(-most).lesser(most))
        return angle.greater(-car.steering_rad).lesser(car.steering_rad)

    def _back(self) -> Lane:
        """What is added to the course of the route where the car drives backwards."""
        zero = self.lanes.constant(0.0)
        is_back = self.number("legs_way", self.robot).is_below(0.0)
        return self.either(is_back, self.lanes.constant(math.pi), zero)

    def _pursue(self, s: Lane, k: Ir, left: Lane) -> None:
        """Set speed and steering angle, as ``Driving._pursue``."""
        pace, every_s = self.kind.pace, self.kind.every_s
        last = self.number("inputs", self._input(0))
        there = (s + last * every_s).lesser(s + left)
        speed = self._at(there, self._segment(there, k)).speed_mps
        speed = speed.lesser(last + pace.accel_mps2 * every_s).greater(CREEP_MPS)
        ahead = (speed * AHEAD_S).greater(AHEAD_M)
        there = s + ahead.lesser(left) - 1e-9
        place = self._segment(there, k)
        spot = self._at(there, place)
        beyond = (ahead - left).greater(0.0)
        along_x, along_y, _ = self.three("tangent", self._row(place))
        x = spot.x + beyond * along_x - self.position[0]
        y = spot.y + beyond * along_y - self.position[1]
        distance = (x * x + y * y).sqrt().greater(1e-6)
        sine, cosine = sine_cosine(self.number("heading", self.robot) + self._back())
        in_front, aside = cosine * x + sine * y, cosine * y - sine * x
        zero, one = self.lanes.constant(0.0), self.lanes.constant(1.0)
        abeam = self.either(aside.is_below(0.0), -one, one)
        share = self.either(zero.is_at_most(in_front), aside / distance, abeam)
        self.put("inputs", self._input(0), speed)
        self.put("inputs", self._input(1), self._steering(2.0 * share / distance))

    def _put_beside(self, column: Ir, problem: Problem) -> None:
        """Put what is kept of the last answer beside that of others who are steered."""
        at = self.code.b.mul(column, word(DOUBLE_BYTES))
        self.code.put(self.arrays["who"], at, self.robot)
        with self.code.loop(word(0), word(problem.kept_rows)) as row:
            self._set_beside("held", row, column, self.number("kept", self._kept_at(row)))

    def _predict(self, column: Ir, s: Lane, k: Ir, left: Lane, problem: Problem) -> None:
        """Tell the solver what is ahead, as ``Driving._predict``."""
        b, code, pace = self.code.b, self.code, self.kind.pace
        steps, dt = problem.horizon.steps, problem.horizon.step_s
        accel = pace.accel_mps2

        def tell(row: Ir | int, value: Lane) -> None:
            place = word(row) if isinstance(row, int) else row
            self._set_beside("told", place, column, value)

        lengths = [self.lanes.constant(0.0)]
        speeds: list[Lane] = []
        last = self.number("inputs", self._input(0))
        for _ in range(steps):
            rest = left - lengths[-1]
            stop = (2 * accel * rest + (accel * dt / 2) ** 2).sqrt() - accel * dt / 2
            last = (last + accel * dt).lesser(stop).lesser(pace.cruise_mps)
            speeds.append(last)
            lengths.append((lengths[-1] + dt * last).lesser(left - SHORT_M))
        way = self.number("legs_way", self.robot)
        spot = self._at(s + lengths[0], k)
        tell(ERROR_ROWS + steps, spot.curvature)
        sine, cosine = sine_cosine(spot.course)
        gap_x, gap_y = self.position[0] - spot.x, self.position[1] - spot.y
        turned = unwound(self.number("heading", self.robot) - (spot.course + self._back()))
        for row, error in enumerate(
            (self.lanes.constant(0.0), cosine * gap_y - sine * gap_x, turned)
        ):
            tell(row, error)
        # What is further ahead is on the same segment, or behind it.
        ahead, along = code.slot(I64), code.slot(F64, steps)
        b.store(k, ahead)
        allowed = code.slot(F64, steps)
        for step in range(steps):
            for block, value in ((along, lengths[step + 1]), (allowed, speeds[step])):
                b.store(value.ir, b.gep(block, [word(step)]))
        with code.loop(word(0), word(steps)) as step:
            there = s + Lane(self.lanes, b.load(b.gep(along, [step])))
            place = self._segment(there, b.load(ahead))
            b.store(place, ahead)
            spot = self._at(there, place)
            speed = Lane(self.lanes, b.load(b.gep(allowed, [step]))).lesser(spot.speed_mps)
            is_first = b.icmp_signed("==", step, word(0))
            speed = self.either(is_first, speed.greater(CREEP_MPS), speed)
            tell(b.add(step, word(ERROR_ROWS)), speed)
            # That of the last spot is none of the course: the way stands there.
            tell(b.add(step, word(ERROR_ROWS + steps + 1)), spot.curvature)
        tell(ERROR_ROWS + 2 * steps, way)
        for row in range(INPUT_ROWS):
            put = self.number("inputs", self._input(row))
            tell(ERROR_ROWS + 2 * steps + 1 + row, put)

    # --- the route ------------------------------------------------------------------------------

    def _segment(self, s: Lane, first: Ir) -> Ir:
        """The segment at a length, as ``Routes.segment``; it is not before the ``first``."""
        b = self.code.b
        found = self.code.slot(I64)
        b.store(first, found)
        last = b.sub(self.whole("size"), word(1))

        def is_behind() -> Ir:
            following = b.add(b.load(found), word(1))
            inside = b.icmp_signed("<=", following, last)
            there = b.select(inside, following, word(0))
            return b.and_(inside, self._of("route_s", there).is_at_most(s))

        with self.code.while_(is_behind):
            b.store(b.add(b.load(found), word(1)), found)
        return b.load(found)

    def _nearest(self, s: Lane) -> Lane:
        """The length at which the route is nearest, as ``Routes.nearest``."""
        b = self.code.b
        here, size = self._segment(s, word(0)), self.whole("size")
        leg_end, last = self._of("leg_end", here), b.sub(size, word(1))
        first = b.sub(here, word(2))
        first = b.select(b.icmp_signed("<", first, word(0)), word(0), first)

        def looked(number: Ir) -> tuple[Lane, Lane]:
            """How far a segment is, as a square, and the length of its nearest point."""
            k = b.add(first, number)
            k = b.select(b.icmp_signed("<", k, last), k, last)
            a, z = (
                self.three("points", self._row(k)),
                self.three("points", self._row(b.add(k, word(1)))),
            )
            along = [one - other for one, other in zip(z, a, strict=True)]
            off = [one - other for one, other in zip(self.position, a, strict=True)]
            square, share = _dot(along, along), _dot(off, along)
            one = self.lanes.constant(1.0)
            whole = square.where(self.lanes.constant(0.0).is_below(square), one)
            share = (share / whole).greater(0.0).lesser(1.0)
            gap = [o - share * w for o, w in zip(off, along, strict=True)]
            same = b.fcmp_ordered("==", self._of("leg_end", k).ir, leg_end.ir)
            apart = self.either(same, _dot(gap, gap), self.lanes.constant(math.inf))
            return apart, self._of("route_s", k) + share * square.sqrt()

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

    def _at(self, s: Lane, k: Ir) -> _Spot:
        """A point of the route on a segment, as ``Routes.at``."""
        one, pace = self.lanes.constant(1.0), self.kind.pace
        then = self.code.b.add(k, word(1))
        begun, end = self._of("route_s", k), self._of("route_s", then)
        length = end - begun
        whole = length.where(self.lanes.constant(0.0).is_below(length), one)
        share = ((s - begun) / whole).greater(0.0).lesser(1.0)
        at_end = one.is_at_most(share)  # it is not greater
        place: list[Lane] = []
        first, last = (self.three("points", self._row(there)) for there in (k, then))
        for a, z in zip(first[:2], last[:2], strict=True):
            between = (a + share * (z - a)).greater(a.lesser(z)).lesser(a.greater(z))
            place.append(z.where(at_end, between))
        bent, bends = self._of("curvature", k), self._of("curvature", then)
        ahead = self._of("speed2", then) + 2 * pace.accel_mps2 * (end - s).greater(0.0)
        return _Spot(
            place[0],
            place[1],
            self._of("course", k) + share * self._of("turn", k),
            bent + share * (bends - bent),
            ahead.sqrt().lesser(pace.cruise_mps),
        )

    # --- arrays ---------------------------------------------------------------------------------

    def _row(self, k: Ir) -> Ir:
        """Where in arrays of routes a point of this car's stands."""
        return self.code.b.add(self.code.b.mul(self.robot, self.room), k)

    def _of(self, name: str, k: Ir) -> Lane:
        return self.number(name, self._row(k))

    def _input(self, row: int) -> Ir:
        return self.code.b.add(self.code.b.mul(self.robot, word(INPUT_ROWS)), word(row))

    def _kept_at(self, row: Ir) -> Ir:
        return self.code.b.add(self.code.b.mul(row, self.count), self.robot)

    def _beside(self, name: str, row: Ir, column: Ir) -> Lane:
        place = self.code.b.add(self.code.b.mul(row, self.columns), column)
        return self.number(name, place)

    def _set_beside(self, name: str, row: Ir, column: Ir, value: Lane) -> None:
        self.put(name, self.code.b.add(self.code.b.mul(row, self.columns), column), value)


def _dot(one: list[Lane], other: list[Lane]) -> Lane:
    x, y, z = (a * b for a, b in zip(one, other, strict=True))
    return x + y + z


__all__ = ["TrackedSquad"]
