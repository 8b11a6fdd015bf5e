"""What a Crazyflie has told: the latest of each kind, and when."""

from __future__ import annotations

import math
from enum import IntFlag

from koord.runtime.drivers.clocks import RemoteClock
from koord.runtime.drivers.crazyflie.link import POSE, Logged
from koord.runtime.drivers.crazyflie.options import CrazyflieOptions
from koord.runtime.drivers.frames import Quaternion, from_xyzw
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.motion.world import Point

#: Its clock counts milliseconds in so many bits.
_CLOCK_BITS = 24

#: What its console says of these is passed on for so long, in s.
_GRAVE, _TEXT_S = ("FAIL", "ERROR", "Locked", "Crashed", "fault"), 10.0


class Info(IntFlag):
    """What its supervisor says: `supervisor.info` of the firmware."""

    CAN_BE_ARMED = 1 << 0
    ARMED = 1 << 1
    ARMS_ITSELF = 1 << 2
    CAN_FLY = 1 << 3
    FLYING = 1 << 4
    TUMBLED = 1 << 5
    LOCKED = 1 << 6
    CRASHED = 1 << 7


class Telemetry:
    """The latest of what a Crazyflie has told."""

    def __init__(self, options: CrazyflieOptions, origin_m: Point) -> None:
        """Know nothing yet. ``origin_m``: of its own estimate, in the world."""
        self._options, self._origin_m = options, origin_m
        self.heard_s = -math.inf
        self.info: Info | None = None
        self.spread_m = math.inf  #: standard deviation of its position, along the worst axis
        self.position_m: Point | None = None
        self.velocity_mps: Point = (0.0, 0.0, 0.0)
        self.attitude: Quaternion | None = None
        self._measured_s = -math.inf
        self._voltage_v: float | None = None
        self._clock, self._boot_ms = RemoteClock(), 0
        self._console = ""
        self._texts: dict[str, float] = {}

    def forget(self) -> None:
        """Forget where it was: it begins with a new estimate."""
        self.position_m = None
        self.begin_anew()

    def begin_anew(self) -> None:
        """Believe no new pose before it says how good they are: it may have been started again."""
        self.spread_m = math.inf
        self._clock, self._boot_ms = RemoteClock(), 0

    def hear(self, logged: Logged) -> None:
        """Take note of a block."""
        self.heard_s = logged.at_s
        values = logged.values
        if "supervisor.info" in values:
            self.info = Info(int(values["supervisor.info"]))
            self._voltage_v = values["pm.vbat"]
            self.spread_m = math.sqrt(max(0.0, *(values[f"kalman.varP{axis}"] for axis in "XYZ")))
        else:
            self._hear_pose(logged)

    def _hear_pose(self, logged: Logged) -> None:
        """A pose that its own estimate is not sure of does not count. (C-POSE)"""
        whole = self._boot_ms >> _CLOCK_BITS << _CLOCK_BITS | logged.boot_ms
        if whole < self._boot_ms - (1 << _CLOCK_BITS - 1):
            whole += 1 << _CLOCK_BITS
        self._boot_ms = whole
        self._clock.hear(whole / 1000, logged.at_s)
        measured_s = self._clock.ours(whole / 1000)
        x, y, z, vx, vy, vz, qx, qy, qz, qw = (logged.values[name] for name, _ in POSE)
        norm = math.hypot(qx, qy, qz, qw)
        if not self.is_sure or not 0.9 < norm < 1.1:
            return
        east, north, up = self._origin_m
        self.position_m = x + east, y + north, z + up
        self.velocity_mps = vx, vy, vz
        self.attitude = from_xyzw(qx / norm, qy / norm, qz / norm, qw / norm)
        self._measured_s = measured_s

    @property
    def is_sure(self) -> bool:
        """Whether its estimate counts."""
        return self.spread_m <= self._options.spread

    def hear_text(self, text: str, now_s: float) -> None:
        """Put lines of its console together."""
        *lines, self._console = (self._console + text).split("\n")
        for line in lines:
            if any(word in line for word in _GRAVE):
                self._texts[line.strip()] = now_s
        self._texts = {one: at_s for one, at_s in self._texts.items() if now_s - at_s <= _TEXT_S}

    def texts(self, now_s: float) -> tuple[str, ...]:
        """What its console has said lately that people should know."""
        return tuple(one for one, at_s in self._texts.items() if now_s - at_s <= _TEXT_S)

    def has(self, *flags: Info) -> bool:
        """Return whether its supervisor says one of these."""
        return self.info is not None and any(flag in self.info for flag in flags)

    @property
    def cannot(self) -> str | None:
        """Why it cannot fly until somebody has looked at it."""
        if self.has(Info.LOCKED):
            return "it has locked itself (after a fall or an emergency stop): start it again"
        if self.has(Info.CRASHED):
            return "it has crashed: look at it, and start it again"
        if self.has(Info.TUMBLED):
            return "it does not lie as it should: put it on its feet"
        return None

    def armed(self, *, was_told: bool) -> bool | None:
        """Whether it flies if it is told to. What arms itself has to be told as well. (C-ARM)"""
        if self.info is None:
            return None
        return Info.ARMED in self.info and (was_told or Info.ARMS_ITSELF not in self.info)

    @property
    def airborne(self) -> bool | None:
        """Whether it flies; so it says for two seconds after its motors have stopped."""
        return None if self.info is None else Info.FLYING in self.info

    @property
    def battery(self) -> float | None:
        """What is left by its voltage, 0 to 1."""
        if self._voltage_v is None:
            return None
        empty_v, full_v = self._options.battery
        return min(1.0, max(0.0, (self._voltage_v - empty_v) / (full_v - empty_v)))

    def sensed(self, *, link: bool, was_told: bool) -> Sensed | None:
        """What the guardian and motion are told; None before the first pose that counts.

        ``was_told``: koord has told it to arm.
        """
        if self.position_m is None or self.attitude is None:
            return None
        return Sensed(
            self.position_m,
            self.attitude,
            self.velocity_mps,
            self._measured_s,
            battery=self.battery,
            armed=self.armed(was_told=was_told),
            airborne=self.airborne,
            link=link,
        )
