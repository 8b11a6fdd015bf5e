"""Which datagrams of a sender have been seen. A window, so that late ones may still come."""

from __future__ import annotations

from msgspec import Struct

#: How far a datagram may be behind the newest of its sender.
WIDTH = 4096
_MASK = (1 << WIDTH) - 1


class Window(Struct):
    """The datagrams of one sender: the newest number, and a bit for each of those before it."""

    incarnation: int = 0
    newest: int = -1
    seen: int = 0

    def is_new(self, incarnation: int, number: int) -> bool:
        """Whether this was not seen before; from now on it was."""
        if incarnation != self.incarnation:
            if incarnation < self.incarnation:
                return False
            self.incarnation, self.newest, self.seen = incarnation, number, 1
            return True
        ahead = number - self.newest
        if ahead > 0:
            self.seen = ((self.seen << ahead) | 1) & _MASK if ahead < WIDTH else 1
            self.newest = number
            return True
        bit = 1 << -ahead
        if ahead <= -WIDTH or self.seen & bit:
            return False
        self.seen |= bit
        return True
