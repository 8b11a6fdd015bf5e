"""The Zenoh transport: a routed network, for fleets across sites. Needs ``koord[zenoh]``."""

from __future__ import annotations

import json
from queue import Empty, Full, Queue
from threading import Lock
from typing import Any

from koord.runtime.transports.transport import TransportError
from koord.runtime.wire.frames import LONGEST

#: Handed on at once, as in ``udp``.
_BATCH = 256

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
        return came


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
        try:
            import zenoh
        except ImportError as error:
            raise TransportError(
                "the zenoh transport is not installed", "pip install 'koord[zenoh]'"
            ) from error
        self._inbox = Inbox()
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        for name, endpoints in (("connect", connect), ("listen", listen)):
            if endpoints:
                config.insert_json5(f"{name}/endpoints", json.dumps(list(endpoints)))
        if connect or listen:
            config.insert_json5("scouting/multicast/enabled", "false")
        zenoh.init_log_from_env_or("error")
        try:
            self._session: Any = zenoh.open(config)
        except zenoh.ZError as error:
            raise TransportError(f"zenoh cannot be started: {error}") from error
        self._closed = False
        self._pid = pid
        root = f"koord/{run.encode().hex()}"
        self._to = [f"{root}/to/{robot}" for robot in range(robots)]
        self._all = f"{root}/all/{pid}"
        self._mine = f"{root}/all/*"
        self._session.declare_subscriber(self._to[pid], self._came)
        self._session.declare_subscriber(self._mine, self._came)

    def _came(self, sample: Any) -> None:
        """Receive a datagram, in a thread of zenoh's."""
        if str(sample.key_expr) != self._all:
            self._inbox.put(sample.payload.to_bytes())

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
