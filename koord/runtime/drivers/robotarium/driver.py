"""The driver ``robotarium``: a robot of the Robotarium, or of its simulator, by the bridge.

All that it says it says when it is asked at a tick; what the bridge does not hear anything of
stands. (B-SILENCE)
"""

from __future__ import annotations

import math
import uuid
from typing import ClassVar

from msgspec import Struct

from koord.runtime.drivers.clocks import RemoteClock
from koord.runtime.drivers.differences import Differences
from koord.runtime.drivers.driver import Device, Driver, DriverError
from koord.runtime.drivers.frames import turned
from koord.runtime.drivers.robotarium.messages import Refused, Seen, Told, decoded, encoded
from koord.runtime.drivers.robotarium.options import RobotariumOptions, address_of
from koord.runtime.drivers.robotarium.wire import UdpWire, Wire
from koord.runtime.drivers.setpoints import Capabilities, Drive, Sensed, Setpoint, Velocity

#: s: of the bridge's dead-man, of a pose at most, of the low pass on differences of poses.
_DEAD_MAN_S, _POSE_AGE_S, _SMOOTHING_S = 0.5, 0.1, 0.1

#: How often the bridge is looked for at the start, and how long it may refuse to answer because of
#: a process that has ended just before, in s.
_LOOK_S, _REFUSES_S = 0.05, 1.0


class RobotariumDriver(Driver):
    """The driver of one robot."""

    OPTIONS: ClassVar[type[Struct]] = RobotariumOptions

    def __init__(self, device: Device, wire: Wire | None = None) -> None:
        """Make a driver; ``wire`` instead of UDP to the bridge of the options."""
        options = device.options
        self.options = options if isinstance(options, RobotariumOptions) else RobotariumOptions()
        self.capabilities = Capabilities(
            kinds=("DIFF",),
            wishes=(Drive, Velocity),
            rate_hz=20.0,
            pose_age_s=_POSE_AGE_S,
            dead_man_s=_DEAD_MAN_S,
        )
        self._world = device.world
        self._robot = device.pid if self.options.robot is None else self.options.robot
        self._session = uuid.uuid4().hex
        self._wire = wire
        self._clock, self._differences = RemoteClock(), Differences(_SMOOTHING_S)
        self._seen: Seen | None = None
        self._measured_s = self._heard_s = -math.inf
        self._refused: Refused | None = None

    def open(self, now_s: float) -> None:
        """Wait for the bridge to say where the robot is. Raises DriverError."""
        if self._wire is None:
            self._wire = UdpWire(address_of(self.options.bridge))
        begun_s = now_s
        while self._seen is None:
            lasts_s = now_s - begun_s
            if lasts_s > self.options.connect or (self._refused and lasts_s > _REFUSES_S):
                break
            self._say(0.0, 0.0)
            now_s += self._wire.wait(_LOOK_S)
            self._listen(now_s)
        trouble = self._trouble
        if trouble is not None:
            self.close()
            raise trouble

    @property
    def _trouble(self) -> DriverError | None:
        """Why it cannot be driven."""
        if self._refused is not None:
            return self._refusal
        if self._seen is not None:
            return self._outside
        return DriverError(
            f"no bridge to the Robotarium answers at {self.options.bridge}",
            "start it: python -m koord.runtime.drivers.robotarium.bridge --robots N",
        )

    @property
    def _refusal(self) -> DriverError:
        assert self._refused is not None
        return DriverError(
            f"the bridge at {self.options.bridge} does not let robot {self._robot} be driven:"
            f" {self._refused.why}",
            "see `robot` of its options, and whether another run goes on",
        )

    @property
    def _outside(self) -> DriverError | None:
        """What is wrong if the world is larger than the arena. (B-FENCE)"""
        assert self._seen is not None
        wide_m, deep_m = self._seen.half_size_m
        (low_x, low_y, _), (high_x, high_y, _) = self._world.low, self._world.high
        if max(-low_x, high_x) <= wide_m and max(-low_y, high_y) <= deep_m:
            return None
        return DriverError(
            f"the world goes beyond the arena, which ends {wide_m:g} m and {deep_m:g} m from its"
            " middle",
            f"bounds: {{low: [{-wide_m:g}, {-deep_m:g}, 0], high: [{wide_m:g}, {deep_m:g}, 1]}}",
        )

    def sense(self, now_s: float) -> Sensed | None:
        self._listen(now_s)
        if self._seen is None:
            return None
        return Sensed(
            (self._seen.x_m, self._seen.y_m, self._world.ground),
            turned(self._seen.heading_rad),
            self._differences.velocity_mps,
            self._measured_s,
            link=self._refused is None and now_s - self._heard_s <= self.options.link,
        )

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        match setpoint:
            case Drive(speed_mps=speed, yaw_rate_radps=rate):
                self._say(speed, rate)
            case Velocity(velocity_mps=(x, y, _), yaw_rate_radps=rate):
                heading = 0.0 if self._seen is None else self._seen.heading_rad
                self._say(x * math.cos(heading) + y * math.sin(heading), rate)
            case _:
                self._say(0.0, 0.0)

    @property
    def remarks(self) -> tuple[str, ...]:
        if self._refused is not None:
            return (self._refusal.message,)
        return ()

    def close(self) -> None:
        if self._wire is not None:
            self._say(0.0, 0.0)
            self._wire.close()

    def _say(self, speed_mps: float, yaw_rate_radps: float) -> None:
        assert self._wire is not None, "open comes first"
        self._wire.send(encoded(Told(self._robot, self._session, speed_mps, yaw_rate_radps)))

    def _listen(self, now_s: float) -> None:
        assert self._wire is not None, "open comes first"
        for data in self._wire.receive():
            match message := decoded(data):
                case Seen(robot=robot) if robot == self._robot:
                    self._hear(message, now_s)
                case Refused(robot=robot) if robot == self._robot:
                    self._refused = message
                case _:
                    pass  # nobody whom this is about

    def _hear(self, seen: Seen, now_s: float) -> None:
        self._clock.hear(seen.at_s, now_s)
        self._seen, self._heard_s, self._refused = seen, now_s, None
        self._measured_s = self._clock.ours(seen.at_s)
        position = seen.x_m, seen.y_m, self._world.ground
        self._differences.hear(position, seen.at_s, now_s)
