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
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Pace
from koord.runtime.motion.driving import (
    BEGUN_M,
    CREEP_MPS,
    PREDICTIVE_TICKS,
    SHORT_M,
    WHEELS_RAD,
    Driving,
)
from koord.runtime.motion.predictive import ERROR_ROWS, INPUT_ROWS, Problem
from koord.runtime.motion.pursuit import AHEAD_M, AHEAD_S
from koord.sim.squads import STEP_S, STEPS, SquadSetup, Wheeled
from koord.sim.vehicles.compiled_automata import arrays_of, numbers_of
from koord.sim.vehicles.compiled_driving import CompiledPredictive, write_solver
from koord.sim.vehicles.compiled_legs import (
    CONSTANTS,
    SLOWEST_AT,
    DrivenSquad,
    OneDriver,
    arrays_in,
    unsigned,
)


class TrackedSquad(DrivenSquad):
    """A squad of cars, by machine code."""

    OWN = ("inputs", "kept")
    MORE = ("told", "held", "found", "who")

    def __init__(self, setup: SquadSetup, vehicles: Wheeled, law: Driving) -> None:
        controller = law.controller
        assert controller is None or isinstance(controller, CompiledPredictive)
        count, width = len(setup.start), widest()
        problem = None if controller is None else controller.problem
        code = tracking_code(_Kind(law.car, problem, setup.group.routes.pace), width)
        super().__init__(setup, vehicles, law, code, ticks_of(law))
        self._law = law
        self._kept: Floats = np.zeros(1) if controller is None else controller.kept
        # Of those who are steered, side by side; lanes of the last register may be left over.
        self.columns = room = -(-count // width) * width
        told, held = (1, 1) if problem is None else (problem.told_rows, problem.kept_rows)
        self._steered = (
            *(np.empty((told, room)), np.empty((held, room))),
            *(np.empty((INPUT_ROWS, room)), np.empty(room, np.int64)),
        )

    def own(self) -> tuple[Any, ...]:
        return self._law.inputs, self._kept

    def more(self) -> tuple[Any, ...]:
        return self._steered


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
    arrays = arrays_of(code, table, arrays_in(TrackedSquad.OWN, TrackedSquad.MORE))
    lanes = Lanes(code, 1)
    numbers = numbers_of(lanes, arrays["constants"], CONSTANTS)
    acts = b.icmp_signed("!=", acts, word(0))
    steered, missed = code.slot(I64), code.slot(I64)
    b.store(word(0), steered)
    b.store(word(0), missed)

    def one(robot: Ir) -> _OneCar:
        made = _OneCar(lanes, arrays, numbers, robot, room, count)
        made.kind, made.columns, made.pace = kind, columns, kind.pace
        made.accel_mps2, made.every_s = kind.car.accel_mps2, kind.every_s
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
                slowest = code.at(arrays["constants"], SLOWEST_AT)
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


class _OneCar(OneDriver):
    """What is computed for one car; ``columns`` are those of arrays of cars side by side."""

    kind: _Kind
    columns: Ir

    # --- what it does ---------------------------------------------------------------------------

    def decide(self, steered: Ir) -> None:
        """Advance along the route, and say whether wheels turn first."""
        b = self.code.b
        with self.on_its_leg() as (s, k, left):
            turning, right = self._turns_wheels(s, k)
            with self.code.only_if(turning):
                self.put("inputs", self.pair(1), right)
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
            self.put("inputs", self.pair(row), self._beside("found", word(row), column))
        with self.code.loop(word(0), word(problem.kept_rows)) as row:
            self.put("kept", self._kept_at(row), self._beside("held", row, column))

    def send(self) -> Ir:
        """Command, as ``Driving.command``; 1 where the end of the route is missed, else 0."""
        going = self.truth("going")
        missed = self.watch(going)
        speed = self.speed_of(going, self.number("inputs", self.pair(0)))
        self.put("inputs", self.pair(0), speed)
        self.put("command", self.pair(0), self.number("legs_way", self.robot) * speed)
        self.put("command", self.pair(1), self.number("inputs", self.pair(1)))
        return self.code.b.zext(missed, I64)

    # --- its parts ------------------------------------------------------------------------------

    def _turns_wheels(self, s: Lane, k: Ir) -> tuple[Ir, Lane]:
        """Whether the wheels are turned first, and how far, as ``Driving._turn_wheels``."""
        b = self.code.b
        is_first = b.icmp_signed("==", k, word(0))
        before = b.select(is_first, k, b.sub(k, word(1)))
        begins = self.of_route("leg_end", before).is_below(self.of_route("leg_end", k))
        first = b.or_(is_first, begins)
        still = b.and_(self.stands(), (s - self.of_route("route_s", k)).is_below(BEGUN_M))
        right = self._steering(self.at(s, k).curvature)
        off = unsigned(self.number("inputs", self.pair(1)) - right)
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
        speed = self.paced(s, k, left, self.number("inputs", self.pair(0)))
        ahead = (speed * AHEAD_S).greater(AHEAD_M)
        there = s + ahead.lesser(left) - 1e-9
        place = self.segment(there, k)
        spot = self.at(there, place)
        beyond = (ahead - left).greater(0.0)
        along_x, along_y, _ = self.three("tangent", self.row_of(place))
        x = spot.x + beyond * along_x - self.position[0]
        y = spot.y + beyond * along_y - self.position[1]
        distance = (x * x + y * y).sqrt().greater(1e-6)
        sine, cosine = sine_cosine(self.number("heading", self.robot) + self._back())
        in_front, aside = cosine * x + sine * y, cosine * y - sine * x
        zero, one = self.lanes.constant(0.0), self.lanes.constant(1.0)
        abeam = self.either(aside.is_below(0.0), -one, one)
        share = self.either(zero.is_at_most(in_front), aside / distance, abeam)
        self.put("inputs", self.pair(0), speed)
        self.put("inputs", self.pair(1), self._steering(2.0 * share / distance))

    def _put_beside(self, column: Ir, problem: Problem) -> None:
        """Put what is kept of the last answer beside that of others who are steered."""
        at = self.code.b.mul(column, word(DOUBLE_BYTES))
        self.code.put(self.arrays["who"], at, self.robot)
        with self.code.loop(word(0), word(problem.kept_rows)) as row:
            self._set_beside("held", row, column, self.number("kept", self._kept_at(row)))

    def _predict(self, column: Ir, s: Lane, k: Ir, left: Lane, problem: Problem) -> None:
        """Tell the solver what is ahead, as ``Driving._predict``."""
        b, code, pace = self.code.b, self.code, self.pace
        steps, dt = problem.horizon.steps, problem.horizon.step_s
        accel = pace.accel_mps2

        def tell(row: Ir | int, value: Lane) -> None:
            place = word(row) if isinstance(row, int) else row
            self._set_beside("told", place, column, value)

        lengths = [self.lanes.constant(0.0)]
        speeds: list[Lane] = []
        last = self.number("inputs", self.pair(0))
        for _ in range(steps):
            rest = left - lengths[-1]
            stop = (2 * accel * rest + (accel * dt / 2) ** 2).sqrt() - accel * dt / 2
            last = (last + accel * dt).lesser(stop).lesser(pace.cruise_mps)
            speeds.append(last)
            lengths.append((lengths[-1] + dt * last).lesser(left - SHORT_M))
        way = self.number("legs_way", self.robot)
        spot = self.at(s + lengths[0], k)
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
            place = self.segment(there, b.load(ahead))
            b.store(place, ahead)
            spot = self.at(there, place)
            speed = Lane(self.lanes, b.load(b.gep(allowed, [step]))).lesser(spot.speed_mps)
            is_first = b.icmp_signed("==", step, word(0))
            speed = self.either(is_first, speed.greater(CREEP_MPS), speed)
            tell(b.add(step, word(ERROR_ROWS)), speed)
            # That of the last spot is none of the course: the way stands there.
            tell(b.add(step, word(ERROR_ROWS + steps + 1)), spot.curvature)
        tell(ERROR_ROWS + 2 * steps, way)
        for row in range(INPUT_ROWS):
            put = self.number("inputs", self.pair(row))
            tell(ERROR_ROWS + 2 * steps + 1 + row, put)

    # --- arrays ---------------------------------------------------------------------------------

    def _kept_at(self, row: Ir) -> Ir:
        return self.code.b.add(self.code.b.mul(row, self.count), self.robot)

    def _beside(self, name: str, row: Ir, column: Ir) -> Lane:
        place = self.code.b.add(self.code.b.mul(row, self.columns), column)
        return self.number(name, place)

    def _set_beside(self, name: str, row: Ir, column: Ir, value: Lane) -> None:
        self.put(name, self.code.b.add(self.code.b.mul(row, self.columns), column), value)
