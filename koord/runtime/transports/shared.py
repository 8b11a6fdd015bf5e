"""UDP of several robots in one process: one poll and one drain for all of their sockets.

Each robot has a socket with an address of its own, as in a process of its own. What is sent to all
of them arrives once in a process, and is handed to each of its robots. Nothing waits in an end:
whoever has one is to be asked again when :meth:`SharedUdp.wait` says so.
"""

from __future__ import annotations

import select
import socket
from collections.abc import Sequence

from koord.runtime.transports.transport import TransportError
from koord.runtime.transports.udp import (
    Mailbox,
    Pace,
    Plan,
    joined,
    most_waiting,
    overflow,
)
from koord.runtime.wire.codec import Channel, Opened
from koord.runtime.wire.frames import LONGEST


class SharedUdp:
    """The sockets of several robots. ``ends`` are their transports, by pid."""

    def __init__(self, plan: Plan, pids: Sequence[int]) -> None:
        """Open the sockets. Raises TransportError."""
        self.plan = plan
        self.ends: dict[int, SharedEnd] = {}
        self._by_number: dict[int, SharedEnd] = {}
        self._opened: dict[tuple[bytes, bool], Opened] = {}
        self._poll = select.poll()
        self._all: socket.socket | None = None
        self._all_number = -1
        self._pace = Pace()  #: of what is sent to all
        try:
            for pid in pids:
                end = self.ends[pid] = SharedEnd(self, pid)
                self._by_number[end.number] = end
                self._poll.register(end.number, select.POLLIN)
            if plan.shared is not None:
                own = [end.socket for end in self.ends.values()]
                self._all = joined(plan, plan.shared, own)
                self._all_number = self._all.fileno()
                self._poll.register(self._all_number, select.POLLIN)
        except TransportError:
            self.close()
            raise

    def wait(self, timeout_s: float) -> None:
        """Wait for datagrams at most so long, and hand out what there is."""
        try:
            ready = self._poll.poll(timeout_s * 1000)
        except InterruptedError:
            return
        for number, _ in ready:
            if number == self._all_number:
                self._drain_all()
            else:
                end = self._by_number.get(number)
                if end is not None:
                    end.drain(end.socket)

    def opened(self, channel: Channel) -> Opened:
        """What robots here have opened of datagrams with a channel's key."""
        key = channel.key, channel.encrypts
        if key not in self._opened:
            self._opened[key] = Opened(channel)
        return self._opened[key]

    def _drain_all(self) -> None:
        one = self._all
        assert one is not None
        ends = tuple(self._by_number.values())
        pace = self._pace
        for _ in range(most_waiting(self.plan) if pace.takes_all() else 1):
            try:
                datagram, source = one.recvfrom(LONGEST + 1)
            except BlockingIOError:
                return
            except OSError:
                continue
            pace.came += 1
            for end in ends:
                end.take(datagram, source)

    @property
    def dropped(self) -> int:
        """How many datagrams to all have found no room."""
        return 0 if self._all is None else overflow(self._all)

    def leave(self, end: SharedEnd) -> None:
        """Close one robot's socket; the last one closes what is shared."""
        if self._by_number.pop(end.number, None) is not None:
            self._poll.unregister(end.number)
            end.socket.close()
        if not self._by_number:
            self.close()

    def close(self) -> None:
        """Close all sockets. May be called twice."""
        for end in self.ends.values():
            end.socket.close()
        self._by_number.clear()
        if self._all is not None:
            self._all.close()
            self._all = None


class SharedEnd(Mailbox):
    """The transport of one robot among several in a process. Receiving never waits.

    ``wanted_s`` is how long the robot would have waited for datagrams when it last received.
    """

    def __init__(self, shared: SharedUdp, pid: int) -> None:
        super().__init__(shared.plan, pid)
        self.wanted_s = 0.0
        self.number = self.socket.fileno()
        self._shared = shared

    def opened(self, channel: Channel) -> Opened:
        """What robots of this process have opened of datagrams with a channel's key."""
        return self._shared.opened(channel)

    @property
    def has_mail(self) -> bool:
        """True if something waits to be received."""
        return bool(self._waiting or self._visits)

    def receive(self, timeout_s: float) -> list[bytes]:
        came = self._handed_on()
        # What is done about these may have timers that are due sooner.
        self.wanted_s = 0.0 if came else max(0.0, timeout_s)
        return came

    @property
    def dropped(self) -> int:
        if self._is_closed:
            return self._dropped
        return self._dropped + overflow(self.socket) + self._shared.dropped

    def close(self) -> None:
        if not self._is_closed:
            self._dropped, self._is_closed = self.dropped, True
            self._shared.leave(self)
