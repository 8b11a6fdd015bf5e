"""A run in the forms of other tools: what is in them is what was recorded."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.motion.world import Box, Disc, Polygon, World
from koord.runtime.shapes import Array, Enumeration
from koord.sim.files import plots, rosbag, space
from koord.sim.run_log import (
    SHARED,
    WHOLE,
    Header,
    LoggedAgent,
    LoggedChange,
    LoggedHome,
    LoggedVariable,
    RunLog,
    RunLogger,
    map_variable,
    turns_of,
)
from tests.sampling import first
from tests.sim.browser import browser, in_a_browser
from tests.sim.recorded import task


@pytest.fixture(scope="module")
def recording() -> RunLog:
    recording = task().recording
    again = RunLogger(recording.header).recording
    for name in ("times_s", "poses", "separations_m", "rounds", "paths", "tasks", "ending"):
        setattr(again, name, getattr(recording, name))
    recorder = RunLogger(again.header)
    recorder.recording = again
    recorder.violation(3.0, "separation", "too near", (0, 1), (1.0, 2.0, 0.5))
    return again


@pytest.fixture
def cluttered() -> RunLog:
    """A world with an obstacle of each shape, without robots."""
    obstacles = (
        Box((1, 1, 0), (2, 3, 1)),
        Disc((4, 4), 0.5),
        Polygon(((5, 5), (7, 5), (6, 6.5)), 0.5, 9.0),
    )
    world = World((0, 0, 0), (8, 8, 3), obstacles)
    return RunLogger(Header("c.krd", "", 0.1, 0, world, (), (), ())).recording


# --- rosbag2 --------------------------------------------------------------------------------------


def test_a_rosbag_is_whole_each_time_that_it_has_grown(recording: RunLog, tmp_path: Path) -> None:
    """As somebody finds it who looks at it then, or after a kill."""
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    bag = rosbag.PartBag(recording, tmp_path / "run.part.rosbag2")
    bag.grow()
    shutil.copytree(tmp_path / "run.part.rosbag2", tmp_path / "found")
    bag.close()
    with AnyReader(
        [tmp_path / "found"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)
    ) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) > len(recording.times_s)


def test_a_rosbag_has_poses_events_and_violations(recording: RunLog, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    folder = tmp_path / "run.rosbag2"
    folder.mkdir()
    for name, data in rosbag.rosbag_of(recording, folder.name).items():
        (folder / name).write_bytes(data)
    read: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            read.setdefault(connection.topic, []).append((time_ns, message))
    assert set(read) == {
        "/tf",
        "/scene",
        "/events",
        "/violations",
        *(f"/robots/robot_{k}/pose" for k in range(3)),
    }
    for (time_ns, message), time_s, poses in zip(
        read["/robots/robot_1/pose"], recording.times_s, recording.poses, strict=True
    ):
        assert time_ns == pytest.approx(time_s * 1e9)
        here = message.pose.position
        assert (here.x, here.y, here.z) == pytest.approx(poses[1, :3].tolist())
        turn = message.pose.orientation
        told = (turn.w, turn.x, turn.y, turn.z)
        assert told == pytest.approx(turns_of(poses)[1].tolist(), abs=1e-6)
    ran = [json.loads(message.data) for _, message in read["/events"]]
    events = sum((done.deeds >= 0).sum() for done in recording.rounds)
    assert sum(len(one["ran"]) for one in ran) == events
    assert json.loads(read["/violations"][0][1].data)["robots"] == [0, 1]
    kinds = {marker.ns for marker in read["/scene"][0][1].markers}
    assert kinds == {"bounds", "robots", "tasks"}


def test_a_rosbag_has_every_obstacle(cluttered: RunLog) -> None:
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE).types
    ((_, _, scene),) = rosbag._Messages(cluttered, types).scenery()
    box, disc, polygon = [marker for marker in scene.markers if marker.ns == "obstacles"]
    assert (box.pose.position.x, box.pose.position.y, box.scale.z) == (1.5, 2.0, 1.0)
    assert (disc.scale.x, disc.scale.z) == (1.0, 3.0)
    assert {point.z for point in polygon.points} == {0.5, 3.0}  # no higher than the world


# --- pictures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "begins"), first(2, [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
)
def test_a_picture_is_of_its_form_and_repeats(recording: RunLog, form: str, begins: bytes) -> None:
    pytest.importorskip("matplotlib")
    picture = plots.plot_of(recording, form)
    assert picture.startswith(begins)
    if form == ".png":
        assert picture == plots.plot_of(recording, form)


def test_maps_are_those_of_their_times() -> None:
    pytest.importorskip("matplotlib")
    recorder = RunLogger(mapped(3))
    for k in range(10):
        changes = [LoggedChange(SHARED, 0, WHOLE, (0,) * 12)] if k == 0 else []
        changes += [LoggedChange(SHARED, 0, k, 2 if k == 5 else 1)] if k else []
        recorder.round(k, 0.1 * k, np.full(0, -1, np.int16), changes)
    recording = recorder.recording
    number = map_variable(recording.header)
    assert number == 0
    maps = plots.maps_of(recording, number)
    assert [time_s for time_s, _ in maps] == pytest.approx([0.0, 0.3, 0.6, 0.9])
    assert [int((cells > 0).sum()) for _, cells in maps] == [0, 3, 6, 9]
    last = maps[-1][1]
    assert last.shape == (3, 4)
    assert last[1, 1] == 2  # cell 5 is in the second row
    assert plots.plot_of(recording, ".png")


def test_a_variable_of_another_size_is_no_map() -> None:
    assert map_variable(mapped(2)) is None


def mapped(rows: int) -> Header:
    """A program that maps a world of four by three cells, with room for four times ``rows``."""
    world = World((0, 0, 0), (4, 3, 2), (Box((1, 1, 0), (2, 2, 1)),), cell_m=1.0)
    cells = Array(Enumeration("Cell", ("unknown", "free", "wall")), 4 * rows)
    shared = (LoggedVariable("map", LoggedHome.ALLWRITE, cells),)
    return Header("m.krd", "", 0.1, 0, world, (LoggedAgent("M", (), ()),), (), shared)


# --- in space -------------------------------------------------------------------------------------


def test_the_page_in_space_is_one_file(
    recording: RunLog, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("viser")
    page = space.space_of(recording)
    assert page.startswith(b"<!doctype html>".upper()) or b"<html" in page[:200].lower()
    assert b"__VISER_EMBED_DATA__=" in page
    assert b'src="http' not in page
    assert len(page) < 2_000_000
    assert capfd.readouterr().out == ""


class _Drawn:
    """A scene that notes what is drawn: names with texts and places."""

    def __init__(self) -> None:
        self.balls: dict[str, tuple[float, ...]] = {}
        self.labels: dict[str, str] = {}
        self.heights: dict[str, float] = {}

    def add_icosphere(self, name: str, _: float, *, position: tuple[float, ...], **__: Any) -> None:
        self.balls[name] = position

    def add_label(self, name: str, text: str, *, position: tuple[float, ...]) -> None:
        self.labels[name], self.heights[name] = text, position[2]


def test_violations_in_space_are_where_they_are_or_where_robots_are(recording: RunLog) -> None:
    scene, (placed,) = _Drawn(), recording.violations
    shown: list[tuple[float, float, float]] = []
    space._draw_violations(scene, recording, [placed], 0, shown)
    space._draw_violations(scene, recording, [replace(placed, place=None)], 20, shown)
    assert scene.balls.pop("/violations/0") == (1.0, 2.0, 0.5)
    for robot, place in enumerate(scene.balls.values()):
        assert place == pytest.approx(recording.poses[20][robot, :3].tolist())
    assert len(scene.balls) == 2
    assert scene.labels == {
        "/violations/0/label": "▲ separation, 3.0 s",
        "/violations/1/label": "▲ separation, 3.0 s",
    }


def test_labels_of_violations_in_space_do_not_cover_each_other(recording: RunLog) -> None:
    """Those of one time and place are one label, that of a later one is above; orders are one."""
    scene, (one,) = _Drawn(), recording.violations
    turned = replace(one, robots=(1, 0), place=(3.0, 2.0, 0.5))
    other, later = replace(one, claim="invariant A"), replace(one, time_s=4.0)
    shown: list[tuple[float, float, float]] = []
    space._draw_violations(scene, recording, [one, turned, other], 0, shown)
    space._draw_violations(scene, recording, [later], 0, shown)
    assert list(scene.balls.values()) == [(1.0, 2.0, 0.5), (3.0, 2.0, 0.5), (1.0, 2.0, 0.5)]
    assert scene.labels == {
        "/violations/0/label": "▲ separation, invariant A, 3.0 s",
        "/violations/2/label": "▲ separation, 4.0 s",
    }
    assert scene.heights["/violations/2/label"] > scene.heights["/violations/0/label"] + 0.2


@pytest.mark.slow
@in_a_browser
def test_the_timeline_in_space_leads_to_violations(recording: RunLog, tmp_path: Path) -> None:
    """Marks and list are there, and lead to where the violation is drawn: so do the keys."""
    pytest.importorskip("viser")
    again = RunLogger(recording.header).recording
    for name in ("times_s", "poses", "tasks"):
        setattr(again, name, getattr(recording, name))
    (one,) = recording.violations
    told = "<b>too near</b></script>"
    again.violations = [one, replace(one, robots=(1, 0)), replace(one, time_s=6.04, words=told)]
    page = tmp_path / "space.html"
    page.write_bytes(space.space_of(again))
    with browser(own="file:") as tab:
        tab.open(page.as_uri(), 'Boolean(document.querySelector("#koord-marks"))')
        # Nothing is drawn from here on: without a graphics card that would take most of the time.
        tab.ask("(window.requestAnimationFrame = () => 0)")
        marks, rows = (f"[...document.querySelectorAll('#koord-{of} button')]" for of in _LISTS)
        now = "Number(document.querySelector('[role=slider]').getAttribute('aria-valuenow'))"
        assert tab.ask(f"{marks}.map((mark) => mark.title)") == [
            "3 s: separation, robots 0 and 1: too near",
            f"6.04 s: separation, robots 0 and 1: {told}",
        ]
        assert tab.ask(f"{rows}.length") == 2
        assert tab.ask("document.querySelector('#koord-violations summary').textContent") == (
            "▲ 2 violations n p"
        )
        (left, right), (start, width) = tab.ask(
            f"[{marks}.map((mark) => mark.getBoundingClientRect()).map((box) => box.x + box.width"
            " / 2), ((box) => [box.x, box.width])(document.querySelector('.mantine-Slider-root')"
            ".getBoundingClientRect())]"
        )
        times = [again.times_s[k] for k in space._shown_samples(again)]
        first, shown = (next(time for time in times if time > at - 1e-9) for at in (3.0, 6.04))
        assert left == pytest.approx(start + width * first / again.times_s[-1], abs=1)
        assert right == pytest.approx(start + width * shown / again.times_s[-1], abs=1)
        tab.ask(f"{marks}[1].click()")
        tab.until(f"Math.abs({now} - {shown}) < 1e-6")
        assert tab.ask(f"{rows}[1].className") == "now"
        for key, time_s in (("p", first), ("n", shown)):
            tab.press(key)
            tab.until(f"Math.abs({now} - {time_s}) < 1e-6")
        tab.ask(f"{rows}[0].click()")
        tab.until(f"Math.abs({now} - {first}) < 1e-6")


_LISTS = ("marks", "violations")


def test_prisms_are_closed_surfaces() -> None:
    vertices, faces = space._prism(Box((1, 1, 0), (2, 3, 1)), World())
    edges: dict[tuple[int, int], int] = {}
    for a, b, c in faces.tolist():
        for edge in ((a, b), (b, c), (c, a)):
            key = (min(edge), max(edge))
            edges[key] = edges.get(key, 0) + 1
    assert set(edges.values()) == {2}
    assert vertices.min(0).tolist() == [1, 1, 0]
    assert vertices.max(0).tolist() == [2, 3, 1]


def test_every_obstacle_is_a_surface_in_space(cluttered: RunLog) -> None:
    world = cluttered.header.world
    for obstacle, (width, depth, height) in zip(
        world.obstacles, ((1, 2, 1), (1, 1, 3), (2, 1.5, 2.5)), strict=True
    ):
        vertices, faces = space._prism(obstacle, world)
        assert np.ptp(vertices, axis=0) == pytest.approx((width, depth, height), abs=0.01)
        assert faces.max() == len(vertices) - 1
    pytest.importorskip("viser")
    assert space.space_of(cluttered)


# --- rerun ----------------------------------------------------------------------------------------


def test_rerun_finds_nothing_wrong(recording: RunLog, cluttered: RunLog, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from koord.sim.files.rerun import rrd_of

    path = tmp_path / "run.rrd"
    tool = shutil.which("rerun", path=Path(sys.executable).parent)
    assert tool is not None
    environment = {**os.environ, "HOME": str(tmp_path)}
    for one in (cluttered, recording):
        path.write_bytes(rrd_of(one))
        checked = subprocess.run(
            [tool, "rrd", "verify", str(path)], capture_output=True, text=True, env=environment
        )
        assert "1 file verified without error" in checked.stdout + checked.stderr
    told = subprocess.run(
        [tool, "rrd", "print", "-vvv", str(path)], capture_output=True, text=True, env=environment
    )
    assert "[[0.0, 0.0, 0.0, 1.0]]" in told.stdout  # a drone that stands upright: w is last
    for name in ("/world/robots/2", "/world/tasks", "/world/paths/0", "/log"):
        assert name in told.stdout
