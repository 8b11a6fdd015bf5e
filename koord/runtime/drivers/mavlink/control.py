"""From set-points to those of autopilots: SET_POSITION_TARGET_LOCAL_NED."""

from __future__ import annotations

from koord.runtime.drivers.frames import heading_to_ned, ned_to_enu
from koord.runtime.drivers.leading import Flight, Leader, Target, between
from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.mavlink.options import MavlinkOptions
from koord.runtime.drivers.setpoints import Takeoff
from koord.runtime.motion.world import Point

_STILL: Point = (0.0, 0.0, 0.0)

_NO_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_NO_ACCELERATION = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
)
_NO_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_NO_YAW_RATE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE


class Control:
    """What an autopilot is told at a tick, to do what is wished."""

    def __init__(self, options: MavlinkOptions, origin_m: Point, ground_m: float) -> None:
        self._options, self._origin_m, self._ground_m = options, origin_m, ground_m
        self._leader = Leader(ground_m, options.climb)

    def target(
        self,
        flight: Flight,
        here: Point | None,
        velocity_mps: Point,
        now_s: float,
        *,
        on_ground: bool,
    ) -> Message:
        """What to tell a vehicle that is here and moves like this."""
        target = self._leader.target(flight, here, velocity_mps, now_s, on_ground=on_ground)
        return self._message(target, now_s)

    def above_start_m(self, wish: Takeoff, here: Point | None) -> float:
        """The height of a take-off, from where it stands."""
        stands_m = self._ground_m if here is None else here[2]
        return self._ground_m + wish.height_m - stands_m

    def _message(self, target: Target, now_s: float) -> Message:
        aim, heading, rate = target.position_m, target.heading_rad, target.yaw_rate_radps
        mask = 0
        mask |= _NO_POSITION if aim is None else 0
        mask |= _NO_ACCELERATION if target.acceleration_mps2 is None else 0
        mask |= _NO_YAW if heading is None else 0
        mask |= _NO_YAW_RATE if rate is None else 0
        return mavlink.MAVLink_set_position_target_local_ned_message(
            int(now_s * 1000) % 2**32,
            self._options.system,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_FRAME_LOCAL_NED,
            mask,
            *ned_to_enu(_STILL if aim is None else between(self._origin_m, aim)),
            *ned_to_enu(target.velocity_mps),
            *ned_to_enu(target.acceleration_mps2 or _STILL),
            0.0 if heading is None else heading_to_ned(heading),
            0.0 if rate is None else -rate,
        )
