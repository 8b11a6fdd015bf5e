"""A simulated autopilot at the end of a UDP socket, in real time."""

from __future__ import annotations

import argparse
import json
import math
import select
import socket
import sys
import time
from collections.abc import Callable

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from koord.testing.autopilot.machine import FIRMWARES, Settings, SimulatedAutopilot

#: Who was not heard for so long is told nothing any more.
_GONE_S = 10.0

#: It reports so often where it is.
_REPORT_S = 0.05

Address = tuple[str, int]


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
            report(_reported(autopilot))
        if truth is not None:
            _send(bound, _true(autopilot, truth), truth.address)
        for data, address in _arrived(bound):
            known[address] = now_s
            wire.heard(autopilot, data)
        known = {one: at_s for one, at_s in known.items() if now_s - at_s < _GONE_S}
        for data in wire.told(autopilot):
            for address in {*peers, *known}:
                _send(bound, data, address)


def _reported(autopilot: SimulatedAutopilot) -> str:
    """Where it is: east, north, up in metres; its heading counter-clockwise from east."""
    north, east, down = autopilot.airframe.position_m
    told = {
        "east": east,
        "north": north,
        "up": -down,
        "heading": math.pi / 2 - autopilot.airframe.yaw_rad,
        "armed": autopilot.armed,
    }
    return json.dumps(told)


class Truth(Struct, frozen=True):
    """Who is told where an aircraft really is, and what that calls it."""

    address: Address
    body: str
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: of its local frame, east, north, up


def _true(autopilot: SimulatedAutopilot, truth: Truth) -> bytes:
    """Where it is, as JSON for a fake motion capture: east, north, up."""
    (north, east, down), (x, y, z) = autopilot.airframe.position_m, truth.origin_m
    there = [x + east, y + north, z - down]
    heading = math.remainder(math.pi / 2 - autopilot.airframe.yaw_rad, math.tau)
    return json.dumps({"body": truth.body, "position": there, "heading": heading}).encode()


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
    """Serve one from the command line: ``python -m koord.testing.autopilot.serving``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--firmware", choices=sorted(FIRMWARES), default="px4")
    parser.add_argument("--bind", type=_address, default=("127.0.0.1", 0), metavar="HOST:PORT")
    parser.add_argument("--peer", type=_address, action="append", default=[], metavar="HOST:PORT")
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
        type=_address,
        metavar="HOST:PORT",
        help="a fake NatNet server (--told), which sees where it really is",
    )
    parser.add_argument("--body", default="drone", help="its name there")
    told = parser.parse_args()
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind(told.bind)
    x, y, z = told.start
    failing = tuple(told.failing)
    settings = Settings(
        told.firmware,
        told.system,
        start_m=(x, y, z),
        yaw_rad=told.yaw,
        failing=failing,
        vision=told.vision,
    )
    report = _print if told.report else None
    truth = None if told.truth is None else Truth(told.truth, told.body)
    serve(bound, settings, tuple(told.peer), report=report, truth=truth)


def _print(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
