"""The driver ``crazyflie``: Crazyflies of Bitcraze, by radio, USB or UDP.

All that it says it says when it is asked at a tick: if koord falls silent, the firmware levels it
out after half a second, and stops its motors after two. (C-TICK) (C-SILENCE)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

from msgspec import Struct

from koord.runtime.drivers.aircraft import AircraftDriver, aircraft_capabilities
from koord.runtime.drivers.crazyflie.library import CRTPPacket, CRTPPort
from koord.runtime.drivers.crazyflie.link import (
    Answer,
    CflibLink,
    Command,
    Down,
    Link,
    Logged,
    Text,
    Up,
)
from koord.runtime.drivers.crazyflie.options import CrazyflieOptions
from koord.runtime.drivers.crazyflie.requests import Request, Requests
from koord.runtime.drivers.crazyflie.telemetry import Info, Telemetry
from koord.runtime.drivers.crazyflie.troubles import first_line, unreachable
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import to_xyzw, turned, yaw_of
from koord.runtime.drivers.leading import Flight, Leader, between
from koord.runtime.drivers.setpoints import (
    Disarm,
    Hold,
    Land,
    Located,
    Sensed,
    Setpoint,
)

#: The firmware stops motors after this. (`COMMANDER_WDT_TIMEOUT_SHUTDOWN` of `supervisor.c`)
_SILENCE_S = 2.0

#: It says that it flies for 2 s after its motors have stopped; who says so for longer than this
#: after the end of its landing has not landed.
_LANDED_S = 4.0

#: What could not be sent within these is dropped: set-points and poses, and commands.
_TICK_S, _COMMAND_S = 0.1, 0.5

#: It connects anew after it was silent so many times longer than it may be.
_PATIENCE = 2

#: A new estimate is begun by a parameter of 8 bits that is set for so long, and good so much later.
_UINT8, _RESET_S = 0x08, 0.1
_BEGIN_ANEW: tuple[Command, ...] = (
    lambda cf: cf.param.set_value_raw("kalman.resetEstimation", _UINT8, 1),
    lambda cf: cf.param.set_value_raw("kalman.resetEstimation", _UINT8, 0),
)

#: Positions of full set-points are integers of 16 bits, in mm, as velocities and accelerations are.
_MOST = 32.0

#: Commands of the supervisor, and of the platform where firmware has none (below CRTP 12).
_ARM, _SUPERVISOR_SINCE = 1, 12

#: `COMMAND_LAND_2`; what it answers: it lands, or does so already.
_LAND, _LANDS = 8, (0, 1)


class CrazyflieDriver(AircraftDriver):
    """The driver of one Crazyflie."""

    OPTIONS: ClassVar[type[Struct]] = CrazyflieOptions

    def __init__(self, device: Device, link: Link | None = None) -> None:
        """Make a driver; ``link`` instead of the address of the options. Raises DriverError."""
        options = device.options
        if not isinstance(options, CrazyflieOptions):
            raise DriverError("a Crazyflie needs a `uri`", "as radio://0/80/2M/E7E7E7E7E7")
        self.options = options
        self.capabilities = aircraft_capabilities(
            options.telemetry, _SILENCE_S, options.takeoff_height
        )
        self._origin = device.position_m if options.origin == "start" else options.origin
        self._ground_m = device.world.ground
        self._is_told_poses = device.vehicle.localiser is not None
        self._telemetry = Telemetry(options, self._origin)
        self._leader = Leader(self._ground_m, options.climb)
        self._link: Link = CflibLink(options) if link is None else link
        self._protocol: int | None = None  #: None: it is not connected
        self._lost: str | None = None  #: why not
        self._since_s = -math.inf  #: last time it was connected to, or that was tried
        self._now_s = -math.inf
        self._heading_rad: float | None = None  #: that it is told to have in the air
        self._requests = Requests()
        self._lands_until_s = -math.inf  #: it has said that it lands, and is down by then
        self._was_told_to_arm = self._was_armed = False  #: since it was told to disarm

    # --- the interface of drivers ---------------------------------------------------------------

    def open(self, now_s: float) -> None:
        """Connect, begin a new estimate, and wait until that is good. Raises DriverError.

        Who is told its pose from outside is not waited for: that begins later.
        """
        try:
            self._since_s = now_s
            self._link.open()
            now_s = self._wait(now_s, lambda: self._telemetry.info is not None)
            if self._telemetry.info is None:
                raise unreachable(self.options.uri, self._lost or "it does not answer")
            if self.options.reset and not self._telemetry.airborne:
                now_s = self._begin_estimate(now_s)
            if not self._is_told_poses:
                self._wait(now_s, lambda: self._telemetry.position_m is not None)
                if self._telemetry.position_m is None:
                    raise DriverError(
                        f"the Crazyflie at `{self.options.uri}` does not know where it is: "
                        + self._unsure,
                        "it needs a Lighthouse, Loco or Flow deck that works, or a `localiser`;"
                        " `spread` says how sure it has to be",
                    )
        except DriverError:
            self._link.close()
            raise

    def sense(self, now_s: float) -> Sensed | None:
        self._listen(now_s)
        obeys = self._hears(now_s) and not self._telemetry.cannot
        return self._telemetry.sensed(link=obeys, was_told=self._was_told_to_arm)

    def locate(self, located: Located, now_s: float) -> None:
        """Tell it where it is, as its own estimate wants to know it. (C-LOCATE)"""
        position = between(self._origin, located.position_m)
        if located.attitude is None:
            self._send(lambda cf: cf.loc.send_extpos(position))
        else:
            attitude = to_xyzw(located.attitude)
            self._send(lambda cf: cf.loc.send_extpose(position, attitude))

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        self._now_s = now_s
        if not isinstance(setpoint, Land):
            self._lands_until_s = -math.inf
        super().command(setpoint, now_s)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Why it does not do what it is told, and what its console says."""
        found: list[str] = []
        if self._lost is not None:
            found.append(f"the link to the Crazyflie is lost: {self._lost}")
        elif not self._hears(self._now_s):
            silent_s = self._now_s - self._telemetry.heard_s
            found.append(
                f"nothing was heard of the Crazyflie for {silent_s:.1f} s: is it in reach?"
            )
        elif not self._telemetry.is_sure:
            found.append(f"the Crazyflie does not know where it is: {self._unsure}")
        if self._telemetry.cannot:
            found.append(f"the Crazyflie cannot fly: {self._telemetry.cannot}")
        elif self._requests.refusal(Request.ARMING) is not None:
            doing = "disarm" if isinstance(self._told, Disarm) else "arm"
            found.append(f"the Crazyflie does not {doing}: its supervisor refuses")
        elif (error := self._requests.refusal(Request.LANDING)) is not None:
            found.append(f"the Crazyflie does not land (error {error})")
        elif self._was_armed and self._is_armed is False and self._moves:
            found.append("the Crazyflie has disarmed itself: koord does not arm it again by itself")
        texts = self._telemetry.texts(self._now_s)
        return (*found, *(f"the Crazyflie says: {text}" for text in texts))

    def close(self) -> None:
        self._link.close()

    # --- what is heard --------------------------------------------------------------------------

    def _wait(self, now_s: float, condition: Callable[[], bool]) -> float:
        """Listen until something holds, the link is lost, or time is up; return the time then."""
        begun_s = now_s
        while not condition() and self._lost is None and now_s - begun_s <= self.options.connect:
            now_s += self._link.wait(0.02)
            self._listen(now_s)
        return now_s

    def _begin_estimate(self, now_s: float) -> float:
        """Let it begin with a new estimate; return the time then."""
        for command in _BEGIN_ANEW:
            self._send(command, _COMMAND_S)
            now_s += self._link.wait(_RESET_S)
        self._listen(now_s)
        self._telemetry.forget()
        return now_s

    def _listen(self, now_s: float) -> None:
        """Take what has arrived; connect anew where that was too long ago."""
        self._now_s = now_s
        for heard in self._link.receive():
            match heard:
                case Logged():
                    self._telemetry.hear(heard)
                case Answer(port=port, data=data):
                    self._hear_answer(port, data)
                case Text(text=text):
                    self._telemetry.hear_text(text, now_s)
                case Up(protocol=protocol):
                    self._protocol, self._lost = protocol, None
                    self._telemetry.begin_anew()
                case Down(why=why):
                    self._protocol, self._lost = None, first_line(why)
        self._was_armed = self._was_armed or bool(self._is_armed)
        patience_s = _PATIENCE * self.options.link
        silent_s = now_s - max(self._telemetry.heard_s, self._since_s)
        if self._telemetry.heard_s > -math.inf and silent_s > patience_s:
            self._since_s = now_s
            self._link.connect_again()  # (C-LINK)

    def _hear_answer(self, port: int, data: bytes) -> None:
        """Take note of what it said to a command."""
        command = data[0] & 0x7F
        if port == CRTPPort.SETPOINT_HL and command == _LAND and len(data) > 3:
            lands = data[3] in _LANDS
            self._requests.hear(None if lands else data[3], self._now_s)
            if lands and isinstance(self._told, Land):
                self._lands_until_s = self._now_s + self._landing_s + _LANDED_S
        elif port != CRTPPort.SETPOINT_HL and command == _ARM and len(data) > 1:
            self._requests.hear(None if data[1] else 1, self._now_s)

    def _hears(self, now_s: float) -> bool:
        return self._lost is None and now_s - self._telemetry.heard_s <= self.options.link

    @property
    def _unsure(self) -> str:
        if math.isinf(self._telemetry.spread_m):
            return "it tells nothing of its estimate"
        return (
            f"its estimate is sure to {self._telemetry.spread_m:.2g} m, and `spread` is"
            f" {self.options.spread:g} m"
        )

    @property
    def _is_armed(self) -> bool | None:
        return self._telemetry.armed(was_told=self._was_told_to_arm)

    # --- what is said ---------------------------------------------------------------------------

    def _disarm(self, now_s: float) -> None:
        """In the air this stops its motors; so it does until it counts as landed."""
        if self._telemetry.airborne is not False:
            self._send(lambda cf: cf.commander.send_stop_setpoint())
            return
        self._was_told_to_arm = self._was_armed = False
        if self._telemetry.has(Info.ARMED) and not self._telemetry.has(Info.ARMS_ITSELF):
            self._ask_arming(False, now_s)
        else:
            self._requests.forget()

    def _arm(self, now_s: float) -> None:
        if self._telemetry.airborne is not False:
            return
        self._was_told_to_arm = True
        if not self._telemetry.has(Info.ARMED):
            self._ask_arming(True, now_s)

    def _ask_arming(self, arms: bool, now_s: float) -> None:
        if not self._requests.is_due(Request.ARMING, now_s):
            return
        protocol = self._protocol or _SUPERVISOR_SINCE

        def ask(cf: Any) -> None:
            packet = CRTPPacket()
            if protocol >= _SUPERVISOR_SINCE:
                packet.set_header(CRTPPort.SUPERVISOR, 1)
            else:
                packet.set_header(CRTPPort.PLATFORM, 0)
            packet.data = (_ARM, arms)
            cf.send_packet(packet)

        self._send(ask, _COMMAND_S)

    def _land(self, now_s: float) -> None:
        """Let it land by itself: it goes on with that if koord is killed. (C-LAND)"""
        if self._telemetry.airborne is False or now_s < self._lands_until_s:
            return
        if not self._requests.is_due(Request.LANDING, now_s):
            return
        height_m = self._ground_m - self._origin[2]
        lasts_s = self._landing_s

        def land(cf: Any) -> None:
            cf.commander.send_notify_setpoint_stop()
            cf.high_level_commander.land(height_m, lasts_s, yaw=None)

        self._send(land, _COMMAND_S)

    @property
    def _landing_s(self) -> float:
        position = self._telemetry.position_m
        height_m = 1.0 if position is None else position[2] - self._ground_m
        return max(1.0, height_m / self.options.sink)

    def _fly(self, flight: Flight, now_s: float) -> None:
        """Only what is armed flies, and what stands and is to hold goes on standing. (C-ARM)"""
        telemetry = self._telemetry
        down = telemetry.airborne is False
        stays = isinstance(flight, Hold) or not self._was_told_to_arm
        if not telemetry.has(Info.CAN_FLY) or (down and stays):
            self._heading_rad = None
            return
        here, velocity = telemetry.position_m, telemetry.velocity_mps
        target = self._leader.target(flight, here, velocity, now_s, on_ground=down)
        if target.position_m is None:
            rate = math.degrees(target.yaw_rate_radps or 0.0)
            self._heading_rad = None
            self._send(
                lambda cf: cf.commander.send_velocity_world_setpoint(*target.velocity_mps, rate)
            )
            return
        heading_rad = self._heading(target.heading_rad)
        position = between(self._origin, target.position_m)
        acceleration = target.acceleration_mps2 or (0.0, 0.0, 0.0)
        if max(map(abs, (*position, *target.velocity_mps, *acceleration))) < _MOST:
            attitude = to_xyzw(turned(heading_rad))
            self._send(
                lambda cf: cf.commander.send_full_state_setpoint(
                    position, target.velocity_mps, acceleration, attitude, 0.0, 0.0, 0.0
                )
            )
        else:
            yaw = math.degrees(heading_rad)
            self._send(lambda cf: cf.commander.send_position_setpoint(*position, yaw))

    def _heading(self, wished_rad: float | None) -> float:
        """The heading that it is told to have: without a wish it keeps the one that it has."""
        if wished_rad is not None:
            self._heading_rad = wished_rad
        elif self._heading_rad is None:
            attitude = self._telemetry.attitude
            self._heading_rad = 0.0 if attitude is None else yaw_of(attitude)
        return self._heading_rad

    def _send(self, command: Command, lasts_s: float = _TICK_S) -> None:
        self._link.send(command, lasts_s)
