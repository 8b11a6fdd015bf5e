"""Drivers of koord's own pass the kit, against processes on the other side."""

from __future__ import annotations

from collections.abc import Collection
from importlib.util import find_spec

import pytest

import koord
from koord.testing.conformance import KNOWN
from koord.testing.conformance.running import NAMES
from tests.runtime.platform.ros1.peers import rospy_python
from tests.testing.alone import failing_alone

LIBRARIES = {
    "ardupilot": "pymavlink",
    "crazyflie": "cflib",
    "px4": "pymavlink",
    "ros1": "rospy",
    "ros2": "cyclonedds",
}


#: So many groups of checks at once keep a test short, and two cores free of peers of others.
JOBS = 4

#: What there is no vehicle for: cars do not fly, and some tell of no battery.
CARS = {"battery", "lands"}


def conformed(peer: str, *only: str, jobs: int = 1) -> koord.Conformance:
    if peer == "ros1":
        rospy_python()
    elif find_spec(LIBRARIES[peer]) is None:
        pytest.skip(f"pip install 'koord[{KNOWN[peer].driver}]'")
    return koord.conform(peer=peer, only=only, jobs=jobs)


def passes_all(peer: str, left_out: Collection[str] = ()) -> None:
    """Assert that a driver passes every check against its peer. (P-KIT) (P-KIT-JOBS)"""
    told = conformed(peer, jobs=JOBS)
    assert failing_alone(told, lambda only: conformed(peer, *only)) == ()
    assert [one.check for one in told.findings] == list(NAMES)
    skipped = {one.check for one in told.findings if one.verdict.value == "skipped"}
    assert skipped == set(left_out)


def test_every_peer_is_tested() -> None:
    assert set(KNOWN) == set(LIBRARIES)


def test_what_takes_no_time_is_seen_of_an_autopilot() -> None:
    told = conformed("px4", "opens", "options", "capabilities", "pose", "stays", "ports", "battery")
    assert told.ok, told.failed
    assert told.count("passed") == 7


@pytest.mark.slow
def test_checks_side_by_side_find_what_they_find_one_after_the_other() -> None:
    """(P-KIT-JOBS)"""
    only = ("opens", "pose", "second", "blocks", "options")
    told = conformed("px4", *only, jobs=3)
    assert told.ok, told.failed
    assert [one.check for one in told.findings] == [one for one in NAMES if one in only]


@pytest.mark.slow
def test_the_driver_of_px4_passes_every_check() -> None:
    passes_all("px4")


@pytest.mark.slow
def test_the_driver_of_ardupilot_passes_every_check() -> None:
    passes_all("ardupilot")


@pytest.mark.slow
def test_the_driver_of_crazyflies_passes_every_check() -> None:
    passes_all("crazyflie")


@pytest.mark.slow
def test_the_driver_of_ros_1_passes_every_check() -> None:
    passes_all("ros1", CARS)


@pytest.mark.slow
def test_the_driver_of_ros_2_passes_every_check() -> None:
    passes_all("ros2", CARS)
