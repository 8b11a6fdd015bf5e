"""A differential drive that hears velocities, in real time, for nodes that tell where it is."""

from __future__ import annotations

import argparse
import math
import socket
import time
from collections.abc import Callable

from koord.testing.sockets import address_of, send
from koord.testing.truth import Place, Truth, reported, show, told

_PERIOD_S = 0.01

#: It reports every so many steps.
_REPORT = 5

#: How hard it speeds up and brakes, and how it turns faster.
_ACCELERATION, _TURN = 2.0, 8.0

#: Without a command for so long it stops. (`cmd_vel_timeout`)
_DEAD_MAN_S = 0.5


class Car:
    """The car. Its frame is east, north, up."""

    def __init__(self, start: tuple[float, float, float]) -> None:
        self.x, self.y, self.heading = start
        self.speed = self.rate = 0.0
        self._wanted = 0.0, 0.0
        self._told_s = -math.inf

    def hear(self, speed: float, rate: float, now_s: float) -> None:
        """Take a command."""
        self._wanted, self._told_s = (speed, rate), now_s

    def step(self, now_s: float, dt_s: float) -> None:
        """Move on."""
        speed, rate = self._wanted if now_s - self._told_s <= _DEAD_MAN_S else (0.0, 0.0)
        self.speed = _towards(self.speed, speed, _ACCELERATION * dt_s)
        self.rate = _towards(self.rate, rate, _TURN * dt_s)
        self.heading += self.rate * dt_s
        self.x += self.speed * math.cos(self.heading) * dt_s
        self.y += self.speed * math.sin(self.heading) * dt_s

    @property
    def place(self) -> Place:
        """Where it is, on the ground."""
        return Place(self.x, self.y, 0.0, self.heading)


def _towards(now: float, wanted: float, most: float) -> float:
    return now + max(-most, min(most, wanted - now))


def arguments(story: str) -> argparse.ArgumentParser:
    """What nodes of cars are told on their command lines."""
    parser = argparse.ArgumentParser(description=story)
    parser.add_argument("--prefix", default="car0", help="of its topics")
    parser.add_argument(
        "--start", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "RAD")
    )
    parser.add_argument("--report", action="store_true", help="tell where it is, as JSON")
    parser.add_argument(
        "--truth",
        type=address_of,
        metavar="HOST:PORT",
        help="a fake NatNet server (--told), which sees where it is",
    )
    parser.add_argument("--body", help="its name there; else that of its topics")
    return parser


def serve(
    car: Car, hear: Callable[[float], None], tell: Callable[[], None], given: argparse.Namespace
) -> None:
    """Move a car for ever: each step it hears at a time, moves, and is told of as ``given``."""
    truth = None if given.truth is None else Truth(given.truth, given.body or given.prefix)
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    steps, due_s = 0, time.monotonic()
    while True:
        now_s = time.monotonic()
        hear(now_s)
        car.step(now_s, _PERIOD_S)
        tell()
        steps += 1
        if given.report and steps % _REPORT == 0:
            show(reported(car.place))
        if truth is not None:
            send(port, told(car.place, truth), truth.address)
        due_s = max(due_s + _PERIOD_S, time.monotonic() - _PERIOD_S)
        time.sleep(max(0.0, due_s - time.monotonic()))
