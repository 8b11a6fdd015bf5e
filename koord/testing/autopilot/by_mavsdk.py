"""An autopilot by MAVSDK's server plugins: who answers koord here is neither koord nor pymavlink.

MAVSDK makes heartbeats, acknowledges commands, grants or refuses modes and arming, and answers for
parameters; the aircraft, and PX4's failsafe of offboard mode, are those of this folder. Its server
plugins take no set-points and tell no attitudes as quaternions: these go through its plugin for
messages as such. It grants offboard mode to whoever asks, set-points or not.
"""

from __future__ import annotations

import argparse
import json
import threading
import time
from typing import Any

import mavsdk
from mavsdk.plugins import action_server, mavlink_direct_server, param_server, telemetry_server

from koord.testing.autopilot.airframe import Airframe, Handling, Target, Vector

#: A step of flight and of telemetry; how fast it lands.
_STEP_S, _SINKING_MPS = 0.02, 0.5

#: What is left of the battery. (MAVSDK 4.1 calls it percent, and takes a share.)
_CHARGE = 0.8

#: PX4's: without set-points for longer it lands. (COM_OF_LOSS_T)
_LOSS_S = 1.0

#: Below it is on the ground; there it disarms after landing for so long.
_DOWN_M, _LANDED_S = 0.05, 0.5

_MODES = action_server.FlightMode
_LANDED = telemetry_server.LandedState


class Vehicle:
    """An aircraft behind MAVSDK's server plugins."""

    def __init__(self, connection: str, *, armable: bool = True) -> None:
        """Stand on the ground, disarmed. ``connection``: as MAVSDK writes it."""
        kind = mavsdk.ComponentType.AUTOPILOT
        self._mavsdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        component = self._mavsdk.server_component()
        self._parameters = param_server.ParamServer(component)
        self._parameters.provide_param_float("COM_OF_LOSS_T", _LOSS_S)
        self._telemetry = telemetry_server.TelemetryServer(component)
        self._messages = mavlink_direct_server.MavlinkDirectServer(component)
        self._actions = action_server.ActionServer(component)
        self._actions.set_armable(armable, False)
        self._actions.set_disarmable(True, True)
        self._actions.set_allowable_flight_modes(
            action_server.AllowableFlightModes(
                can_auto_mode=True,
                can_guided_mode=True,
                can_auto_land_mode=True,
                can_auto_loiter_mode=True,
            )
        )
        self.airframe = Airframe((0.0, 0.0, 0.0), 0.0, Handling())
        self.mode, self.armed = _MODES.HOLD, False
        self._lock = threading.Lock()
        self._setpoint: tuple[Target, float] | None = None
        self._down_s = 0.0
        self._boot_s = time.monotonic()
        self._actions.subscribe_arm_disarm(self._on_arm)
        self._actions.subscribe_flight_mode_change(self._on_mode)
        self._messages.subscribe_message("SET_POSITION_TARGET_LOCAL_NED", self._on_setpoint)
        self._actions.set_flight_mode(self.mode)
        result = self._mavsdk.add_any_connection(connection)
        assert result == mavsdk.ConnectionResult.SUCCESS, result

    # --- what MAVSDK calls, in threads of its own -------------------------------------------------

    def _on_arm(self, result: Any, asked: Any, _data: Any) -> None:
        if result == action_server.ActionServerResult.SUCCESS:
            with self._lock:
                self.armed = asked.arm

    def _on_mode(self, result: Any, mode: Any, _data: Any) -> None:
        if result == action_server.ActionServerResult.SUCCESS:
            with self._lock:
                self.mode = _MODES(mode)

    def _on_setpoint(self, message: Any, _data: Any) -> None:
        told = json.loads(message.fields_json)
        mask = int(told["type_mask"])

        def vector(shift: int, x: str, y: str, z: str) -> Vector | None:
            said = mask >> shift & 0b111 == 0
            return (float(told[x]), float(told[y]), float(told[z])) if said else None

        still = (0.0, 0.0, 0.0)
        target = Target(
            vector(0, "x", "y", "z"),
            vector(3, "vx", "vy", "vz") or still,
            vector(6, "afx", "afy", "afz") or still,
            None if mask >> 10 & 1 else float(told["yaw"]),
            0.0 if mask >> 11 & 1 else float(told["yaw_rate"]),
        )
        with self._lock:
            self._setpoint = target, time.monotonic()

    # --- time -----------------------------------------------------------------------------------

    def fly(self) -> None:
        """Fly on for ever, in real time."""
        step, due_s = 0, time.monotonic()
        while True:
            with self._lock:
                self._step()
                self._tell(step)
            step, due_s = step + 1, due_s + _STEP_S
            time.sleep(max(0.0, due_s - time.monotonic()))

    def _step(self) -> None:
        now_s = time.monotonic()
        x, y, z = self.airframe.position_m
        aim: Target | None = Target((x, y, z))
        if self.mode is _MODES.OFFBOARD:
            if self._setpoint is None or now_s - self._setpoint[1] > _LOSS_S:
                self.mode = _MODES.LAND
                self._actions.set_flight_mode(self.mode)
            else:
                aim = self._setpoint[0]
        if self.mode is _MODES.LAND:
            aim = Target((x, y, z + _SINKING_MPS * _STEP_S), (0.0, 0.0, _SINKING_MPS))
        self.airframe.step(aim if self.armed else None, _STEP_S)
        is_down = self.airframe.height_m < _DOWN_M
        self._down_s = self._down_s + _STEP_S if is_down and self.mode is _MODES.LAND else 0.0
        if self.armed and self._down_s > _LANDED_S:
            self.armed = False
            self._actions.set_armed_state(False)

    def _tell(self, step: int) -> None:
        body = self.airframe
        self._telemetry.publish_position_velocity_ned(
            telemetry_server.PositionVelocityNed(
                telemetry_server.PositionNed(*body.position_m),
                telemetry_server.VelocityNed(*body.velocity_mps),
            )
        )
        w, x, y, z = body.attitude
        fields = {
            "time_boot_ms": int((time.monotonic() - self._boot_s) * 1000),
            **{"q1": w, "q2": x, "q3": y, "q4": z},
            **dict.fromkeys(("rollspeed", "pitchspeed", "yawspeed"), 0.0),
        }
        self._messages.send_message(
            mavlink_direct_server.MavlinkMessage(
                "ATTITUDE_QUATERNION", fields_json=json.dumps(fields)
            )
        )
        if step % 10 == 0:
            landed = _LANDED.ON_GROUND if body.height_m < _DOWN_M else _LANDED.IN_AIR
            vtol = telemetry_server.VtolState.UNDEFINED
            self._telemetry.publish_extended_sys_state(vtol, landed)
        if step % 50 == 0:
            self._telemetry.publish_battery(telemetry_server.Battery(12.0, _CHARGE))


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.autopilot.by_mavsdk``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connection", default="udpout://127.0.0.1:14540", metavar="URL")
    parser.add_argument("--refuses", action="store_true", help="it refuses to arm")
    told = parser.parse_args()
    Vehicle(told.connection, armable=not told.refuses).fly()


if __name__ == "__main__":
    main()
