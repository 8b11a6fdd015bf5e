"""What a simulated autopilot makes of messages, and what it tells: without clock or socket.

It does what the manuals of PX4 (offboard mode) and ArduPilot (guided mode) say, as far as a driver
can see it. Its numbers are written down here anew: it shares nothing with the driver.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from msgspec import Struct
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as mavlink

from koord.testing.autopilot.airframe import Airframe, Handling, Target, Vector
from koord.testing.autopilot.estimate import Estimate

#: A step of flight.
_STEP_S = 0.02

#: A landing ends on the ground, and it disarms, so much later.
_LANDED_S = 1.0

_SINKING_MPS, _RISING_MPS = 0.5, 0.7

#: Speeds of set-points do not count for longer. (ArduPilot: GUID_TIMEOUT)
_SPEEDS_S = 3.0

#: Below this share of its battery it lands.
_EMPTY = 0.07

#: Disarms whatever happens.
_FORCE = 21196


class Mode(Enum):
    """The modes that it has."""

    MANUAL = "manual"  #: POSCTL, POSHOLD: a person steers, who does nothing here
    GUIDED = "guided"  #: OFFBOARD, GUIDED
    HOLD = "hold"  #: AUTO.LOITER, BRAKE
    LAND = "land"


class Firmware(Struct, frozen=True):
    """What differs between autopilots."""

    autopilot: int
    numbers: dict[Mode, int]  #: ``custom_mode``
    shifts: bool  #: main and sub mode stand in bits 16 and 24
    wants_stream: bool  #: guided mode and staying in it take set-points
    rises_by_command: bool
    complains: str  #: how its texts about arming begin
    refuses: int  #: the result of a command to arm that it refuses


FIRMWARES = {
    "px4": Firmware(
        mavlink.MAV_AUTOPILOT_PX4,
        {
            Mode.MANUAL: 3 << 16,
            Mode.GUIDED: 6 << 16,
            Mode.HOLD: 4 << 16 | 3 << 24,
            Mode.LAND: 4 << 16 | 6 << 24,
        },
        shifts=True,
        wants_stream=True,
        rises_by_command=False,
        complains="Preflight Fail",
        refuses=mavlink.MAV_RESULT_DENIED,
    ),
    "ardupilot": Firmware(
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        {Mode.MANUAL: 16, Mode.GUIDED: 4, Mode.HOLD: 17, Mode.LAND: 9},
        shifts=False,
        wants_stream=False,
        rises_by_command=True,
        complains="PreArm",
        refuses=mavlink.MAV_RESULT_FAILED,
    ),
}


class Settings(Struct, frozen=True):
    """A simulated autopilot, as it is set up."""

    firmware: str = "px4"
    system: int = 1
    ground_system: int = 255  #: whose heartbeats count
    start_m: Vector = (0.0, 0.0, 0.0)  #: NED of the local origin; it stands on the ground there
    yaw_rad: float = 0.0
    failing: tuple[str, ...] = ()  #: arming checks that fail
    stream_loss_s: float = 1.0  #: COM_OF_LOSS_T
    ground_loss_s: float = 5.0  #: FS_GCS_TIMEOUT, COM_DL_LOSS_T
    loss_mode: Mode = Mode.LAND  #: what it does then
    idle_s: float = 10.0  #: armed on the ground it disarms after this
    battery: float = 1.0
    drain_per_s: float = 0.0
    handling: Handling = Handling()
    vision: bool = False  #: it knows where it is by what it is told alone
    vision_loss_s: float = 1.0  #: and no more so long after that


class SimulatedAutopilot:
    """An autopilot, its aircraft, and what it knows of who talks to it."""

    def __init__(self, settings: Settings, now_s: float) -> None:
        """Stand on the ground, disarmed."""
        self.settings, self.firmware = settings, FIRMWARES[settings.firmware]
        self.airframe = Airframe(settings.start_m, settings.yaw_rad, settings.handling)
        self.estimate = Estimate(is_external=settings.vision, loss_s=settings.vision_loss_s)
        self.mode, self.armed, self.battery = Mode.MANUAL, False, settings.battery
        self.failing = settings.failing
        self.failsafes: list[str] = []
        self._now_s = self._boot_s = now_s
        self._target = Target(settings.start_m)
        self._setpoint: Target | None = None
        self._setpoint_s = self._ground_s = -math.inf
        self._stream_s = math.inf  #: since when set-points come without a break
        self._rises_to_m: float | None = None
        self._idle_since_s = now_s
        self._intervals = {mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0}
        self._due: dict[int, float] = {}
        self._out: list[Any] = []

    # --- what it hears --------------------------------------------------------------------------

    def hear(self, message: Any) -> None:
        """Take note of a message."""
        match message.get_type():
            case "HEARTBEAT" if message.get_srcSystem() == self.settings.ground_system:
                self._ground_s = self._now_s
            case "COMMAND_LONG" if message.target_system == self.settings.system:
                result = self._obey(message)
                self._out.append(mavlink.MAVLink_command_ack_message(message.command, result))
            case "PARAM_REQUEST_READ" if message.target_system == self.settings.system:
                self._tell_parameter(message.param_id)
            case "SET_POSITION_TARGET_LOCAL_NED" if message.target_system == self.settings.system:
                self._hear_setpoint(message)
            case "VISION_POSITION_ESTIMATE":
                self._hear_place((message.x, message.y, message.z), message.yaw)
            case "ODOMETRY" if self._reads(message):
                w, x, y, z = message.q
                yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
                self._hear_place((message.x, message.y, message.z), yaw)

    def _reads(self, odometry: Any) -> bool:
        """Whether odometry is in the frames that this firmware takes."""
        frame = mavlink.MAV_FRAME_LOCAL_NED if self.firmware.wants_stream else 20  # LOCAL_FRD
        return (odometry.frame_id, odometry.child_frame_id) == (frame, mavlink.MAV_FRAME_BODY_FRD)

    def _hear_place(self, position_m: Vector, yaw_rad: float) -> None:
        true = self.airframe.position_m, self.airframe.yaw_rad
        self.estimate.hear((position_m, yaw_rad), true, self._now_s)

    @property
    def position_m(self) -> Vector:
        """Where it believes that it is."""
        x, y, z = (
            a + b for a, b in zip(self.airframe.position_m, self.estimate.error_m, strict=True)
        )
        return x, y, z

    def _hear_setpoint(self, message: Any) -> None:
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            return
        if self._now_s - self._setpoint_s > 0.5:
            self._stream_s = self._now_s
        self._setpoint_s = self._now_s
        mask = message.type_mask
        self._rises_to_m = None
        self._setpoint = Target(
            None if mask & 0b111 else (message.x, message.y, message.z),
            (0.0, 0.0, 0.0) if mask >> 3 & 0b111 else (message.vx, message.vy, message.vz),
            (0.0, 0.0, 0.0) if mask >> 6 & 0b111 else (message.afx, message.afy, message.afz),
            None if mask >> 10 & 1 else message.yaw,
            0.0 if mask >> 11 & 1 else message.yaw_rate,
        )

    def _tell_parameter(self, name: str) -> None:
        settings = self.settings
        known = {"FS_GCS_ENABLE": float(math.isfinite(settings.ground_loss_s))}
        if self.firmware.wants_stream:
            known = {"COM_OF_LOSS_T": settings.stream_loss_s}
        if name in known:
            real = mavlink.MAV_PARAM_TYPE_REAL32
            value = mavlink.MAVLink_param_value_message(name.encode(), known[name], real, 1, 0)
            self._out.append(value)

    def _obey(self, command: Any) -> int:
        match command.command:
            case mavlink.MAV_CMD_DO_SET_MODE:
                return self._set_mode(int(command.param2), int(command.param3))
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM if command.param1 == 1:
                return self._arm()
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                if self.is_in_the_air and command.param2 != _FORCE:
                    return int(mavlink.MAV_RESULT_DENIED)
                self.armed = False
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                return self._take_off(command.param7)
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._intervals[int(command.param1)] = command.param2 / 1e6
            case _:
                return int(mavlink.MAV_RESULT_UNSUPPORTED)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _set_mode(self, main: int, sub: int) -> int:
        number = main << 16 | sub << 24 if self.firmware.shifts else main
        mode = next((one for one, its in self.firmware.numbers.items() if its == number), None)
        if mode is None:
            return int(mavlink.MAV_RESULT_UNSUPPORTED)
        streams = self._now_s - self._setpoint_s < 0.5 and self._now_s - self._stream_s > 0.5
        if mode is Mode.GUIDED and not self.estimate.is_valid(self._now_s):
            self._say("Mode change failed: no position estimate")
            return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        if mode is Mode.GUIDED and self.firmware.wants_stream and not streams:
            self._say("Switching to Offboard denied: no setpoints")
            return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        self._enter(mode)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _arm(self) -> int:
        failing = self.failing
        if not self.estimate.is_valid(self._now_s):
            failing = (*failing, "no position estimate")
        if failing:
            for check in failing:
                self._say(f"{self.firmware.complains}: {check}")
            return self.firmware.refuses
        if self.mode is Mode.LAND:
            self._say(f"{self.firmware.complains}: mode not armable")
            return self.firmware.refuses
        if not self.armed:
            self.armed, self._idle_since_s = True, self._now_s
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _take_off(self, height_m: float) -> int:
        if not self.firmware.rises_by_command:
            return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        if not self.armed or self.mode is not Mode.GUIDED or self.is_in_the_air:
            return int(mavlink.MAV_RESULT_FAILED)
        self._rises_to_m = height_m
        self._target = Target(self.position_m)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _enter(self, mode: Mode) -> None:
        if mode is not self.mode:
            self.mode, self._rises_to_m = mode, None
            self._target = Target(self.position_m)

    # --- what it does ---------------------------------------------------------------------------

    @property
    def is_in_the_air(self) -> bool:
        """True above the ground."""
        return self.airframe.height_m > 0.05

    def advance(self, now_s: float) -> None:
        """Fly on until then."""
        while self._now_s + _STEP_S <= now_s:
            self._now_s += _STEP_S
            self._watch()
            self.airframe.step(self._controlled() if self.armed else None, _STEP_S)
            self.estimate.step(self._now_s, _STEP_S)
            if self.armed:
                self.battery = max(0.0, self.battery - self.settings.drain_per_s * _STEP_S)

    def _watch(self) -> None:
        """Failsafes, and what ends by itself."""
        if not self.armed:
            return
        settings = self.settings
        if self.is_in_the_air:
            self._idle_since_s = self._now_s
        lands = self.mode is Mode.LAND
        if self._now_s - self._idle_since_s > (_LANDED_S if lands else settings.idle_s):
            self.armed = False
        if not self.estimate.is_valid(self._now_s) and self.is_in_the_air and not lands:
            self._fail_safe("Position estimate lost, landing", Mode.LAND)
        if self.mode is Mode.GUIDED:
            stream_s = self._now_s - self._setpoint_s
            if self.firmware.wants_stream and stream_s > settings.stream_loss_s:
                self._fail_safe("No offboard signal", settings.loss_mode)
            elif self._now_s - self._ground_s > settings.ground_loss_s:
                self._fail_safe("GCS failsafe", settings.loss_mode)
        if self.battery < _EMPTY and not lands:
            self._fail_safe("Low battery, landing", Mode.LAND)

    def _fail_safe(self, why: str, mode: Mode) -> None:
        self.failsafes.append(why)
        self._say(why)
        self._enter(mode)

    def _controlled(self) -> Target:
        """Its aim, as far off as it is wrong about where it is."""
        aim, error = self._aim(), self.estimate.error_m
        if aim.position_m is None:
            return aim
        x, y, z = (a - b for a, b in zip(aim.position_m, error, strict=True))
        return replace(aim, position_m=(x, y, z))

    def _aim(self) -> Target:
        """What its position controller is to reach, where it believes that to be."""
        x, y, z = self._target.position_m or self.position_m
        ground_m = self.airframe.ground_m + self.estimate.error_m[2]
        match self.mode:
            case Mode.LAND:
                z = min(z + _SINKING_MPS * _STEP_S, ground_m + 0.2)
                self._target = Target((x, y, z), (0.0, 0.0, _SINKING_MPS))
            case Mode.GUIDED if self._rises_to_m is not None:
                z = max(z - _RISING_MPS * _STEP_S, ground_m - self._rises_to_m)
                self._target = Target((x, y, z))
            case Mode.GUIDED if self._setpoint is not None:
                self._target = self._guided(self._setpoint)
            case _:
                pass
        return self._target

    def _guided(self, setpoint: Target) -> Target:
        if self.firmware.rises_by_command and not self.is_in_the_air:
            return Target(self.position_m)  # set-points do not lift it off
        if self._now_s - self._setpoint_s > _SPEEDS_S:
            return Target(setpoint.position_m or self.position_m)
        return setpoint

    # --- what it tells --------------------------------------------------------------------------

    def _say(self, text: str) -> None:
        """Tell people something, in pieces if it is long."""
        data = text.encode()
        pieces = [data[k : k + 50] for k in range(0, len(data), 50)]
        number = len(self.failsafes) + 1 if len(pieces) > 1 else 0
        self._out += [
            mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, piece, number, k)
            for k, piece in enumerate(pieces)
        ]

    def tell(self) -> list[Any]:
        """What goes out by now."""
        found, self._out = self._out, []
        for number, interval_s in self._intervals.items():
            if interval_s > 0 and self._now_s >= self._due.get(number, -math.inf):
                late = self._now_s - self._due.get(number, -math.inf) > interval_s
                begun = self._now_s if late else self._due[number]
                self._due[number] = begun + interval_s
                message = self._message(number)
                if message is not None:
                    found.append(message)
        return found

    def _message(self, number: int) -> Any:
        boot_ms = int((self._now_s - self._boot_s) * 1000)
        match number:
            case mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
                flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
                return mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_QUADROTOR,
                    self.firmware.autopilot,
                    flags,
                    self.firmware.numbers[self.mode],
                    mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY,
                    3,
                )
            case mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                if not self.estimate.is_valid(self._now_s):
                    return None
                return mavlink.MAVLink_local_position_ned_message(
                    boot_ms, *self.position_m, *self.airframe.velocity_mps
                )
            case mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
                return mavlink.MAVLink_attitude_quaternion_message(
                    boot_ms, *self.airframe.attitude, 0.0, 0.0, 0.0
                )
            case mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
                return mavlink.MAVLink_extended_sys_state_message(0, self._landed_state)
            case mavlink.MAVLINK_MSG_ID_SYS_STATUS:
                percent = round(self.battery * 100)
                return mavlink.MAVLink_sys_status_message(
                    0, 0, 0, 0, 12000, -1, percent, 0, 0, 0, 0, 0, 0
                )
            case mavlink.MAVLINK_MSG_ID_BATTERY_STATUS:
                percent = round(self.battery * 100)
                return mavlink.MAVLink_battery_status_message(
                    0, 0, 0, 2500, [4000] * 3 + [65535] * 7, -1, -1, -1, percent
                )
        return None

    @property
    def _landed_state(self) -> int:
        if not self.is_in_the_air:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        landing = self.mode is Mode.LAND
        in_the_air = mavlink.MAV_LANDED_STATE_IN_AIR
        return int(mavlink.MAV_LANDED_STATE_LANDING if landing else in_the_air)
