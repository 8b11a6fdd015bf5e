"""What drivers of aircraft share whose autopilots follow positions and velocities."""

from __future__ import annotations

from abc import abstractmethod

from koord.runtime.drivers.driver import Driver
from koord.runtime.drivers.leading import Flight
from koord.runtime.drivers.setpoints import (
    Arm,
    Capabilities,
    Disarm,
    Drive,
    Hold,
    Land,
    Position,
    Setpoint,
    Takeoff,
    Track,
    Velocity,
)


def aircraft_capabilities(
    telemetry_hz: float, dead_man_s: float, takeoff_height_m: float
) -> Capabilities:
    """What such an aircraft can do that tells where it is so often."""
    return Capabilities(
        kinds=("QUAD",),
        wishes=(Track, Position, Velocity, Takeoff, Land),
        rate_hz=20.0,
        pose_age_s=3 / telemetry_hz,
        dead_man_s=dead_man_s,
        tells_battery=True,
        tells_airborne=True,
        takeoff_height_m=takeoff_height_m,
    )


class AircraftDriver(Driver):
    """A driver that arms, disarms, lands and flies, each in its own way."""

    _told: Setpoint = Disarm()  #: what it was told last

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        self._told = setpoint
        match setpoint:
            case Disarm():
                self._disarm(now_s)
            case Arm():
                self._arm(now_s)
            case Land():
                self._land(now_s)
            case Drive():
                self._fly(Hold(), now_s)  # no pilot of an aircraft wishes for this
            case _:
                self._fly(setpoint, now_s)

    @property
    def _moves(self) -> bool:
        return isinstance(self._told, Track | Position | Velocity | Takeoff)

    @abstractmethod
    def _disarm(self, now_s: float) -> None:
        """Take the power from the rotors, also in the air."""

    @abstractmethod
    def _arm(self, now_s: float) -> None:
        """Give power to the rotors, on the ground."""

    @abstractmethod
    def _land(self, now_s: float) -> None:
        """Let it come down where it is."""

    @abstractmethod
    def _fly(self, flight: Flight, now_s: float) -> None:
        """Lead it, if it may fly."""
