"""Drivers of koord's own pass the kit, against processes on the other side."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

import koord
from koord.testing.conformance import KNOWN
from tests.runtime.platform.ros1.peers import rospy_python

LIBRARIES = {
    "ardupilot": "pymavlink",
    "crazyflie": "cflib",
    "px4": "pymavlink",
    "ros1": "rospy",
    "ros2": "cyclonedds",
}


def conformed(peer: str, *only: str) -> koord.Conformance:
    if peer == "ros1":
        rospy_python()
    elif find_spec(LIBRARIES[peer]) is None:
        pytest.skip(f"pip install 'koord[{KNOWN[peer].driver}]'")
    return koord.conform(peer=peer, only=only)


def test_every_peer_is_tested() -> None:
    assert set(KNOWN) == set(LIBRARIES)


def test_what_takes_no_time_is_seen_of_an_autopilot() -> None:
    told = conformed("px4", "opens", "options", "capabilities", "pose", "stays", "ports", "battery")
    assert told.ok, told.failed
    assert told.count("passed") == 7


@pytest.mark.slow
@pytest.mark.parametrize("peer", sorted(KNOWN))
def test_a_driver_passes_every_check_against_its_peer(peer: str) -> None:
    told = conformed(peer)
    assert told.failed == ()
    left_out = {one.check for one in told.findings if one.verdict.value == "skipped"}
    assert left_out <= {"battery", "lands"}
