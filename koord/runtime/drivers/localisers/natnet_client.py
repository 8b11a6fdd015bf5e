"""A client of a NatNet server, which never waits: requests go out, and what has come is read.

The packets' insides are read by the package ``natnet``; its own client blocks, and has threads.
"""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any

from msgspec import Struct

from koord.runtime.drivers.driver import DriverError
from koord.runtime.motion.libraries import require

require(("natnet",), "natnet")

_natnet: Any = import_module("natnet")
_PacketBuffer: Any = import_module("natnet.packet_buffer").PacketBuffer

#: Numbers of messages.
_CONNECT, _SERVERINFO, _REQUEST_MODELDEF, _MODELDEF = 0, 1, 4, 5
_FRAMEOFDATA, _KEEPALIVE = 7, 10

#: Requests are sent again after this, in s; a server forgets who is silent for longer.
_AGAIN_S, _KEEPALIVE_S = 0.5, 1.0

#: What follows name and versions in the answer to who connects: the frequency of the clock, the
#: port of frames, whether they go to a group, and to which.
_CONNECTION = struct.Struct("<QHB4s")

#: Versions that are read: Motive 2 and 3.
_OLDEST, _NEWEST = (3, 0), (4, 2)

#: The end of a frame that is not read: a time of another clock, and a zero.
_UNREAD = 12

#: More than these are not read at a time.
_MOST_PACKETS = 1000

#: What a packet raises that is none, or is cut off.
_UNREADABLE = (struct.error, _natnet.NatNetError, ValueError)


class _Packet(_PacketBuffer):  # type: ignore[misc]
    """A packet, in which nothing is read beyond its end, however much it says that there is."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.pointer = 4  # behind its message and its length

    @property
    def left(self) -> int:
        """Bytes that are not read yet."""
        return len(self.data) - self.pointer

    def read_string(self, max_length: int | None = None, static_length: bool = False) -> str:
        if self.left <= 0:
            raise ValueError("a text is missing")
        text: str = super().read_string(max_length, static_length)
        return text

    def read_float32_array(self, count: int) -> tuple[float, ...]:
        if 4 * count > self.left:
            raise ValueError("numbers are missing")
        numbers: tuple[float, ...] = super().read_float32_array(count)
        return numbers

    def read_uint64(self) -> int:
        (number,) = self.read("<Q")  # of this size on all machines
        return int(number)


class Server(Struct, frozen=True):
    """A server, as it says itself."""

    version: tuple[int, int]
    clock_hz: int  #: 0: it does not say
    group: tuple[str, int] | None  #: where frames go to; None: to each client

    @property
    def flaw(self) -> str | None:
        """Why its frames cannot be read."""
        if _OLDEST <= self.version <= _NEWEST:
            return None
        spoken, oldest, newest = (
            ".".join(map(str, one)) for one in (self.version, _OLDEST, _NEWEST)
        )
        return f"it speaks NatNet {spoken}, and {oldest} to {newest} are read (Motive 2 and 3)"


class Request(Struct):
    """A request, and when it was sent last."""

    message: int
    payload: bytes = b"\0"
    sent_s: float = -1e9


class NatNetClient:
    """A client of one server. ``frame`` is the newest one, ``names`` are the bodies' numbers."""

    def __init__(self, address: tuple[str, int], local: str | None) -> None:
        """Open its sockets; ``local`` is the address of this machine in the server's network.

        Raises DriverError.
        """
        self.server: Server | None = None
        self.frame: Any = None
        self.names: dict[str, int] | None = None
        self.wants_names = True
        self.trouble: str | None = None  #: why what comes is not read
        self._version: Any = _natnet.Version()
        # Name, versions, and which stream is asked for: that which the server has.
        self._connect = Request(_CONNECT, b"Ping".ljust(256, b"\0") + bytes(13))
        self._model = Request(_REQUEST_MODELDEF)
        self._alive = Request(_KEEPALIVE)
        self._frames: socket.socket | None = None
        try:
            self.address = socket.gethostbyname(address[0]), address[1]  # once: it may wait
            self._local = _route(self.address) if local is None else local
            self._commands = _socket((self._local, 0))
        except OSError as error:
            raise DriverError(
                f"no way to the NatNet server at {address[0]}:{address[1]}: {error.strerror}",
                "see `server`, and `local`: the address of this machine in its network",
            ) from None

    def poll(self, now_s: float) -> None:
        """Send the requests that are due, and read what has come."""
        if self.server is None:
            self._ask(self._connect, now_s, _AGAIN_S)
        else:
            if self.wants_names or self.names is None:
                self._ask(self._model, now_s, _AGAIN_S)
            if self.server.group is None:
                self._ask(self._alive, now_s, _KEEPALIVE_S)
        newest = None
        for data in self._arrived():
            (message,) = struct.unpack_from("<H", data)
            if message == _FRAMEOFDATA:
                newest = data  # of frames that came since, the last one counts
            else:
                self._read(message, data)
        if newest is not None:
            self._read(_FRAMEOFDATA, newest)

    def lost(self, now_s: float) -> None:
        """Connect anew: the server may have been started again."""
        self._ask(self._connect, now_s, _AGAIN_S)

    def close(self) -> None:
        """Leave."""
        self._commands.close()
        if self._frames is not None:
            self._frames.close()

    def _ask(self, request: Request, now_s: float, again_s: float) -> None:
        if now_s - request.sent_s < again_s:
            return
        request.sent_s = now_s
        head = struct.pack("<HH", request.message, len(request.payload))
        with suppress(OSError):  # it is asked again
            self._commands.sendto(head + request.payload, self.address)

    def _arrived(self) -> Iterator[bytes]:
        for one in (self._commands, self._frames):
            for _ in range(0 if one is None else _MOST_PACKETS):
                assert one is not None
                try:
                    data = one.recv(65536)
                except BlockingIOError:
                    break
                except OSError:  # nobody is at that port: it is asked again
                    continue
                if len(data) >= 4:
                    yield data

    def _read(self, message: int, data: bytes) -> None:
        packet = _Packet(data)
        try:
            if message == _SERVERINFO:
                self._hear_server(packet)
            elif message == _MODELDEF and self._is_readable:
                told = _natnet.DataDescriptions.read_from_buffer(packet, self._version)
                self.names = {one.name: one.id_num for one in told.rigid_bodies}
            elif message == _FRAMEOFDATA and self._is_readable:
                frame = _natnet.DataFrame.read_from_buffer(packet, self._version)
                if not 0 <= packet.left <= _UNREAD:
                    raise ValueError("bytes are left")
                self.frame, self.trouble = frame, None
        except _UNREADABLE:
            self.trouble = f"a packet of NatNet {self._version.truncate(2)} cannot be read"

    @property
    def _is_readable(self) -> bool:
        return self.server is not None and self.server.flaw is None

    def _hear_server(self, packet: _Packet) -> None:
        version = _natnet.ServerInfo.read_from_buffer(
            packet, self._version
        ).nat_net_protocol_version
        clock_hz, group = 0, None
        if packet.left >= _CONNECTION.size:
            clock_hz, port, shared, octets = packet.read(_CONNECTION)
            group = (socket.inet_ntoa(octets), port) if shared else None
        server = Server((version.major, version.minor), clock_hz, group)
        if server == self.server:
            return
        self.server, self._version = server, version
        self.trouble = server.flaw
        if self._frames is not None:
            self._frames.close()
            self._frames = None
        if group is not None:
            self._join(group)

    def _join(self, group: tuple[str, int]) -> None:
        """Hear what a group hears, as others on this machine may, too."""
        address = ("" if sys.platform == "win32" else group[0], group[1])
        try:
            self._frames = _socket(address, shared=True)
            member = socket.inet_aton(group[0]) + socket.inet_aton(self._local)
            self._frames.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            self.trouble = (
                f"the group {group[0]}:{group[1]} cannot be joined ({error.strerror}): is `local`"
                " the address of this machine in the server's network?"
            )


def _socket(address: tuple[str, int], *, shared: bool = False) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    try:
        if shared:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "SO_REUSEPORT"):
                made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind(address)
    except OSError:
        made.close()
        raise
    return made


def _route(address: tuple[str, int]) -> str:
    """The address of this machine from which a server is reached."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.connect(address)
        host: str = made.getsockname()[0]
        return host
