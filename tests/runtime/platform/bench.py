"""A driver of an aircraft and the other side of its wire in one process, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, Self, TypeVar

from koord.runtime.drivers.driver import Driver
from koord.runtime.drivers.setpoints import Arm, Sensed, Setpoint, Takeoff
from koord.runtime.motion.world import Point, World

WORLD = World((-5.0, -5.0, 0.0), (5.0, 5.0, 4.0))
TICK_S = 0.05


class Wire(Protocol):
    """The time on the wire, and the other side in it."""

    now: float

    def pass_time(self, until_s: float) -> None: ...


AnyWire = TypeVar("AnyWire", bound=Wire)
AnyDriver = TypeVar("AnyDriver", bound=Driver)


class AircraftBench(Generic[AnyWire, AnyDriver]):
    """A driver and its aircraft; time passes in ticks."""

    def __init__(self, air: AnyWire, driver: AnyDriver) -> None:
        self.air, self.driver = air, driver
        self.driver.open(air.now)
        self._sensed = self.driver.sense(air.now)

    @property
    def sensed(self) -> Sensed:
        assert self._sensed is not None
        return self._sensed

    @property
    def here(self) -> Point:
        return self.sensed.position_m

    def is_linked(self) -> bool:
        return self.sensed.link

    def sense(self) -> Sensed | None:
        self._sensed = self.driver.sense(self.air.now)
        return self._sensed

    def tick(self, setpoint: Setpoint | None, times: int = 1) -> None:
        """Sense and command, as a platform does; None: say nothing."""
        for _ in range(times):
            self.air.pass_time(self.air.now + TICK_S)
            if setpoint is not None:
                self.sense()
                self.driver.command(setpoint, self.air.now)

    def until(
        self, setpoint: Setpoint | None, condition: Callable[[], bool], most_s: float = 20.0
    ) -> None:
        begun = self.air.now
        while not condition():
            assert self.air.now - begun < most_s, (self._sensed, self.driver.remarks)
            self.tick(setpoint)

    def armed(self) -> Self:
        self.until(Arm(), lambda: self.sensed.armed is True)
        return self

    def risen(self, height_m: float = 1.0) -> Self:
        self.armed()
        self.until(Takeoff(height_m), lambda: self.here[2] > 0.95 * height_m)
        self.tick(Takeoff(height_m), 40)
        return self
