"""Squads of cars: kinematic bicycles under pursuit or model-predictive control."""

from __future__ import annotations

from koord.machine import is_installed
from koord.runtime.motion.bodies import Car, Steering
from koord.runtime.motion.driving import PREDICTIVE_TICKS, Driving
from koord.runtime.motion.predictive import Predictive
from koord.runtime.motion.pursuit import Horizon
from koord.sim.squads import (
    STEP_S,
    STEPS,
    SquadSetup,
    VehicleSetup,
    Wheeled,
    WheeledSquad,
    tracker,
    wheeled,
)
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.wheels import Hull


def squad(setup: SquadSetup) -> WheeledSquad:
    """Make a squad of cars at rest, with pursuit or model-predictive control."""
    car, steering = setup.model.body, setup.model.steering
    assert isinstance(car, Car)
    predicts = steering is Steering.PREDICTIVE and setup.model.controller is None
    every = PREDICTIVE_TICKS if predicts else 1
    horizon = Horizon(step_s=every * STEPS * STEP_S)
    law = tracker(setup, lambda: Driving(setup.group, steering, horizon, _predictive()))
    if isinstance(law, Driving) and is_installed():
        from koord.sim.vehicles.compiled_tracking import TrackedSquad

        return TrackedSquad(setup, vehicles(setup), law)
    return WheeledSquad(setup, vehicles(setup), law, every)


def _predictive() -> type[Predictive]:
    """The kind of controllers: by machine code where there is llvmlite, and the same without."""
    if not is_installed():
        return Predictive
    from koord.sim.vehicles.compiled_driving import CompiledPredictive

    return CompiledPredictive


def vehicles(setup: VehicleSetup) -> Wheeled:
    """Make cars at rest; commands are speeds and steering angles."""
    car = setup.model.body
    assert isinstance(car, Car)
    hull = Hull(car.mass_kg, *car.outline_m)
    return wheeled(setup, Bicycles(car, setup.start, setup.heading_rad), hull)
