"""What tells where a GPS receiver is: NMEA, gpsd, an autopilot, a topic of ROS. None of them waits.

Each tells its latest message once.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any, Protocol

import msgspec
from msgspec import Struct

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.graph import Graph
from koord.runtime.drivers.ros.options import Wire

#: More bytes are not read at a time; a line is no longer.
_MOST_BYTES, _LONGEST = 65_536, 8_192

#: gpsd is waited for at the start.
_CONNECT_S = 2.0

#: Fixes of MAVLink and of gpsd from which there is a position.
_GPS_FIX_2D, _TPV_2D, _TPV_3D = 2, 2, 3


class GeoFix(Struct, frozen=True):
    """What a receiver says."""

    is_fixed: bool
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    height_m: float | None = None  #: above what the origin's is; None: it does not tell


_NO_FIX = GeoFix(is_fixed=False)


class Source(Protocol):
    """What tells where a receiver is."""

    def take(self) -> GeoFix | None:
        """The latest message that was not taken yet, without waiting."""

    @property
    def why_silent(self) -> str:
        """What to look at where nothing is told."""

    def close(self) -> None:
        """Let go of it."""


class _Lines:
    """Lines that come as bytes, in pieces."""

    def __init__(self) -> None:
        self._rest = b""

    def of(self, data: bytes) -> Iterator[bytes]:
        """Yield the lines that end in these bytes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-_LONGEST:]
        yield from lines


class NmeaSource:
    """Sentences of NMEA 0183 over UDP or a serial line: GGA."""

    def __init__(self, connection: str) -> None:
        """Open it. Raises DriverError."""
        self.connection, self._lines = connection, _Lines()
        word, _, place = connection.partition(":")
        where, _, number = place.rpartition(":")
        self._socket: socket.socket | None = None
        self._serial: Any = None
        if word not in ("udpin", "serial") or not where or not number.isdecimal():
            raise _no_connection(connection, "serial:DEVICE:BAUD or udpin:HOST:PORT")
        try:
            if word == "udpin":
                self._socket = _bound((where, int(number)))
            else:
                self._serial = import_module("serial").Serial(where, int(number), timeout=0)
        except ImportError:
            hint = "install it with: pip install pyserial"
            raise DriverError(f"pyserial is needed for `{connection}`", hint) from None
        except (OSError, OverflowError, ValueError) as error:
            raise _not_open(connection, error) from None

    def take(self) -> GeoFix | None:
        found = None
        for line in self._lines.of(self._read()):
            found = _gga(line) or found
        return found

    def _read(self) -> bytes:
        if self._socket is None:
            try:
                data: bytes = self._serial.read(_MOST_BYTES)
            except OSError:  # it was pulled out: what is known grows old
                return b""
            return data
        data = b""
        with suppress(OSError):
            while len(data) < _MOST_BYTES:
                data += self._socket.recv(_MOST_BYTES) + b"\n"
        return data

    @property
    def why_silent(self) -> str:
        return f"no GGA comes from `{self.connection}`: is the receiver on, and its speed right?"

    def close(self) -> None:
        for one in (self._serial, self._socket):
            if one is not None:
                one.close()


def _bound(address: tuple[str, int]) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    try:
        made.bind(address)
    except (OSError, OverflowError):
        made.close()
        raise
    return made


def _gga(line: bytes) -> GeoFix | None:
    """What a sentence says; None: it is another one, or none."""
    nmea = import_module("pynmea2")
    try:
        told = nmea.parse(line.decode("ascii").strip(), check=True)
        if told.sentence_type != "GGA":
            return None
        if not int(told.gps_qual):
            return _NO_FIX
        height_m = None if told.altitude is None else float(told.altitude)
        return GeoFix(True, float(told.latitude), float(told.longitude), height_m)
    except (nmea.ParseError, ValueError, TypeError, AttributeError):
        return None


class GpsdSource:
    """The daemon gpsd, over TCP: its reports of time, position and velocity (TPV)."""

    def __init__(self, connection: str) -> None:
        """Connect. Raises DriverError."""
        self.connection, self._lines = connection, _Lines()
        word, _, place = connection.partition(":")
        host, _, port = place.rpartition(":")
        if word != "tcp" or not host or not port.isdecimal():
            raise _no_connection(connection, "tcp:HOST:PORT")
        try:
            self._socket = socket.create_connection((host, int(port)), timeout=_CONNECT_S)
            self._socket.sendall(b'?WATCH={"enable":true,"json":true}\n')
        except (OSError, OverflowError) as error:
            raise _not_open(connection, error) from None
        self._socket.setblocking(False)

    def take(self) -> GeoFix | None:
        data = b""
        with suppress(OSError):
            while len(data) < _MOST_BYTES and (piece := self._socket.recv(_MOST_BYTES)):
                data += piece
        found = None
        for line in self._lines.of(data):
            found = _tpv(line) or found
        return found

    @property
    def why_silent(self) -> str:
        return f"no positions come from gpsd at `{self.connection}`: does `cgps` show any?"

    def close(self) -> None:
        self._socket.close()


def _tpv(line: bytes) -> GeoFix | None:
    """What a report says; None: it is another one, or none."""
    try:
        told = json.loads(line)
        if told["class"] != "TPV":
            return None
        if told.get("mode", 0) < _TPV_2D:
            return _NO_FIX
        height = told.get("altHAE", told.get("alt")) if told["mode"] >= _TPV_3D else None
        height_m = None if height is None else float(height)
        return GeoFix(True, float(told["lat"]), float(told["lon"]), height_m)
    except (ValueError, KeyError, TypeError):
        return None


class MavlinkSource:
    """An autopilot: GLOBAL_POSITION_INT, which is its estimate, or else GPS_RAW_INT."""

    def __init__(self, connection: str) -> None:
        """Open it. Raises DriverError."""
        from koord.runtime.drivers.mavlink.link import WireLink
        from koord.runtime.drivers.mavlink.options import MavlinkOptions

        try:
            options = msgspec.convert({"connection": connection}, MavlinkOptions)
        except msgspec.ValidationError as error:
            raise DriverError(str(error), "see `connection` of the localiser") from None
        self.connection, self._link = connection, WireLink(options)
        self._has_estimate = False

    def take(self) -> GeoFix | None:
        found = None
        for message in self._link.receive():
            kind = message.get_type()
            if kind == "GLOBAL_POSITION_INT":
                self._has_estimate = True
                found = _of_sevens(message)
            elif kind == "GPS_RAW_INT" and message.fix_type < _GPS_FIX_2D:
                found = _NO_FIX
            elif kind == "GPS_RAW_INT" and not self._has_estimate:
                found = _of_sevens(message)
        return found

    @property
    def why_silent(self) -> str:
        return (
            f"no GLOBAL_POSITION_INT comes from `{self.connection}`: is it sent there? A port that"
            " the driver listens to needs another one beside it"
        )

    def close(self) -> None:
        self._link.close()


def _of_sevens(message: Any) -> GeoFix:
    """Degrees in 1e-7, and millimetres above the sea."""
    return GeoFix(True, message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)


class TopicSource:
    """A topic of ROS: NavSatFix."""

    def __init__(self, graph: Graph, wire: Wire) -> None:
        """Listen. Raises DriverError."""
        self._graph, self._wire = graph, wire
        self._latest = graph.listen(wire)

    def take(self) -> GeoFix | None:
        message = self._latest.take()
        if message is None:
            return None
        if message.status.status < 0:
            return _NO_FIX
        return GeoFix(True, message.latitude, message.longitude, message.altitude)

    @property
    def why_silent(self) -> str:
        return f"{self._graph.why_silent(self._wire)}; {self._graph.hint}"

    def close(self) -> None:
        self._graph.close()


def _no_connection(connection: str, forms: str) -> DriverError:
    return DriverError(f"`{connection}` is no connection of this source", f"write {forms}")


def _not_open(connection: str, error: Exception) -> DriverError:
    return DriverError(f"cannot open `{connection}`: {error}", "see `connection` of the localiser")
