"""The localiser ``natnet``: a rigid body of OptiTrack's Motive. (P-LOCATE-NATNET)"""

from __future__ import annotations

from typing import ClassVar

from msgspec import Struct

from koord.runtime.configuration.forms import Port
from koord.runtime.drivers.clocks import RemoteClock
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.frames import from_xyzw
from koord.runtime.drivers.localisers.capture import CaptureOptions, Up
from koord.runtime.drivers.localisers.natnet_client import NatNetClient
from koord.runtime.drivers.setpoints import Located

#: From exposure to transmission it takes less, in s; else these stamps say nothing.
_LONGEST_S = 1.0


class NatNetOptions(CaptureOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the server is, and which body is the vehicle's."""

    server: str  #: the address of Motive's machine
    port: Port = 1510  #: of its commands; where frames go it says itself
    local: str | None = None  #: the address of this machine in its network; else by the route
    number: int | None = None  #: of the body, its streaming ID, instead of a name
    up: Up = Up.Y


class NatNetLocaliser:
    """The localiser of one rigid body.

    A pose counts from when the cameras were exposed: stamps of the server say how long before the
    frame was sent, and the way of frames takes as long as the shortest one did.
    """

    OPTIONS: ClassVar[type[Struct]] = NatNetOptions

    def __init__(self, device: Device) -> None:
        assert isinstance(device.options, NatNetOptions)
        self.options = device.options
        self._name = self.options.body_of(device)
        self._client: NatNetClient | None = None
        self._clock = RemoteClock()
        self._located: Located | None = None
        self._seen_s = self._now_s = 0.0  #: when the body was seen last; when it was asked last
        self._frame: tuple[int, float] | None = None  #: number and exposure of the last one
        self._frame_s = 0.0  #: when that was read

    def open(self, now_s: float) -> None:
        self._client = NatNetClient((self.options.server, self.options.port), self.options.local)
        self._seen_s = self._frame_s = self._now_s = now_s

    def locate(self, now_s: float) -> Located | None:
        client = self._client
        if client is None:
            return self._located
        self._now_s = now_s
        client.wants_names = now_s - self._seen_s > self.options.silent
        client.poll(now_s)
        if now_s - self._frame_s > self.options.silent:
            client.lost(now_s)
        if client.frame is not None:
            self._hear(client, now_s)
        return self._located

    @property
    def _number(self) -> int | None:
        """The body's number, if it is known."""
        if self.options.number is not None or self._client is None:
            return self.options.number
        return (self._client.names or {}).get(self._name)

    def _hear(self, client: NatNetClient, now_s: float) -> None:
        """Take the frame that was read last, unless it is the one before. (P-LOCATE-NATNET)"""
        frame, client.frame = client.frame, None
        assert frame is not None
        number, told = frame.prefix.frame_number, frame.suffix
        if self._frame == (number, told.stamp_camera_mid_exposure):
            return
        self._frame, self._frame_s = (number, told.stamp_camera_mid_exposure), now_s
        measured_s = now_s
        if client.server is not None and client.server.clock_hz:
            sent_s = told.stamp_transmit / client.server.clock_hz
            exposed_s = told.stamp_camera_mid_exposure / client.server.clock_hz
            self._clock.hear(sent_s, now_s)
            tells = 0 <= sent_s - exposed_s <= _LONGEST_S
            measured_s = self._clock.ours(exposed_s if tells else sent_s)
        for body in frame.rigid_bodies:
            if body.id_num == self._number and body.tracking_valid:
                position = self.options.position(body.pos)
                attitude = self.options.attitude(from_xyzw(*body.rot))
                self._located = Located(position, attitude, measured_s)
                self._seen_s = now_s

    @property
    def remarks(self) -> tuple[str, ...]:
        why = self._why()
        return () if why is None else (f"natnet: {why}",)

    def _why(self) -> str | None:
        """Why there is no pose, with what would help. (P-LOCATE-LOST)"""
        client, options = self._client, self.options
        if client is None:
            return None
        where = f"{options.server}:{options.port}"
        if client.trouble is not None:
            return f"the server at {where}: {client.trouble}"
        if client.server is None:
            return (
                f"no server answers at {where}: is Motive's streaming on, with its local interface"
                " in this network?"
            )
        if self._now_s - self._frame_s > options.silent or self._frame is None:
            group = client.server.group
            to = "this client" if group is None else f"the group {group[0]}:{group[1]}"
            return f"no new frames come from {where} to {to}: is Motive paused, or `local` wrong?"
        called = f"`{self._name}`" if options.number is None else f"number {options.number}"
        if client.names is not None and self._number not in client.names.values():
            known = ", ".join(f"`{name}` ({k})" for name, k in client.names.items()) or "none"
            return f"there is no rigid body {called}: set `body` or `number` to one of: {known}"
        if self._now_s - self._seen_s > options.silent or self._located is None:
            return f"the rigid body {called} is not tracked: do cameras see its markers?"
        return None

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
