"""The wire between a driver and the bridge: datagrams on this machine."""

from __future__ import annotations

import socket
import time
from typing import Protocol


class Wire(Protocol):
    """What carries datagrams to the bridge and back."""

    def receive(self) -> list[bytes]:
        """What has arrived."""

    def send(self, data: bytes) -> None:
        """Send a datagram; whether anybody hears it is not known."""

    def wait(self, most_s: float) -> float:
        """Wait for a moment; return for how long."""

    def close(self) -> None:
        """Let go of it."""


class UdpWire:
    """A wire over UDP."""

    def __init__(self, bridge: tuple[str, int]) -> None:
        self._bridge = bridge
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def receive(self) -> list[bytes]:
        found = []
        try:
            while True:
                found.append(self._socket.recv(2048))
        except OSError:
            return found

    def send(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self._bridge)
        except OSError:
            return  # the bridge is not there (any more): so its silence says

    def wait(self, most_s: float) -> float:
        time.sleep(most_s)
        return most_s

    def close(self) -> None:
        self._socket.close()
