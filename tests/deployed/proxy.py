"""A UDP proxy between robots: it records, loses, doubles, delays, cuts off, and lets in strangers.

Each process of a robot has a *seat*: its own address, and for each other robot a socket of the
proxy, which it takes for that robot. So the proxy knows of every datagram whose it is and whom it
is for, whatever is in it.
"""

from __future__ import annotations

import selectors
import socket
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from heapq import heappop, heappush
from itertools import cycle
from queue import SimpleQueue
from random import Random
from typing import NamedTuple

from msgspec import Struct

from koord.runtime.chaos.network import Faults

Address = tuple[str, int]

#: A network on which nothing happens.
CALM = Faults(least_delay_s=0.0, most_delay_s=0.0)

#: Larger than anything that robots send.
_LARGEST = 65_535

#: What is sent at once before there is a pause, so that buffers of a usual size hold it.
_BURST, _PAUSE_S = 50, 0.005


class Datagram(NamedTuple):
    """A datagram as a robot sent it; ``at_s`` as of ``time.monotonic``."""

    at_s: float
    seat: str
    sender: int
    to: int
    data: bytes


class Seat(Struct, eq=False):
    """A place for a process of robot ``pid``, and the sockets that stand for other robots there."""

    name: str
    pid: int
    address: Address
    others: dict[int, socket.socket]
    heard_at_s: float | None = None  #: when its process sent something for the first time
    outer: socket.socket | None = None  #: what its datagrams come from if it is a second one


class Proxy:
    """The network of a fleet. ``faults`` and ``cut`` may be changed at any time."""

    def __init__(self, robots: int, seed: int = 0) -> None:
        self.faults = CALM
        self.cut: frozenset[str] = frozenset()  #: the seats that hear nobody and nobody hears
        self.recording: list[Datagram] | None = None
        self.carried = 0
        self._robots = robots
        self._random = Random(seed)
        self._seats: dict[str, Seat] = {}
        self._selector = selectors.DefaultSelector()
        self._under_way: list[_UnderWay] = []
        self._number = 0
        self._new: SimpleQueue[Seat] = SimpleQueue()  #: seats that the thread does not know yet
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._carry_on, name="proxy", daemon=True)
        self._thread.start()

    # --- seats ----------------------------------------------------------------------------------

    def seat(self, name: str, pid: int, address: Address) -> Seat:
        """Make a seat, or find it. A second one of a robot has an outer address of its own."""
        found = self._seats.get(name)
        if found is not None:
            return found
        others = {other: _opened() for other in range(self._robots) if other != pid}
        made = Seat(name, pid, address, others)
        if any(seat.pid == pid for seat in self._seats.values()):
            made.outer = _opened()
        self._seats[name] = made
        self._new.put(made)
        return made

    # --- what tests do --------------------------------------------------------------------------

    def record(self) -> list[Datagram]:
        """Begin a recording of all that is sent, and return it; it grows."""
        made: list[Datagram] = []
        self.recording = made
        return made

    def inject(self, to: int, data: bytes, sender: int | None = None) -> None:
        """Send a datagram to a robot as if it came from another one's address."""
        for seat in self._of(to):
            source = seat.others.get(to if sender is None else sender)
            source = source or next(iter(seat.others.values()))
            with suppress(OSError):
                source.sendto(data, seat.address)

    def replay(self, recorded: Iterable[Datagram]) -> int:
        """Send recorded datagrams again, as :meth:`flood` does; return how many."""
        return self._paced((one.to, one.data, one.sender) for one in recorded)

    def flood(self, to: Sequence[int], datagrams: Iterable[bytes]) -> int:
        """Send datagrams to robots in turn, as fast as buffers hold them; return how many."""
        return self._paced((pid, data, None) for pid, data in zip(cycle(to), datagrams))

    def _paced(self, injected: Iterable[tuple[int, bytes, int | None]]) -> int:
        sent = 0
        for sent, one in enumerate(injected, 1):
            self.inject(*one)
            if sent % _BURST == 0:
                time.sleep(_PAUSE_S)
        return sent

    def close(self) -> None:
        """End the network."""
        self._ended.set()
        self._thread.join()
        for seat in self._seats.values():
            for one in (*seat.others.values(), *([seat.outer] if seat.outer else ())):
                one.close()
        self._selector.close()

    # --- the proxy's thread ---------------------------------------------------------------------

    def _carry_on(self) -> None:
        while not self._ended.is_set():
            now = time.monotonic()
            while self._under_way and self._under_way[0].at_s <= now:
                self._deliver(heappop(self._under_way).datagram)
            wait_s = 0.02
            if self._under_way:
                wait_s = min(wait_s, max(0.0, self._under_way[0].at_s - now))
            while not self._new.empty():
                made = self._new.get()
                for other, one in made.others.items():
                    self._selector.register(one, selectors.EVENT_READ, (made, other))
            for key, _ in self._selector.select(wait_s):
                seat, to = key.data
                assert isinstance(key.fileobj, socket.socket)
                self._drain(key.fileobj, seat, to)

    def _drain(self, source: socket.socket, seat: Seat, to: int) -> None:
        for _ in range(_BURST):
            try:
                data, address = source.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError:
                continue  # a robot is not there: an ICMP answer to something sent before
            if address == seat.address:
                self._take(Datagram(time.monotonic(), seat.name, seat.pid, to, data), seat)

    def _take(self, datagram: Datagram, seat: Seat) -> None:
        """Decide the fate of a datagram."""
        if seat.heard_at_s is None:
            seat.heard_at_s = datagram.at_s
        if self.recording is not None:
            self.recording.append(datagram)
        if seat.name in self.cut:
            return
        faults, draw = self.faults, self._random
        for _ in range(1 + (draw.random() < faults.duplication)):
            if draw.random() < faults.loss:
                continue
            delay_s = draw.uniform(faults.least_delay_s, faults.most_delay_s)
            if delay_s <= 0.0:
                self._deliver(datagram)
            else:
                self._number += 1
                due = _UnderWay(datagram.at_s + delay_s, self._number, datagram)
                heappush(self._under_way, due)

    def _deliver(self, datagram: Datagram) -> None:
        outer = self._seats[datagram.seat].outer
        for seat in self._of(datagram.to):
            if seat.name not in self.cut:
                source = seat.others[datagram.sender] if outer is None else outer
                with suppress(OSError):
                    source.sendto(datagram.data, seat.address)
                    self.carried += 1

    def _of(self, pid: int) -> list[Seat]:
        return [seat for seat in list(self._seats.values()) if seat.pid == pid]


class _UnderWay(NamedTuple):
    """A datagram that arrives later; ``number`` keeps the order of equal times."""

    at_s: float
    number: int
    datagram: Datagram


def _opened() -> socket.socket:
    """A socket on a port that is free."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    made.bind(("127.0.0.1", 0))
    return made
