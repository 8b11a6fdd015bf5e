"""What drivers and the bridge say to each other: datagrams of JSON."""

from __future__ import annotations

import msgspec
from msgspec import Struct


class Told(Struct, frozen=True, tag="told", forbid_unknown_fields=True):
    """What a robot is to do until the next word."""

    robot: int
    session: str  #: of the driver that says it
    speed_mps: float
    yaw_rate_radps: float


class Seen(Struct, frozen=True, tag="seen", forbid_unknown_fields=True):
    """Where a robot is."""

    robot: int
    at_s: float  #: by the bridge's clock
    x_m: float
    y_m: float
    heading_rad: float
    half_size_m: tuple[float, float]  #: of the arena, about its middle, which is the origin


class Refused(Struct, frozen=True, tag="refused", forbid_unknown_fields=True):
    """Why a driver is not listened to."""

    robot: int
    why: str


_ENCODER = msgspec.json.Encoder()
_DECODER: msgspec.json.Decoder[Told | Seen | Refused] = msgspec.json.Decoder(Told | Seen | Refused)


def encoded(message: Told | Seen | Refused) -> bytes:
    """A message as a datagram."""
    return _ENCODER.encode(message)


def decoded(data: bytes) -> Told | Seen | Refused | None:
    """The message in a datagram; None: it is none."""
    try:
        return _DECODER.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
