"""The platforms of deployed robots: vehicles, their drivers and their pilots."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from koord.api.fitting import Fitted
from koord.api.sim_setup import fallback
from koord.api.undriven import Drivers
from koord.runtime.configuration.model import Vehicle
from koord.runtime.deploy.job import CannotTakePartError, Job, ideal_host
from koord.runtime.deploy.member import Platform
from koord.runtime.drivers.driver import Device, Driver, DriverError, NoOptions
from koord.runtime.drivers.localised import Localised
from koord.runtime.guardian.conditions import Setup
from koord.runtime.motion.field import field
from koord.runtime.motion.planning import Planner, Room
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.rising import RisingPlanner
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.platform.world_host import WorldHost
from koord.runtime.plugins.loading import served_modules
from koord.runtime.robot import Host
from koord.sim.driver import SIMULATED
from koord.sim.scene_library import library_of

#: Ways are planned anew after so many rounds at most.
_KEPT_ROUNDS = 10


def simulated(fitted: Fitted) -> Callable[[Job, int], Platform]:
    """What makes the platforms of a dry run. Raises KoordError."""
    pids = range(len(fitted.scene.robots))
    drivers = Drivers(dict.fromkeys(pids, SIMULATED), dict.fromkeys(pids, NoOptions()))
    return platforms(fitted, drivers, fallback(fitted), arms=True)


def platforms(
    fitted: Fitted,
    drivers: Drivers,
    supplied: Callable[[Host], Host] | None = None,
    *,
    arms: bool,
) -> Callable[[Job, int], Platform]:
    """What makes the platform of a robot; ``supplied`` answers more than a vehicle knows.

    ``arms``: people have said that vehicles may move.
    """

    def make(job: Job, pid: int) -> Platform:
        if pid not in drivers.made:
            return ideal_host(job, pid)
        scene, vehicle = fitted.scene, fitted.configuration.robots[pid].vehicle
        world, placed = scene.world, scene.robots[pid]
        start = _standing(placed.start, vehicle, world)
        device = Device(pid, vehicle, world, start, placed.heading_rad, scene.seed)
        model = placed.model
        settings = pilot_settings(fitted, pid)
        guarded = Setup(vehicle.safety, field(world, flat=model.body.ON_GROUND), float(job.delta_s))
        try:
            driver = _driver(drivers, device)
            wishes = driver.capabilities.wishes
            steersman = pilot(settings, world, scene.seed * len(scene.robots) + pid, wishes=wishes)
            driven = DrivenVehicle(driver, steersman, guarded, time.monotonic(), watched=arms)
        except DriverError as error:
            raise CannotTakePartError(f"robot {pid}: {error.message}", error.hint) from None

        planner: Planner = steersman.asked
        height_m = steersman.takeoff_height_m
        if height_m is not None and not model.body.ON_GROUND:
            planner = RisingPlanner(planner, world.ground, height_m)
        library = library_of(scene, {pid: planner}, lambda robot: driven.sensors, _KEPT_ROUNDS)
        host = VehicleHost(job.classes, job.kinds, world, library, driven, scene.seed)
        if model.ignores_height:
            host.ignoring_height = frozenset((pid,))
        if vehicle.modules:
            host.modules[pid] = served_modules(
                vehicle.modules,
                pid,
                world,
                model.body,
                scene.seed,
                is_simulated=drivers.made[pid] is SIMULATED,
            )
        return VehiclePlatform(
            host,
            driven,
            supplied,
            arms=arms,
            stated=_stated(fitted, pid, start),
        )

    return make


def pilot_settings(fitted: Fitted, pid: int) -> PilotSettings:
    """How a robot moves. Its ways keep to where its guardian lets it be. (P-WAY)"""
    scene, safety = fitted.scene, fitted.configuration.robots[pid].vehicle.safety
    model = scene.robots[pid].model
    # Who is as far off its way as claims allow for is not yet where its guardian holds it.
    room = Room(safety.margin_m, scene.clearance.tracking_m)
    return PilotSettings(
        model.body,
        model.planner,
        model.steering,
        model.visit,
        model.effort,
        model.controller,
        room,
    )


def _driver(drivers: Drivers, device: Device) -> Driver:
    """The driver of a device, with its localiser if it has one. Raises DriverError."""
    pid = device.pid
    localiser = drivers.localisers.get(pid)
    driven = replace(device, options=drivers.options[pid])
    if localiser is None:
        return drivers.made[pid](driven)
    located = replace(device, options=drivers.localiser_options[pid])
    return Localised(drivers.made[pid](driven), localiser(located), located)


class ClaimsHost(WorldHost):
    """What answers the questions of claims about all robots: it has a world, and no vehicles."""

    def sensors(self, robot: int) -> MotionSensors:
        raise LookupError(robot)

    def scan(self, robot: int) -> tuple[Point, ...]:
        raise LookupError(robot)

    def follow(self, robot: int, path: Sequence[Point]) -> None:
        """Nobody moves."""

    def go_to(self, robot: int, target: Point) -> None:
        """Nobody moves."""

    def take_off(self, robot: int, up: bool) -> None:
        """Nobody moves."""


def claims_host(fitted: Fitted, job: Job) -> ClaimsHost:
    """Make what answers the questions of claims about the robots of a run."""
    scene = fitted.scene

    def nobody(robot: int) -> MotionSensors:
        raise LookupError(robot)

    library = library_of(scene, {}, nobody, _KEPT_ROUNDS)
    return ClaimsHost(job.classes, job.kinds, scene.world, library, scene.seed)


def _stated(fitted: Fitted, pid: int, start: Point) -> Stated:
    """What the configuration says of where a robot is."""
    configuration = fitted.configuration
    position = None if configuration.robots[pid].position is None else start
    return Stated(position, configuration.bounded)


def _standing(start: Point, vehicle: Vehicle, world: World) -> Point:
    """Where a vehicle stands before the run: aircraft on the ground, below where they begin."""
    x, y, z = start
    return (x, y, z) if vehicle.body.IS_EXACT else (x, y, world.ground)
