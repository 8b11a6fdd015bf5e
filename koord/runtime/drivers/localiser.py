"""The interface of localisers: what tells where a vehicle is, instead of its driver.

A localiser is found by its name among the entry points ``koord.localisers`` (:mod:`.registry`). As
drivers do, it never blocks: it is asked at each tick, and answers with the latest that it knows.
(P-LOCATE)
"""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

from msgspec import Struct

from koord.runtime.configuration.forms import NotNegative
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.setpoints import Located


class LocaliserOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The options that all localisers have; their own forms begin with these."""

    wait: NotNegative = 5.0  #: s, for the first pose
    smoothing: NotNegative = 0.1  #: s, of the low pass on velocities from differences of poses


class LocaliserType(Protocol):
    """What makes the localisers of one name: a class of them, or a function with these facts."""

    #: The form of options in configurations, which begins with LocaliserOptions.
    OPTIONS: ClassVar[type[Struct]]

    def __call__(self, device: Device) -> Localiser:
        """Make the localiser of a device; nothing is opened yet. Raises DriverError.

        The ``options`` of the device are the localiser's.
        """
        ...


class Localiser(Protocol):
    """The localiser of one vehicle."""

    def open(self, now_s: float) -> None:
        """Connect, without waiting for a pose. Raises DriverError."""

    def locate(self, now_s: float) -> Located | None:
        """The latest pose, which grows old if there is no newer one; None: there was none yet."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What people should know by now: why there is no pose, with what would help."""

    def close(self) -> None:
        """Let go of it."""


@runtime_checkable
class Locatable(Protocol):
    """A driver that passes on, or needs for itself, where a localiser says that its vehicle is."""

    def locate(self, located: Located, now_s: float) -> None:
        """Take the vehicle's pose: each one once, before the vehicle is opened or asked."""
