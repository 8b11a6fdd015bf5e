"""The page of a run: what is embedded in it, and what it does in a browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Drone
from koord.runtime.motion.world import Disc, World
from koord.runtime.shapes import FLOAT
from koord.sim.packing import pack
from koord.sim.run_log import (
    Header,
    LoggedAgent,
    LoggedChange,
    LoggedHome,
    LoggedVariable,
    LogSizes,
    RunLog,
    RunLogger,
    TaskState,
)
from koord.sim.run_log import LoggedRobot as Robot
from koord.sim.viewing import page_of
from tests.sampling import first
from tests.sim.browser import Tab, in_a_browser, one_tab
from tests.sim.recorded import lineform, task
from tests.sim.unpacking import data_of, unpacked

WORLD = World((0, 0, 0), (8, 6, 3), (Disc((4, 3), 0.5, 0, 2),), ((1, 1, 0), (7, 5, 1)))


@pytest.fixture(scope="module")
def recording() -> RunLog:
    return task().recording


# --- what is embedded -----------------------------------------------------------------------------


def test_poses_come_back(recording: RunLog) -> None:
    found = unpacked(data_of(page_of(recording)))
    assert np.allclose(found.times_s, recording.times_s, atol=5e-4)
    assert np.allclose(found.poses[..., :3], recording.stacked()[..., :3], atol=6e-4)
    turn = found.poses[..., 3] - recording.stacked()[..., 3]
    assert np.abs(np.angle(np.exp(1j * turn))).max() < 2e-3
    tilting = recording.header.tilting
    assert tilting == (1, 2)
    assert np.allclose(found.tilts, recording.stacked()[:, tilting, 4:], atol=5e-3)
    assert np.abs(found.tilts).max() > 0.05


def test_rounds_paths_and_tasks_come_back(recording: RunLog) -> None:
    found = unpacked(data_of(page_of(recording)))
    assert np.array_equal(found.deeds, [done.deeds for done in recording.rounds])
    assert len(found.paths) == len(recording.paths)
    for (time_s, robot, points), planned in zip(found.paths, recording.paths, strict=True):
        assert (robot, round(planned.time_s, 3)) == (planned.robot, time_s)
        assert np.allclose(points, planned.points, atol=6e-4)
    changes = [[list(c[:3]) for c in done.changes] for done in recording.rounds]
    assert [[c[:3] for c in r[2]] for r in found.document["rounds"]] == changes
    tasks = [[round(c.time_s * 1000), c.task, c.state, c.robot] for c in recording.tasks]
    assert found.document["tasks"] == tasks


def test_the_header_is_json_that_says_all_shapes(recording: RunLog) -> None:
    header = unpacked(data_of(page_of(recording))).document["header"]
    of_task = header["shared"][1]["shape"]
    assert of_task["size"] == 6
    fields = [name for name, _ in of_task["array"]["fields"]]
    assert fields == ["loc", "assigned", "assignedTo", "id"]
    assert header["text"] == recording.header.text


def test_packs_in_pieces_are_one_pack(recording: RunLog) -> None:
    whole = unpacked(pack(recording, LogSizes(), recording.sizes))
    until = LogSizes(50, 40, 3, 2, 0)
    first = unpacked(pack(recording, LogSizes(), until))
    header = first.document["header"]
    second = unpacked(pack(recording, until, recording.sizes), header)
    assert "header" not in second.document
    assert first.document["ending"] is None
    assert second.document["ending"] == "all robots have stopped"
    assert np.array_equal(np.concatenate([first.poses, second.poses]), whole.poses)
    assert np.array_equal(np.concatenate([first.deeds, second.deeds]), whole.deeds)
    assert first.document["rounds"] + second.document["rounds"] == whole.document["rounds"]
    assert len(first.paths) + len(second.paths) == len(whole.paths)


def test_headings_may_turn_any_number_of_times() -> None:
    recorder = RunLogger(header(1))
    turns = np.linspace(0, 300, 400)
    for k, angle in enumerate(turns):
        wrapped = np.angle(np.exp(1j * angle))
        recorder.sample(0.1 * k, np.array([[1.0, 2.0, 0.5]]), np.array([wrapped]))
    found = unpacked(pack(recorder.recording, LogSizes(), recorder.recording.sizes))
    assert np.abs(np.angle(np.exp(1j * (found.poses[:, 0, 3] - turns)))).max() < 2e-3


def test_what_lies_outside_of_the_world_is_drawn_at_its_edge() -> None:
    recorder = RunLogger(header(1))
    recorder.sample(0.0, np.array([[1e6, -1e6, 0.0]]), np.zeros(1))
    (x, y, _, _) = unpacked(data_of(page_of(recorder.recording))).poses[0, 0]
    assert x > 8
    assert y < 0


@pytest.mark.parametrize("evil", ["</script><script>x()</script>", "{{style}}", "a&b<c>"])
def test_names_and_texts_cannot_leave_their_place(evil: str) -> None:
    recorder = RunLogger(header(1, program=evil))
    page = page_of(recorder.recording).decode()
    assert page.count("<script") == 2
    assert "x()" not in page.replace("&lt;/script&gt;&lt;script&gt;x()&lt;/script&gt;", "")
    assert unpacked(data_of(page.encode())).document["header"]["program"] == evil


@pytest.mark.parametrize("rounds", first(1, [120, 1200]))
def test_a_page_of_16_robots_and_two_minutes_is_small(rounds: int) -> None:
    page = page_of(lineform(16, rounds).recording)
    assert len(page) < 100_000 + 750 * rounds


def header(robots: int, program: str = "a.krd", world: World = WORLD) -> Header:
    team = tuple(
        Robot(f"robot {k}", 0, "drone" if k % 2 else "car", *_LOOKS[k % 2]) for k in range(robots)
    )
    agent = LoggedAgent("A", ("Go", "Wait"), (LoggedVariable("speed", LoggedHome.LOCAL, FLOAT),))
    return Header(program, "Go:\n    eff: x = 1\n", 0.1, 7, world, (agent,), team, (), 0.6)


_LOOKS: tuple[Any, ...] = ((Car.LOOK, 0.48, 0.58, 0.31, 0.165), (Drone.LOOK, 0.29, 0.58, 0.58))


def circling(robots: int, seconds: float, broken: tuple[float, ...] = ()) -> RunLog:
    """Robots on circles, with an event in every fifth round; the more, the wider their world."""
    wide = max(1.0, (robots / 10) ** 0.5)
    recorder = RunLogger(header(robots, world=replace(WORLD, high=(8 * wide, 6 * wide, 3))))
    row, rows = np.arange(robots), np.ceil(robots**0.5)
    middle = wide * np.column_stack([8 * (row % rows + 0.5), 6 * (row // rows + 0.5)]) / rows
    for k in range(round(seconds / 0.1) + 1):
        time_s = 0.1 * k
        angle: Floats = 0.7 * time_s + np.arange(robots, dtype=np.float64)
        if recorder.is_due(time_s):
            flat = middle + 0.4 * np.column_stack([np.cos(angle), np.sin(angle)])
            yaw: Floats = angle + np.pi / 2
            place = np.column_stack([flat, np.ones(robots)])
            recorder.sample(time_s, place, yaw, 0.7 + 0.3 * float(np.cos(time_s)))
        deeds = np.where((np.arange(robots) + k) % 5 == 0, 0, -1).astype(np.int16)
        deeds[-1] = -2
        recorder.round(k, time_s, deeds, [LoggedChange(0, 0, -1, 0.5 * k)])
    for time_s in broken:
        recorder.violation(time_s, "separation", "0.41 m apart", (0, 1), (4.0, 5.0, 0.0))
        recorder.violation(time_s, "invariant Slow", "at a.krd:2:5", (1,))
    recorder.task(1.0, 0, TaskState.ASSIGNED, 0)
    recorder.task(2.0, 0, TaskState.DONE, 0)
    recorder.end("time is up")
    return recorder.recording


# --- in a browser ---------------------------------------------------------------------------------

tab = pytest.fixture(scope="module")(one_tab)


@pytest.fixture
def opened(tab: Tab, tmp_path: Path) -> Iterator[Tab]:
    """A page of ten seconds, three robots and two violations; nothing may complain of it."""
    path = tmp_path / "run.html"
    path.write_bytes(page_of(circling(3, 10.0, (3.05, 6.0))))
    tab.complaints.clear()
    tab.open(path.as_uri())
    yield tab
    assert tab.complaints == []


@in_a_browser
def test_the_page_shows_the_run(opened: Tab) -> None:
    assert opened.ask("document.querySelector('h1').textContent") == "a.krd"
    assert "3 robots (2 cars, 1 drone)" in opened.ask("byId('facts').textContent")
    assert opened.ask("page.run.duration") == pytest.approx(10.0)
    assert opened.ask("page.run.speedOf(0, 5)") == pytest.approx(0.28, abs=0.02)
    here = opened.ask("[...page.run.posesAt(4.25, new Float32Array(12))]")
    assert here[0] == pytest.approx(2 + 0.4 * np.cos(0.7 * 4.25), abs=2e-3)
    assert not is_blank(opened, "map")
    assert not is_blank(opened, "lanes")


@in_a_browser
def test_it_plays_and_pauses(opened: Tab) -> None:
    opened.ask("page.setSpeed(4)")
    opened.press(" ")
    assert opened.ask("page.isPlaying") is True
    opened.until("page.time > 0.5")
    opened.press(" ")
    assert opened.ask("page.isPlaying") is False
    stopped = opened.ask("page.time")
    opened.ask("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert opened.ask("page.time") == stopped
    opened.ask("page.setSpeed(64), page.play()")
    opened.until("!page.isPlaying")
    assert opened.ask("page.time") == pytest.approx(10.0)


@in_a_browser
def test_keys_step_and_jump(opened: Tab) -> None:
    def time() -> float:
        found: float = opened.ask("page.time")
        return found

    opened.press("ArrowRight")
    assert time() == pytest.approx(0.1)
    opened.press("ArrowRight", shift=True)
    assert time() == pytest.approx(1.1)
    opened.press("ArrowLeft")
    assert time() == pytest.approx(1.0)
    opened.press("n")
    assert time() == pytest.approx(3.05)
    assert "invariant Slow robot 1: at a.krd:2:5 — and 1 more" in shown_text(opened, "toast")
    opened.press("n")
    assert time() == pytest.approx(6.0)
    opened.press("n")
    assert time() == pytest.approx(6.0)  # there is no further one
    opened.press("p")
    assert time() == pytest.approx(3.05)
    opened.press("End")
    assert time() == pytest.approx(10.0)
    opened.press("Home")
    assert time() == 0
    before = opened.ask("page.speed")
    opened.press("+")
    assert opened.ask("page.speed") > before
    opened.press("-")
    assert opened.ask("page.speed") == before
    opened.press("]")
    assert opened.ask("page.chosen") == 1
    opened.press("?")
    assert opened.ask("byId('keys').open") is True


@in_a_browser
def test_the_timeline_scrubs(opened: Tab) -> None:
    place = opened.ask(
        "(({x, y, width}) => [x, y, width])(byId('timeline').getBoundingClientRect())"
    )
    x, y, width = place
    opened.mouse("mousePressed", x + 84 + (width - 98) / 2, y + 10)
    assert opened.ask("page.time") == pytest.approx(5.0, abs=0.1)
    opened.mouse("mouseMoved", x + 84 + (width - 98) / 4, y + 10)
    opened.mouse("mouseReleased", x + 84 + (width - 98) / 4, y + 10)
    assert opened.ask("page.time") == pytest.approx(2.5, abs=0.1)
    assert opened.ask("byId('timeline').getAttribute('aria-valuenow')") == "2.5"


@in_a_browser
def test_a_click_in_the_world_chooses_a_robot(opened: Tab) -> None:
    opened.ask("page.seek(2), new Promise((done) => requestAnimationFrame(done))")
    x, y = opened.ask(
        "(({x, y}) => [x + page.map.x(page.map.now[8]), y + page.map.y(page.map.now[9])])"
        "(byId('map').getBoundingClientRect())"
    )
    opened.mouse("mousePressed", x, y)
    opened.mouse("mouseReleased", x, y)
    assert opened.ask("page.chosen") == 2
    assert "Robot 2" in shown_text(opened, "pane")


@in_a_browser
def test_variables_are_those_of_the_round(opened: Tab) -> None:
    for time_s, speed in ((4.0, "20.0"), (1.0, "5.0"), (9.9, "49.5")):
        opened.ask(f"page.choose(0), page.seek({time_s})")
        assert f"speed{speed}" in shown_text(opened, "pane")
    opened.ask("page.choose(2)")
    assert "kept out by a lock" in shown_text(opened, "pane")


@in_a_browser
def test_ports_are_named_as_the_program_names_them(
    tab: Tab, recording: RunLog, tmp_path: Path
) -> None:
    path = tmp_path / "run.html"
    path.write_bytes(page_of(recording))
    tab.open(path.as_uri())
    tab.ask("page.choose(0), page.seek(1)")
    told = shown_text(tab, "pane")
    assert "isOnTask" in told
    assert "Motion.path" in told
    assert "Motion_" not in told


@in_a_browser
def test_every_tab_and_layer_can_be_shown_light_and_dark(opened: Tab) -> None:
    for name in ("Shared", "Plot", "Log", "Program", "Robot"):
        opened.ask(f"page.panels.show('{name}')")
        assert shown_text(opened, "pane")
    opened.ask("[...byId('layers').children].forEach((button) => button.click())")
    opened.ask("page.choose(0), page.panels.show('Program')")
    opened.ask("page.seek(1)")  # robot 0 runs Go in every fifth round
    shown_text(opened, "pane")
    assert opened.ask("document.querySelectorAll('.runs').length") == 2
    assert opened.ask("document.querySelector('.broken').textContent") == "    eff: x = 1"
    opened.ask("page.seek(1.1)")
    shown_text(opened, "pane")
    assert opened.ask("document.querySelectorAll('.runs').length") == 0
    light = opened.ask("theme('--panel')")
    opened.press("d")
    assert opened.ask("theme('--panel')") != light


@in_a_browser
def test_rounds_count_as_verify_counts_them(opened: Tab) -> None:
    for time_s, words in ((0.0, "round 1"), (0.95, "round 10"), (9.95, "round 100")):
        opened.ask(f"page.seek({time_s})")
        assert shown_text(opened, "clock").endswith(words)
    opened.press("End")
    assert shown_text(opened, "clock").endswith("after round 100")


@in_a_browser
def test_a_violation_that_is_told_in_both_orders_counts_once(tab: Tab, tmp_path: Path) -> None:
    recorder = RunLogger(header(3))
    recorder.sample(0.0, np.zeros((3, 3)), np.zeros(3))
    recorder.round(0, 0.0, np.full(3, -1, np.int16))
    for robots in ((0, 2), (2, 0), (0, 1)):
        recorder.violation(0.0, "invariant Apart", "at a.krd:1:1", robots)
    recorder.violation(0.1, "invariant Apart", "at a.krd:1:1", (0, 2))
    path = tmp_path / "twice.html"
    path.write_bytes(page_of(recorder.recording))
    tab.open(path.as_uri())
    assert tab.ask("page.run.violations.map((one) => one.robots)") == [[0, 2], [0, 1], [0, 2]]
    assert "▲ 3" in shown_text(tab, "violations")


@in_a_browser
def test_variables_are_drawn_over_time(opened: Tab) -> None:
    opened.ask("page.choose(0), page.panels.show('Plot')")
    plot = "page.panels.plot"
    names = opened.ask(f"{plot}.choices.map((one) => one.name)")
    assert names == ["speed", "speed in m/s", "x in m", "y in m", "height in m"]
    opened.ask("page.seek(4)")
    assert "speed of robot 0 at 0:04.0: 20" in shown_text(opened, "pane")
    points = opened.ask(f"{plot}.points({plot}.choices[0].series[0])")
    assert points[0] == [0, 0]
    assert points[-1] == [10, 50]
    assert [p for p in points if abs(p[0] - 4) < 1e-9][-1] == [4, 20]
    opened.ask(f"{plot}.select.value = '2', {plot}.select.dispatchEvent(new Event('change'))")
    assert "x in m of robot 0" in shown_text(opened, "pane")
    colours = opened.ask(
        f"new Set(new Uint32Array({plot}.canvas.getContext('2d').getImageData(0, 0, 300, 190)"
        ".data.buffer)).size"
    )
    assert colours > 5


@in_a_browser
def test_the_log_lists_what_is_asked_for(opened: Tab) -> None:
    opened.ask("page.panels.show('Log')")
    before = opened.ask("page.panels.journal.found.length")
    opened.ask("document.querySelector('[data-kind=event]').click()")
    events = opened.ask("page.panels.journal.found.filter((one) => one.deed >= 0).length")
    assert events == opened.ask("page.run.deeds.slice(0, 303).filter((deed) => deed >= 0).length")
    assert opened.ask("page.panels.journal.found.length") == before + events
    opened.ask("page.choose(1), page.panels.journal.mine.click()")
    assert set(opened.ask("page.panels.journal.found.map((one) => one.robot ?? 1)")) <= {0, 1}
    opened.ask(
        "page.panels.journal.search.value = 'slow',"
        "page.panels.journal.search.dispatchEvent(new Event('input'))"
    )
    assert opened.ask("page.panels.journal.found.length") == 2
    opened.ask("document.querySelector('.log button').click()")
    assert opened.ask("page.time") == pytest.approx(3.05)


@in_a_browser
def test_a_robot_under_the_mouse_is_told_of(opened: Tab) -> None:
    opened.ask("page.seek(2), new Promise((done) => requestAnimationFrame(done))")
    x, y = opened.ask(
        "(({x, y}) => [x + page.map.x(page.map.now[4]), y + page.map.y(page.map.now[5])])"
        "(byId('map').getBoundingClientRect())"
    )
    opened.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    assert shown_text(opened, "tip").startswith("robot 1 · drone · ")
    assert opened.ask("byId('tip').hidden") is False


@in_a_browser
def test_on_narrow_screens_the_time_is_always_in_sight(opened: Tab) -> None:
    size = {"height": 844, "deviceScaleFactor": 1, "mobile": False}
    try:
        opened.call("Emulation.setDeviceMetricsOverride", width=390, **size)
        shown_text(opened, "clock")
        for scroll in (0, 400, 10_000):
            opened.ask(f"window.scrollTo(0, {scroll})")
            for name in ("play", "timeline"):
                top, bottom = opened.ask(
                    f"(({{top, bottom}}) => [top, bottom])(byId('{name}').getBoundingClientRect())"
                )
                assert 0 <= top < bottom <= 844
        assert opened.ask("document.documentElement.scrollWidth") <= 390
    finally:
        opened.call("Emulation.setDeviceMetricsOverride", width=1400, **{**size, "height": 900})


@in_a_browser
def test_events_of_other_names_look_otherwise(tab: Tab, tmp_path: Path) -> None:
    kinds = (LoggedAgent("A", ("Go", "Wait"), ()), LoggedAgent("B", ("Wait", "Land"), ()))
    two = replace(header(2), agents=kinds)
    two = replace(two, robots=(two.robots[0], replace(two.robots[1], agent=1)))
    recorder = RunLogger(two)
    recorder.sample(0.0, np.zeros((2, 3)), np.zeros(2))
    recorder.round(0, 0.0, np.array([1, 0], np.int16))
    path = tmp_path / "kinds.html"
    path.write_bytes(page_of(recorder.recording))
    tab.open(path.as_uri())
    looks = tab.ask("[[0, 0], [0, 1], [1, 0], [1, 1]].map(([r, d]) => page.run.lookOf(r, d))")
    assert looks == [0, 1, 1, 2]


@in_a_browser
def test_values_are_told_as_programs_write_them(opened: Tab) -> None:
    place = {"record": "pos", "fields": [["x", "float"], ["y", "float"], ["z", "float"]]}
    for shape, value, words in (
        (place, [1, 2.5, 0.12345], "(1.0, 2.5, 0.123)"),
        ({"list": place}, [[0, 0, 0]], "[(0.0, 0.0, 0.0)]"),
        ({"enum": "Mode", "members": ["go", "wait"]}, 1, "wait"),
        ({"map": ["int", "bool"]}, [[3, True]], "{3: true}"),
        ({"record": "T", "fields": [["a", "int"], ["b", "string"]]}, [1, "x"], "{a 1, b x}"),
        ("int", None, "unset"),
        ({"list": "int"}, list(range(100)), "… "),
    ):
        told = opened.ask(f"valueOf({json.dumps(shape)}, {json.dumps(value)}, 60)")
        assert words in told


@in_a_browser
def test_a_page_of_a_whole_task_run(tab: Tab, tmp_path: Path, recording: RunLog) -> None:
    path = tmp_path / "task.html"
    path.write_bytes(page_of(recording))
    tab.complaints.clear()
    tab.open(f"{path.as_uri()}#t=9.5&robot=2")
    assert tab.ask("[page.time, page.chosen]") == [9.5, 2]
    for k, done in enumerate(recording.rounds[:: len(recording.rounds) // 8]):
        number = recording.rounds.index(done)
        (mine,) = [v for v in recording.header.agents[0].variables if v.name == "mine"]
        position = recording.header.agents[0].variables.index(mine)
        known = -1
        for earlier in recording.rounds[: number + 1]:
            for change in earlier.changes:
                if change.robot == k % 3 and change.variable == position:
                    known = int(change.value)  # type: ignore[arg-type]
        assert tab.ask(f"page.run.own[{k % 3}][{position}].at({number})") == known
    assert tab.complaints == []


@in_a_browser
def test_labels_of_near_tasks_cover_nothing(tab: Tab, tmp_path: Path) -> None:
    """A task has one to its right, or else to its left, or a shorter one, or none."""
    near = ((2.0, 3, 1.5), (2.5, 3, 0), (5, 3, 0), (5.0, 4, 0), (5.3, 4, 1), (5.1, 4, 0))
    recorder = RunLogger(header(3, world=replace(WORLD, tasks=near)))
    recorder.sample(0.0, np.ones((3, 3)), np.zeros(3), 1.0)
    recorder.end("time is up")
    path = tmp_path / "run.html"
    path.write_bytes(page_of(recorder.recording))
    tab.open(path.as_uri())
    tab.ask("page.map.scale = 60, page.map.shown.side = true")
    found = tab.ask(
        "page.map.ground.labels(byId('map').getContext('2d'), page.run.tasksAt(0), 6)"
        ".map(({text, x, y, width}) => [text, x, y, width])"
    )
    places = tab.ask(
        "page.run.header.world.tasks.map(([x, y]) => ['', page.map.x(x) - 6, page.map.y(y), 12])"
    )
    assert [text for text, *_ in found][:3] == ["t0 ↑1.5", "t1", "t2"]
    for (_, x, y, width), (_, other, level, wide) in combinations([*places, *found], 2):
        if width == wide == 12 and y == level:
            continue  # two places may be near each other
        assert abs(y - level) > 12 or x >= other + wide or other >= x + width


@in_a_browser
def test_many_robots_are_drawn_without_complaint(tab: Tab, tmp_path: Path) -> None:
    path = tmp_path / "many.html"
    path.write_bytes(page_of(circling(150, 3.0)))
    tab.complaints.clear()
    tab.open(path.as_uri())
    tab.ask("page.choose(149), page.seek(2)")
    tab.ask("new Promise((done) => requestAnimationFrame(done))")
    assert "Robot 149" in shown_text(tab, "pane")
    assert tab.complaints == []


def shown_text(tab: Tab, name: str) -> str:
    """The text of an element after the next frame."""
    wait = "await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    found: str = tab.ask(f"(async () => {{ {wait}; return byId('{name}').textContent; }})()")
    return found


def is_blank(tab: Tab, canvas: str) -> bool:
    """Whether all of a canvas has one colour."""
    wait = "await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    colours = tab.ask(
        f"(async () => {{ {wait}; const canvas = byId('{canvas}');"
        "const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;"
        "return new Set(new Uint32Array(data.buffer)).size; })()"
    )
    return bool(colours < 5)
