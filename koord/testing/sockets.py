"""Sockets of those who serve vehicles to tests."""

from __future__ import annotations

import socket

Address = tuple[str, int]


def address_of(text: str) -> Address:
    """An address as people write it: HOST:PORT. Raises ValueError."""
    host, _, port = text.rpartition(":")
    return host, int(port)


def arrived(bound: socket.socket) -> list[tuple[bytes, Address]]:
    """The datagrams that are there by now, each with whose it is; the socket does not block."""
    found = []
    try:
        while True:
            found.append(bound.recvfrom(65536))
    except OSError:
        return found


def send(bound: socket.socket, data: bytes, address: Address) -> None:
    """Send a datagram; whether anybody hears it is not known."""
    try:
        bound.sendto(data, address)
    except OSError:
        return  # as on the air
