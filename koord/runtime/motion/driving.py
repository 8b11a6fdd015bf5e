"""Path following of ground vehicles: progress along routes, speed and steering.

While a robot drives, its rate of turning is that of the path, and what brings it back to the path
(Kanayama et al. 1990, "A stable tracking control method for an autonomous mobile robot")::

    ω = v (κ + k_y e_y + k_θ sin e_θ)

with the path's curvature κ, how far the path is to the left e_y, and by how much its course is
further to the left than the robot points e_θ.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from koord.runtime.motion import automaton, pursuit
from koord.runtime.motion.angles import sine_cosine, unwound
from koord.runtime.motion.arrays import Bools, Floats, Ints, bounded
from koord.runtime.motion.bodies import Car, DifferentialDrive, Steering
from koord.runtime.motion.group import Group
from koord.runtime.motion.predictive import Predictive
from koord.runtime.motion.pursuit import Course, Horizon

#: Predictive controllers act at every so many ticks.
PREDICTIVE_TICKS = 2

#: A leg is driven when no more than this is left of it. Who drives it is so little before its end.
DONE_M, LEAST_M = 0.03, 1e-9

#: What is left of a leg is driven at this speed at least.
CREEP_MPS = 0.08

#: A car begins a leg when its wheels are turned so, to this. It has not begun it so near its start.
WHEELS_RAD, BEGUN_M = 0.03, 0.01

#: Predicted lengths stay so much before the end of the leg.
SHORT_M = 1e-6

#: Who stands at the end of its route for so long and has not reached it has missed it.
MISSED_S = 1.0


class Measured(Struct, frozen=True):
    """Measured states: position ``(n, 3)`` in m, heading in rad, signed speed in m/s."""

    position: Floats
    heading_rad: Floats
    speed_mps: Floats


class Legs:
    """The progress of ground vehicles along the legs of their routes, and missed ends."""

    def __init__(self, group: Group, accel_mps2: float) -> None:
        self.group, self._accel = group, accel_mps2
        self.way: Floats = np.ones(group.count)
        #: who stands at the end of its route and has not reached it
        self.missed: Bools = np.zeros(group.count, np.bool_)
        self.waited: Floats = np.zeros(group.count)

    def advance(self, robots: Ints, measured: Measured) -> tuple[Ints, Ints, Floats]:
        """Advance ``s`` to the robots' positions, and to the next leg.

        Returns those of them that are not at the end of their leg, the segments that they are on,
        and what is left of their legs.
        """
        group, routes = self.group, self.group.routes
        s = np.maximum(
            group.s[robots], routes.nearest(robots, group.s[robots], measured.position[robots])
        )
        k = routes.segment(robots, s)
        end = routes.leg_end[robots, k]
        slow = stands(measured, robots)
        done = (end - s <= DONE_M) & (end < routes.length[robots]) & slow
        s = np.where(done, end, np.minimum(s, end - LEAST_M))
        k = routes.segment(robots, s)
        group.s[robots], self.way[robots] = s, routes.way[robots, k]
        left = routes.leg_end[robots, k] - s
        goes = left > DONE_M
        return robots[goes], k[goes], left[goes]

    def pace(self, robots: Ints, last: Floats, left: Floats, dt_s: float) -> Floats:
        """The target speed a moment ahead on the route, within the robots' acceleration."""
        pace, s = self.group.routes.pace, self.group.s[robots]
        spot = self.group.routes.at(robots, np.minimum(s + last * dt_s, s + left))
        speed: Floats = np.minimum(spot.speed_mps, last + pace.accel_mps2 * dt_s)
        return np.maximum(speed, CREEP_MPS)

    def speeds(self, going: Bools, speed: Floats, measured: Measured, dt_s: float) -> Floats:
        """The speeds of all robots; those that are not moving brake."""
        slowest = np.abs(measured.speed_mps) - self._accel * dt_s
        self.group.speed[:] = np.where(going, speed, 0.0)
        return np.where(going, speed, np.maximum(slowest, 0.0))

    def watch(self, wanted: Bools, going: Bools, dt_s: float) -> None:
        """Note the robots that stand at a route's end without having come near enough to it."""
        group = self.group
        there = group.automata.reached | ~np.isnan(group.automata.since_s)
        stuck = wanted & ~going & ~there & (group.routes.size > 0)
        self.waited = np.where(stuck, self.waited + dt_s, 0.0)
        self.missed = self.waited >= MISSED_S
        self.waited[self.missed] = 0.0


def stands(measured: Measured, robots: Ints) -> Bools:
    """A mask of the robots that stand still, or nearly."""
    slow: Bools = np.abs(measured.speed_mps[robots]) < CREEP_MPS
    return slow


class Driving:
    """The motion law of a group of cars: speeds and steering angles."""

    def __init__(
        self,
        group: Group,
        steering: Steering,
        horizon: Horizon = Horizon(),
        predictive: type[Predictive] = Predictive,
    ) -> None:
        """Make the law; ``predictive`` is the kind of controller that solves its problems."""
        assert isinstance(group.body, Car)
        self.group, self.car, self.horizon = group, group.body, horizon
        self.inputs: Floats = np.zeros((group.count, 2))  #: speed of travel and steering angle
        self.legs = Legs(group, self.car.accel_mps2)
        self.controller: Predictive | None = None
        if steering is Steering.PREDICTIVE:
            self.controller = predictive(group.count, self.car, horizon)

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """Speeds (negative: backwards) and steering angles, shape ``(n, 2)``, for the next step."""
        group = self.group
        wanted = automaton.moves(group.automata)
        inputs = np.zeros_like(self.inputs)
        inputs[:, 1] = self.inputs[:, 1]  # wheels stay as they are while a car stands
        cars = np.flatnonzero(wanted & (group.routes.size > 0))
        going = np.zeros(group.count, np.bool_)
        if len(cars):
            cars, k, left = self.legs.advance(cars, measured)
            right, turning = self._turn_wheels(cars, k, measured)
            inputs[cars[turning], 1] = right[turning]
            cars, left = cars[~turning], left[~turning]
            going[cars] = True
            if len(cars):
                inputs[cars] = self._steer(cars, left, measured, dt_s)
        self.legs.watch(wanted, going, dt_s)
        inputs[:, 0] = self.legs.speeds(going, inputs[:, 0], measured, dt_s)
        self.inputs = inputs
        return np.column_stack([self.legs.way * inputs[:, 0], inputs[:, 1]])

    def _turn_wheels(self, cars: Ints, k: Ints, measured: Measured) -> tuple[Floats, Bools]:
        """The wheel angles of cars at starts of legs, and the cars that have to turn them first.

        Of others there is no angle.
        """
        routes, s = self.group.routes, self.group.s[cars]
        first = (k == 0) | (routes.leg_end[cars, np.maximum(k - 1, 0)] < routes.leg_end[cars, k])
        still = stands(measured, cars) & (s - routes.s[cars, k] < BEGUN_M)
        right, begins = np.zeros(len(cars)), first & still
        turning: Bools = np.zeros(len(cars), np.bool_)
        if begins.any():
            some = cars[begins]
            bend = routes.at(some, s[begins], k[begins]).curvature
            right[begins] = pursuit.steering(bend, self.legs.way[some], self.car)
            turning[begins] = np.abs(self.inputs[some, 1] - right[begins]) > WHEELS_RAD
        return right, turning

    def _steer(self, cars: Ints, left: Floats, measured: Measured, dt_s: float) -> Floats:
        if self.controller is None:
            return self._pursue(cars, left, measured, dt_s)
        return self._predict(cars, left, measured, self.controller)

    def _pursue(self, cars: Ints, left: Floats, measured: Measured, dt_s: float) -> Floats:
        routes, s = self.group.routes, self.group.s[cars]
        speed = self.legs.pace(cars, self.inputs[cars, 0], left, dt_s)
        ahead = pursuit.look_ahead(speed)
        spot = routes.at(cars, s + np.minimum(ahead, left) - 1e-9)
        beyond = np.maximum(ahead - left, 0.0)
        aim = spot.position[:, :2] + beyond[:, None] * spot.tangent[:, :2]
        way = self.legs.way[cars]
        course = measured.heading_rad[cars] + np.where(way < 0, np.pi, 0.0)
        bend = pursuit.curvature_towards(aim, measured.position[cars, :2], course)
        return np.column_stack([speed, pursuit.steering(bend, way, self.car)])

    def _predict(
        self, cars: Ints, left: Floats, measured: Measured, controller: Predictive
    ) -> Floats:
        routes, s, way = self.group.routes, self.group.s[cars], self.legs.way[cars]
        steps, dt, accel = self.horizon.steps, self.horizon.step_s, routes.pace.accel_mps2
        # Where the car will be after each step, going as fast as the end of the leg allows.
        at, speed = np.zeros((len(cars), steps + 1)), np.empty((len(cars), steps))
        last = self.inputs[cars, 0]
        for step in range(steps):
            rest = left - at[:, step]
            # The speed from which a stop is met if it is kept for one more step.
            stop = np.sqrt(2 * accel * rest + (accel * dt / 2) ** 2) - accel * dt / 2
            last = np.minimum(np.minimum(last + accel * dt, stop), routes.pace.cruise_mps)
            speed[:, step] = last
            at[:, step + 1] = np.minimum(at[:, step] + dt * last, left - SHORT_M)
        spots = routes.at(np.repeat(cars, steps + 1), (s[:, None] + at).ravel())
        allowed = spots.speed_mps.reshape(at.shape)[:, 1:]
        speed = np.minimum(speed, allowed)
        speed[:, 0] = np.maximum(speed[:, 0], CREEP_MPS)
        bends = spots.curvature.reshape(at.shape)[:, :-1]
        here = spots.position.reshape(*at.shape, 3)[:, 0, :2]
        course = spots.course_rad.reshape(at.shape)[:, 0]
        gap = measured.position[cars, :2] - here
        sine, cosine = sine_cosine(course)
        across = cosine * gap[:, 1] - sine * gap[:, 0]
        pointing = course + np.where(way < 0, np.pi, 0.0)
        turned = unwound(measured.heading_rad[cars] - pointing)
        error = np.column_stack([np.zeros(len(cars)), across, turned])
        return controller.inputs(
            cars, error, Course(speed, bends, CREEP_MPS), way, self.inputs[cars]
        )


#: The gains k_y (per m²) and k_θ (per m).
ACROSS, HEADING = 16.0, 8.0

#: Who points this far aside of its path turns on the spot, until it is no further aside than that.
ASIDE_RAD, ALONG_RAD = 0.5, 0.03

#: Wheels that are slower stand, as far as their limits are concerned.
SLOWEST_MPS = 1e-9


class Turning:
    """The motion law of a group of differential drives: wheel speeds."""

    def __init__(self, group: Group) -> None:
        assert isinstance(group.body, DifferentialDrive)
        self.group, self.body = group, group.body
        self.legs = Legs(group, group.body.wheel_accel_mps2)
        self.speed: Floats = np.zeros(group.count)  #: that was commanded last
        self.turn: Floats = np.zeros(group.count)  #: the rate of turning that was
        self.turns: Bools = np.zeros(group.count, np.bool_)  #: who turns on the spot

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """The speeds of the wheels for the next step, in m/s, shape ``(n, 2)``, left ones first."""
        group = self.group
        wanted = automaton.moves(group.automata)
        speed, turn = np.zeros(group.count), np.zeros(group.count)
        turns, going = np.zeros(group.count, np.bool_), np.zeros(group.count, np.bool_)
        robots = np.flatnonzero(wanted & (group.routes.size > 0))
        if len(robots):
            robots, k, left = self.legs.advance(robots, measured)
            going[robots] = True
            aside = unwound(
                group.routes.at(robots, group.s[robots], k).course_rad
                - measured.heading_rad[robots]
            )
            begins = stands(measured, robots) & (self.speed[robots] == 0)
            limit = np.where(self.turns[robots] | begins, ALONG_RAD, ASIDE_RAD)
            turns[robots] = np.abs(aside) > limit
            turn[robots] = self._on_the_spot(robots, aside, dt_s)
            drives = ~turns[robots]
            robots, k, left, aside = robots[drives], k[drives], left[drives], aside[drives]
            speed[robots] = self.legs.pace(robots, self.speed[robots], left, dt_s)
            turn[robots] = self._along(robots, k, aside, speed[robots], measured)
        self.legs.watch(wanted, going, dt_s)
        speed = self.legs.speeds(going & ~turns, speed, measured, dt_s)
        half = self.body.track_m / 2
        # Where a wheel would have to be too quick both are slower: the bend stays what it is.
        share = self.body.wheel_mps / np.maximum(np.abs(speed) + half * np.abs(turn), SLOWEST_MPS)
        share = np.minimum(share, 1.0)
        self.turns, self.speed, self.turn = turns, share * speed, share * turn
        return np.column_stack([self.speed - half * self.turn, self.speed + half * self.turn])

    def _on_the_spot(self, robots: Ints, aside: Floats, dt_s: float) -> Floats:
        """Rates in rad/s of turning on the spot to the path, so that the wheels can stop there."""
        body = self.body
        accel = body.wheel_accel_mps2 / body.track_m  # half of what the wheels can do
        rate = np.minimum(np.sqrt(2 * accel * np.abs(aside)), np.abs(aside) / dt_s)
        rate = np.copysign(np.minimum(rate, body.cruise_turn_radps), aside)
        last = self.turn[robots]
        return last + bounded(rate - last, -2 * accel * dt_s, 2 * accel * dt_s)

    def _along(
        self, robots: Ints, k: Ints, aside: Floats, speed: Floats, measured: Measured
    ) -> Floats:
        """Rates in rad/s of turning that follow the path."""
        spot = self.group.routes.at(robots, self.group.s[robots], k)
        gap = spot.position[:, :2] - measured.position[robots, :2]
        sine, cosine = sine_cosine(spot.course_rad)
        across = cosine * gap[:, 1] - sine * gap[:, 0]
        bend = spot.curvature + ACROSS * across + HEADING * sine_cosine(aside)[0]
        return bounded(speed * bend, -self.body.cruise_turn_radps, self.body.cruise_turn_radps)
