"""What a fake motion capture sees: bodies that are where it is told, without clock or socket.

It is told in metres, east, north, up, what is true; what it streams has its own axes, y or z up.
"""

from __future__ import annotations

import math
from enum import Enum

import msgspec
from msgspec import Struct

from koord.testing.natnet.packets import CLOCK_HZ, Body, Quaternion, Times, Vector, Version, frame

_LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Up(Enum):
    """The axis that points up in what is streamed."""

    Y = "y"
    Z = "z"


class Told(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """What it is told, as a datagram of JSON or a line of a script; what is left out stays."""

    at: float | None = None  #: s after its start; of scripts
    body: str | None = None  #: of which what follows is said
    position: Vector | None = None  #: m, east, north, up
    attitude: Quaternion | None = None  #: wxyz
    heading: float | None = None  #: rad, counter-clockwise from east, instead of an attitude
    tracked: bool | None = None  #: whether cameras see it
    shift: Vector | None = None  #: m, by which it is seen elsewhere than it is
    nan: bool | None = None  #: whether its position is no number
    #: of all: whether each frame is the last one again; whether there are no frames; no answers
    frozen: bool | None = None
    silent: bool | None = None
    deaf: bool | None = None


def told_in(data: bytes) -> Told | None:
    """What a datagram says; None: nothing that can be read."""
    try:
        return msgspec.json.decode(data, type=Told)
    except msgspec.MsgspecError:
        return None


class Seen(Struct):
    """A body as it is, and how cameras see it."""

    number: int
    position_m: Vector | None = None
    attitude: Quaternion = _LEVEL
    tracked: bool = True
    shift_m: Vector = (0.0, 0.0, 0.0)
    is_nan: bool = False


class MotionCapture:
    """Bodies, by the names of a configuration, numbered from 1; and frames of them."""

    def __init__(self, names: tuple[str, ...], version: Version, up: Up = Up.Y) -> None:
        self.version, self.up = version, up
        self.seen = {name: Seen(k + 1) for k, name in enumerate(names)}
        self.is_frozen = self.is_silent = self.is_deaf = False
        self._number = 0
        self._last: tuple[int, tuple[Body, ...], int] | None = None

    def hear(self, told: Told) -> None:
        """Take note of what it is told; of bodies that it does not know, of nothing."""
        self.is_frozen = self.is_frozen if told.frozen is None else told.frozen
        self.is_silent = self.is_silent if told.silent is None else told.silent
        self.is_deaf = self.is_deaf if told.deaf is None else told.deaf
        seen = None if told.body is None else self.seen.get(told.body)
        if seen is None:
            return
        seen.position_m = seen.position_m if told.position is None else told.position
        if told.heading is not None:
            seen.attitude = math.cos(told.heading / 2), 0.0, 0.0, math.sin(told.heading / 2)
        seen.attitude = seen.attitude if told.attitude is None else told.attitude
        seen.tracked = seen.tracked if told.tracked is None else told.tracked
        seen.shift_m = seen.shift_m if told.shift is None else told.shift
        seen.is_nan = seen.is_nan if told.nan is None else told.nan

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies as they are streamed now."""
        return tuple(self._streamed(name, seen) for name, seen in self.seen.items())

    def _streamed(self, name: str, seen: Seen) -> Body:
        position = seen.position_m
        if position is None or not seen.tracked:
            return Body(seen.number, name, (0.0, 0.0, 0.0), _LEVEL, tracked=False)
        x, y, z = (a + b for a, b in zip(position, seen.shift_m, strict=True))
        if seen.is_nan:
            x = math.nan
        w, i, j, k = seen.attitude
        if self.up is Up.Y:  # its z axis points south
            return Body(seen.number, name, (x, z, -y), (w, i, k, -j), tracked=True)
        return Body(seen.number, name, (x, y, z), (w, i, j, k), tracked=True)

    def frame(self, exposed_s: float, sent_s: float) -> bytes | None:
        """The next frame, of what was exposed and is sent at times of its clock; None: none."""
        if self.is_silent:
            return None
        exposed, sent = round(exposed_s * CLOCK_HZ), round(sent_s * CLOCK_HZ)
        if self._last is None or not self.is_frozen:
            self._number += 1
            self._last = self._number, self.bodies, exposed
        number, bodies, exposed = self._last
        return frame(self.version, number, bodies, Times(exposed, sent))
