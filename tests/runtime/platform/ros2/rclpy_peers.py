"""Nodes of rclpy as processes of their own.

rclpy comes from the package index, in an environment of its own: it brings a parser that others
have another version of, and starts Python anew.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

NODE = Path(__file__).with_name("rclpy_node.py")


@cache
def rclpy_python() -> str:
    """A Python that has rclpy; or skip."""
    if find_spec("rclpy") is not None:
        return sys.executable
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    python = cache / "koord" / "rclpy" / "bin" / "python"
    asked = [str(python), "-c", "import rclpy, nav_msgs.msg, sensor_msgs.msg"]
    if not python.exists() or subprocess.run(asked, timeout=60, check=False).returncode != 0:
        pytest.skip("rclpy is not installed: run .ci/peers")
    return str(python)


def environment(domain: int) -> dict[str, str]:
    """What rclpy is told: how it is carried, on this machine alone."""
    return {
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(domain),
    }


@contextmanager
def node(
    kind: str, prefix: str, domain: int, pose: str | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """A vehicle as a process."""
    told = {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ}
    about = kind, f"{kind}_{prefix}".replace("/", "_"), pose or f"/{prefix}/pose", f"/{prefix}"
    with subprocess.Popen(
        [rclpy_python(), str(NODE), *about],
        stdin=subprocess.PIPE,
        env={**told, **environment(domain)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()
