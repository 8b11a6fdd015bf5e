"""The interface of transports."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from msgspec import Struct


class Visit(Struct, frozen=True):
    """A datagram of somebody who need not be a robot, and the way to answer. (O-BESIDE)"""

    datagram: bytes
    answer: Callable[[bytes], None]


class Transport(Protocol):
    """A transport: it carries datagrams of up to 1,400 bytes, or loses them.

    Sending never waits and never fails: what cannot be sent is lost. What waits to be received
    takes up bounded memory.
    """

    @property
    def dropped(self) -> int:
        """How many datagrams have arrived and found no room, as far as that is known."""

    def send(self, to: int, datagram: bytes) -> None:
        """Send to one robot."""

    def tell(self, datagram: bytes) -> None:
        """Send to all other robots."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """Return datagrams that have arrived; if there are none, wait at most ``timeout_s``.

        A visit ends the waiting, too.
        """

    def visits(self) -> list[Visit]:
        """Return the visits that have arrived, which are none of the other datagrams."""

    def close(self) -> None:
        """Close the transport. May be called twice."""


class TransportError(Exception):
    """Raised for a network that cannot be used, with a cure."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
