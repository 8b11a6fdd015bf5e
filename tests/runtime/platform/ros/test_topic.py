"""The localiser of a topic, by a graph that a test holds in hand; and over DDS."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.localisers import topic
from koord.runtime.drivers.localisers.topic import TopicLocaliser, TopicOptions
from koord.runtime.motion.libraries import missing
from tests.runtime.platform.ros.test_heard import WORLD, HeldGraph, pose
from tests.runtime.platform.ros2.peers import DOMAIN, fresh_prefix, peer


def localiser(**options: Any) -> TopicLocaliser:
    made = msgspec.convert({"topic": "/pose", **options}, TopicOptions)
    return TopicLocaliser(Device(3, Vehicle("car", "CAR"), WORLD, (0.0, 0.0, 0.0), options=made))


class Heard:
    """An open localiser, and its topic."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **options: Any) -> None:
        self.graph: Any = HeldGraph()
        monkeypatch.setattr(topic, "joined", lambda _: self.graph)
        self.localiser = localiser(**options)
        self.localiser.open(10.0)
        self.graph.ends["pose"].says.clear()

    def hear(self, message: Any) -> None:
        self.graph.ends["pose"].says.append(message)


def test_a_pose_counts_from_the_tick_that_hears_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """(P-LOCATE-TOPIC)"""
    one = Heard(monkeypatch)
    assert one.localiser.locate(10.0) is None
    one.hear(pose(0.5, at_s=77.0))
    located = one.localiser.locate(10.1)
    assert located is not None
    assert located.position_m == (0.5, 0.0, 0.0)
    assert located.measured_at_s == 10.1
    assert one.localiser.locate(10.2) == located
    made: Any = one.localiser
    assert made.remarks == ()
    one.localiser.locate(10.7)
    assert "nothing is said on `/pose` any more" in made.remarks[0]
    one.localiser.close()
    assert one.graph.closed


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing_here(name: str) -> object:
        raise missing("cyclonedds", "ros2")

    monkeypatch.setattr(topic, "import_module", missing_here)
    with pytest.raises(DriverError, match="cyclonedds is needed") as caught:
        localiser().open(10.0)
    assert "pip install" in caught.value.hint


@pytest.mark.parametrize(
    ("wrong", "told"),
    [(pose(5.0, frame="odom"), "in the frame `odom`"), (pose(5.0, w=0.0), "length 0")],
)
def test_what_is_in_another_frame_or_is_no_pose_does_not_count(
    wrong: Any, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-LOCATE-TOPIC)"""
    one = Heard(monkeypatch)
    one.hear(pose(0.5))
    located = one.localiser.locate(10.1)
    one.hear(wrong)
    assert one.localiser.locate(10.2) == located
    assert told in one.localiser.remarks[0]


def test_the_first_pose_has_to_be_in_the_frame_that_is_stated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-LOCATE-TOPIC)"""
    one = Heard(monkeypatch, frame="world")
    one.hear(pose(0.5))
    assert one.localiser.locate(10.1) is None
    assert "in the frame `map`, not in `world`" in one.localiser.remarks[0]


def test_names_are_those_of_the_published_middleware() -> None:
    """(P-LOCATE-TOPIC)"""
    assert localiser(topic="/vrpn_client_node/").wire.told == "/vrpn_client_node/car/pose"
    assert localiser(topic="/cf{pid}/pose").wire.told == "/cf3/pose"
    with pytest.raises(DriverError, match="does not fit"):
        localiser(type="Twist")


def test_poses_come_over_dds() -> None:
    """(P-LOCATE-TOPIC) The node is a process of its own."""
    prefix = fresh_prefix()
    with peer("car", prefix):
        made = localiser(topic=f"/{prefix}/pose", domain=DOMAIN)
        made.open(time.monotonic())
        end_s = time.monotonic() + 30.0
        while (located := made.locate(time.monotonic())) is None:
            assert time.monotonic() < end_s, made.remarks
            time.sleep(0.01)
        assert located.position_m == (0.0, 0.0, 0.0)
        made.close()
        nobody = localiser(topic=f"/{prefix}/nowhere", domain=DOMAIN)
        nobody.open(time.monotonic())
        assert nobody.locate(time.monotonic()) is None
        assert f"nobody publishes `/{prefix}/nowhere`" in nobody.remarks[0]
        nobody.close()
