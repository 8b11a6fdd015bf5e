"""The other side of a driver's wire, as a process that is started, frozen and ended. (P-KIT-PEER)

It may tell where the vehicle is: lines of JSON on its standard output, such as
``{"east": 1.0, "north": 2.0, "up": 0.0, "heading": 0.7, "armed": false}`` (metres; radians
counter-clockwise from east). What else it writes is kept for people.
"""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import msgspec
from msgspec import Struct

from koord.runtime.motion.world import Point
from koord.testing.conformance.findings import Failed
from koord.testing.conformance.holders import Holders

#: A peer that has said nothing for so long says nothing.
_SAYS_S = 5.0

#: So many lines that are no reports are kept.
_LINES = 20


class Truth(Struct, frozen=True):
    """Where a vehicle is, as the other side says. ``heard_s``: when that was read, monotonic."""

    east: float
    north: float
    up: float = 0.0
    heading: float | None = None
    armed: bool | None = None
    heard_s: float = 0.0

    @property
    def position_m(self) -> Point:
        return self.east, self.north, self.up


class OtherSide(Protocol):
    """The other side of a driver's wire."""

    @property
    def is_running(self) -> bool: ...

    def start(self) -> None:
        """Start it, and wait until it is there. Raises Failed."""

    def stop(self) -> None:
        """End it at once."""

    def freeze(self) -> None:
        """Let it do and say nothing, until it is thawed."""

    def thaw(self) -> None: ...

    def truth(self) -> Truth | None:
        """Where the vehicle is; None: it does not say."""

    def seen(self) -> Sequence[Truth]:
        """Where the vehicle was, the latest last, as far as that is kept."""


class CommandPeer:
    """A command as the other side."""

    def __init__(self, command: Sequence[str], environment: dict[str, str] | None = None) -> None:
        self.command = tuple(command)
        self._environment = environment or {}
        self._process: subprocess.Popen[bytes] | None = None
        self._reports: deque[Truth] = deque(maxlen=2000)
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._spoke = threading.Event()

    @property
    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def start(self) -> None:
        self._spoke.clear()
        self._reports.clear()
        try:
            self._process = subprocess.Popen(
                self.command,
                stdin=subprocess.PIPE,  # peers end with it
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, **self._environment},
                start_new_session=True,
            )
        except OSError as error:
            raise Failed(
                f"the peer `{shlex.join(self.command)}` cannot be started: {error}"
            ) from None
        threading.Thread(target=self._read, args=(self._process,), daemon=True).start()
        self._spoke.wait(_SAYS_S)
        if not self.is_running:
            said = "; ".join(self._lines) or "without a word"
            raise Failed(f"the peer `{shlex.join(self.command)}` has ended: {said}")

    def stop(self) -> None:
        if self._process is not None:
            self._signal(signal.SIGKILL)
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout):
                if stream is not None:
                    stream.close()
        self._process = None

    def freeze(self) -> None:
        self._signal(signal.SIGSTOP)

    def thaw(self) -> None:
        self._signal(signal.SIGCONT)

    def truth(self) -> Truth | None:
        return self._reports[-1] if self._reports else None

    def seen(self) -> Sequence[Truth]:
        return tuple(self._reports)

    def _signal(self, number: int) -> None:
        assert self._process is not None
        if self._process.poll() is None:
            os.killpg(self._process.pid, number)

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                self._hear(line)
        except ValueError:
            return  # it was closed: the process has been ended

    def _hear(self, line: bytes) -> None:
        try:
            told = msgspec.json.decode(line, type=Truth)
        except msgspec.MsgspecError:
            self._lines.append(line.decode(errors="replace").strip())
            return
        self._reports.append(msgspec.structs.replace(told, heard_s=time.monotonic()))
        self._spoke.set()


class KnownPeer(Struct, frozen=True):
    """A peer that comes with koord; its place-holders are filled when it is used. (P-KIT-JOBS)"""

    driver: str
    command: tuple[str, ...]
    options: dict[str, Any]
    vehicle: str
    at_m: Point = (0.0, 0.0, 0.0)
    heading_rad: float = 0.0
    environment: dict[str, str] = {}

    def filled(self, holders: Holders) -> KnownPeer:
        """The same, with what its place-holders stand for."""
        return KnownPeer(
            self.driver,
            tuple(map(holders.text, self.command)),
            holders.value(self.options),
            self.vehicle,
            self.at_m,
            self.heading_rad,
            self.environment,
        )


@contextmanager
def patched(environment: Mapping[str, str]) -> Iterator[None]:
    """Within the context, this process and those it starts have these variables too."""
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _autopilot(firmware: str, silence_s: float) -> KnownPeer:
    """A simulated autopilot, 2 m east and 1 m north of its origin; it faces north-east."""
    return KnownPeer(
        "mavlink",
        (
            *(sys.executable, "-m", "koord.testing.autopilot.serving", "--firmware", firmware),
            *("--bind", "127.0.0.1:{free}", "--start", "1", "2", "0", "--yaw", "0.7"),
            "--report",
        ),
        {
            "connection": "udpout:127.0.0.1:{free}",
            "autopilot": firmware,
            "connect": 5.0,
            "silence": silence_s,
        },
        "QUAD",
        (2.0, 1.0, 0.0),
        1.5707963 - 0.7,
    )


#: DDS on this machine alone, without multicast.
_LOOPBACK = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast><Interfaces>"
    '<NetworkInterface name="lo" multicast="false"/></Interfaces></General><Discovery>'
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40"
    '</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)


def _car() -> KnownPeer:
    """A car as a node of ROS 2."""
    return KnownPeer(
        "ros2",
        (
            *(sys.executable, "-m", "koord.testing.ros2.serving", "--prefix", "kit{free}"),
            *("--domain", "{domain}", "--start", "1.0", "-0.5", "0.6", "--report"),
        ),
        {
            "positioning_topic": {"topic": "pose", "type": "PoseStamped"},
            "ros_node_prefix": "kit{free}",
            "domain": "{domain}",
            "dead_man": 0.5,
        },
        "DIFF",
        (1.0, -0.5, 0.0),
        0.6,
        {"CYCLONEDDS_URI": _LOOPBACK},
    )


def _car_of_ros_1() -> KnownPeer:
    """A car as a node of ROS 1, with a master."""
    return KnownPeer(
        "ros1",
        (
            *(sys.executable, "-m", "koord.testing.ros1.serving", "--prefix", "kit"),
            *("--master", "{free}", "--start", "1.0", "-0.5", "0.6", "--report"),
        ),
        {
            "positioning_topic": {"topic": "pose", "type": "PoseStamped"},
            "ros_node_prefix": "kit",
            "master": "http://127.0.0.1:{free}",
            "dead_man": 0.5,
        },
        "DIFF",
        (1.0, -0.5, 0.0),
        0.6,
        {"ROS_IP": "127.0.0.1"},
    )


def _crazyflie() -> KnownPeer:
    """A Crazyflie that is simulated."""
    return KnownPeer(
        "crazyflie",
        (
            *(sys.executable, "-m", "koord.testing.crazyflie.serving"),
            *("--bind", "127.0.0.1:{free}", "--start", "0.5", "-0.5", "0", "--yaw", "0.6"),
            *("--report", "--switched-on-again"),
        ),
        {"uri": "udp://127.0.0.1:{free}"},
        "QUAD",
        (0.5, -0.5, 0.0),
        0.6,
    )


#: The peers that come with koord, by name.
KNOWN = {
    "crazyflie": _crazyflie(),
    "ros1": _car_of_ros_1(),
    "ros2": _car(),
    "px4": _autopilot("px4", 1.0),
    "ardupilot": _autopilot("ardupilot", 5.0),
}
