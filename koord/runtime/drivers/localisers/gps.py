"""The localiser ``gps``: latitude, longitude and height as metres east, north and up of an origin.

By pymap3d, on the ellipsoid of WGS 84. (P-LOCATE-GPS)
"""

from __future__ import annotations

from enum import Enum
from importlib import import_module
from typing import Annotated, Any, ClassVar, assert_never

from msgspec import Meta, Struct

from koord.runtime.configuration.forms import Name, NotNegative, Positive, Topic
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.localisers.gps_sources import (
    GeoFix,
    GpsdSource,
    MavlinkSource,
    NmeaSource,
    Source,
    TopicSource,
)
from koord.runtime.drivers.localisers.topic import GraphOptions, joined
from koord.runtime.drivers.ros.options import Names, Use
from koord.runtime.drivers.setpoints import Located
from koord.runtime.motion.libraries import require

require(("pymap3d", "pynmea2"), "gps")

_pymap3d: Any = import_module("pymap3d")

Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Height = Annotated[float, Meta(ge=-1000, le=20_000)]


class GpsSource(Enum):
    """What tells where a receiver is."""

    GPSD = "gpsd"
    MAVLINK = "mavlink"
    NMEA = "nmea"
    TOPIC = "topic"


class GpsOptions(GraphOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the world is, and what tells where the receiver is."""

    #: latitude and longitude in degrees, height in metres: where the world's origin is
    origin: tuple[Latitude, Longitude, Height]
    source: GpsSource
    #: nmea: serial:DEVICE:BAUD or udpin:HOST:PORT; gpsd: tcp:HOST:PORT; mavlink: as its driver
    connection: Name = "tcp:127.0.0.1:2947"
    topic: Name = "/fix"  #: a NavSatFix of ROS
    latency: NotNegative = 0.0  #: s, from a measurement until it is told
    silent: Positive = 2.0  #: s without a position until people are told why


class GpsLocaliser:
    """The localiser of one receiver. It tells positions alone: attitudes are the driver's."""

    OPTIONS: ClassVar[type[Struct]] = GpsOptions

    def __init__(self, device: Device, source: Source | None = None) -> None:
        """Make a localiser; ``source`` instead of that of the options."""
        assert isinstance(device.options, GpsOptions)
        self.options, self._device = device.options, device
        self._source = source
        self._located: Located | None = None
        self._trouble: str | None = None
        self._heard_s = self._now_s = 0.0

    def open(self, now_s: float) -> None:
        self._heard_s = self._now_s = now_s
        if self._source is None:
            self._source = self._opened()

    def _opened(self) -> Source:
        """What the options name. Raises DriverError."""
        options = self.options
        match options.source:
            case GpsSource.NMEA:
                return NmeaSource(options.connection)
            case GpsSource.GPSD:
                return GpsdSource(options.connection)
            case GpsSource.MAVLINK:
                return MavlinkSource(options.connection)
            case GpsSource.TOPIC:
                names = Names("", self._device.vehicle.name, self._device.pid)
                wire = names.wire(Use.FIX, Topic(topic=options.topic, type="NavSatFix"))
                return TopicSource(joined(options), wire)
            case _:
                assert_never(options.source)

    def locate(self, now_s: float) -> Located | None:
        self._now_s = now_s
        fix = None if self._source is None else self._source.take()
        if fix is None:
            return self._located
        self._heard_s = now_s
        self._trouble = self._flaw(fix)
        if self._trouble is None:
            origin = self.options.origin
            height_m = origin[2] if fix.height_m is None else fix.height_m
            east, north, up = _pymap3d.geodetic2enu(
                fix.latitude_deg, fix.longitude_deg, height_m, *origin
            )
            ground_m = self._device.world.ground
            up_m = ground_m if self._device.body.ON_GROUND else float(up)
            there = (float(east), float(north), up_m)
            self._located = Located(there, None, now_s - self.options.latency)
        return self._located

    def _flaw(self, fix: GeoFix) -> str | None:
        """Why a message is no position."""
        if not fix.is_fixed:
            return "the receiver has no fix: does it see the sky?"
        if fix.height_m is None and not self._device.body.ON_GROUND:
            return "the receiver tells no height, and the vehicle flies"
        return None

    @property
    def remarks(self) -> tuple[str, ...]:
        if self._source is None:
            return ()
        if self._trouble is not None:
            return (f"gps: {self._trouble}",)
        if self._located is None or self._now_s - self._heard_s > self.options.silent:
            return (f"gps: {self._source.why_silent}",)
        return ()

    def close(self) -> None:
        if self._source is not None:
            self._source.close()
