"""Vehicles that brake as their limits say, under motion that wishes for anything.

They obey after ``reaction_s`` and change their velocity by ``braking_mps2``, turning included; so
what specs/guardian assumes holds of them, and what it promises has to.
"""

from __future__ import annotations

import math
import random
from collections import deque

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Hold, Sensed, Velocity, Wish
from koord.runtime.guardian.events import Order, Ordered, Other, Ticked
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.guardian.machine import step
from koord.runtime.guardian.modes import Mode, initial
from koord.runtime.motion.world import Point
from tests.runtime.guardian.guarded import CAR, DRONE, LEVEL, setup_of
from tests.sampling import first

TICK_S = 0.02

#: Robots learn where the others are as often as this.
SEEN_S = 0.1

AT_REST = (0.0, 0.0, 0.0)


class Vehicle:
    """A point with a velocity, and its guardian, which is reset to running now and then."""

    def __init__(self, limits: SafetyLimits, place: Point, rng: random.Random) -> None:
        self.setup = setup_of(replace(limits, hold_s=1e9, resume_s=0.2))
        self.state = replace(initial(0.0), mode=Mode.RUNNING, clear_since_s=0.0)
        self.place, self.velocity = np.array(place), np.zeros(3)
        self.told = deque([np.zeros(3)] * (round(limits.reaction_s / TICK_S) - 1))
        self.braking_mps2 = limits.braking_mps2
        self.ran = 0
        self._rng = rng
        self._wish: Wish = Hold()
        self._until_s = 0.0

    def wish(self, now_s: float, others: tuple[Other, ...]) -> Wish:
        """Any velocity that motion may wish for, for some time; often towards another robot."""
        if now_s >= self._until_s:
            rng = self._rng
            self._until_s = now_s + rng.uniform(0.05, 1.0)
            angle, up = rng.uniform(-math.pi, math.pi), rng.choice([0.0, rng.uniform(-1, 1)])
            if others and rng.random() < 0.6:
                x, y, _ = np.array(others[0].position_m) - self.place
                angle, up = math.atan2(y, x) + rng.uniform(-0.4, 0.4), 0.0
            up *= self.setup.limits.flies
            flat, speed = math.sqrt(1 - up * up), self.setup.limits.speed_mps
            speed *= rng.choice([0.3, 1.0, 1.0])
            way = (flat * math.cos(angle), flat * math.sin(angle), up)
            self._wish = Velocity((speed * way[0], speed * way[1], speed * way[2]))
        return self._wish

    def tick(self, now_s: float, others: tuple[Other, ...] = ()) -> None:
        sensed = Sensed(self.at(), LEVEL, self.moves(), now_s)
        tick = Ticked(now_s, sensed, self.wish(now_s, others), 0.05, others=others)
        self.state, answer = step(self.setup, self.state, tick)
        if self.state.waits:
            self.state, _ = step(self.setup, self.state, Ordered(now_s, Order.START))
        self.ran += self.state.mode is Mode.RUNNING
        said = answer.setpoint
        self.told.append(np.array(said.velocity_mps if isinstance(said, Velocity) else AT_REST))
        change = self.told.popleft() - self.velocity
        most = self.braking_mps2 * TICK_S
        self.velocity = self.velocity + change * min(
            1.0, most / max(float(np.linalg.norm(change)), most)
        )
        self.place = self.place + self.velocity * TICK_S
        if self.place[2] < 0:
            self.place[2] = self.velocity[2] = 0.0

    def at(self) -> Point:
        x, y, z = map(float, self.place)
        return x, y, z

    def moves(self) -> Point:
        x, y, z = map(float, self.velocity)
        return x, y, z


def nearest_to_the_fence(vehicle: Vehicle, seconds: float) -> float:
    """How near a vehicle comes to walls and obstacles, in metres."""
    nearest = math.inf
    for k in range(round(seconds / TICK_S)):
        vehicle.tick(k * TICK_S)
        nearest = min(nearest, vehicle.setup.field.clearance(*vehicle.at()))
    return nearest


@pytest.mark.parametrize("limits", first(1, [CAR, DRONE]), ids=["car", "drone"])
def test_nobody_leaves_the_fence(limits: SafetyLimits) -> None:
    """(G-AHEAD, G-FENCE): nobody comes into the margin, and most of the time they move."""
    for seed in range(8):
        rng = random.Random(seed)
        place = (rng.uniform(-4, 2), rng.uniform(-4, 4), 1.5 * limits.flies)
        vehicle = Vehicle(limits, place, rng)
        assert nearest_to_the_fence(vehicle, 20.0) >= limits.margin_m
        assert vehicle.ran > 300


def test_who_brakes_worse_than_it_says_comes_into_the_margin() -> None:
    vehicle = Vehicle(CAR, (-4.0, 0.0, 0.0), random.Random(1))
    vehicle.braking_mps2 /= 3
    assert nearest_to_the_fence(vehicle, 20.0) < CAR.margin_m


def nearest_to_each_other(one: Vehicle, other: Vehicle, seconds: float) -> float:
    """How near two vehicles come to each other, in metres."""
    both = (one, other)
    seen: tuple[tuple[float, Point, Point], ...] = ()
    nearest = math.inf
    for k in range(round(seconds / TICK_S)):
        now_s = k * TICK_S
        if k % round(SEEN_S / TICK_S) == 0:
            seen = tuple((now_s, robot.at(), robot.moves()) for robot in both)
        for pid, robot in enumerate(both):
            at_s, place, velocity = seen[1 - pid]
            robot.tick(now_s, (Other(1 - pid, place, velocity, now_s - at_s),))
        nearest = min(nearest, float(np.linalg.norm(one.place - other.place)))
    return nearest


@pytest.mark.parametrize("limits", first(1, [CAR, DRONE]), ids=["car", "drone"])
def test_nobody_comes_too_close_to_another_robot(limits: SafetyLimits) -> None:
    """(G-APART)"""
    for seed in range(5):
        rng = random.Random(seed)
        one = Vehicle(limits, (-1.0, 0.0, 1.5 * limits.flies), rng)
        other = Vehicle(limits, (1.0, 0.0, 1.5 * limits.flies), rng)
        assert nearest_to_each_other(one, other, 15.0) >= limits.separation_m
        assert one.ran + other.ran > 300


def test_without_the_rule_they_would_come_too_close() -> None:
    careless = replace(CAR, separation_m=0.05)
    rng = random.Random(0)
    one, other = (Vehicle(careless, (x, 0.0, 0.0), rng) for x in (-1.0, 1.0))
    assert nearest_to_each_other(one, other, 15.0) < CAR.separation_m
