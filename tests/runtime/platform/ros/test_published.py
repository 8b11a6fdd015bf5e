"""Configurations of the published middleware drive vehicles as they stand. (P-ROS-PUBLISHED)"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

import koord
from koord.api.drivers import localiser_registry, registry
from koord.api.undriven import drivers_of
from koord.runtime.configuration.checking import load
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros2.driver import Ros2Driver
from koord.syntax.source import Source
from tests.runtime.platform.ros1 import peers as ros1
from tests.runtime.platform.ros2 import peers as dds
from tests.runtime.platform.ros2 import rclpy_peers as ros2

#: As the published ones are written: no world, no key, nowhere that robots begin.
CONFIGURATION = """\
leader_pid: 0
udp_bcast_ip: 127.255.255.255
udp_port: 61820
agents:
    - {pid: 0, on_device: device0, motion_automaton: MoatTestCar}
    - {pid: 1, on_device: device1, motion_automaton: MoatHectorQuadrotor}
devices:
    device0:
        bot_type: CAR
        ip: 127.0.0.1
        port: 61821
        motion: &moat
            ros_node_prefix: 'waypoint_node'
            queue_size: 1
            waypoint_topic: {topic: 'waypoint', type: PoseStamped}
            reached_topic: {topic: 'reached', type: String}
            positioning_topic: {topic: '/vrpn_client_node/', type: PoseStamped}
            planner: SimplePlanner
            motion_automata: [MoatTestCar]
    device1:
        bot_type: QUAD
        ip: 127.0.0.1
        port: 61822
        motion:
            <<: *moat
            motion_automata: [MoatTestDrone, MoatHectorQuadrotor]
"""

#: Each goes to a place of its own, and stops there.
PROGRAM = """\
param pos[] places = [pos(1, 0.5, 0), pos(-1, -0.5, 1.2)]

using Motion:
    sensors:
        bool reached
    actuators:
        pos target

local:
    bool sent = false

Go:
    pre: not sent
    eff:
        sent = true
        Motion.target = places[pid]

End:
    pre: sent and Motion.reached
    eff:
        trystop()
"""


def drivers(text: str) -> tuple[dict[int, Any], dict[int, Any], list[str]]:
    """What makes the drivers of a configuration, their options, and what is wrong."""
    found, problems = drivers_of(load(Source("run.yaml", text)), registry(), localiser_registry())
    return dict(found.made), dict(found.options), [problem.message for problem in problems]


@pytest.fixture
def of_ros_2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_VERSION", "2")


def test_a_device_that_names_topics_is_driven_by_the_ros_that_is_set_up(of_ros_2: None) -> None:
    made, options, problems = drivers(CONFIGURATION)
    assert problems == []
    assert made == {0: Ros2Driver, 1: Ros2Driver}
    assert all(one.motion_automaton is not None for one in options.values())


@pytest.mark.parametrize(
    ("was", "wrong", "message"),
    [
        ("MoatTestCar", "MoatOfNobody", "device0: Invalid enum value 'MoatOfNobody'"),
        (
            "'waypoint'",
            "'2nd'",
            "device0: `/device0/waypoint_node/2nd` (waypoint_topic) is no name",
        ),
        (
            "'waypoint'",
            "'/waypoint'",
            "robots 0 and 1 would both move `/waypoint`",
        ),
    ],
)
def test_what_cannot_be_is_told_before_the_run(
    was: str, wrong: str, message: str, of_ros_2: None
) -> None:
    _, _, problems = drivers(CONFIGURATION.replace(was, wrong))
    assert any(problem.startswith(message) for problem in problems), problems


@pytest.mark.parametrize("is_checked", [True, False])
def test_a_library_that_is_missing_fails_what_drives_alone(
    is_checked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(P-NOTHING-INVENTED)"""
    monkeypatch.delitem(sys.modules, "koord.runtime.drivers.ros1.driver", raising=False)
    monkeypatch.setattr(library, "is_installed", lambda: False)
    monkeypatch.setenv("ROS_VERSION", "1")
    source = Source("run.yaml", CONFIGURATION)
    if is_checked:
        report = koord.check_configuration(source)
        assert report.ok
        problems = [one for one in report.diagnostics if one.code == "K954"]
    else:
        _, problems = drivers_of(load(source), registry(), localiser_registry())
    (told,) = problems  # once for both robots
    assert told.code == ("K954" if is_checked else "K950")
    assert CONFIGURATION.splitlines()[told.span.line - 1].strip() == "bot_type: CAR"
    assert told.message.startswith("rospy is needed for this and is not installed")
    assert str(told.hint).startswith("install it with: apt-get install python3-rospy")


def test_computers_may_have_masters_of_ros_1_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not library.is_installed():
        pytest.skip(f"rospy is not installed: run .ci/peers, or {library.INSTALL}")
    monkeypatch.setenv("ROS_VERSION", "1")
    shared = CONFIGURATION.replace("'waypoint'", "'/waypoint'")
    message = "robots 0 and 1 would both move `/waypoint`"
    assert drivers(shared)[2] == [message]
    elsewhere = shared.replace("127.0.0.1\n        port: 61822", "10.0.0.7\n        port: 61822")
    assert drivers(elsewhere)[2] == []
    bot = "        bot_type:"
    one = elsewhere.replace(
        bot, "        driver: ros1\n        options: {master: 'http://a:1'}\n" + bot
    )
    assert drivers(one)[2] == [message]


# --- with nodes in processes of their own ---------------------------------------------------------

KOORD = (sys.executable, "-m", "koord")

Node = Callable[[str, str], AbstractContextManager[Any]]


@contextmanager
def of_rospy(folder: Path) -> Iterator[tuple[Node, dict[str, str]]]:
    def node(prefix: str, pose: str) -> AbstractContextManager[Any]:
        return ros1.node("follower", prefix, folder, pose, name=pose.split("/")[2])

    with ros1.master(folder):
        yield node, ros1.environment(folder)


@contextmanager
def of_rclpy(folder: Path) -> Iterator[tuple[Node, dict[str, str]]]:
    def node(prefix: str, pose: str) -> AbstractContextManager[Any]:
        return ros2.node("follower", prefix, dds.DOMAIN, pose)

    told = {"ROS_VERSION": "2", "ROS_DOMAIN_ID": str(dds.DOMAIN), "CYCLONEDDS_URI": dds.LOOPBACK}
    ros2.rclpy_python()
    yield node, told


@pytest.mark.slow
@pytest.mark.parametrize("graph", [of_rospy, of_rclpy])
def test_a_published_configuration_leads_vehicles_of_the_published_kind(
    graph: Callable[[Path], AbstractContextManager[tuple[Node, dict[str, str]]]], tmp_path: Path
) -> None:
    (tmp_path / "visit.krd").write_text(PROGRAM, encoding="utf-8")
    (tmp_path / "run.yaml").write_text(CONFIGURATION, encoding="utf-8")
    root = str(Path(__file__).parents[4])
    with graph(tmp_path) as (node, told), ExitStack() as vehicles:
        for name in ("device0", "device1"):
            pose = f"/vrpn_client_node/{name}/pose"
            vehicles.enter_context(node(f"{name}/waypoint_node", pose))
        done = subprocess.run(
            [*KOORD, "deploy", "visit.krd", "run.yaml", "--all-local", "--arm", "--yes"],
            cwd=tmp_path,
            env={**os.environ, **told, "PYTHONPATH": root},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all robots have stopped" in done.stdout
