"""The interface of transports, and a network within one process."""

from __future__ import annotations

from collections import deque
from typing import Protocol

from msgspec import Struct


class Transport(Protocol):
    """A transport: it carries datagrams of up to 1,400 bytes, or loses them.

    Sending never waits and never fails: what cannot be sent is lost.
    """

    def send(self, to: int, datagram: bytes) -> None:
        """Send to one robot."""

    def tell(self, datagram: bytes) -> None:
        """Send to all other robots."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """Return datagrams that have arrived; if there are none, wait at most ``timeout_s``."""

    def close(self) -> None:
        """Close the transport. May be called twice."""


class TransportError(Exception):
    """Raised for a network that cannot be used, with a cure."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


# --- within one process ---------------------------------------------------------------------------


class Hub:
    """A network within one process: the inboxes of all robots of a run."""

    def __init__(self, robots: int) -> None:
        self.robots = robots
        self.sent = 0  #: datagrams, one to all counted once
        self.inboxes: list[deque[bytes]] = [deque() for _ in range(self.robots)]

    def transport(self, pid: int) -> InProcess:
        """Make one robot's transport."""
        return InProcess(self, pid)


class InProcess(Struct):
    """One robot's transport on a hub. It never waits, as nobody else moves meanwhile."""

    hub: Hub
    pid: int
    closed: bool = False

    def send(self, to: int, datagram: bytes) -> None:
        self.hub.sent += 1
        if not self.closed and to != self.pid:
            self.hub.inboxes[to].append(datagram)

    def tell(self, datagram: bytes) -> None:
        self.hub.sent += 1
        if self.closed:
            return
        for robot, inbox in enumerate(self.hub.inboxes):
            if robot != self.pid:
                inbox.append(datagram)

    def receive(self, timeout_s: float) -> list[bytes]:
        inbox = self.hub.inboxes[self.pid]
        if self.closed:
            return []
        came = list(inbox)
        inbox.clear()
        return came

    def close(self) -> None:
        self.closed = True
