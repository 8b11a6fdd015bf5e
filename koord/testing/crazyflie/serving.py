"""A simulated Crazyflie at the end of a UDP socket, in real time.

A datagram is a packet of CRTP, as cflib sends it to `udp://HOST:PORT`: a header, and 30 bytes at
most.
"""

from __future__ import annotations

import argparse
import select
import socket
import time
from collections.abc import Callable

from koord.testing.crazyflie.machine import Packet, Settings, SimulatedCrazyflie

#: Who was not heard for so long is told nothing any more.
_GONE_S = 10.0

Address = tuple[str, int]


def packet_of(data: bytes) -> Packet:
    """The packet in a datagram."""
    return data[0] >> 4, data[0] & 3, data[1:]


def datagram_of(packet: Packet) -> bytes:
    """A packet as a datagram."""
    port, channel, data = packet
    return bytes([port << 4 | 3 << 2 | channel]) + data


def serve(
    bound: socket.socket, settings: Settings, goes_on: Callable[[], bool] = lambda: True
) -> None:
    """Be a Crazyflie for all who talk to a bound socket."""
    crazyflie = SimulatedCrazyflie(settings, time.monotonic())
    known: dict[Address, float] = {}
    bound.setblocking(False)
    while goes_on():
        select.select([bound], [], [], 0.005)
        now_s = time.monotonic()
        crazyflie.advance(now_s)
        for data, address in _arrived(bound):
            known[address] = now_s
            if data[:1] == b"\xff":
                _send(bound, b"\xff", address)  # somebody looks who is there
            elif len(data) > 1:
                crazyflie.hear(packet_of(data))
        known = {one: at_s for one, at_s in known.items() if now_s - at_s < _GONE_S}
        for packet in crazyflie.tell():
            for address in known:
                _send(bound, datagram_of(packet), address)


def _arrived(bound: socket.socket) -> list[tuple[bytes, Address]]:
    found = []
    try:
        while True:
            found.append(bound.recvfrom(2048))
    except OSError:
        return found


def _send(bound: socket.socket, data: bytes, address: Address) -> None:
    try:
        bound.sendto(data, address)
    except OSError:
        return  # as on the air


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    return host, int(port)


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.crazyflie.serving``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bind", type=_address, default=("127.0.0.1", 19850), metavar="HOST:PORT")
    parser.add_argument(
        "--start", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z")
    )
    parser.add_argument("--waits-for-arming", action="store_true", help="as larger ones do")
    parser.add_argument("--tumbled", action="store_true", help="it refuses to arm")
    parser.add_argument("--wants-poses", action="store_true", help="it has no positioning")
    told = parser.parse_args()
    x, y, z = told.start
    settings = Settings(
        (x, y, z),
        arms_itself=not told.waits_for_arming,
        tumbled=told.tumbled,
        wants_poses=told.wants_poses,
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(told.bind)
        serve(bound, settings)


if __name__ == "__main__":
    main()
