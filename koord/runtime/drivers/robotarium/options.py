"""The options of robots of the Robotarium in configurations."""

from __future__ import annotations

from ipaddress import ip_address
from typing import Annotated

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0, le=1e6)]


class RobotariumOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a robot is reached."""

    bridge: str = "127.0.0.1:5550"  #: where the bridge is, on this machine
    robot: Annotated[int, Meta(ge=0, le=49)] | None = None  #: its number; else the robot's pid
    link: Positive = 0.5  #: s, greatest age of what the bridge tells
    connect: Positive = 10.0  #: s, for which the bridge is waited for at the start

    def __post_init__(self) -> None:
        address_of(self.bridge)


def address_of(text: str) -> tuple[str, int]:
    """An address of the loopback, as HOST:PORT. Raises ValueError for others.

    The bridge believes whoever speaks to it, so nobody else is to. (B-LOCAL)
    """
    host, _, port = text.rpartition(":")
    try:
        is_local = ip_address(host).is_loopback
    except ValueError:
        is_local = False
    if not is_local or not port.isdecimal() or int(port) > 65535 or ":" in host:
        raise ValueError(f"`{text}` is no address of this machine alone: write 127.0.0.1:PORT")
    return host, int(port)
