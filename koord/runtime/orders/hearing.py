"""A robot's side of orders: which of them are authentic, fresh and new, and are obeyed. (O-KEY)

Nothing here knows of sockets or of what time it is: both clocks are given.
"""

from __future__ import annotations

import math
import secrets
from collections import OrderedDict
from collections.abc import Callable
from typing import assert_never

from msgspec import Struct

from koord.runtime.guardian.events import Order
from koord.runtime.orders.messages import (
    BOOT_BYTES,
    STOPPING,
    Outcome,
    Reply,
    Request,
    Stamp,
    Wanted,
)
from koord.runtime.wire.codec import Channel, DatagramWriter, OrderReader
from koord.runtime.wire.frames import MOST_STARTS, Drop, Drops

#: A stamp that is older does not count any more. (O-STAMP)
FRESH_S = 10.0

#: What stops a robot may have been said so long ago, by the clocks of the wall. (O-STOP)
SAID_S = 60.0

#: So many orders are known again. More are not obeyed within the time in which they would count.
_MOST_KNOWN = 4096

#: Longer texts are cut: an answer is one datagram.
_LONGEST_TEXT = 400

_ORDERS = {
    Wanted.ESTOP: Order.ESTOP,
    Wanted.STOP: Order.STOP,
    Wanted.LAND: Order.LAND,
    Wanted.START: Order.START,
    Wanted.RESET: Order.RESET,
}


class Obeyed(Struct, frozen=True):
    """What a platform has made of an order: why it was refused, if it was."""

    refused: str | None = None


class Body(Struct, frozen=True):
    """The robot that is told orders."""

    obey: Callable[[Order], Obeyed]
    state: Callable[[], str]


class Hearer:
    """The ear of one robot. ``hear`` never raises, whatever the bytes.

    ``clock`` is monotonic, ``wall`` tells seconds since 1970.
    """

    def __init__(
        self,
        channel: Channel,
        body: Body,
        clock: Callable[[], float],
        wall: Callable[[], float],
    ) -> None:
        """Make an ear; ``channel`` has the order key, and the number of the robot."""
        self.alive_at_s: float | None = None  #: people were there, by the own clock (O-ALIVE)
        self.heard_at_s: float | None = None  #: when anything authentic was heard last
        self.clock_off_s = 0.0  #: how far the caller's clock of the wall is ahead of this one's
        self._pid = channel.pid
        self._body = body
        self._clock, self._wall = clock, wall
        self._boot = secrets.token_bytes(BOOT_BYTES)
        self._reader = OrderReader(channel.key, encrypts=channel.encrypts)
        start = secrets.randbelow(MOST_STARTS)
        self._writer = DatagramWriter(
            Channel(channel.key, channel.robots, channel.pid, start, channel.encrypts)
        )
        self._known: OrderedDict[bytes, Obeyed] = OrderedDict()
        self._stopped_at_s = -math.inf  #: when an order stopped it last

    @property
    def drops(self) -> Drops:
        """What was dropped, by reason."""
        return self._reader.drops

    def hear(self, datagram: bytes) -> bytes | None:
        """Obey a request, and return the answer; None if it is none to this robot."""
        request = self._reader.read(datagram)
        if not isinstance(request, Request):
            if request is not None:
                self.drops[Drop.MALFORMED] += 1  # an answer that came back
            return None
        if request.robot != self._pid:  # (O-ADDRESSEE)
            self.drops[Drop.STRANGER] += 1
            return None
        now_s = self._clock()
        self.heard_at_s = now_s
        self.clock_off_s = request.said_at_s - self._wall()
        outcome, why = self._outcome(request, now_s)
        if outcome is Outcome.STALE:
            self.drops[Drop.STALE] += 1
        stamp = Stamp(self._boot, self._clock())
        state = self._body.state()[:_LONGEST_TEXT]
        reply = Reply(request.id, self._pid, outcome, state, why[:_LONGEST_TEXT], stamp)
        (answer,) = self._writer.datagrams(0, 0, reply)
        return answer

    def _outcome(self, request: Request, now_s: float) -> tuple[Outcome, str]:
        """What becomes of a request, and why it was refused."""
        at_s = self._stamped_at_s(request.stamp, now_s)
        match request.wanted:
            case Wanted.ASK:
                return Outcome.HEARD, ""
            case Wanted.ALIVE:
                if at_s is None:
                    return Outcome.STALE, ""
                self.alive_at_s = max(at_s, self.alive_at_s or at_s)
                return Outcome.HEARD, ""
            case Wanted.ESTOP | Wanted.STOP | Wanted.LAND | Wanted.START | Wanted.RESET:
                known = self._known.get(request.id)  # (O-ONCE)
                if known is None:
                    if not self._counts(request, at_s):
                        return Outcome.STALE, ""
                    known = self._obeyed(request, now_s)
                refused = known.refused
                return (Outcome.DONE, "") if refused is None else (Outcome.REFUSED, refused)
            case _:
                assert_never(request.wanted)

    def _stamped_at_s(self, stamp: Stamp | None, now_s: float) -> float | None:
        """When a stamp was given, if it is fresh. (O-STAMP)"""
        if stamp is None or stamp.boot != self._boot:
            return None
        return stamp.at_s if 0 <= now_s - stamp.at_s <= FRESH_S else None

    def _counts(self, request: Request, at_s: float | None) -> bool:
        """Return whether an order is to be obeyed. (O-START) (O-LATER) (O-STOP)"""
        if request.wanted in STOPPING:
            return at_s is not None or abs(self._wall() - request.said_at_s) <= SAID_S
        return at_s is not None and at_s > self._stopped_at_s

    def _obeyed(self, request: Request, now_s: float) -> Obeyed:
        if request.wanted in STOPPING:
            self._stopped_at_s = now_s
        made = self._body.obey(_ORDERS[request.wanted])
        self._known[request.id] = made
        if len(self._known) > _MOST_KNOWN:
            self._known.popitem(last=False)
        return made
