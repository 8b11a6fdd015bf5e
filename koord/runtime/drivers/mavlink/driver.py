"""The driver ``mavlink``: PX4 in offboard mode and ArduPilot in guided mode.

All that it sends, heartbeats too, it sends when it is asked at a tick: if koord falls silent,
the autopilot's own failsafe acts. (M-TICK)
"""

from __future__ import annotations

import math
import time
from typing import ClassVar

from msgspec import Struct

from koord.runtime.drivers.aircraft import AircraftDriver, aircraft_capabilities
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.leading import Flight
from koord.runtime.drivers.mavlink.control import Control
from koord.runtime.drivers.mavlink.failsafe import FailsafeCheck
from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.mavlink.link import Link, WireLink
from koord.runtime.drivers.mavlink.modes import MODES
from koord.runtime.drivers.mavlink.options import MavlinkOptions
from koord.runtime.drivers.mavlink.requests import Requests
from koord.runtime.drivers.mavlink.telemetry import Telemetry
from koord.runtime.drivers.mavlink.vision import ExternalVision
from koord.runtime.drivers.setpoints import (
    Disarm,
    Hold,
    Located,
    Sensed,
    Setpoint,
    Takeoff,
)

#: Our heartbeats, s apart.
_HEARTBEAT_S = 0.5

#: After koord or the autopilot was silent for long, the autopilot may have changed its mode for
#: that, and be heard of it so much later.
_EXCUSED_S = 5.0

#: Set-points that are further apart are no stream.
_BREAK_S = 0.3

_MODE = mavlink.MAV_CMD_DO_SET_MODE
_ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
_TAKEOFF = mavlink.MAV_CMD_NAV_TAKEOFF

#: Disarms what is in the air.
_FORCE = 21196.0


class MavlinkDriver(AircraftDriver):
    """The driver of one aircraft."""

    OPTIONS: ClassVar[type[Struct]] = MavlinkOptions

    def __init__(self, device: Device, link: Link | None = None) -> None:
        """Make a driver; ``link`` instead of the connection of the options. Raises DriverError."""
        options = device.options
        if not isinstance(options, MavlinkOptions):
            raise DriverError("a MAVLink vehicle needs a `connection`", "as udpin:0.0.0.0:14540")
        self.options = options
        self.capabilities = aircraft_capabilities(
            options.telemetry, options.silence, options.takeoff_height
        )
        origin = device.position_m if options.origin == "start" else options.origin
        ground_m = device.world.ground
        self._modes = MODES[options.autopilot]
        self._telemetry = Telemetry(origin, ground_m)
        self._requests = Requests(options)
        self._control = Control(options, origin, ground_m)
        self._failsafe = FailsafeCheck(options)
        self._vision = ExternalVision(options, origin)
        self._link = link
        self._told_s = -math.inf
        self._beat_s = -math.inf  #: our last heartbeat
        self._sent_s = -math.inf  #: our last set-point
        self._streaming_s = math.inf  #: since when set-points go out without a break
        self._heard_s = -math.inf  #: anything of the autopilot
        self._hears = True  #: it was heard of lately
        self._excused_s = -math.inf  #: until then it may have changed its mode for want of us
        self._asked_mode: int | None = None
        self._own_mode: int | None = None  #: the mode in which it is because koord asked for it
        self._taken: str | None = None  #: the mode in which somebody else has taken over
        self._was_armed = False  #: since koord asked for it

    # --- the interface of drivers ---------------------------------------------------------------

    def open(self, now_s: float) -> None:
        """Connect, and wait for the first pose: here alone. Raises DriverError.

        Whoever is told where it is has no pose before: its heartbeat is waited for.
        """
        if self._link is None:
            opening_s = time.monotonic()
            self._link = WireLink(self.options)
            now_s += time.monotonic() - opening_s
        begun_s = now_s
        while not self._is_found(now_s):
            if now_s - begun_s > self.options.connect:
                self._link.close()
                raise self._nothing_heard()
            self._listen(now_s)
            now_s += self._link.wait(0.02)

    def _is_found(self, now_s: float) -> bool:
        if self._vision.is_used:
            return self._telemetry.armed is not None
        return self._sensed(now_s) is not None

    def locate(self, located: Located, now_s: float) -> None:
        """Tell the autopilot where it is. (M-VISION)"""
        message = self._vision.take(located, now_s)
        if message is not None and self._link is not None:
            self._send(message)

    def sense(self, now_s: float) -> Sensed | None:
        self._listen(now_s)
        self._vision.watch(self._telemetry.position_m, now_s)
        return self._sensed(now_s)

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        if now_s - self._told_s > self.options.silence:
            self._excused_s = now_s + _EXCUSED_S
        self._told_s = now_s
        if not isinstance(setpoint, Takeoff):
            self._requests.forget(_TAKEOFF)
        super().command(setpoint, now_s)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Why the vehicle does not do what it is told, and what its autopilot says."""
        found: list[str] = []
        if not self._hears:
            found.append(f"nothing is heard of the autopilot at `{self.options.connection}`")
        if self._taken is not None:
            found.append(
                f"koord does not command it: a person or the autopilot has switched it to"
                f" {self._taken}. Land it, and start it again"
            )
        elif self._was_armed and self._telemetry.armed is False and self._moves:
            found.append("the autopilot has disarmed itself: koord does not arm it again by itself")
        if trouble := self._vision.trouble(self._telemetry.position_m):
            found.append(trouble)
        if trouble := self._failsafe.trouble:
            found.append(f"the failsafe of the autopilot is not set up: {trouble}")
        disarms = isinstance(self._told, Disarm)
        for command, doing in (
            (_MODE, "change its mode"),
            (_ARM, "disarm" if disarms else "arm"),
            (_TAKEOFF, "take off"),
        ):
            if why := self._requests.trouble(command):
                found.append(f"the autopilot does not {doing} ({why})")
        return (*found, *(f"the autopilot says: {text}" for text in self._telemetry.texts))

    def close(self) -> None:
        if self._link is not None:
            self._link.close()

    # --- what is heard --------------------------------------------------------------------------

    def _listen(self, now_s: float) -> None:
        """Take what has arrived; send our heartbeat, and ask for what is not told yet."""
        assert self._link is not None, "open comes first"
        for message in self._link.receive():
            if message.get_srcSystem() != self.options.system:
                continue
            if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
                continue
            self._hear(message, now_s)
        self._telemetry.forget(now_s)
        if now_s - self._beat_s >= _HEARTBEAT_S:
            self._beat_s = now_s
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS,
                    mavlink.MAV_AUTOPILOT_INVALID,
                    0,
                    0,
                    mavlink.MAV_STATE_ACTIVE,
                    3,  # of MAVLink
                )
            )
        for request in self._requests.streams(self._telemetry.pose_age_s(now_s), now_s):
            self._send(request)
        question = self._failsafe.ask(now_s)
        if question is not None:
            self._send(question)

    def _hear(self, message: Message, now_s: float) -> None:
        if now_s - self._heard_s > self.options.silence:
            self._excused_s = now_s + _EXCUSED_S
        self._heard_s = now_s
        if message.get_type() == "COMMAND_ACK":
            self._requests.hear(message)
        if message.get_type() == "PARAM_VALUE":
            self._failsafe.hear(message)
        self._telemetry.hear(message, now_s)
        if message.get_type() == "HEARTBEAT":
            self._watch_mode(now_s)

    def _watch_mode(self, now_s: float) -> None:
        """Notice that it did what koord asked for, and that somebody else has changed its mode."""
        mode, armed = self._telemetry.mode, self._telemetry.armed
        if armed is not isinstance(self._told, Disarm):
            self._requests.forget(_ARM)
        self._was_armed = self._was_armed or (bool(armed) and not isinstance(self._told, Disarm))
        if mode == self._asked_mode:
            self._own_mode = mode
            self._requests.forget(_MODE)
        elif self._own_mode not in (None, mode):
            self._own_mode = self._asked_mode = None
            self._requests.forget(_MODE)
            if armed and now_s > self._excused_s and mode is not None:
                self._taken = self._modes.name(mode)

    def _sensed(self, now_s: float) -> Sensed | None:
        self._hears = now_s - self._telemetry.heard_s <= self.options.link
        obeys = self._taken is None or self._telemetry.airborne(now_s) is False
        obeys = obeys and not self._vision.differs
        return self._telemetry.sensed(now_s, link=self._hears and obeys)

    def _nothing_heard(self) -> DriverError:
        where = f"`{self.options.connection}`"
        if math.isinf(self._heard_s):
            return DriverError(
                f"nothing is heard of system {self.options.system} at {where}",
                "is it switched on, and does it send there? See `connection` and `system`",
            )
        return DriverError(
            f"the autopilot at {where} tells no local position",
            "it needs an estimate of its position: by GPS, optical flow or motion capture",
        )

    # --- what is said ---------------------------------------------------------------------------

    def _disarm(self, now_s: float) -> None:
        in_the_air = self._telemetry.airborne(now_s) is True
        if not in_the_air:
            self._taken, self._was_armed = None, False
        if self._telemetry.armed is not False:
            self._ask(_ARM, (0.0, _FORCE) if in_the_air else (0.0,), now_s)

    def _arm(self, now_s: float) -> None:
        """On the ground: the mode first, then the motors. (M-ARM)"""
        if self._telemetry.airborne(now_s) is not False:
            return
        self._stream(Hold(), now_s)
        if self._switch(self._modes.GUIDED, now_s) and not self._telemetry.armed:
            self._ask(_ARM, (1.0,), now_s)

    def _land(self, now_s: float) -> None:
        """Let the autopilot land. It disarms itself then."""
        if self._telemetry.armed is not False and not self._is_steered(now_s):
            self._switch(self._modes.LAND, now_s)

    def _fly(self, flight: Flight, now_s: float) -> None:
        if self._taken is not None or not self._telemetry.armed or self._is_steered(now_s):
            return
        by_command = self._modes.RISES_BY_COMMAND and self._is_down(now_s)
        if isinstance(flight, Takeoff) and by_command:
            self._rise(flight, now_s)
            return
        self._stream(flight, now_s)
        if not isinstance(flight, Hold):
            self._switch(self._modes.GUIDED, now_s)

    def _rise(self, takeoff: Takeoff, now_s: float) -> None:
        """Let it take off by its own command. (M-TAKEOFF)"""
        if self._switch(self._modes.GUIDED, now_s):
            height_m = self._control.above_start_m(takeoff, self._telemetry.position_m)
            self._ask(_TAKEOFF, (0.0,) * 6 + (round(height_m, 2),), now_s)

    def _is_down(self, now_s: float) -> bool:
        return self._telemetry.airborne(now_s) is False

    def _is_steered(self, now_s: float) -> bool:
        """Return whether a person steers it in the air: nothing takes it from them. (M-HANDS)"""
        mode = self._telemetry.mode
        return mode is not None and not self._is_down(now_s) and self._modes.is_manual(mode)

    def _switch(self, mode: int, now_s: float) -> bool:
        """Ask for a mode if it is in another one; return whether it is in this one. (M-MODE)"""
        if self._telemetry.mode == mode:
            self._asked_mode = self._own_mode = mode
            return True
        streams = now_s - self._streaming_s >= self._modes.STREAM_FIRST_S
        if mode != self._modes.GUIDED or streams:
            self._asked_mode = mode
            custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
            self._ask(_MODE, (custom, *self._modes.numbers(mode)), now_s)
        return False

    def _stream(self, flight: Flight, now_s: float) -> None:
        if now_s - self._sent_s > _BREAK_S:
            self._streaming_s = now_s
        self._sent_s = now_s
        here, velocity = self._telemetry.position_m, self._telemetry.velocity_mps
        on_ground = self._is_down(now_s)
        self._send(self._control.target(flight, here, velocity, now_s, on_ground=on_ground))

    def _ask(self, command: int, parameters: tuple[float, ...], now_s: float) -> None:
        message = self._requests.ask(command, parameters, now_s)
        if message is not None:
            self._send(message)

    def _send(self, message: Message) -> None:
        assert self._link is not None, "open comes first"
        self._link.send(message)
