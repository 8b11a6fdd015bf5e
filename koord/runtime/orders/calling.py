"""A caller's side of orders: what is said to whom, until all have answered. (O-ANSWER)

Pure but for the id that it draws: the time is given, and so is what was heard.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.runtime.orders.messages import (
    ID_BYTES,
    STOPPING,
    Outcome,
    Reply,
    Request,
    Stamp,
    Wanted,
)

#: How often it is said again, and of more robots than this each less often.
EVERY_S = 0.05
_MANY = 50

#: An answer ends the saying of what is said once.
_FINAL = frozenset({Outcome.DONE, Outcome.REFUSED})


class Called(Struct):
    """What is known of one robot."""

    stamp: Stamp | None = None
    reply: Reply | None = None  #: the last one
    heard_at_s: float | None = None
    is_over: bool = False  #: it has answered what it was asked for

    @property
    def has_done_it(self) -> bool:
        return self.reply is not None and self.reply.outcome in (Outcome.DONE, Outcome.HEARD)


class Call:
    """One request to some robots, repeated until each has answered; heartbeats for ever."""

    def __init__(self, robots: Iterable[int], wanted: Wanted) -> None:
        self.wanted = wanted
        self.robots = {pid: Called() for pid in robots}
        self._id = secrets.token_bytes(ID_BYTES)
        self._every_s = EVERY_S * max(1.0, len(self.robots) / _MANY)
        self._due_s = -float("inf")

    @property
    def is_over(self) -> bool:
        """True if all have answered."""
        return all(one.is_over for one in self.robots.values())

    def due_in_s(self, now_s: float) -> float:
        """How long there is nothing to say, in seconds."""
        return max(0.0, self._due_s - now_s)

    def requests(self, now_s: float, wall_s: float) -> Iterator[Request]:
        """Yield what is to be said now. ``wall_s`` is the time since 1970."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + self._every_s
        for pid, one in self.robots.items():
            if not one.is_over:
                yield self._request(pid, one, wall_s)

    def _request(self, pid: int, one: Called, wall_s: float) -> Request:
        # Who is to move needs a stamp; who is to stop does not wait for one. (O-START) (O-STOP)
        needs = self.wanted not in STOPPING
        wanted = Wanted.ASK if needs and one.stamp is None else self.wanted
        return Request(self._id, pid, wanted, wall_s, one.stamp)

    def hear(self, reply: Reply, now_s: float, wall_s: float) -> Request | None:
        """Take an answer in; return what is to be said to that robot at once."""
        one = self.robots.get(reply.robot)
        if one is None or reply.id != self._id or one.is_over:
            return None
        had = one.stamp
        one.stamp, one.reply, one.heard_at_s = reply.stamp, reply, now_s
        if self.wanted is Wanted.ALIVE:
            return None
        asked = self.wanted is Wanted.ASK
        one.is_over = reply.outcome in _FINAL or (asked and reply.outcome is Outcome.HEARD)
        is_new = had is None or had.boot != reply.stamp.boot
        return self._request(reply.robot, one, wall_s) if is_new and not one.is_over else None
