"""The networks by which a caller reaches robots: it is no robot, and has no address of theirs."""

from __future__ import annotations

import secrets
import select
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Protocol, assert_never

from msgspec import Struct

from koord.runtime.transports.routed import ORDERS, Inbox, zenoh_session
from koord.runtime.transports.udp import Address
from koord.runtime.wire.frames import LONGEST, is_order

#: Datagrams handed on at once.
_BATCH = 256


class Addresses(Struct, frozen=True, tag="udp"):
    """Robots by their addresses."""

    robots: tuple[tuple[int, Address], ...]


class Routes(Struct, frozen=True, tag="zenoh"):
    """Robots on a routed network."""

    robots: tuple[int, ...]
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()


Reach = Addresses | Routes


class Line(Protocol):
    """A caller's end of a network. Sending never fails: what cannot be sent is lost."""

    def send(self, pid: int, datagram: bytes) -> None:
        """Send to a robot."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """Return what has arrived; if nothing has, wait at most so long."""

    def close(self) -> None:
        """Leave the network."""


class UdpLine:
    """A line over UDP, to each robot by itself, however robots reach each other."""

    def __init__(self, robots: Mapping[int, Address]) -> None:
        self._robots = dict(robots)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, pid: int, datagram: bytes) -> None:
        with suppress(OSError):
            self._socket.sendto(datagram, self._robots[pid])

    def receive(self, timeout_s: float) -> list[bytes]:
        with suppress(InterruptedError):
            select.select([self._socket], [], [], max(0.0, timeout_s))
        came: list[bytes] = []
        while len(came) < _BATCH:
            try:
                datagram = self._socket.recv(LONGEST + 1)
            except BlockingIOError:
                break
            except OSError:
                continue  # an ICMP answer to something sent before
            if is_order(datagram):
                came.append(datagram)
        return came

    def close(self) -> None:
        self._socket.close()


class RoutedLine:
    """A line over zenoh."""

    def __init__(self, routes: Routes) -> None:
        """Open a session. Raises TransportError."""
        name = secrets.token_hex(8)
        self._inbox = Inbox()
        self._session: Any = zenoh_session(routes.connect, routes.listen)
        self._session.declare_subscriber(f"{ORDERS}/from/{name}", self._came)
        self._name = name

    def _came(self, sample: Any) -> None:
        self._inbox.put(sample.payload.to_bytes())

    def send(self, pid: int, datagram: bytes) -> None:
        self._session.put(f"{ORDERS}/to/{pid}/{self._name}", datagram)

    def receive(self, timeout_s: float) -> list[bytes]:
        return self._inbox.take(timeout_s)

    def close(self) -> None:
        self._session.close()


def line_to(reach: Reach) -> Line:
    """Open a line to robots. Raises TransportError."""
    match reach:
        case Addresses(robots=robots):
            return UdpLine(dict(robots))
        case Routes():
            return RoutedLine(reach)
        case _:
            assert_never(reach)


def robots_of(reach: Reach) -> tuple[int, ...]:
    """The robots that are reached."""
    match reach:
        case Addresses(robots=robots):
            return tuple(pid for pid, _ in robots)
        case Routes(robots=pids):
            return pids
        case _:
            assert_never(reach)
