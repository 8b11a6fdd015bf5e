"""The localiser ``motioncapture``: Vicon, Qualisys, VRPN, OptiTrack, by one library for them all.

It is read by a process of its own. (P-LOCATE-READER)
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import ClassVar

import msgspec
from msgspec import Struct

from koord.runtime.configuration.forms import Name
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.localisers.capture import CaptureOptions
from koord.runtime.drivers.setpoints import Located
from koord.runtime.motion.libraries import require

require(("motioncapture",), "motioncapture")

_READER = "koord.runtime.drivers.localisers.motioncapture_reader"

#: More is not read at a time: the pipe holds no more.
_MOST_BYTES = 65_536


class MotionCaptureOptions(CaptureOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which system it is, as the library names it, and where."""

    type: Name  #: vicon, qualisys, vrpn, optitrack, …
    hostname: Name
    settings: Mapping[str, str] = {}  #: more of the library's, of this type


class Line(Struct, frozen=True):
    """What the reader tells."""

    connected: bool = False
    names: tuple[str, ...] | None = None
    at_s: float = 0.0  #: our time
    pose: tuple[float, float, float, float, float, float, float] | None = None
    error: str | None = None


def _command(*arguments: str) -> list[str]:
    """How its reader is started."""
    return [sys.executable, "-m", _READER, *arguments]


class MotionCaptureLocaliser:
    """The localiser of one rigid body. A pose counts from when the library told it."""

    OPTIONS: ClassVar[type[Struct]] = MotionCaptureOptions

    def __init__(self, device: Device) -> None:
        assert isinstance(device.options, MotionCaptureOptions)
        self.options = device.options
        self._name = self.options.body_of(device)
        self._reader: subprocess.Popen[bytes] | None = None
        self._rest = b""
        self._located: Located | None = None
        self._names: tuple[str, ...] | None = None
        self._error: str | None = None
        self._is_connected = False
        self._now_s = 0.0

    def open(self, now_s: float) -> None:
        self._now_s = now_s
        settings = {"hostname": self.options.hostname, **self.options.settings}
        try:
            self._reader = subprocess.Popen(
                _command(self.options.type, self._name, json.dumps(settings)),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            raise DriverError(f"the reader cannot be started: {error.strerror}") from None
        assert self._reader.stdout is not None
        os.set_blocking(self._reader.stdout.fileno(), False)

    def locate(self, now_s: float) -> Located | None:
        self._now_s = now_s
        for line in self._lines():
            with suppress(msgspec.MsgspecError):
                self._hear(msgspec.json.decode(line, type=Line))
        return self._located

    def _lines(self) -> list[bytes]:
        """What the reader has said."""
        if self._reader is None or self._reader.stdout is None:
            return []
        data = self._rest
        with suppress(OSError):
            while len(data) < _MOST_BYTES and (piece := self._read()):
                data += piece
        *lines, self._rest = data.split(b"\n")
        return lines

    def _read(self) -> bytes:
        assert self._reader is not None
        assert self._reader.stdout is not None
        return os.read(self._reader.stdout.fileno(), _MOST_BYTES)

    def _hear(self, line: Line) -> None:
        self._is_connected = self._is_connected or line.connected
        self._names = self._names if line.names is None else line.names
        self._error = self._error if line.error is None else line.error
        if line.pose is not None:
            x, y, z, *turn = line.pose
            attitude = self.options.attitude((turn[0], turn[1], turn[2], turn[3]))
            self._located = Located(self.options.position((x, y, z)), attitude, line.at_s)

    @property
    def remarks(self) -> tuple[str, ...]:
        why = self._why()
        return () if why is None else (f"motioncapture: {why}",)

    def _why(self) -> str | None:
        """Why there is no pose, with what would help. (P-LOCATE-LOST)"""
        where = f"{self.options.type} at {self.options.hostname}"
        if self._error is not None:
            return f"{where}: {self._error}; see `type` and `hostname`"
        if self._reader is not None and self._reader.poll() is not None:
            return f"what reads {where} has ended ({self._reader.returncode})"
        if not self._is_connected:
            return f"{where} does not answer: does it stream, and to this machine?"
        if self._located is not None:
            if self._now_s - self._located.measured_at_s <= self.options.silent:
                return None
            return f"the body `{self._name}` is not seen any more"
        known = ", ".join(f"`{name}`" for name in self._names or ()) or "none"
        return f"there is no body `{self._name}`: set `body` to one of: {known}"

    def close(self) -> None:
        if self._reader is not None:
            self._reader.kill()
            self._reader.wait()
            assert self._reader.stdout is not None
            self._reader.stdout.close()
