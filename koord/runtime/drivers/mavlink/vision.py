"""Where a localiser says that an aircraft is: for its autopilot, and against what that believes."""

from __future__ import annotations

import math

from koord.runtime.drivers.differences import Differences
from koord.runtime.drivers.frames import (
    Quaternion,
    angles_of,
    attitude_to_ned,
    flu_to_frd,
    in_body,
    ned_to_enu,
)
from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.mavlink.options import AutopilotKind, MavlinkOptions, Vision
from koord.runtime.drivers.setpoints import Located
from koord.runtime.motion.world import Point

#: Whose estimate differs for longer does not know where it is, in s.
_DIFFERS_S = 0.5

#: The low pass on velocities of odometry, in s.
_SMOOTHING_S = 0.1

#: A covariance that is not known.
_UNKNOWN = [math.nan] * 21


class ExternalVision:
    """What an autopilot is told of a localiser, and whether it believes it. (M-VISION)"""

    def __init__(self, options: MavlinkOptions, origin_m: Point) -> None:
        self._options, self._origin_m = options, origin_m
        self._located: Located | None = None
        self._differences = Differences(_SMOOTHING_S)
        self._agreed_s: float | None = None  #: when its estimate was the localiser's last
        self._gap_m = 0.0
        self._differs = False

    @property
    def is_used(self) -> bool:
        """True if there is a localiser."""
        return self._located is not None

    def take(self, located: Located, now_s: float) -> Message | None:
        """Take a pose; return how the autopilot is told it, if it is."""
        self._located = located
        self._differences.hear(located.position_m, located.measured_at_s, now_s)
        if located.attitude is None:
            return None
        x, y, z = (a - b for a, b in zip(located.position_m, self._origin_m, strict=True))
        here = ned_to_enu((x, y, z))
        time_us = round(located.measured_at_s * 1e6)
        match self._options.vision:
            case Vision.NONE:
                return None
            case Vision.POSITION:
                angles = angles_of(attitude_to_ned(located.attitude))
                return mavlink.MAVLink_vision_position_estimate_message(
                    time_us, *here, *angles, _UNKNOWN
                )
            case Vision.ODOMETRY:
                return self._odometry(time_us, here, located.attitude)

    def _odometry(self, time_us: int, here: Point, attitude: Quaternion) -> Message:
        """Odometry in the frames that the autopilot takes."""
        is_px4 = self._options.autopilot is AutopilotKind.PX4
        velocity = flu_to_frd(in_body(attitude, self._differences.velocity_mps))
        return mavlink.MAVLink_odometry_message(
            time_us,
            mavlink.MAV_FRAME_LOCAL_NED if is_px4 else mavlink.MAV_FRAME_LOCAL_FRD,
            mavlink.MAV_FRAME_BODY_FRD,
            *here,
            attitude_to_ned(attitude),
            *velocity,
            *(math.nan,) * 3,
            _UNKNOWN,
            _UNKNOWN,
            0,
            mavlink.MAV_ESTIMATOR_TYPE_MOCAP,
        )

    def watch(self, believed_m: Point | None, now_s: float) -> None:
        """Compare the localiser with what the autopilot believes by now."""
        if self._located is None or believed_m is None:
            return
        if now_s - self._located.measured_at_s > _DIFFERS_S:
            return  # that its pose is old is told
        self._gap_m = math.dist(believed_m, self._located.position_m)
        if self._agreed_s is None or self._gap_m <= self._options.agree:
            self._agreed_s = now_s
        self._differs = now_s - self._agreed_s > _DIFFERS_S

    @property
    def differs(self) -> bool:
        """Whether the autopilot is elsewhere by its own estimate, for a while."""
        return self._differs

    def trouble(self, believed_m: Point | None) -> str | None:
        """What is wrong with the autopilot's estimate, with what would help."""
        if self._located is None:
            return None
        is_told = self._options.vision is not Vision.NONE
        if is_told and self._located.attitude is None:
            return "the localiser tells no attitude, and the autopilot needs one: see `vision`"
        if believed_m is None and is_told:
            return (
                "the autopilot tells no local position, though it is told where it is: is it set up"
                " for external vision? (PX4: EKF2_EV_CTRL; ArduPilot: VISO_TYPE, EK3_SRC1_POSXY 6,"
                " and an EKF origin)"
            )
        if self._differs:
            return (
                f"by its own estimate the autopilot is {self._gap_m:.2f} m from where the localiser"
                f" says (`agree`: {self._options.agree:g} m): see `origin`, `vision`, and its EKF"
            )
        return None
