"""Seeded mistakes in the driver of aircraft with MAVLink, and in who takes off."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

MAVLINK = "tests/runtime/platform/test_mavlink.py"
FRAMES = "tests/runtime/platform/test_frames.py"
DRIVEN = "tests/runtime/platform/test_driven.py"

_DRIVER = "runtime.drivers.mavlink.driver.MavlinkDriver"
_CONTROL = "runtime.drivers.mavlink.control"
_TELEMETRY = "runtime.drivers.mavlink.telemetry"
_PILOT = "runtime.platform.pilots.FlyingPilot"

#: What would let an aircraft fly elsewhere, or against a person, without anybody being told.
MAVLINKED = (
    Mutant(
        "yaw counts the other way round",
        "runtime.drivers.frames.heading_to_ned",
        "math.pi / 2 - heading_rad",
        "heading_rad - math.pi / 2",
        (FRAMES, MAVLINK),
    ),
    Mutant(
        "the origin of the autopilot's frame is forgotten in set-points",
        f"{_CONTROL}.Control._message",
        "between(self._origin_m, aim)",
        "aim",
        (MAVLINK,),
    ),
    Mutant(
        "who holds goes back to where it was told to",
        "runtime.drivers.leading.Leader.target",
        "self._aim = _stopping(here, velocity_mps)",
        "self._aim = here",
        (MAVLINK,),
    ),
    Mutant(
        "an old pose that waited in a queue is a new one",
        f"{_TELEMETRY}.Telemetry._measured_at",
        "return self._clock.ours(boot_s)",
        "return now_s",
        (MAVLINK,),
    ),
    Mutant(
        "who steers by hand is told to land",
        f"{_DRIVER}._land",
        "self._telemetry.armed is not False and not self._is_steered(now_s)",
        "self._telemetry.armed is not False",
        (MAVLINK,),
    ),
    Mutant(
        "who was switched to another mode is taken back",
        f"{_DRIVER}._fly",
        "self._taken is not None or not self._telemetry.armed or self._is_steered(now_s)",
        "not self._telemetry.armed or self._is_steered(now_s)",
        (MAVLINK,),
    ),
    Mutant(
        "after silence the autopilot's own mode is somebody's",
        f"{_DRIVER}._watch_mode",
        "armed and now_s > self._excused_s and mode is not None",
        "armed and mode is not None",
        (MAVLINK,),
    ),
    Mutant(
        "what stands is disarmed by force",
        f"{_DRIVER}._disarm",
        "(0.0, _FORCE) if in_the_air else (0.0,)",
        "(0.0, _FORCE)",
        (MAVLINK,),
    ),
    Mutant(
        "offboard mode is asked for before set-points stream",
        f"{_DRIVER}._switch",
        "mode != self._modes.GUIDED or streams",
        "True",
        (MAVLINK,),
    ),
    Mutant(
        "other vehicles on the wire are listened to",
        f"{_DRIVER}._listen",
        "message.get_srcSystem() != self.options.system",
        "False",
        (MAVLINK,),
    ),
    Mutant(
        "a refusal is kept from people",
        "runtime.drivers.mavlink.requests.Requests.trouble",
        "asked.result is None or asked.result in _AGREED",
        "True",
        (MAVLINK,),
    ),
    Mutant(
        "who is to take off follows its way from the ground on",
        f"{_PILOT}.wish",
        "not self._has_risen",
        "False",
        (DRIVEN,),
    ),
    Mutant(
        "a path is joined through what is in between",
        f"{_PILOT}._join",
        "path and not self._field.path_free(as_path([here, *path]), reach_m)",
        "False",
        (DRIVEN,),
    ),
)
