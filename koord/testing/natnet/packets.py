"""Packets of NatNet 3 and 4, as OptiTrack's SDK documents them: what a server sends.

Everything is little-endian; texts end with a zero. A packet is its message's number, the number of
bytes that follow, and these.
"""

from __future__ import annotations

import socket
import struct
from enum import IntEnum

from msgspec import Struct

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Message(IntEnum):
    """The messages that there are."""

    CONNECT = 0
    SERVERINFO = 1
    REQUEST = 2
    RESPONSE = 3
    REQUEST_MODELDEF = 4
    MODELDEF = 5
    FRAMEOFDATA = 7
    DISCONNECT = 9
    KEEPALIVE = 10
    UNRECOGNIZED_REQUEST = 100


class Version(Struct, frozen=True, order=True):
    """A version of the stream."""

    major: int
    minor: int = 0

    @classmethod
    def of(cls, text: str) -> Version:
        """Read ``4.1``."""
        major, _, minor = text.partition(".")
        return cls(int(major), int(minor or 0))

    @property
    def octets(self) -> bytes:
        return bytes((self.major, self.minor, 0, 0))

    @property
    def has_sizes(self) -> bool:
        """Whether each kind of data says how many bytes it has, and assets are among them."""
        return self >= Version(4, 1)


#: Ticks a second of the clock of a server.
CLOCK_HZ = 1_000_000_000

#: The markers of each rigid body, in its own frame.
_MARKERS: tuple[Vector, ...] = ((0.04, 0.0, 0.0), (-0.03, 0.0, 0.02), (0.0, 0.05, -0.03))

_NO_PARENT = 0xFFFFFFFF


class Stream(Struct, frozen=True):
    """How frames go out: to a group, or to each client."""

    port: int = 1511
    group: str | None = None


class Body(Struct, frozen=True):
    """A rigid body in a frame, in the server's axes."""

    number: int
    name: str
    position_m: Vector
    attitude: Quaternion  #: wxyz here; the wire has xyzw
    tracked: bool


class Times(Struct, frozen=True):
    """When a frame was exposed and sent, in ticks of the server's clock."""

    exposed: int
    sent: int


def packet(message: Message, payload: bytes = b"") -> bytes:
    """A packet."""
    return struct.pack("<HH", message, len(payload)) + payload


def server_info(version: Version, stream: Stream) -> bytes:
    """The answer to who connects: name, versions, the clock's frequency, and where frames go."""
    name = b"koord fake NatNet server".ljust(256, b"\0")
    told = name + bytes((3, 1, 0, 0)) + version.octets
    told += struct.pack("<QHB", CLOCK_HZ, stream.port, stream.group is not None)
    told += socket.inet_aton(stream.group or "0.0.0.0")
    return packet(Message.SERVERINFO, told)


def model_definitions(version: Version, bodies: tuple[Body, ...]) -> bytes:
    """The answer to who asks which bodies there are: their markers as sets, and they themselves."""
    sets = [
        (0, _text(body.name) + _count(len(_MARKERS)) + b"".join(map(_text, _marker_names())))
        for body in bodies
    ]
    described = [(1, _described(version, body)) for body in bodies]
    told = _count(len(sets) + len(described))
    for kind, data in (*sets, *described):
        told += _count(kind) + (_count(len(data)) if version.has_sizes else b"") + data
    return packet(Message.MODELDEF, told)


def _described(version: Version, body: Body) -> bytes:
    told = _text(body.name) + struct.pack("<II", body.number, _NO_PARENT) + _floats(0.0, 0.0, 0.0)
    if version >= Version(4, 2):
        told += _floats(0.0, 0.0, 0.0, 1.0)
    told += _count(len(_MARKERS)) + b"".join(_floats(*one) for one in _MARKERS)
    told += b"".join(_count(0) for _ in _MARKERS)  # they are passive
    if version >= Version(4):
        told += b"".join(map(_text, _marker_names()))
    return told


def frame(version: Version, number: int, bodies: tuple[Body, ...], times: Times) -> bytes:
    """A frame: marker sets, other markers, bodies, and kinds of data of which there are none."""
    sets = b"".join(
        _text(body.name) + _count(len(_MARKERS)) + len(_MARKERS) * _floats(*body.position_m)
        for body in bodies
    )
    tracked = b"".join(_tracked(body) for body in bodies)
    told = _count(number)
    told += _some(version, len(bodies), sets)
    told += _some(version, 0)  # other markers
    told += _some(version, len(bodies), tracked)
    told += _some(version, 0)  # skeletons
    if version.has_sizes:
        told += _some(version, 0)  # assets
    for _ in ("labelled markers", "force plates", "devices"):
        told += _some(version, 0)
    told += _count(0) + _count(0) + struct.pack("<d", times.exposed / CLOCK_HZ)  # time codes
    told += struct.pack("<QQQ", times.exposed, times.exposed, times.sent)
    if version >= Version(4):
        told += _count(0) + _count(0)  # time of a clock that there is none of
    told += struct.pack("<H", 0)  # not recorded; bodies are those that they were
    return packet(Message.FRAMEOFDATA, told + _count(0))


def _tracked(body: Body) -> bytes:
    w, x, y, z = body.attitude
    told = struct.pack("<I", body.number) + _floats(*body.position_m) + _floats(x, y, z, w)
    return told + _floats(0.0002) + struct.pack("<H", int(body.tracked))


def _some(version: Version, count: int, data: bytes = b"") -> bytes:
    return _count(count) + (_count(len(data)) if version.has_sizes else b"") + data


def _marker_names() -> list[str]:
    return [f"Marker{k + 1}" for k in range(len(_MARKERS))]


def _count(number: int) -> bytes:
    return struct.pack("<I", number)


def _floats(*numbers: float) -> bytes:
    return struct.pack(f"<{len(numbers)}f", *numbers)


def _text(text: str) -> bytes:
    return text.encode() + b"\0"
