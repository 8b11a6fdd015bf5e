"""What is found of a vehicle before it is armed. (P-PREFLIGHT)"""

from __future__ import annotations

import math
from collections.abc import Iterator

from msgspec import Struct

from koord.runtime.deploy.preflight import Check, Finding, check
from koord.runtime.guardian.events import Condition
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.vehicle import DrivenVehicle


class Stated(Struct, frozen=True):
    """What the configuration says of where a robot is."""

    position: Point | None = None  #: where it begins
    is_bounded: bool = True  #: it says how large the world is


def vehicle_checks(vehicle: DrivenVehicle, stated: Stated) -> Iterator[Check]:
    """Yield what is found of a vehicle, where it is ``stated`` to be."""
    sensed, limits = vehicle.sensed, vehicle.limits
    yield check("link", vehicle.matter(Condition.LINK), "the vehicle answers")
    here = _shown(sensed.position_m)
    yield check("pose", vehicle.matter(Condition.POSE), f"{here} m, and fresh")
    yield check("place", vehicle.matter(Condition.FENCE), "inside of the world, with its margin")
    yield _fence(vehicle.world, stated)
    yield _position(sensed.position_m, stated.position, limits.start_m)
    moves = None if vehicle.stands else "it is not known to be on the ground and to stand"
    yield check("at rest", moves, "it stands")
    yield _armed(sensed.armed)
    yield _battery(vehicle)
    yield _dead_man(vehicle)
    if limits.heartbeat_s is not None:
        beat = vehicle.matter(Condition.HEARTBEAT)
        finding = Finding.GOOD if beat is None else Finding.BAD
        cure = "" if beat is None else "koord heartbeat CONFIG"
        yield Check("heartbeat", finding, beat or "people are there", cure)
    if watchdog := vehicle.matter(Condition.WATCHDOG):
        yield Check("watchdog", Finding.BAD, watchdog)
    for remark in vehicle.driver.remarks:
        yield Check("driver", Finding.DOUBTFUL, remark)


def _armed(armed: bool | None) -> Check:
    match armed:
        case None:
            return Check("armed", Finding.GOOD, "the vehicle does not tell")
        case False:
            return Check("armed", Finding.GOOD, "it is not")
        case True:  # some vehicles arm themselves when they are switched on
            text = "it is armed, and no robot of this run has done that"
            return Check("armed", Finding.DOUBTFUL, text, "keep away from it")


def _fence(world: World, stated: Stated) -> Check:
    """How large the world is, and whether somebody has said that."""
    text = f"from {_shown(world.low)} to {_shown(world.high)} m"
    if stated.is_bounded:
        return Check("fence", Finding.GOOD, text)
    unsaid = f"{text}, with room for all places that are named: nobody has said it"
    cure = "write world: {bounds: …}, in the configuration or the file of --site"
    return Check("fence", Finding.DOUBTFUL, unsaid, cure)


def _position(here: Point, expected: Point | None, most_m: float) -> Check:
    """Whether the localisation agrees with the configuration; heights are the ground's matter."""
    if expected is None:
        return Check("position", Finding.GOOD, "the configuration does not say where it begins")
    off_m = math.dist(here[:2], expected[:2])
    said = f"{off_m:.2f} m from {_shown(expected)}, where the configuration has it"
    if off_m <= most_m:
        return Check("position", Finding.GOOD, said)
    cure = "carry it there, or mend `position`, the localisation, or `start` of `safety:`"
    return Check("position", Finding.BAD, f"{said} (limit {most_m:g} m)", cure)


def _battery(vehicle: DrivenVehicle) -> Check:
    battery = vehicle.sensed.battery
    if (low := vehicle.matter(Condition.BATTERY)) is not None:
        return Check("battery", Finding.BAD, low)
    if battery is None:
        return Check("battery", Finding.GOOD, "the vehicle does not tell")
    return Check("battery", Finding.GOOD, f"{battery:.0%}")


def _dead_man(vehicle: DrivenVehicle) -> Check:
    stops = vehicle.dead_man
    if stops is not None:
        return Check("dead man", Finding.GOOD, stops)
    text = "nothing stops it if this process is killed"
    return Check("dead man", Finding.DOUBTFUL, text, "as the configuration says on purpose")


def _shown(point: Point) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
