"""The bridge to the Robotarium: a process that owns the arena, and moves its robots for drivers.

The arena, and its simulator (`rps`), is one object for all robots, which is stepped thirty times a
second; koord's robots are processes of their own. (B-BRIDGE)

    python -m koord.runtime.drivers.robotarium.bridge --robots 2 --at -1,0,0 --at 1,0,3.14
"""

from __future__ import annotations

import argparse
import math
import socket
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from msgspec import Struct

from koord.runtime.drivers.robotarium.messages import Refused, Seen, Told, decoded, encoded
from koord.runtime.drivers.robotarium.options import address_of
from koord.runtime.motion.arrays import Floats

#: A step of the arena, in s; half of its size in m; the fastest that wheels go, and the distance
#: between them. (`rps/robotarium_abc.py`, the larger distance of its versions 0.0 and 2.1)
STEP_S = 0.033
HALF_SIZE_M = (1.6, 1.0)
_WHEEL_MPS, _TRACK_M = 0.2, 0.11

#: A robot that was told nothing for so many steps stands. (B-SILENCE)
DEAD_MAN_STEPS = 15

#: Who was not heard for so many steps is told nothing any more.
_GONE_STEPS = 300

#: Robots of one arena at most, as it has it itself.
_MOST_ROBOTS = 50

Address = tuple[str, int]


class Arena(Protocol):
    """What is used of `rps.robotarium.Robotarium`: poses once a step, velocities, the step."""

    def get_poses(self) -> Floats:
        """x, y in m and heading in rad of each robot, shape ``(3, robots)``."""

    def set_velocities(self, ids: Any, velocities: Floats) -> None:
        """Speed in m/s and yaw rate in rad/s of each robot, shape ``(2, robots)``."""

    def step(self) -> None:
        """Move on by a step."""


class _Driver(Struct):
    """Who drives a robot."""

    session: str
    address: Address
    speed_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    quiet_steps: int = 0


class Bridge:
    """What is heard of drivers, and what the arena is told at a step: without clock or socket."""

    def __init__(self, arena: Arena, robots: int) -> None:
        self._arena, self._robots = arena, robots
        self._drivers: dict[int, _Driver] = {}
        self._refused: list[tuple[Refused, Address]] = []

    def hear(self, data: bytes, address: Address) -> None:
        """Take note of a datagram. A robot has one driver. (B-ONE)"""
        told = decoded(data)
        if not isinstance(told, Told):
            return
        if not 0 <= told.robot < self._robots:
            self._refuse(told.robot, f"there are robots 0 to {self._robots - 1}", address)
            return
        known = self._drivers.get(told.robot)
        if known is None or known.quiet_steps > DEAD_MAN_STEPS:
            known = self._drivers[told.robot] = _Driver(told.session, address)
        if known.session != told.session:
            self._refuse(told.robot, "another process drives it", address)
            return
        known.address, known.quiet_steps = address, 0
        known.speed_mps, known.yaw_rate_radps = limited(told.speed_mps, told.yaw_rate_radps)

    def _refuse(self, robot: int, why: str, address: Address) -> None:
        self._refused.append((Refused(robot, why), address))

    def step(self, now_s: float) -> list[tuple[bytes, Address]]:
        """Take a step of the arena; return what is to be told, and to whom."""
        poses = self._arena.get_poses()
        refused, self._refused = self._refused, []
        said = [(encoded(refusal), address) for refusal, address in refused]
        velocities = np.zeros((2, self._robots))
        for robot, driver in list(self._drivers.items()):
            x, y, heading = poses[:, robot].tolist()
            seen = Seen(robot, now_s, x, y, heading, HALF_SIZE_M)
            said.append((encoded(seen), driver.address))
            driver.quiet_steps += 1
            if driver.quiet_steps <= DEAD_MAN_STEPS:
                velocities[:, robot] = driver.speed_mps, driver.yaw_rate_radps
            elif driver.quiet_steps > _GONE_STEPS:
                del self._drivers[robot]
        self._arena.set_velocities(np.arange(self._robots), velocities)
        self._arena.step()
        return said


def limited(speed_mps: float, yaw_rate_radps: float) -> tuple[float, float]:
    """A velocity that the wheels can do, along the same circle. What is no number is to stand.

    The arena would cut each wheel off by itself, and so turn robots elsewhere. (B-LIMITS)
    """
    rim_mps = abs(speed_mps) + _TRACK_M / 2 * abs(yaw_rate_radps)
    if not math.isfinite(rim_mps):
        return 0.0, 0.0
    share = min(1.0, _WHEEL_MPS / rim_mps) if rim_mps > 0 else 0.0
    return share * speed_mps, share * yaw_rate_radps


def serve(bridge: Bridge, bound: socket.socket, goes_on: Callable[[], bool] = lambda: True) -> None:
    """Step an arena in real time, for all who talk to a bound socket."""
    bound.setblocking(False)
    due_s = time.monotonic()
    while goes_on():
        for data, address in _arrived(bound):
            bridge.hear(data, address)
        for data, address in bridge.step(time.monotonic()):
            _send(bound, data, address)
        due_s = max(due_s + STEP_S, time.monotonic() - STEP_S)  # the arena may wait by itself
        time.sleep(max(0.0, due_s - time.monotonic()))


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
        return  # whoever it was is gone


def _pose(text: str) -> tuple[float, float, float]:
    x, y, heading = map(float, text.split(","))
    return x, y, heading


def main(arguments: Sequence[str] | None = None) -> None:
    """Serve an arena from the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m koord.runtime.drivers.robotarium.bridge", description=__doc__
    )
    parser.add_argument("--robots", type=int, required=True, help="how many, 1 to 50")
    parser.add_argument("--bind", type=address_of, default=("127.0.0.1", 5550), metavar="HOST:PORT")
    parser.add_argument(
        "--at",
        type=_pose,
        action="append",
        default=[],
        metavar="X,Y,HEADING",
        help="where a robot begins, in m and rad; for all robots, or the arena says where",
    )
    parser.add_argument(
        "--arena",
        default="rps.robotarium:Robotarium",
        metavar="MODULE:CLASS",
        help="what has the arena's interface",
    )
    parser.add_argument("--show", action="store_true", help="show the arena in a window")
    told = parser.parse_args(arguments)
    if not 1 <= told.robots <= _MOST_ROBOTS:
        parser.error(f"--robots: there are 1 to {_MOST_ROBOTS}")
    if told.at and len(told.at) != told.robots:
        parser.error(f"--at: {len(told.at)} places for {told.robots} robots")
    module, _, name = told.arena.partition(":")
    try:
        made = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        parser.error(f"{error}; install it with: pip install 'koord[robotarium]'")
    start = np.array(told.at).T if told.at else np.array([])
    arena = made(number_of_robots=told.robots, show_figure=told.show, initial_conditions=start)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        try:
            bound.bind(told.bind)
        except OSError as error:
            parser.error(f"--bind: {error.strerror}: does another bridge run?")
        try:
            serve(Bridge(arena, told.robots), bound)
        except KeyboardInterrupt:
            return


if __name__ == "__main__":
    main()
