"""Robots that are killed or stuck while their vehicles drive on: the watchdog stops those.

``test_killed.py PREFIX DOMAIN COMMAND`` is such a robot. (P-WATCHDOG)
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.drivers.setpoints import Drive, Position, Sensed
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.platform.watchdog import watchdog_of
from tests.runtime.platform.ros.driving import until
from tests.runtime.platform.ros2.peers import DOMAIN, LOOPBACK, fresh_prefix, peer
from tests.runtime.platform.ros2.test_driven import COMMANDS, driver

ROOT = Path(__file__).parents[4]
LIMITS = SafetyLimits()
SPEED_MPS = 0.5


def drive(prefix: str, domain: str, command: str) -> None:
    """Be a robot that drives, or sends its vehicle far away, until it is killed."""
    assert int(domain) == DOMAIN
    if command == "waypoint":
        made = driver(prefix, waypoint_topic=Topic(topic="waypoint", type="String"))
    else:
        made = driver(prefix, command_topic=COMMANDS[command])
    made.open(time.monotonic())
    watchdog = watchdog_of(made.capabilities, LIMITS)
    assert watchdog is not None
    while True:
        watchdog.feed()
        now = time.monotonic()
        made.sense(now)
        far = Position((50.0, 0.0, 0.0), None, SPEED_MPS)
        made.command(far if command == "waypoint" else Drive(SPEED_MPS), now)
        time.sleep(0.05)


@contextmanager
def robot(prefix: str, command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A robot as a process of its own."""
    with subprocess.Popen(
        [sys.executable, "-m", __name__, prefix, str(DOMAIN), command],
        cwd=ROOT,
        env={
            **os.environ,
            "CYCLONEDDS_URI": LOOPBACK,
            "PYTHONPATH": str(ROOT),
            "KOORD_TEST_DOMAIN": str(DOMAIN),
        },
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def stands(sensed: Sensed) -> bool:
    return math.hypot(*sensed.velocity_mps) < 0.01


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ("runaway", "Twist"),
        pytest.param("runaway", "TwistStamped", marks=pytest.mark.slow),
        pytest.param("runaway", "AckermannDriveStamped", marks=pytest.mark.slow),
        pytest.param("follower", "waypoint", marks=pytest.mark.slow),
    ],
)
def test_the_vehicle_of_a_killed_robot_stands(kind: str, command: str) -> None:
    """(P-WATCHDOG) (P-ROS-DEAD-MAN) It would go on by itself for ever."""
    prefix = fresh_prefix()
    with peer(kind, prefix):
        watching = driver(prefix, positioning_topic=Topic(topic="odom", type="Odometry"))
        watching._links = watching._linked()
        while watching.sense(time.monotonic()) is None:
            time.sleep(0.01)
        with robot(prefix, command) as process:
            until(watching, lambda s: s.velocity_mps[0] > 0.9 * SPEED_MPS)
            process.kill()
            killed_at = time.monotonic()
            until(watching, stands)
            assert time.monotonic() - killed_at < LIMITS.watchdog_s + 0.5


@pytest.mark.slow
def test_the_vehicle_of_a_stuck_robot_stands_until_it_is_back() -> None:
    """(P-WATCHDOG)"""
    prefix = fresh_prefix()
    with peer("runaway", prefix):
        watching = driver(prefix, positioning_topic=Topic(topic="odom", type="Odometry"))
        watching._links = watching._linked()
        while watching.sense(time.monotonic()) is None:
            time.sleep(0.01)
        with robot(prefix, "Twist") as process:
            until(watching, lambda s: s.velocity_mps[0] > 0.9 * SPEED_MPS)
            process.send_signal(signal.SIGSTOP)
            stopped_at = time.monotonic()
            until(watching, stands)
            assert time.monotonic() - stopped_at < LIMITS.watchdog_s + 0.5
            process.send_signal(signal.SIGCONT)
            until(watching, lambda s: s.velocity_mps[0] > 0.9 * SPEED_MPS)


if __name__ == "__main__":
    drive(*sys.argv[1:])
