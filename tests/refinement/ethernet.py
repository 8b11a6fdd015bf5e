"""A bad Ethernet for real processes, in network namespaces.

The hub carries what is sent from card to card, and loses, doubles, delays and reorders it on the
way. Nothing leaves it: no namespace has another card, and all end with their processes. It needs
Linux, and root.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import select
import shutil
import socket
import struct
import subprocess
import sys
import time
from heapq import heappop, heappush
from pathlib import Path
from random import Random

from msgspec.structs import replace

from koord.runtime.chaos.network import Faults
from koord.runtime.transports.udp import Delivery, Plan, Udp

#: The robots of this network are few.
MOST_ROBOTS = 200

_PORT = 4700
_CARD = "koord0"
_TUN = "/dev/net/tun"

_CLONE_NEWNET = 0x4000_0000
_TUNSETIFF = 0x4004_54CA
_IFF_TAP, _IFF_NO_PI = 0x0002, 0x1000

#: Of an Ethernet frame: who it is for, who it is from, what it carries.
_HEADER = struct.Struct("!6s6sH")
_IPV4 = 0x0800
_LONGEST_FRAME = 2048


def why_not() -> str | None:
    """What keeps this process from having such a network; None if nothing does."""
    if not sys.platform.startswith("linux"):
        return "network namespaces are Linux's"
    if os.geteuid() != 0:
        return "network namespaces need root"
    if not Path(_TUN).exists():
        return f"there is no {_TUN}"
    if shutil.which("ip") is None:
        return "there is no `ip` (iproute2)"
    tried = subprocess.run(
        [sys.executable, "-c", f"import {__name__} as e; e.unshare(); e.card()"],
        capture_output=True,
        check=False,
        cwd=Path(__file__).parents[2],
        timeout=30,
    )
    return None if tried.returncode == 0 else "network namespaces are not permitted here"


def address(pid: int) -> str:
    """Where a robot is on this network."""
    return f"10.75.0.{pid + 1}"


def _mac(pid: int) -> bytes:
    return bytes((2, 0, 0, 0, 75, pid + 1))


def plan(robots: int) -> Plan:
    """Who is where, and one group for all."""
    addresses = tuple((address(pid), _PORT) for pid in range(robots))
    return Plan(addresses, Delivery.GROUP, ("239.255.75.1", _PORT + 1))


# --- a robot's end --------------------------------------------------------------------------------


def plugged_in(hub: Path, shared: Plan, pid: int) -> Udp:
    """Take this process into a namespace of its own, with a card that is plugged into the hub."""
    unshare()
    tap = card()
    robots = len(shared.addresses)
    others = (i for i in range(robots) if i != pid)
    known = (f"neigh add {address(i)} lladdr {_mac(i).hex(':')} dev {_CARD}" for i in others)
    commands = (
        "link set lo up",
        f"link set {_CARD} address {_mac(pid).hex(':')} up",
        f"addr add {address(pid)}/24 dev {_CARD}",
        f"route add 224.0.0.0/4 dev {_CARD}",
        *known,
    )
    batch = "\n".join(commands).encode()
    subprocess.run(["ip", "-batch", "-"], input=batch, check=True, capture_output=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        line.connect(str(hub))
        socket.send_fds(line, [bytes([pid])], [tap])
    os.close(tap)
    return Udp(replace(shared, interface=address(pid)), pid)


def unshare() -> None:
    """Leave the network of this machine for an empty one. Raises OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "unshare")


def card() -> int:
    """A network card whose other end is the file that is returned. Raises OSError."""
    tap = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack("16sH14x", _CARD.encode(), _IFF_TAP | _IFF_NO_PI)
    fcntl.ioctl(tap, _TUNSETIFF, request)
    return tap


# --- the hub --------------------------------------------------------------------------------------


class BadHub:
    """Carries frames between the cards, badly. One process, until somebody ends it."""

    def __init__(self, path: Path, faults: Faults, seed: int) -> None:
        self.path = path
        self.faults = faults
        self.cards: dict[int, int] = {}  #: files by pid
        self._under_way: list[tuple[float, int, int, bytes]] = []
        self._number = 0
        self._random = Random(seed)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._line.bind(str(path))
        self._line.listen(MOST_ROBOTS)

    def close(self) -> None:
        """Nobody can plug in any more."""
        self._line.close()

    def run(self) -> None:
        """For ever."""
        while True:
            now = time.monotonic()
            wait_s = max(0.0, self._under_way[0][0] - now) if self._under_way else None
            line = self._line.fileno()
            readable, _, _ = select.select([line, *self.cards.values()], [], [], wait_s)
            for one in readable:
                if one == line:
                    self._plug_in()
                elif one in self.cards.values():  # and was not pulled just now
                    self._read(one)
            self._deliver()

    def _plug_in(self) -> None:
        line, _ = self._line.accept()
        with line:
            said, files, _, _ = socket.recv_fds(line, 1, 1)
        if said and files:
            self._pull(said[0])
            self.cards[said[0]] = files[0]

    def _pull(self, pid: int) -> None:
        """The robot is switched off, and its namespace gone."""
        if pid in self.cards:
            os.close(self.cards.pop(pid))

    def _read(self, file: int) -> None:
        while True:
            try:
                frame = os.read(file, _LONGEST_FRAME)
            except BlockingIOError:
                return
            except OSError:
                self._pull(next(pid for pid, one in self.cards.items() if one == file))
                return
            self._take(frame)

    def _take(self, frame: bytes) -> None:
        """Draw what becomes of a frame at each card that it is for."""
        to, sender, carries = _HEADER.unpack_from(frame)
        if carries != _IPV4:
            return
        everyone = bool(to[0] & 1)
        faults, draw, now = self.faults, self._random, time.monotonic()
        for pid in self.cards:
            if _mac(pid) == sender or not (everyone or _mac(pid) == to):
                continue
            for _ in range(1 + (draw.random() < faults.duplication)):
                if draw.random() < faults.loss:
                    continue
                self._number += 1
                delay = draw.uniform(faults.least_delay_s, faults.most_delay_s)
                heappush(self._under_way, (now + delay, self._number, pid, frame))

    def _deliver(self) -> None:
        now = time.monotonic()
        while self._under_way and self._under_way[0][0] <= now:
            _, _, pid, frame = heappop(self._under_way)
            if pid not in self.cards:
                continue
            try:
                os.write(self.cards[pid], frame)
            except OSError:
                self._pull(pid)
