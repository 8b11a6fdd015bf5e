"""Vehicles that cannot touch anything move without pymunk, exactly as it moves them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, DifferentialDrive
from koord.runtime.motion.planning import Hindrance
from koord.runtime.motion.world import Box, World
from koord.sim.vehicles import contact
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.contact import Colliding, Floor
from koord.sim.vehicles.room import Room, room_m
from koord.sim.vehicles.rovers import Differentials
from koord.sim.vehicles.wheels import Hull
from tests.sampling import first

CAR, ROVER = Car(), DifferentialDrive()
CARS = Hull(CAR.mass_kg, *CAR.outline_m)
ROVERS = Hull(ROVER.mass_kg, *ROVER.outline_m, is_disc=True)
WORLD = World((-6, -6, 0), (6, 6, 3), obstacles=(Box((-0.5, -0.5, 0), (0.5, 0.5, 1)),))
WALLS = np.array([[-6.0, -6, -5, 6], [5.0, -6, 6, 6], [-0.5, -0.5, 0.5, 0.5]])


class Never(Room):
    """Room that is never enough: pymunk makes all steps."""

    def suffices(self, state: Floats, radius_m: float, span_s: float, accel_mps2: float) -> bool:
        return False


class Noting(Room):
    """Notes whether there was room."""

    found: list[bool]

    def suffices(self, state: Floats, radius_m: float, span_s: float, accel_mps2: float) -> bool:
        found = super().suffices(state, radius_m, span_s, accel_mps2)
        self.found.append(found)
        return found


def fleet(seed: int) -> tuple[Floor, Colliding, Colliding]:
    """Three cars and two differential drives on one floor."""
    draw, floor = np.random.default_rng(seed), Floor(WORLD)
    start = np.array([[-3.0, -3, 0], [3.0, -3, 0], [0.0, 3, 0]])
    cars = Colliding(Bicycles(CAR, start, draw.uniform(-3, 3, 3)), CARS, floor)
    others = np.array([[-3.0, 3, 0], [3.0, 3, 0]])
    rovers = Colliding(Differentials(ROVER, others, draw.uniform(-3, 3, 2)), ROVERS, floor)
    return floor, cars, rovers


def seen(parts: tuple[Colliding, ...]) -> bytes:
    return b"".join(
        row.tobytes() for one in parts for row in (one.position, one.heading, one.speed)
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(1, range(6)))
def test_bodies_move_as_pymunk_moves_them(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also when they come to where they touch something, and away from there."""
    monkeypatch.setattr(Noting, "found", [], raising=False)
    runs = []
    for room in (Noting, Never):
        monkeypatch.setattr(contact, "Room", room)
        _, *parts = fleet(seed)
        draw, story = np.random.default_rng(seed), []
        for k in range(300):
            for one, count in zip(parts, (3, 2), strict=True):
                sign = 1.0 if k % 120 < 80 else -1.0
                command = np.column_stack(
                    [sign * draw.uniform(0.5, 1.0, count), draw.uniform(-0.2, 0.6, count)]
                )
                one.advance(command, 0.01, 5)
            touched = [
                [(one.what, one.number) for one in parts[0].touched(row)] for row in range(3)
            ]
            story.append((seen((parts[0], parts[1])), touched))
        runs.append(story)
    assert runs[0] == runs[1]
    assert {True, False} == set(Noting.found)
    assert any(any(touched) for _, touched in runs[0])


def test_who_drives_against_a_wall_touches_it() -> None:
    cars = Colliding(Bicycles(CAR, np.array([[3.0, 3, 0]]), np.zeros(1)), CARS, Floor(WORLD))
    for _ in range(120):
        cars.advance(np.array([[1.0, 0.0]]), 0.01, 5)
    assert [one.what for one in cars.touched(0)] == [Hindrance.EDGE]
    assert cars.position[0, 0] < 6.0


@pytest.mark.parametrize("seed", range(20))
def test_room_is_no_more_than_there_is(seed: int) -> None:
    """Every circle may move so far, in any direction, and none touches anything."""
    draw = np.random.default_rng(seed)
    middles, radius_m = draw.uniform(-5, 5, (draw.integers(1, 12), 2)), 0.2
    room = room_m(middles, radius_m, WALLS)
    gaps = [0.5]
    for k, (x, y) in enumerate(middles.tolist()):
        for left, low, right, high in WALLS.tolist():
            aside, above = max(left - x, x - right, 0.0), max(low - y, y - high, 0.0)
            gaps.append(math.hypot(aside, above) - radius_m)
        gaps += [math.dist((x, y), other) / 2 - radius_m for other in middles[:k].tolist()]
    if min(gaps) > 0:
        assert room == pytest.approx(min(gaps), abs=1e-12)
    else:
        assert room <= 1e-12


def test_what_is_no_number_has_no_room() -> None:
    state = np.full((2, 6), np.nan)
    assert not Room(WALLS).suffices(state, 0.2, 0.05, 8.8)
    still = np.zeros((2, 6))
    still[:, 0] = 2.0, np.nan
    assert not Room(WALLS).suffices(still, 0.2, 0.05, 8.8)


def test_room_is_used_up_by_whoever_is_the_fastest() -> None:
    """Two that drive towards each other are let go only as far as they are from each other."""
    state = np.array([[1.5, 2.0, 0, 0, 0, 0], [4.0, 2.0, 0, -1.0, 0, 0]])
    room = Room(WALLS)
    while room.suffices(state, 0.2, 0.05, 0.0):
        state[1, 0] -= 0.05
    # They begin 2.5 m apart, and touch at 0.4 m. Either might have moved.
    assert 0.4 < state[1, 0] - state[0, 0] < 0.56
