"""The flight modes of PX4 and ArduPilot, as far as koord has to know them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Set
from typing import ClassVar

from koord.runtime.drivers.mavlink.library import mavlink, mavutil
from koord.runtime.drivers.mavlink.options import AutopilotKind


class Modes(ABC):
    """The modes of an autopilot, by their ``custom_mode`` in heartbeats."""

    GUIDED: ClassVar[int]  #: in it set-points count
    LAND: ClassVar[int]
    #: The mode is granted to who has been sending set-points for so long, in s.
    STREAM_FIRST_S: ClassVar[float]
    #: Whether it takes off by a command, or by set-points above it.
    RISES_BY_COMMAND: ClassVar[bool]

    @abstractmethod
    def name(self, mode: int) -> str:
        """The mode's name, as ground stations write it."""

    @abstractmethod
    def is_manual(self, mode: int) -> bool:
        """Return whether a person steers in it."""

    @abstractmethod
    def numbers(self, mode: int) -> tuple[float, float]:
        """The mode as second and third parameter of MAV_CMD_DO_SET_MODE."""


class Px4Modes(Modes):
    """The modes of PX4: a main mode in bits 16 to 23, and one below it in bits 24 to 31."""

    GUIDED = mavutil.PX4_CUSTOM_MAIN_MODE_OFFBOARD << 16
    LAND = mavutil.PX4_CUSTOM_MAIN_MODE_AUTO << 16 | mavutil.PX4_CUSTOM_SUB_MODE_AUTO_LAND << 24
    STREAM_FIRST_S = 1.0
    RISES_BY_COMMAND = False

    _BY_THEMSELVES = frozenset(
        {mavutil.PX4_CUSTOM_MAIN_MODE_AUTO, mavutil.PX4_CUSTOM_MAIN_MODE_OFFBOARD}
    )

    def name(self, mode: int) -> str:
        return str(mavutil.interpret_px4_mode(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode))

    def is_manual(self, mode: int) -> bool:
        return mode >> 16 & 0xFF not in self._BY_THEMSELVES

    def numbers(self, mode: int) -> tuple[float, float]:
        return float(mode >> 16 & 0xFF), float(mode >> 24 & 0xFF)


class ArduPilotModes(Modes):
    """The modes of ArduPilot's copters."""

    GUIDED = 4
    LAND = 9
    STREAM_FIRST_S = 0.0
    RISES_BY_COMMAND = True

    _MANUAL: ClassVar[Set[str]] = frozenset(
        {
            "STABILIZE",
            "ACRO",
            "ALT_HOLD",
            "LOITER",
            "DRIFT",
            "SPORT",
            "FLIP",
            "AUTOTUNE",
            "POSHOLD",
            "FLOWHOLD",
        }
    )

    def name(self, mode: int) -> str:
        return str(mavutil.mode_mapping_acm.get(mode, f"mode {mode}"))

    def is_manual(self, mode: int) -> bool:
        return self.name(mode) in self._MANUAL

    def numbers(self, mode: int) -> tuple[float, float]:
        return float(mode), 0.0


MODES: dict[AutopilotKind, Modes] = {
    AutopilotKind.PX4: Px4Modes(),
    AutopilotKind.ARDUPILOT: ArduPilotModes(),
}
