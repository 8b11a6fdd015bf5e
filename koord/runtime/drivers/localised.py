"""A driver whose vehicle is where a localiser says."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from msgspec.structs import replace

from koord.runtime.drivers.differences import Differences
from koord.runtime.drivers.driver import Device, Driver, DriverError
from koord.runtime.drivers.localiser import Localiser, LocaliserOptions, Locatable
from koord.runtime.drivers.setpoints import Located, Sensed, Setpoint
from koord.runtime.motion.world import Point, World

#: Attitudes are unit quaternions up to this.
_UNIT = 0.05

#: What stands on the ground may be seen so much below it.
_BELOW_M = 0.3

#: While it is waited for a pose, it is asked for after this.
_LOOK_S = 0.01

#: For so long a vehicle is waited for that was told where it is.
_TAKES_S = 30.0


class Localised:
    """A driver with a localiser, whose poses count instead of the driver's own. (P-LOCATE)

    What is no pose does not count, and the last one that was one grows old. (P-LOCATE-POSE)
    """

    def __init__(self, driver: Driver, localiser: Localiser, device: Device) -> None:
        """Make it of a driver and a localiser; the options of the device are the localiser's."""
        assert isinstance(device.options, LocaliserOptions)
        self.driver, self.localiser = driver, localiser
        self.capabilities = driver.capabilities
        self._name = device.vehicle.localiser or "the localiser"
        self._world, self._options = device.world, device.options
        self._differences = Differences(device.options.smoothing)
        self._located: Located | None = None
        self._trouble: str | None = None  #: why the latest pose does not count

    def open(self, now_s: float) -> None:
        """Wait for the first pose, and then for the vehicle. Raises DriverError."""
        begun_s = time.monotonic()

        def now() -> float:
            return now_s + time.monotonic() - begun_s

        self.localiser.open(now_s)
        try:
            self._wait_for_pose(now)
            self.driver.open(now())
        except DriverError:
            self.localiser.close()
            raise
        try:
            self._wait_for_vehicle(now)
        except DriverError:
            self.close()
            raise

    def _wait_for_pose(self, now: Callable[[], float]) -> None:
        """Wait until it is known where the vehicle is. Raises DriverError. (P-LOCATE-START)"""
        until_s = now() + self._options.wait
        while self._listen(now()) is None:
            if now() >= until_s:
                why = "; ".join(self._why) or f"{self._name} does not say where the vehicle is"
                raise DriverError(why, "see `localiser` and its options")
            time.sleep(_LOOK_S)

    def _wait_for_vehicle(self, now: Callable[[], float]) -> None:
        """Wait until a vehicle that was told where it is knows that. Raises DriverError."""
        until_s = now() + _TAKES_S
        while self.sense(now()) is None:
            if now() >= until_s:
                why = "; ".join(self.driver.remarks)
                raise DriverError(
                    f"the vehicle does not take where {self._name} says that it is"
                    + (f": {why}" if why else ""),
                    "see the options of its driver",
                )
            time.sleep(_LOOK_S)

    def sense(self, now_s: float) -> Sensed | None:
        located = self._listen(now_s)
        sensed = self.driver.sense(now_s)
        if located is None or sensed is None:
            return None
        return replace(
            sensed,
            position_m=located.position_m,
            attitude=sensed.attitude if located.attitude is None else located.attitude,
            velocity_mps=self._differences.velocity_mps,
            measured_at_s=located.measured_at_s,
        )

    def _listen(self, now_s: float) -> Located | None:
        """The latest pose that counts; a driver that wants to know is told each once."""
        located = self.localiser.locate(now_s)
        if located is None or located == self._located:
            return self._located
        self._trouble = _flaw(located)
        if self._trouble is None:
            self._located = located
            self._differences.hear(located.position_m, located.measured_at_s, now_s)
            if isinstance(self.driver, Locatable):  # (P-LOCATE-DRIVER)
                self.driver.locate(located, now_s)
        return self._located

    @property
    def _why(self) -> tuple[str, ...]:
        """Why it is not known where the vehicle is, or why that cannot be."""
        found = list(self.localiser.remarks)
        if self._trouble is not None:
            found.append(f"poses of {self._name} do not count: {self._trouble}")
        located = self._located
        if located is not None and _is_outside(located.position_m, self._world):
            where = ", ".join(f"{c:.2f}" for c in located.position_m)
            found.append(
                f"{self._name} says that the vehicle is at ({where}), outside of the world: are"
                " axes and origin those of the configuration?"
            )
        return tuple(found)

    @property
    def remarks(self) -> tuple[str, ...]:
        return (*self._why, *self.driver.remarks)

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        self.driver.command(setpoint, now_s)

    def ports(self) -> Mapping[str, Any]:
        return self.driver.ports()

    def act(self, port: str, value: Any) -> None:
        self.driver.act(port, value)

    def close(self) -> None:
        try:
            self.driver.close()
        finally:
            self.localiser.close()


def _is_outside(position_m: Point, world: World) -> bool:
    x, y, z = position_m
    (low_x, low_y, low_z), (high_x, high_y, high_z) = world.low, world.high
    return not (low_x <= x <= high_x and low_y <= y <= high_y and low_z - _BELOW_M <= z <= high_z)


def _flaw(located: Located) -> str | None:
    """Why something is no pose; None: it is one."""
    if not all(map(math.isfinite, (*located.position_m, located.measured_at_s))):
        return "a coordinate is no number"
    length = 1.0 if located.attitude is None else math.hypot(*located.attitude)
    if not abs(length - 1.0) <= _UNIT:
        return f"its orientation has the length {length:g}, and not 1"
    return None
