"""Seeded mistakes in the driver and the bridge of the Robotarium."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ROBOTARIUM = "tests/runtime/platform/test_robotarium.py"

_BRIDGE = "runtime.drivers.robotarium.bridge"
_DRIVER = "runtime.drivers.robotarium.driver.RobotariumDriver"

#: What would let a robot drive on, or somebody else drive it, without anybody being told.
BRIDGED = (
    Mutant(
        "a robot drives on when nobody speaks",
        f"{_BRIDGE}.Bridge.step",
        "driver.quiet_steps <= DEAD_MAN_STEPS",
        "True",
        (ROBOTARIUM,),
    ),
    Mutant(
        "whoever speaks last drives",
        f"{_BRIDGE}.Bridge.hear",
        "known.session != told.session",
        "False",
        (ROBOTARIUM,),
    ),
    Mutant(
        "wheels are cut off each by itself",
        f"{_BRIDGE}.limited",
        "share * speed_mps, share * yaw_rate_radps",
        "speed_mps, share * yaw_rate_radps",
        (ROBOTARIUM,),
    ),
    Mutant(
        "a speed that is no number goes to the arena",
        f"{_BRIDGE}.limited",
        "not math.isfinite(rim_mps)",
        "False",
        (ROBOTARIUM,),
    ),
    Mutant(
        "a world that goes beyond the arena is driven in",
        f"{_DRIVER}._outside",
        "max(-low_x, high_x) <= wide_m and max(-low_y, high_y) <= deep_m",
        "True",
        (ROBOTARIUM,),
    ),
    Mutant(
        "the bridge's silence is a link",
        f"{_DRIVER}.sense",
        "self._refused is None and now_s - self._heard_s <= self.options.link",
        "self._refused is None",
        (ROBOTARIUM,),
    ),
)
