"""Squads of robots with a differential drive."""

from __future__ import annotations

from koord.machine import is_installed
from koord.runtime.motion.bodies import DifferentialDrive
from koord.runtime.motion.driving import Turning
from koord.sim.squads import SquadSetup, VehicleSetup, Wheeled, WheeledSquad, tracker, wheeled
from koord.sim.vehicles.rovers import Differentials
from koord.sim.vehicles.wheels import Hull


def squad(setup: SquadSetup) -> WheeledSquad:
    """Make a squad of differential drives at rest."""
    law = tracker(setup, lambda: Turning(setup.group))
    if isinstance(law, Turning) and is_installed():
        from koord.sim.vehicles.compiled_turning import TurningSquad

        return TurningSquad(setup, vehicles(setup), law)
    return WheeledSquad(setup, vehicles(setup), law)


def vehicles(setup: VehicleSetup) -> Wheeled:
    """Make differential drives at rest; commands are the speeds of wheels, left ones first."""
    body = setup.model.body
    assert isinstance(body, DifferentialDrive)
    hull = Hull(body.mass_kg, *body.outline_m, is_disc=True)
    return wheeled(setup, Differentials(body, setup.start, setup.heading_rad), hull)
