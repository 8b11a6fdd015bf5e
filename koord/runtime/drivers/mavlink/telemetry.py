"""What an autopilot has told: the latest of each kind, and when."""

from __future__ import annotations

import math

from koord.runtime.drivers.clocks import RemoteClock
from koord.runtime.drivers.frames import Quaternion, attitude_from_ned, ned_to_enu
from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.motion.world import Point

#: What was told about ground and battery holds for so long.
_LANDED_S, _BATTERY_S = 3.0, 30.0

#: What is higher above the ground is in the air, where the autopilot does not tell.
_AIRBORNE_M = 0.15

_IN_THE_AIR = frozenset(
    {
        mavlink.MAV_LANDED_STATE_IN_AIR,
        mavlink.MAV_LANDED_STATE_TAKEOFF,
        mavlink.MAV_LANDED_STATE_LANDING,
    }
)

#: What is said at this severity, or a graver one, is passed on.
_GRAVE = mavlink.MAV_SEVERITY_WARNING

#: Its texts are shown for so long, in s.
_TEXT_S = 10.0


class Telemetry:
    """The latest of what an autopilot has told. (M-FRAME)"""

    def __init__(self, origin_m: Point, ground_m: float) -> None:
        """Know nothing yet. ``origin_m``: of the autopilot's local frame, in the world."""
        self._origin_m, self._ground_m = origin_m, ground_m
        self.mode: int | None = None
        self.armed: bool | None = None
        self.heard_s = -math.inf  #: its last heartbeat
        self.position_m: Point | None = None
        self.velocity_mps: Point = (0.0, 0.0, 0.0)
        self._position_s = -math.inf
        self._attitude: Quaternion | None = None
        self._attitude_s = -math.inf
        self._landed_state = mavlink.MAV_LANDED_STATE_UNDEFINED
        self._landed_s = -math.inf
        self._battery: float | None = None
        self._battery_s = -math.inf
        self._texts: dict[str, float] = {}
        self._pieces: dict[int, dict[int, str]] = {}
        self._clock = RemoteClock()

    def hear(self, message: Message, now_s: float) -> None:
        """Take note of a message."""
        match message.get_type():
            case "HEARTBEAT":
                self.mode = int(message.custom_mode)
                self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self.heard_s = now_s
            case "LOCAL_POSITION_NED":
                x, y, z = ned_to_enu((message.x, message.y, message.z))
                east, north, up = self._origin_m
                self.position_m = x + east, y + north, z + up
                self.velocity_mps = ned_to_enu((message.vx, message.vy, message.vz))
                self._position_s = self._measured_at(message, now_s)
            case "ATTITUDE_QUATERNION":
                attitude = (message.q1, message.q2, message.q3, message.q4)
                self._attitude = attitude_from_ned(attitude)
                self._attitude_s = self._measured_at(message, now_s)
            case "EXTENDED_SYS_STATE":
                self._landed_state, self._landed_s = int(message.landed_state), now_s
            case "BATTERY_STATUS" if message.id == 0:
                self._hear_battery(message.battery_remaining, now_s)
            case "SYS_STATUS":
                self._hear_battery(message.battery_remaining, now_s)
            case "STATUSTEXT" if message.severity <= _GRAVE:
                self._hear_text(message, now_s)

    def _measured_at(self, message: Message, now_s: float) -> float:
        """When something was measured that is read now: it says how long after its start."""
        boot_s = message.time_boot_ms / 1000
        self._clock.hear(boot_s, now_s)
        return self._clock.ours(boot_s)

    def _hear_battery(self, percent: int, now_s: float) -> None:
        if percent >= 0:
            self._battery, self._battery_s = percent / 100, now_s

    def _hear_text(self, message: Message, now_s: float) -> None:
        """Put a text together, which may come in pieces of 50 characters."""
        text = message.text
        if message.id:
            pieces = self._pieces.get(message.id, {}) | {message.chunk_seq: text}
            self._pieces = {message.id: pieces}  # of one text at a time: others have lost a piece
            ends = [number for number, piece in pieces.items() if len(piece) < 50]
            if not ends or set(pieces) != set(range(min(ends) + 1)):
                return
            text = "".join(piece for _, piece in sorted(pieces.items()))
        self._texts[text] = now_s

    def forget(self, now_s: float) -> None:
        """Forget what it said long ago."""
        self._texts = {one: at_s for one, at_s in self._texts.items() if now_s - at_s <= _TEXT_S}

    @property
    def texts(self) -> tuple[str, ...]:
        """What it has said lately."""
        return tuple(self._texts)

    def pose_age_s(self, now_s: float) -> float:
        """The age of the pose; infinite before the first one."""
        return now_s - min(self._position_s, self._attitude_s)

    def battery(self, now_s: float) -> float | None:
        """What is left, 0 to 1."""
        return self._battery if now_s - self._battery_s <= _BATTERY_S else None

    def airborne(self, now_s: float) -> bool | None:
        """Whether it is in the air: as it says itself, else by its height."""
        told = self._landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED
        if told and now_s - self._landed_s <= _LANDED_S:
            return self._landed_state in _IN_THE_AIR
        if self.position_m is None or self.armed is None:
            return None
        return self.armed and self.position_m[2] > self._ground_m + _AIRBORNE_M

    def sensed(self, now_s: float, *, link: bool) -> Sensed | None:
        """What the guardian and motion are told; None before the first pose."""
        if self.position_m is None or self._attitude is None:
            return None
        return Sensed(
            self.position_m,
            self._attitude,
            self.velocity_mps,
            min(self._position_s, self._attitude_s),
            battery=self.battery(now_s),
            armed=self.armed,
            airborne=self.airborne(now_s),
            link=link,
        )
