"""What a node needs of a network."""

from __future__ import annotations

from typing import Protocol


class Transport(Protocol):
    """Carries datagrams of up to 1,400 bytes, or loses them. Nothing more is promised.

    Sending never waits and never fails: what cannot be sent is lost.
    """

    def send(self, to: int, datagram: bytes) -> None:
        """To one robot."""

    def tell(self, datagram: bytes) -> None:
        """To all other robots."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """What has come; if nothing has, wait for something for so long at most."""

    def close(self) -> None:
        """Nothing comes any more. May be called twice."""


class TransportError(Exception):
    """A network that cannot be used, with what could be done about it."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
