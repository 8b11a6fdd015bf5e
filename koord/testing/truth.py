"""Where a simulated vehicle really is, told to people, test benches and fake motion capture."""

from __future__ import annotations

import json
import math
import sys
from typing import NamedTuple

from msgspec import Struct

from koord.testing.sockets import Address


class Place(NamedTuple):
    """Where a vehicle is: metres, and radians counter-clockwise from east."""

    east: float
    north: float
    up: float
    heading: float


class Truth(Struct, frozen=True):
    """Who is told where a vehicle really is, and what that calls it."""

    address: Address
    body: str
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: of its frame, east, north, up


def reported(place: Place, *, armed: bool | None = None) -> str:
    """A line of JSON for benches; ``armed`` where the vehicle knows."""
    known = {} if armed is None else {"armed": armed}
    return json.dumps({**place._asdict(), **known})


def told(place: Place, truth: Truth) -> bytes:
    """JSON for a fake motion capture."""
    x, y, z = truth.origin_m
    there = [x + place.east, y + place.north, z + place.up]
    heading = math.remainder(place.heading, math.tau)
    return json.dumps({"body": truth.body, "position": there, "heading": heading}).encode()


def show(line: str) -> None:
    """Write a line for whoever reads this process."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
