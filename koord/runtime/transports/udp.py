"""The UDP transport: unicast to a list of addresses, multicast or broadcast."""

from __future__ import annotations

import select
import socket
import struct
import sys
from collections import deque
from collections.abc import Sequence
from enum import Enum
from functools import partial

from msgspec import Struct

from koord.runtime.transports.transport import TransportError, Visit
from koord.runtime.wire.frames import LONGEST, is_order

Address = tuple[str, int]

#: What the kernel may keep for a robot that is busy. Some systems give less.
_BUFFER_BYTES = 4 << 20

#: Datagrams handed on at once, so that timers get their turn in a flood. Whatever has come by then
#: is taken from the kernel first: by default it keeps only some hundred.
BATCH = 32

#: A socket to which datagrams come one by one is asked so many times for one of them, and then for
#: whatever there is: to ask once more each time would be half of what receiving takes.
_SINGLY = 8

#: So many datagrams wait in this process for each robot of the fleet, and for a small fleet.
_WAITING_PER_ROBOT, LEAST_WAITING = 4, 512

#: So many orders of people wait; of more the oldest are lost, as on a network.
MOST_VISITS = 256


class Delivery(Enum):
    """The ways in which a datagram reaches all robots."""

    EACH = "unicast"  #: once for each robot
    GROUP = "multicast"  #: once, to a group that all have joined
    SUBNET = "broadcast"  #: once, to everyone on the network


class Plan(Struct, frozen=True):
    """The addresses of robots. ``shared`` is the group's or broadcast address, if there is one.

    ``interface`` is the address of the network card for multicast.
    """

    addresses: tuple[Address, ...]
    reach: Delivery = Delivery.EACH
    shared: Address | None = None
    interface: str = "0.0.0.0"


def on_this_machine(robots: int, port: int, *, group: str | None = "239.255.75.1") -> Plan:
    """A plan with one port per robot on loopback; without a group each is sent to by itself."""
    addresses = tuple(("127.0.0.1", port + 1 + pid) for pid in range(robots))
    if group is None:
        return Plan(addresses)
    return Plan(addresses, Delivery.GROUP, (group, port), "127.0.0.1")


def most_waiting(plan: Plan) -> int:
    """How many datagrams wait in a process for a robot of a plan."""
    return max(LEAST_WAITING, _WAITING_PER_ROBOT * len(plan.addresses))


class Pace:
    """How datagrams come to a socket: one by one, or several at once.

    ``came`` is to count those that came since :meth:`takes_all` was asked last.
    """

    __slots__ = ("_is_all", "_left", "came")

    def __init__(self) -> None:
        self.came = 0
        self._is_all = False  #: all that had come was taken last
        self._left = 0  #: so many times one is taken yet, before all are again

    def takes_all(self) -> bool:
        """Return whether to take now all that has come, or else one datagram."""
        if self._left:
            self._left -= 1
            self._is_all = False
            return False
        if self._is_all and self.came <= 1:
            self._left, self._is_all = _SINGLY - 1, False
            return False
        self.came, self._is_all = 0, True
        return True


class Mailbox:
    """The socket of one robot, and the datagrams that wait for it in this process."""

    def __init__(self, plan: Plan, pid: int) -> None:
        """Open the socket. Raises TransportError."""
        self.sent = 0
        self.socket = bound(plan.addresses[pid])
        self._plan, self._own = plan, plan.addresses[pid]
        self._others = tuple(a for i, a in enumerate(plan.addresses) if i != pid)
        self._most = most_waiting(plan)
        self._waiting: deque[bytes] = deque()
        self._visits: deque[Visit] = deque(maxlen=MOST_VISITS)
        self._paces: dict[socket.socket, Pace] = {}
        self._dropped = 0  #: here, or by the kernel when the socket was closed
        self._is_closed = False

    def drain(self, one: socket.socket) -> None:
        """Take what has come to a socket, as far as there is room.

        Where datagrams come one by one, the rest may be left to the next call.
        """
        pace = self._paces.get(one)
        if pace is None:
            pace = self._paces[one] = Pace()
        room = self._most - len(self._waiting)
        for _ in range(room if pace.takes_all() else min(room, 1)):
            try:
                datagram, source = one.recvfrom(LONGEST + 1)
            except BlockingIOError:
                break
            except OSError:
                continue  # an ICMP answer to something sent before
            pace.came += 1
            self.take(datagram, source)

    def take(self, datagram: bytes, source: Address) -> None:
        """Take a datagram that has come, if it is not this robot's own."""
        if is_order(datagram):
            self._visits.append(Visit(datagram, partial(self._answer, source)))
        elif source != self._own:
            if len(self._waiting) < self._most:
                self._waiting.append(datagram)
            else:
                self._dropped += 1

    def send(self, to: int, datagram: bytes) -> None:
        self._send(self._plan.addresses[to], datagram)

    def tell(self, datagram: bytes) -> None:
        if self._plan.shared is not None:
            self._send(self._plan.shared, datagram)
            return
        for address in self._others:
            self._send(address, datagram)

    def _send(self, address: Address, datagram: bytes) -> None:
        try:
            self.socket.sendto(datagram, address)
        except OSError:
            return  # full buffers, no route, a port that is closed: to the protocol it is all loss
        self.sent += 1

    def _answer(self, address: Address, datagram: bytes) -> None:
        if not self._is_closed:
            self._send(address, datagram)

    def _handed_on(self) -> list[bytes]:
        """Some of the datagrams that wait, which do so no longer."""
        waiting = self._waiting
        if len(waiting) > BATCH:
            return [waiting.popleft() for _ in range(BATCH)]
        came = list(waiting)
        waiting.clear()
        return came

    def visits(self) -> list[Visit]:
        if not self._visits:
            return []
        came = list(self._visits)
        self._visits.clear()
        return came


class Udp(Mailbox):
    """The UDP transport of one robot."""

    def __init__(self, plan: Plan, pid: int) -> None:
        """Open the sockets. Raises TransportError."""
        super().__init__(plan, pid)
        self._sockets = [self.socket]
        if plan.shared is not None:
            try:
                self._sockets.append(joined(plan, plan.shared, [self.socket]))
            except TransportError:
                self.close()
                raise
        self._poll = select.poll()
        for one in self._sockets:
            self._poll.register(one, select.POLLIN)
        self._by_number = {one.fileno(): one for one in self._sockets}

    def receive(self, timeout_s: float) -> list[bytes]:
        try:
            ready = self._poll.poll(0.0 if self._waiting else max(0.0, timeout_s) * 1000)
        except InterruptedError:
            ready = []
        for number, _ in ready:
            if not self._is_closed:
                self.drain(self._by_number[number])
        return self._handed_on()

    @property
    def dropped(self) -> int:
        if self._is_closed:
            return self._dropped
        return self._dropped + sum(map(overflow, self._sockets))

    def close(self) -> None:
        self._dropped, self._is_closed = self.dropped, True
        for one in self._sockets:
            one.close()


#: Linux' ``SO_MEMINFO``, of which :mod:`socket` has no name: nine numbers of 32 bits about a
#: socket's buffers, the last of which is how many datagrams found no room (socket(7)).
_SO_MEMINFO, _MEMINFO = 55, struct.Struct("=9I")


def overflow(one: socket.socket) -> int:
    """How many datagrams the kernel has dropped for want of room; 0 where it does not say."""
    if not sys.platform.startswith("linux"):
        return 0
    try:
        return int(
            _MEMINFO.unpack(one.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))[-1]
        )
    except (OSError, struct.error):  # kernels before 4.12
        return 0


def joined(plan: Plan, shared: Address, own: Sequence[socket.socket]) -> socket.socket:
    """Open a socket that receives what is sent to all, and enable ``own`` ones to send that.

    Raises TransportError.
    """
    try:
        if plan.reach is Delivery.GROUP:
            card = socket.inet_aton(plan.interface)
            for one in own:
                one.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, card)
                one.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
                one.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
            common = bound(shared, several=True)
            membership = struct.pack("=4s4s", socket.inet_aton(shared[0]), card)
            common.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            return common
        for one in own:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        return bound(shared, several=True)
    except OSError as error:
        raise TransportError(
            f"{plan.reach.value} on {shared[0]}:{shared[1]} cannot be used: {error}",
            "another address or network card, or unicast, may do",
        ) from error


def bound(address: Address, *, several: bool = False) -> socket.socket:
    """Bind a socket to an address, shared with others if ``several``. Raises TransportError."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        if several:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
    except OSError as error:
        made.close()
        raise TransportError(
            f"{address[0]}:{address[1]} cannot be listened on: {error.strerror}",
            "another run may be using it, or it is no address of this machine",
        ) from error
    return made
