"""Seeded mistakes in the driver of Crazyflies."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

CRAZYFLIE = "tests/runtime/platform/test_crazyflie.py"
PROCESS = "tests/runtime/platform/test_crazyflie_process.py"

_DRIVER = "runtime.drivers.crazyflie.driver.CrazyflieDriver"
_TELEMETRY = "runtime.drivers.crazyflie.telemetry.Telemetry"

#: What would let it fly elsewhere, fall or rise, without anybody being told.
FLOWN = (
    Mutant(
        "the origin of its estimate is forgotten in set-points",
        f"{_DRIVER}._fly",
        "between(self._origin, target.position_m)",
        "target.position_m",
        (CRAZYFLIE,),
    ),
    Mutant(
        "the origin of its estimate is forgotten in poses that it is told",
        f"{_DRIVER}.locate",
        "between(self._origin, located.position_m)",
        "located.position_m",
        (CRAZYFLIE,),
    ),
    Mutant(
        "it is told attitudes as wxyz",
        f"{_DRIVER}.locate",
        "to_xyzw(located.attitude)",
        "located.attitude",
        (CRAZYFLIE,),
    ),
    Mutant(
        "its own attitudes are read as wxyz",
        f"{_TELEMETRY}._hear_pose",
        "from_xyzw(qx / norm, qy / norm, qz / norm, qw / norm)",
        "(qx / norm, qy / norm, qz / norm, qw / norm)",
        (CRAZYFLIE,),
    ),
    Mutant(
        "a pose counts though nothing supports it",
        f"{_TELEMETRY}.is_sure",
        "self.spread_m <= self._options.spread",
        "True",
        (CRAZYFLIE,),
    ),
    Mutant(
        "an armed one that stands is held above where it stands",
        f"{_DRIVER}._fly",
        "isinstance(flight, Hold) or not self._was_told_to_arm",
        "not self._was_told_to_arm",
        (CRAZYFLIE,),
    ),
    Mutant(
        "one that arms itself flies though nobody told it to arm",
        f"{_DRIVER}._fly",
        "isinstance(flight, Hold) or not self._was_told_to_arm",
        "isinstance(flight, Hold)",
        (CRAZYFLIE,),
    ),
    Mutant(
        "it is told to stop its motors once, and locks itself",
        f"{_DRIVER}._disarm",
        "self._telemetry.airborne is not False",
        "self._telemetry.position_m is not None and self._telemetry.position_m[2] > 0.1",
        (CRAZYFLIE,),
    ),
    Mutant(
        "it is told to land anew while it lands",
        f"{_DRIVER}._land",
        "self._telemetry.airborne is False or now_s < self._lands_until_s",
        "self._telemetry.airborne is False",
        (CRAZYFLIE,),
    ),
    Mutant(
        "set-points go on to be what flies while it lands",
        f"{_DRIVER}._land",
        "cf.commander.send_notify_setpoint_stop()",
        "None",
        (CRAZYFLIE,),
    ),
    Mutant(
        "who is let go of in the air is told to stop its motors",
        "runtime.drivers.crazyflie.link.CflibLink._shut",
        "link, crazyflie.link = crazyflie.link, None",
        "link = None",
        (PROCESS,),
    ),
    Mutant(
        "what could not be sent in time is sent late",
        "runtime.drivers.crazyflie.link.CflibLink._send_all",
        "time.monotonic() <= until_s",
        "True",
        (PROCESS,),
    ),
    Mutant(
        "what is locked obeys",
        f"{_DRIVER}.sense",
        "self._hears(now_s) and not self._telemetry.cannot",
        "self._hears(now_s)",
        (CRAZYFLIE,),
    ),
    Mutant(
        "what has disarmed itself is armed by a wish",
        f"{_DRIVER}._fly",
        "telemetry = self._telemetry",
        "telemetry = self._ask_arming(True, now_s) or self._telemetry",
        (CRAZYFLIE,),
    ),
)
