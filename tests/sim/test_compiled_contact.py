"""Cars in contact by machine code: bit for bit those of NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, DifferentialDrive
from koord.runtime.motion.world import Box, World
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.contact import Colliding, Floor
from koord.sim.vehicles.rovers import Differentials
from koord.sim.vehicles.wheels import Hull, Rolling
from tests.sampling import first

compiled_contact = pytest.importorskip("koord.sim.vehicles.compiled_contact")

CAR = Car()
ROVER = DifferentialDrive()
WORLD = World((-4, -4, 0), (4, 4, 3), obstacles=(Box((-0.5, -0.5, 0), (0.5, 0.5, 1)),))

WIDE = World((-400, -400, 0), (400, 400, 3))


def bicycles(start: Floats, heading: Floats) -> Rolling:
    return Bicycles(CAR, start, heading)


def differentials(start: Floats, heading: Floats) -> Rolling:
    return Differentials(ROVER, start, heading)


Kind = Callable[[Floats, Floats], Rolling]

HULLS: dict[Kind, Hull] = {
    bicycles: Hull(CAR.mass_kg, *CAR.outline_m),
    differentials: Hull(ROVER.mass_kg, *ROVER.outline_m, is_disc=True),
}


def seen(cars: Colliding) -> bytes:
    model = cars.model
    kept = model.steering if isinstance(model, Bicycles) else model.turning()
    parts: tuple[Floats, ...] = (cars.position, cars.heading, cars.speed, kept)
    return b"".join(part.tobytes() for part in parts)


@pytest.mark.parametrize("width", first(1, [2, 4, 8]))
@pytest.mark.parametrize("count", [1, 8, 13])
@pytest.mark.parametrize("kind", [bicycles, differentials])
@pytest.mark.parametrize("world", [WORLD, WIDE])
def test_machine_code_pushes_as_numpy_does(
    width: int,
    count: int,
    kind: Kind,
    world: World,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where they touch each other and walls, or nothing; with more than one step of time."""
    if width > compiled_contact.widest():
        pytest.skip("this processor's registers hold less")
    monkeypatch.setattr(compiled_contact, "_width", lambda: width)
    draw = np.random.default_rng(count)
    start = np.zeros((count, 3))
    start[:, :2] = draw.uniform(-3, 3, (count, 2)) * (1 if world is WORLD else 100)
    heading = draw.uniform(-3, 3, count)
    hull = HULLS[kind]
    one = Colliding(kind(start, heading), hull, Floor(world))
    other = compiled_contact.compiled(kind(start, heading), hull, Floor(world))
    whole = compiled_contact.CompiledCars if kind is bicycles else compiled_contact.CompiledRovers
    assert type(other) is whole
    for k in range(60):
        command = np.column_stack([draw.uniform(-3, 3, count), draw.uniform(-0.6, 0.6, count)])
        for cars in (one, other):
            before = cars.speed
            kept = before.copy()
            cars.advance(command, 0.01 if k % 2 else 0.004, 5)
            assert np.array_equal(before, kept)  # who has seen a speed keeps it
        assert seen(one) == seen(other)
    assert np.linalg.norm(one.position - start, axis=1).max() > 0.05
