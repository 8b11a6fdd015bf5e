"""Seeded mistakes in localisers, and in the drivers that are told what they say."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

LOCALISED = "tests/runtime/platform/test_localised.py"
NATNET = "tests/runtime/platform/test_natnet.py"
VISION = "tests/runtime/platform/test_vision.py"
GPS = "tests/runtime/platform/test_gps.py"
HEARD = "tests/runtime/platform/ros/test_heard.py"
CONFIGURATION = "tests/runtime/test_configuration.py"

_DRIVERS = "runtime.drivers"
_LOCALISED = f"{_DRIVERS}.localised.Localised"
_NATNET = f"{_DRIVERS}.localisers.natnet.NatNetLocaliser"
_CAPTURE = f"{_DRIVERS}.localisers.capture.CaptureOptions"
_VISION = f"{_DRIVERS}.mavlink.vision.ExternalVision"
_GPS = f"{_DRIVERS}.localisers.gps.GpsLocaliser"

#: Where a vehicle is, is known otherwise than it is said.
LOCATED = (
    Mutant(
        "a vehicle is where its driver says, whatever its localiser does",
        f"{_LOCALISED}.sense",
        "located.position_m",
        "sensed.position_m",
        (LOCALISED,),
    ),
    Mutant(
        "a pose that is none counts",
        f"{_LOCALISED}._listen",
        "self._trouble is None",
        "True",
        (LOCALISED,),
    ),
    Mutant(
        "a vehicle is told the same pose again and again",
        f"{_LOCALISED}._listen",
        "located is None or located == self._located",
        "located is None",
        (LOCALISED,),
    ),
    Mutant(
        "a device cannot do without the localiser of all",
        "runtime.configuration.locating.stated_localiser",
        "None if name == _OWN else name",
        "name",
        (CONFIGURATION,),
    ),
    Mutant(
        "a body that cameras do not see is where the server says",
        f"{_NATNET}._hear",
        "body.id_num == self._number and body.tracking_valid",
        "body.id_num == self._number",
        (NATNET,),
    ),
    Mutant(
        "a frame that is told again is a new one",
        f"{_NATNET}._hear",
        "self._frame == (number, told.stamp_camera_mid_exposure)",
        "False",
        (NATNET,),
    ),
    Mutant(
        "a pose of a motion capture counts from when it is read",
        f"{_NATNET}._hear",
        "self._clock.ours(exposed_s if tells else sent_s)",
        "now_s",
        (NATNET,),
    ),
    Mutant(
        "a motion capture with y up is taken for one with z up",
        f"{_CAPTURE}.position",
        "y_up_to_enu(seen_m) if self.up is Up.Y else seen_m",
        "seen_m",
        (NATNET,),
    ),
    Mutant(
        "a body was made known while its vehicle looked along x, always",
        f"{_CAPTURE}.attitude",
        "product(product(turned(self.turn), level), turned(self.ahead))",
        "product(turned(self.turn), level)",
        (NATNET,),
    ),
    Mutant(
        "a server that was started again is not asked again",
        f"{_NATNET}.locate",
        "client.lost(now_s)",
        "pass",
        (NATNET,),
    ),
    Mutant(
        "an autopilot is told where it is in the frame of the world",
        f"{_VISION}.take",
        "a - b",
        "a",
        (VISION,),
    ),
    Mutant(
        "an autopilot may be elsewhere by its own estimate",
        f"{_VISION}.watch",
        "self._gap_m <= self._options.agree",
        "True",
        (VISION,),
    ),
    Mutant(
        "velocities of odometry are those of the world",
        f"{_VISION}._odometry",
        "flu_to_frd(in_body(attitude, self._differences.velocity_mps))",
        "self._differences.velocity_mps",
        (VISION,),
    ),
    Mutant(
        "a vehicle of ROS is where its topic says, whatever its localiser does",
        f"{_DRIVERS}.ros.driver.RosDriver._fix",
        "located is None",
        "True",
        (HEARD,),
    ),
    Mutant(
        "a receiver without a fix is where it says",
        f"{_GPS}._flaw",
        "not fix.is_fixed",
        "False",
        (GPS,),
    ),
    Mutant(
        "what drives is as high as its receiver says",
        f"{_GPS}.locate",
        "ground_m if self._device.body.ON_GROUND else float(up)",
        "float(up)",
        (GPS,),
    ),
)
