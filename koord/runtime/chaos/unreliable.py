"""A real network with injected faults: arriving datagrams are lost, doubled and delayed."""

from __future__ import annotations

import time
from heapq import heappop, heappush
from random import Random

from koord.runtime.chaos.network import Faults
from koord.runtime.node import Clock
from koord.runtime.transports.transport import Transport, Visit


class Unreliable:
    """One robot's end of a network with faults; crashes are injected elsewhere."""

    def __init__(
        self, inner: Transport, faults: Faults, seed: int, clock: Clock = time.monotonic
    ) -> None:
        self._inner = inner
        self._faults = faults
        self._random = Random(seed)
        self._clock = clock
        self._under_way: list[tuple[float, int, bytes]] = []
        self._number = 0
        self._deaf_until = 0.0
        self._looked_at = clock()

    def send(self, to: int, datagram: bytes) -> None:
        self._inner.send(to, datagram)

    def tell(self, datagram: bytes) -> None:
        self._inner.tell(datagram)

    def receive(self, timeout_s: float) -> list[bytes]:
        """Return the datagrams that are due; wait at most until the next one is."""
        now = self._clock()
        if self._under_way:
            timeout_s = min(timeout_s, max(0.0, self._under_way[0][0] - now))
        for datagram in self._inner.receive(timeout_s):
            self._take(datagram)
        now = self._clock()
        came: list[bytes] = []
        while self._under_way and self._under_way[0][0] <= now:
            came.append(heappop(self._under_way)[2])
        return came

    def _take(self, datagram: bytes) -> None:
        """Draw the fate of a datagram."""
        faults, draw, now = self._faults, self._random, self._clock()
        cut = draw.random() < faults.cuts_per_s * (now - self._looked_at)
        self._looked_at = now
        if cut:
            self._deaf_until = now + faults.cut_s
        for _ in range(1 + (draw.random() < faults.duplication)):
            if now < self._deaf_until or draw.random() < faults.loss:
                continue
            self._number += 1
            delay = draw.uniform(faults.least_delay_s, faults.most_delay_s)
            heappush(self._under_way, (now + delay, self._number, datagram))

    def visits(self) -> list[Visit]:
        """Return the visits that are not lost: what people say is not delayed."""
        came = self._inner.visits()
        return [one for one in came if self._random.random() >= self._faults.loss]

    @property
    def dropped(self) -> int:
        return self._inner.dropped

    def close(self) -> None:
        self._inner.close()
