"""The Zenoh transport: a routed network, for fleets across sites. Needs ``koord[zenoh]``."""

from __future__ import annotations

import json
from collections import deque
from functools import partial
from queue import Empty, Full, Queue
from threading import Lock
from typing import Any

from koord.runtime.transports.transport import TransportError, Visit
from koord.runtime.wire.frames import LONGEST

#: Handed on at once, as in ``udp``.
_BATCH = 256

#: Wakes who waits for datagrams, and is none.
_BELL = b""

#: So many orders of people wait; of more the oldest are lost.
_MOST_VISITS = 256

#: What people say, whatever runs: to a robot, by a caller; and the answers to that caller. (O-KEY)
ORDERS = "koord/orders"

#: So many datagrams may wait, which are less than 6 MB: about what kernels keep of UDP.
MOST_WAITING = 4096


class Inbox:
    """What has arrived and was not taken yet: threads of zenoh's fill it, and may flood it."""

    def __init__(self, most: int = MOST_WAITING) -> None:
        self.dropped = 0  #: those for which there was no room
        self._waiting: Queue[bytes] = Queue(most)
        self._lock = Lock()

    def put(self, datagram: bytes) -> None:
        """Keep a datagram, if there is room; of one that is too long only as much as shows it."""
        try:
            self._waiting.put_nowait(datagram[: LONGEST + 1])
        except Full:
            with self._lock:
                self.dropped += 1

    def take(self, timeout_s: float) -> list[bytes]:
        """Return what has arrived; if nothing has, wait at most ``timeout_s`` seconds."""
        came: list[bytes] = []
        try:
            if timeout_s > 0:
                came.append(self._waiting.get(timeout=timeout_s))
            while len(came) < _BATCH:
                came.append(self._waiting.get_nowait())
        except Empty:
            pass
        return [datagram for datagram in came if datagram != _BELL]


def zenoh_session(connect: tuple[str, ...], listen: tuple[str, ...]) -> Any:
    """Open a session of zenoh's. Raises TransportError."""
    try:
        import zenoh
    except ImportError as error:
        raise TransportError(
            "the zenoh transport is not installed", "pip install 'koord[zenoh]'"
        ) from error
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    for name, endpoints in (("connect", connect), ("listen", listen)):
        if endpoints:
            config.insert_json5(f"{name}/endpoints", json.dumps(list(endpoints)))
    if connect or listen:
        config.insert_json5("scouting/multicast/enabled", "false")
    zenoh.init_log_from_env_or("error")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise TransportError(f"zenoh cannot be started: {error}") from error


class Routed:
    """A zenoh session of one robot. ``connect`` and ``listen`` are endpoints.

    Without any, robots find each other by multicast on the local network.
    """

    def __init__(
        self,
        run: str,
        pid: int,
        robots: int,
        connect: tuple[str, ...] = (),
        listen: tuple[str, ...] = (),
    ) -> None:
        """Open a session. Raises TransportError."""
        self._inbox = Inbox()
        self._session = zenoh_session(connect, listen)
        self._closed = False
        self._pid = pid
        root = f"koord/{run.encode().hex()}"
        self._to = [f"{root}/to/{robot}" for robot in range(robots)]
        self._all = f"{root}/all/{pid}"
        self._mine = f"{root}/all/*"
        self._session.declare_subscriber(self._to[pid], self._came)
        self._session.declare_subscriber(self._mine, self._came)
        self._visits: deque[Visit] = deque(maxlen=_MOST_VISITS)
        self._session.declare_subscriber(f"{ORDERS}/to/{pid}/*", self._visited)

    def _came(self, sample: Any) -> None:
        """Receive a datagram, in a thread of zenoh's."""
        if str(sample.key_expr) != self._all:
            self._inbox.put(sample.payload.to_bytes())

    def _visited(self, sample: Any) -> None:
        """Receive an order, in a thread of zenoh's. Its key ends with the name of the caller."""
        caller = str(sample.key_expr).rpartition("/")[2]
        datagram = sample.payload.to_bytes()[: LONGEST + 1]
        self._visits.append(Visit(datagram, partial(self._answer, f"{ORDERS}/from/{caller}")))
        self._inbox.put(_BELL)

    def _answer(self, key: str, datagram: bytes) -> None:
        if not self._closed:
            self._session.put(key, datagram)

    def visits(self) -> list[Visit]:
        came: list[Visit] = []
        while self._visits:
            came.append(self._visits.popleft())
        return came

    def send(self, to: int, datagram: bytes) -> None:
        if not self._closed:
            self._session.put(self._to[to], datagram)

    def tell(self, datagram: bytes) -> None:
        if not self._closed:
            self._session.put(self._all, datagram)

    def receive(self, timeout_s: float) -> list[bytes]:
        return self._inbox.take(timeout_s)

    @property
    def dropped(self) -> int:
        return self._inbox.dropped

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._session.close()
