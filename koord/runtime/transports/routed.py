"""The Zenoh transport: a routed network, for fleets across sites. Needs ``koord[zenoh]``."""

from __future__ import annotations

import json
from queue import Empty, SimpleQueue
from typing import Any

from koord.runtime.transports.transport import TransportError

#: Handed on at once, as in ``udp``.
_BATCH = 256


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
        self._inbox: SimpleQueue[bytes] = SimpleQueue()
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
        came: list[bytes] = []
        try:
            if timeout_s > 0:
                came.append(self._inbox.get(timeout=timeout_s))
            while len(came) < _BATCH:
                came.append(self._inbox.get_nowait())
        except Empty:
            pass
        return came

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._session.close()
