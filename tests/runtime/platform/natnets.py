"""Fake NatNet servers: in virtual time at sockets that a test holds, and as processes."""

from __future__ import annotations

import json
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.localisers import natnet_client
from koord.runtime.drivers.localisers.natnet import NatNetLocaliser, NatNetOptions
from koord.runtime.drivers.setpoints import Located
from koord.runtime.motion.world import World
from koord.testing.natnet.machine import Told
from koord.testing.natnet.serving import Server, Settings, serve
from tests.runtime.platform.autopilots import running

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))
STEP_S = 0.002


class HeldSocket:
    """An end of a network that is in a test."""

    def __init__(self, network: Network) -> None:
        self.network, self.inbox = network, deque[bytes]()
        self.member = False

    def setsockopt(self, *told: Any) -> None:
        self.member = self.member or told[1] == socket.IP_ADD_MEMBERSHIP

    def sendto(self, data: bytes, address: Any) -> None:
        self.network.requests.append((data, self))

    def recv(self, most: int) -> bytes:
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.popleft()

    def close(self) -> None:
        return


class Network:
    """A server, and the sockets of who listens to it, in virtual time."""

    def __init__(self, settings: Settings) -> None:
        self.now = 100.0
        self.server = Server(settings, self.now - 5000.0)  # its clock is another one
        self.server._begun_s = 100.0
        self.server._due_s = 100.0
        self.requests = deque[tuple[bytes, HeldSocket]]()
        self.sockets: list[HeldSocket] = []
        self.way_s = 0.0  #: how long packets are under way
        self._under_way: deque[tuple[float, bytes, HeldSocket]] = deque()

    def socket(self, address: Any, *, shared: bool = False) -> HeldSocket:
        made = HeldSocket(self)
        self.sockets.append(made)
        return made

    def hear(self, **told: Any) -> None:
        self.server.capture.hear(Told(**told))

    def pass_time(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += STEP_S
            while self.requests:
                data, sender = self.requests.popleft()
                client: Any = sender
                answer = self.server.answer(data, client, self.now)
                if answer is not None:
                    self._send(answer, sender)
            for frame in self.server.frames(self.now):
                if self.server.settings.stream.group is None:
                    for one in self.server.clients:
                        reached: Any = one
                        self._send(frame, reached)
                else:
                    for listener in self.sockets:
                        if listener.member:
                            self._send(frame, listener)
            while self._under_way and self._under_way[0][0] <= self.now + 1e-9:
                _, data, to = self._under_way.popleft()
                to.inbox.append(data)

    def _send(self, data: bytes, to: HeldSocket) -> None:
        self._under_way.append((self.now + self.way_s, data, to))


class Watched:
    """A localiser in a network, which is asked at each tick."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, settings: Settings, **options: Any) -> None:
        self.network = Network(settings)
        monkeypatch.setattr(natnet_client, "_socket", self.network.socket)
        monkeypatch.setattr(natnet_client, "_route", lambda address: "10.0.0.2")
        self.localiser = localiser("10.0.0.1", **options)
        self.localiser.open(self.network.now)

    def ticks(self, times: int = 1) -> Located | None:
        located = None
        for _ in range(times):
            self.network.pass_time(0.05)
            located = self.localiser.locate(self.network.now)
        return located


def localiser(server: str, name: str = "car", **options: Any) -> NatNetLocaliser:
    made = msgspec.convert({"server": server, **options}, NatNetOptions)
    return NatNetLocaliser(Device(2, Vehicle(name, "CAR"), WORLD, (0.0, 0.0, 0.0), options=made))


class Served:
    """A server in a process of its own."""

    def __init__(self, told: tuple[str, int], commands: tuple[str, int]) -> None:
        self.port = commands[1]
        self._told = told
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def tell(self, **told: Any) -> None:
        self._socket.sendto(json.dumps(told).encode(), self._told)

    def close(self) -> None:
        self._socket.close()


@contextmanager
def serving(settings: Settings) -> Iterator[Served]:
    """A server as a process, ended and waited for."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as commands,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as told,
    ):
        for one in (commands, told):
            one.bind(("127.0.0.1", 0))
        with running(serve, commands, told, settings):
            served = Served(told.getsockname(), commands.getsockname())
            try:
                yield served
            finally:
                served.close()
