"""A simulated autopilot at the end of a UDP socket, in real time."""

from __future__ import annotations

import argparse
import math
import select
import socket
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from koord.testing.autopilot.machine import FIRMWARES, Settings, SimulatedAutopilot
from koord.testing.sockets import Address, address_of, arrived, send
from koord.testing.truth import Place, Truth, reported, show, told

#: Who was not heard for so long is told nothing any more.
_GONE_S = 10.0

#: It reports so often where it is.
_REPORT_S = 0.05


class Wire:
    """The bytes of an autopilot's messages, and the messages in bytes that it gets."""

    def __init__(self, system: int) -> None:
        self._codec = mavlink.MAVLink(
            None, srcSystem=system, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1
        )
        self._codec.robust_parsing = True

    def heard(self, autopilot: SimulatedAutopilot, data: bytes) -> None:
        """Tell an autopilot what stands in these bytes."""
        for message in self._codec.parse_buffer(data) or []:
            if message.get_type() != "BAD_DATA":
                autopilot.hear(message)

    def told(self, autopilot: SimulatedAutopilot) -> list[bytes]:
        """What an autopilot tells by now, a datagram each."""
        found = []
        for message in autopilot.tell():
            found.append(message.pack(self._codec))
            self._codec.seq = (self._codec.seq + 1) % 256
        return found


def serve(
    bound: socket.socket,
    settings: Settings,
    peers: tuple[Address, ...] = (),
    goes_on: Callable[[], bool] = lambda: True,
    report: Callable[[str], None] | None = None,
    truth: Truth | None = None,
) -> None:
    """Be an autopilot for all who talk to a bound socket, and for ``peers`` from the beginning.

    ``report`` hears some times a second where the aircraft is, as a line of JSON; ``truth`` is told
    where it really is, as a motion capture sees it.
    """
    autopilot = SimulatedAutopilot(settings, time.monotonic())
    wire = Wire(settings.system)
    known: dict[Address, float] = {}
    reported_s = -math.inf
    bound.setblocking(False)
    while goes_on():
        select.select([bound], [], [], 0.01)
        now_s = time.monotonic()
        autopilot.advance(now_s)
        if report is not None and now_s - reported_s >= _REPORT_S:
            reported_s = now_s
            report(reported(_place(autopilot), armed=autopilot.armed))
        if truth is not None:
            send(bound, told(_place(autopilot), truth), truth.address)
        for data, address in arrived(bound):
            known[address] = now_s
            wire.heard(autopilot, data)
        known = {one: at_s for one, at_s in known.items() if now_s - at_s < _GONE_S}
        for data in wire.told(autopilot):
            for address in {*peers, *known}:
                send(bound, data, address)


def _place(autopilot: SimulatedAutopilot) -> Place:
    north, east, down = autopilot.airframe.position_m
    return Place(east, north, -down, math.pi / 2 - autopilot.airframe.yaw_rad)


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.autopilot.serving``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--firmware", choices=sorted(FIRMWARES), default="px4")
    parser.add_argument("--bind", type=address_of, default=("127.0.0.1", 0), metavar="HOST:PORT")
    parser.add_argument("--peer", type=address_of, action="append", default=[], metavar="HOST:PORT")
    parser.add_argument("--system", type=int, default=1)
    parser.add_argument(
        "--start", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("N", "E", "D")
    )
    parser.add_argument(
        "--failing", action="append", default=[], metavar="CHECK", help="an arming check that fails"
    )
    parser.add_argument("--yaw", type=float, default=0.0, help="rad, clockwise from north")
    parser.add_argument("--report", action="store_true", help="tell where it is, as JSON")
    parser.add_argument(
        "--vision", action="store_true", help="know where it is by external vision alone"
    )
    parser.add_argument(
        "--truth",
        type=address_of,
        metavar="HOST:PORT",
        help="a fake NatNet server (--given), which sees where it really is",
    )
    parser.add_argument("--body", default="drone", help="its name there")
    given = parser.parse_args()
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind(given.bind)
    x, y, z = given.start
    failing = tuple(given.failing)
    settings = Settings(
        given.firmware,
        given.system,
        start_m=(x, y, z),
        yaw_rad=given.yaw,
        failing=failing,
        vision=given.vision,
    )
    report = show if given.report else None
    truth = None if given.truth is None else Truth(given.truth, given.body)
    serve(bound, settings, tuple(given.peer), report=report, truth=truth)


if __name__ == "__main__":
    main()
