"""Serve bodies from the command line: ``python -m koord.testing.natnet --body car0``.

Where they are is told by datagrams of JSON to `--told`, or by lines of a script, with the seconds
after its start: {"body": "car0", "position": [1, 2, 0], "heading": 0.5}, {"at": 3, "body": "car0",
"tracked": false}, {"body": "car0", "shift": [0, 1, 0]}, {"frozen": true}, {"silent": true}.
"""

from __future__ import annotations

import argparse
import socket
from pathlib import Path

import msgspec

from koord.testing.natnet.machine import Told, Up
from koord.testing.natnet.packets import Stream, Version
from koord.testing.natnet.serving import Settings, serve
from koord.testing.sockets import Address, address_of


def main() -> None:
    """Serve until it is ended."""
    parser = argparse.ArgumentParser(
        prog="python -m koord.testing.natnet",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--body", action="append", required=True, metavar="NAME")
    parser.add_argument(
        "--bind", type=address_of, default=("127.0.0.1", 1510), metavar="HOST:PORT", help="requests"
    )
    parser.add_argument(
        "--told",
        type=address_of,
        default=("127.0.0.1", 1512),
        metavar="HOST:PORT",
        help="the truth",
    )
    parser.add_argument("--version", type=Version.of, default=Version(4, 1), help="3.0 to 4.2")
    parser.add_argument("--up", type=Up, default=Up.Y, help="the axis that points up: y, z")
    parser.add_argument("--rate", type=float, default=100.0, help="frames a second")
    parser.add_argument("--latency", type=float, default=0.0, help="s from exposure to frame")
    parser.add_argument(
        "--multicast", type=address_of, metavar="GROUP:PORT", help="else to clients"
    )
    parser.add_argument("--interface", default="127.0.0.1", help="for multicast")
    parser.add_argument("--script", type=Path, metavar="FILE", help="lines of JSON")
    told = parser.parse_args()
    group, port = told.multicast or (None, 1511)
    script = () if told.script is None else told.script.read_bytes().splitlines()
    settings = Settings(
        tuple(told.body),
        told.version,
        told.up,
        told.rate,
        told.latency,
        Stream(port, group),
        told.interface,
        tuple(msgspec.json.decode(line, type=Told) for line in script if line.strip()),
    )
    serve(_bound(told.bind), _bound(told.told), settings)


def _bound(address: Address) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(address)
    return made


if __name__ == "__main__":
    main()
