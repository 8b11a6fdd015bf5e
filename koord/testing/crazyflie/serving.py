"""A simulated Crazyflie at the end of a UDP socket, in real time.

A datagram is a packet of CRTP, as cflib sends it to `udp://HOST:PORT`: a header, and 30 bytes at
most.
"""

from __future__ import annotations

import argparse
import math
import select
import socket
import time
from collections.abc import Callable, Iterable

from msgspec import Struct

from koord.testing.crazyflie.attitudes import yaw_of
from koord.testing.crazyflie.machine import Packet, Settings, SimulatedCrazyflie
from koord.testing.sockets import Address, address_of, arrived, send
from koord.testing.truth import Place, Truth, reported, show, told

#: Who was not heard for so long is told nothing any more.
_GONE_S = 10.0

#: Who asks for it is told so often where it really is.
_TOLD_S = 0.02

#: Ports and channels of what nobody asks for: its console, and what is logged.
_FOR_ALL = ((0, 0), (5, 2))

#: Whoever switches it off and on again comes after so long.
_LOOKS_S = 1.5


def packet_of(data: bytes) -> Packet:
    """The packet in a datagram."""
    return data[0] >> 4, data[0] & 3, data[1:]


def datagram_of(packet: Packet) -> bytes:
    """A packet as a datagram."""
    port, channel, data = packet
    return bytes([port << 4 | 3 << 2 | channel]) + data


class Serving(Struct, frozen=True):
    """What is done about a Crazyflie besides."""

    report: Callable[[str], None] | None = None  #: hears where it really is, as a line of JSON
    truth: Truth | None = None  #: is told where it really is, as a motion capture sees it
    switched_on_again: bool = False  #: somebody does that when it has locked itself


def serve(
    bound: socket.socket,
    settings: Settings,
    goes_on: Callable[[], bool] = lambda: True,
    serving: Serving | None = None,
) -> None:
    """Be a Crazyflie for all who talk to a bound socket."""
    served = serving or Serving()
    crazyflie = SimulatedCrazyflie(settings, time.monotonic())
    known: dict[Address, float] = {}
    told_s = -math.inf
    bound.setblocking(False)
    while goes_on():
        select.select([bound], [], [], 0.005)
        now_s = time.monotonic()
        crazyflie.advance(now_s)
        if served.switched_on_again and crazyflie.locked_s > _LOOKS_S:
            crazyflie = crazyflie.switched_on(now_s)
        if now_s - told_s >= _TOLD_S:
            told_s = now_s
            _tell(crazyflie, served, bound)
        for data, address in arrived(bound):
            known[address] = now_s
            if data[:1] == b"\xff":
                send(bound, b"\xff", address)  # somebody looks who is there
            elif len(data) > 1:
                crazyflie.hear(packet_of(data))
                _send(crazyflie, bound, known, address)
        known = {one: at_s for one, at_s in known.items() if now_s - at_s < _GONE_S}
        _send(crazyflie, bound, known)


def _send(
    crazyflie: SimulatedCrazyflie,
    bound: socket.socket,
    known: Iterable[Address],
    asking: Address | None = None,
) -> None:
    """Send what goes out by now: answers to who asked alone, as a link has them.

    cflib begins to connect anew when it hears the answer to what another asked.
    """
    for packet in crazyflie.tell():
        told = known if asking is None or packet[:2] in _FOR_ALL else (asking,)
        for address in told:
            send(bound, datagram_of(packet), address)


def _tell(crazyflie: SimulatedCrazyflie, serving: Serving, bound: socket.socket) -> None:
    place = Place(*crazyflie.position_m, yaw_of(crazyflie.attitude))
    if serving.report is not None:
        serving.report(reported(place, armed=crazyflie.armed))
    if serving.truth is not None:
        send(bound, told(place, serving.truth), serving.truth.address)


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.crazyflie.serving``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--bind", type=address_of, default=("127.0.0.1", 19850), metavar="HOST:PORT"
    )
    parser.add_argument(
        "--start", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z")
    )
    parser.add_argument("--yaw", type=float, default=0.0, help="rad, counter-clockwise from east")
    parser.add_argument("--waits-for-arming", action="store_true", help="as larger ones do")
    parser.add_argument("--tumbled", action="store_true", help="it refuses to arm")
    parser.add_argument("--wants-poses", action="store_true", help="it has no positioning")
    parser.add_argument(
        "--switched-on-again", action="store_true", help="when it has locked itself"
    )
    parser.add_argument("--report", action="store_true", help="tell where it is, as JSON")
    parser.add_argument(
        "--truth",
        type=address_of,
        metavar="HOST:PORT",
        help="a fake NatNet server (--told), which sees where it really is",
    )
    parser.add_argument("--body", default="drone", help="its name there")
    given = parser.parse_args()
    x, y, z = given.start
    settings = Settings(
        (x, y, z),
        given.yaw,
        arms_itself=not given.waits_for_arming,
        tumbled=given.tumbled,
        wants_poses=given.wants_poses,
    )
    serving = Serving(
        show if given.report else None,
        None if given.truth is None else Truth(given.truth, given.body),
        given.switched_on_again,
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(given.bind)
        serve(bound, settings, serving=serving)


if __name__ == "__main__":
    main()
