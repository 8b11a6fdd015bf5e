"""A network within one process."""

from __future__ import annotations

from collections import deque

from msgspec import Struct

from koord.runtime.transports.transport import Visit


class Hub:
    """All inboxes of a run."""

    def __init__(self, robots: int) -> None:
        self.robots = robots
        self.sent = 0  #: datagrams, one to all counted once
        self.inboxes: list[deque[bytes]] = [deque() for _ in range(self.robots)]
        self.visits: list[deque[Visit]] = [deque() for _ in range(self.robots)]  #: of people

    def transport(self, pid: int) -> InProcess:
        """A robot's end."""
        return InProcess(self, pid)


class InProcess(Struct):
    """One robot's end. Waiting is pointless: nobody else moves meanwhile."""

    hub: Hub
    pid: int
    closed: bool = False
    dropped: int = 0

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

    def visits(self) -> list[Visit]:
        visits = self.hub.visits[self.pid]
        came = [] if self.closed else list(visits)
        visits.clear()
        return came

    def close(self) -> None:
        self.closed = True
