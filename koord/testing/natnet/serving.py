"""A fake NatNet server at UDP sockets, in real time."""

from __future__ import annotations

import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable

from msgspec import Struct

from koord.testing.natnet.machine import MotionCapture, Told, Up, told_in
from koord.testing.natnet.packets import (
    Message,
    Stream,
    Version,
    model_definitions,
    packet,
    server_info,
)
from koord.testing.sockets import Address, arrived, send

#: Who has not said for so long that it is there is sent nothing any more.
_GONE_S = 10.0


class Settings(Struct, frozen=True):
    """A fake server, as it is set up."""

    bodies: tuple[str, ...]
    version: Version = Version(4, 1)
    up: Up = Up.Y
    rate_hz: float = 100.0
    latency_s: float = 0.0  #: from an exposure until its frame is sent
    stream: Stream = Stream()  #: a group, or to each client
    interface: str = "127.0.0.1"  #: through which a group is sent to
    script: tuple[Told, ...] = ()


class Server:
    """What a server does at each moment: it is asked and told things, and frames become due."""

    def __init__(self, settings: Settings, now_s: float) -> None:
        self.settings = settings
        self.capture = MotionCapture(settings.bodies, settings.version, settings.up)
        self.clients: dict[Address, float] = {}
        self._begun_s = self._due_s = now_s
        self._script = deque(sorted(settings.script, key=lambda one: one.at or 0.0))
        self._exposed: deque[float] = deque()

    def answer(self, data: bytes, client: Address, now_s: float) -> bytes | None:
        """The answer to a request; None: none."""
        if len(data) < 4 or self.capture.is_deaf:
            return None
        (number,) = struct.unpack_from("<H", data)
        match number:
            case Message.CONNECT:
                self.clients[client] = now_s
                return server_info(self.settings.version, self.settings.stream)
            case Message.KEEPALIVE:
                if client in self.clients:
                    self.clients[client] = now_s
                return None
            case Message.DISCONNECT:
                self.clients.pop(client, None)
                return None
            case Message.REQUEST_MODELDEF:
                return model_definitions(self.settings.version, self.capture.bodies)
            case _:
                return packet(Message.UNRECOGNIZED_REQUEST)

    def frames(self, now_s: float) -> list[bytes]:
        """The frames that are sent by now."""
        while self._script and (self._script[0].at or 0.0) <= now_s - self._begun_s:
            self.capture.hear(self._script.popleft())
        settings = self.settings
        if now_s >= self._due_s:
            self._exposed.append(now_s)
            self._due_s = max(self._due_s + 1 / settings.rate_hz, now_s)
        found = []
        while self._exposed and now_s >= self._exposed[0] + settings.latency_s:
            data = self.capture.frame(self._exposed.popleft(), now_s)
            if data is not None:
                found.append(data)
        gone = [one for one, at_s in self.clients.items() if now_s - at_s > _GONE_S]
        for client in gone:
            del self.clients[client]
        return found


def serve(
    commands: socket.socket,
    told: socket.socket,
    settings: Settings,
    goes_on: Callable[[], bool] = lambda: True,
) -> None:
    """Be a server: requests come to one socket, and what is true to another, as JSON."""
    server = Server(settings, time.monotonic())
    out = _sender(settings)
    for one in (commands, told):
        one.setblocking(False)
    while goes_on():
        select.select([commands, told], [], [], min(0.002, 0.5 / settings.rate_hz))
        now_s = time.monotonic()
        for data, _ in arrived(told):
            news = told_in(data)
            if news is not None:
                server.capture.hear(news)
        for data, client in arrived(commands):
            answer = server.answer(data, client, now_s)
            if answer is not None:
                send(commands, answer, client)
        for data in server.frames(now_s):
            stream = settings.stream
            if stream.group is not None:
                send(out, data, (stream.group, stream.port))
                continue
            for client in server.clients:
                send(commands, data, client)


def _sender(settings: Settings) -> socket.socket:
    """A socket that sends to the group."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    interface = socket.inet_aton(settings.interface)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    return made
