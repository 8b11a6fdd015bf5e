"""A master of ROS 1, and nodes of rospy, as processes of their own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from shutil import which

import pytest

from koord.runtime.drivers.ros1 import library

NODE = Path(__file__).with_name("rospy_node.py")
INSTALL = f"{library.INSTALL} python3-rosmaster"
_NUMBERS = count()


@cache
def rospy_python() -> str:
    """A Python that has rospy, where there is a master too; else skip."""
    if not library.is_installed() or which("rosmaster") is None:
        pytest.skip(f"rospy or rosmaster is not installed: run .ci/peers, or {INSTALL}")
    return sys.executable if library.folder() is None else "/usr/bin/python3"


@cache
def port() -> int:
    """The port of all masters of this process, which has one node."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        number: int = free.getsockname()[1]
        return number


def uri() -> str:
    return f"http://127.0.0.1:{port()}"


def fresh_prefix() -> str:
    """A prefix of topics that nobody else has."""
    return f"t{next(_NUMBERS)}"


def environment(home: Path) -> dict[str, str]:
    """What rospy is told: who is the master, on this machine alone, and where to write."""
    return {"ROS_MASTER_URI": uri(), "ROS_IP": "127.0.0.1", "ROS_HOME": str(home)}


@contextmanager
def master(home: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A master that answers."""
    rospy_python()
    with subprocess.Popen(
        ["rosmaster", "--core", "-p", str(port())],
        env={**os.environ, **environment(home)},
        stdout=subprocess.DEVNULL,
    ) as process:
        try:
            end_s = time.monotonic() + 30.0
            while True:
                try:
                    socket.create_connection(("127.0.0.1", port()), timeout=1.0).close()
                    break
                except OSError:
                    assert time.monotonic() < end_s, "no master"
                    time.sleep(0.02)
            yield process
        finally:
            process.kill()


@contextmanager
def node(
    kind: str, prefix: str, home: Path, pose: str | None = None, name: str = "car"
) -> Iterator[subprocess.Popen[bytes]]:
    """A vehicle as a process."""
    told = {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ}
    called = f"{name}_{prefix}".replace("/", "_")
    with subprocess.Popen(
        [rospy_python(), str(NODE), kind, called, pose or f"/{prefix}/pose", f"/{prefix}"],
        stdin=subprocess.PIPE,
        env={**told, **environment(home)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()
