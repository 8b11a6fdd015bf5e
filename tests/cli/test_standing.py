"""A robot that stands still and is to go somewhere is told, with an exit code of its own."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.motion.arrays import Bools
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import Car, PlannerName
from koord.runtime.motion.planning import Hindrance, Plight
from koord.runtime.motion.world import World
from koord.runtime.platform.sensors import MotionSensors
from koord.sim.sensing import FleetSensors
from koord.sim.standing import StandingRobot, Watchman
from tests.sampling import first

NOBODY = np.zeros(2, np.bool_)

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Robots that are sent somewhere once, and wait until they are there.
SENT = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
        pos[] path
local:
    int n = 0
Go:
    pre: n == 0
    eff:
        {order}
        n = 1
Done:
    pre: n == 1 and Motion.reached
    eff: n = 2
"""

#: Robots that look for a way in every round, and take none that is not clear.
LOOKS = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos[] path
allread:
    pos[][] route
local:
    pos[] way
init:
    route[pid] = [Motion.psn]
Go:
    pre: Motion.reached
    eff:
        atomic:
            way = findPath(Motion.psn, pos(2.0, 0.0, 0.0))
            if pathIsClear(route, way, pid):
                route[pid] = way
                Motion.path = way
"""

ARENA = "world: {bounds: {low: [-4, -4, 0], high: [4, 4, 3]}}\n"
CAR = "device: {bot_type: CAR, planner: STRAIGHT}\n"
DRONE = "device: {bot_type: QUAD, planner: STRAIGHT}\n"
ONE = "num_robots: 1\npositions: {0: [0, 0, HEIGHT]}\n"


def sim(
    folder: Path, capsys: pytest.CaptureFixture[str], program: str, text: str, *flags: str
) -> tuple[int, Any, str]:
    file, configuration = folder / "one.krd", folder / "one.yaml"
    file.write_text(program, "utf-8")
    configuration.write_text(text, "utf-8")
    files = [str(file), str(configuration)]
    code = main(["sim", *files, "--json", "--no-html", "--time", "20", *flags])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


@pytest.mark.parametrize(
    ("order", "configuration", "why"),
    [
        ("Motion.target = pos(9.0, 0.0, 0.0)", CAR, "outside"),
        ("Motion.target = pos(2.0, 0.0, 1.0)", CAR, "above_ground"),
        ("Motion.target = pos(2.0, 0.0, 0.0)", DRONE, "on_ground"),
        ("Motion.target = pos(2.0, 0.0, 0.0)", CAR + "WALL", "no_way"),
        ("Motion.path = findPath(Motion.psn, pos(9.0, 0.0, 0.0))", CAR, "no_points"),
    ],
)
def test_who_cannot_go_where_it_was_sent_is_told(
    order: str,
    configuration: str,
    why: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arena = ARENA
    if "WALL" in configuration:
        wall = "obstacles: [{box: {low: [1, -4, 0], high: [1.5, 4, 3]}}]"
        arena = ARENA.replace("}}\n", "}, " + wall + "}\n")
    height = "1" if "QUAD" in configuration else "0"
    text = ONE.replace("HEIGHT", height) + configuration.replace("WALL", "") + arena
    code, run, err = sim(tmp_path, capsys, SENT.format(order=order), text)
    (standing,) = run["standing"]
    assert code == Exit.STUCK
    assert (standing["robot"], standing["since_s"], standing["why"]) == (0, 0.0, why)
    assert run["ending"] == "still"
    assert f"robot 0 stands still since 0.0 s: {standing['words']}" in err


FULL = "device: {bot_type: CAR, planner: STRAIGHT, simulation: {level: full}}\n"
MUJOCO = FULL.replace("full", "mujoco")
TWO = "num_robots: 2\npositions: {0: [0, 0, 0], 1: [1.2, 0, 0]}\nmonitor: {safety: 0}\n"
AHEAD = "Motion.path = [Motion.psn, pos(3.0, 0.0, 0.0)]"


@pytest.mark.parametrize(
    ("order", "configuration", "why", "what"),
    first(
        3,
        [
            (AHEAD, ONE.replace("HEIGHT", "0") + FULL, "obstacle", "obstacle 0 of the world"),
            (f"if pid == 0:\n            {AHEAD}", TWO + FULL, "robot", "robot 1"),
            (AHEAD, ONE.replace("HEIGHT", "0") + MUJOCO, "obstacle", "obstacle 0 of the world"),
            (f"if pid == 0:\n            {AHEAD}", TWO + MUJOCO, "robot", "robot 1"),
        ],
    ),
)
def test_who_is_blocked_on_its_way_is_told(
    order: str,
    configuration: str,
    why: str,
    what: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wall = "obstacles: [{box: {low: [2, -4, 0], high: [2.2, 4, 3]}}]"
    text = configuration + ARENA.replace("}}\n", "}, " + wall + "}\n")
    code, run, err = sim(tmp_path, capsys, SENT.format(order=order), text, "--time", "10")
    assert code == Exit.STUCK, run
    (standing,) = run["standing"]
    assert (standing["robot"], standing["why"]) == (0, why)
    assert 0.5 < standing["since_s"] < 8
    assert (
        standing["words"]
        == f"it is on its way, and its vehicle makes no headway: it touches {what}"
    )
    assert f"stands still since {standing['since_s']:.1f} s: {standing['words']}" in err


def test_what_is_near_and_not_touched_is_not_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A car is stopped by another one, with an obstacle two centimetres beside it."""
    side = 0.02 + Car().width_m / 2
    ahead = "{box: {low: [2, -4, 0], high: [2.2, 4, 3]}}"
    wall = f"obstacles: [{ahead}, {{box: {{low: [0, {side}, 0], high: [1.9, 1, 3]}}}}]"
    text = TWO + FULL + ARENA.replace("}}\n", "}, " + wall + "}\n")
    program = SENT.format(order=f"if pid == 0:\n            {AHEAD}")
    code, run, _ = sim(tmp_path, capsys, program, text)
    (standing,) = run["standing"]
    assert (code, standing["why"]) == (Exit.STUCK, "robot")
    assert standing["words"].endswith("makes no headway: it touches robot 1")


def test_where_nothing_is_touched_nothing_is_named() -> None:
    watchman = Watchman(World(), [Car(), Car()])
    known = MotionSensors(
        (0.0, 0.0, 0.0), 0.0, False, PlannerName.STRAIGHT, MotionState.MOVING, None, 1.0
    )
    sensed = FleetSensors.of([known, known])
    places = np.array([(0.0, 0.0, 0.0), (0.3, 0.0, 0.0)])
    told = [
        one
        for k in range(60)
        for one in watchman.round(k / 10, (k + 1) / 10, sensed, NOBODY, places, lambda robot: ())
    ]
    assert [(one.robot, one.hindrance) for one in told] == [
        (0, Hindrance.NO_HEADWAY),
        (1, Hindrance.NO_HEADWAY),
    ]
    assert "robot" not in told[0].words


def watched(
    known: Sequence[MotionSensors], stopped: Bools, along: Callable[[int], float]
) -> list[StandingRobot]:
    """What is told in six seconds of two cars on an axis; the second stays where it is."""
    watchman = Watchman(World(), [Car(), Car()])
    told: list[StandingRobot] = []
    for k in range(60):
        places = np.array([(along(k), 0.0, 0.0), (9.0, 0.0, 0.0)])
        seen = FleetSensors.of(known)
        told += watchman.round(k / 10, (k + 1) / 10, seen, stopped, places, lambda robot: ())
    return told


def test_who_gets_on_is_not_stuck_and_who_has_stopped_is_not_either() -> None:
    going = MotionSensors(
        (0.0, 0.0, 0.0), 0.0, False, PlannerName.STRAIGHT, MotionState.MOVING, None, 1.0
    )
    creeps = watched([going, going], NOBODY, lambda k: k * 0.0125)
    assert [(one.robot, one.since_s) for one in creeps] == [(1, 0.0)]
    # Five centimetres to and fro are a place, and what is more is none.
    sways = watched([going, going], NOBODY, lambda k: 0.05 * (k % 2))
    assert [one.robot for one in sways] == [0, 1]
    strays = watched([going, going], NOBODY, lambda k: math.nextafter(0.05, 1.0) * (k % 2))
    assert [one.robot for one in strays] == [1]
    assert not watched([going, going], ~NOBODY, lambda k: 0.0)
    near, idle = going._replace(short_m=0.04), going._replace(state=MotionState.IDLE)
    assert not watched([near, idle], NOBODY, lambda k: 0.0)


def test_who_cannot_go_is_told_at_once_and_once() -> None:
    lost = MotionSensors(
        (0.0, 0.0, 0.0),
        0.0,
        False,
        PlannerName.STRAIGHT,
        MotionState.IDLE,
        Plight(Hindrance.NO_WAY, (1.0, 2.0, 3.0)),
    )
    told = watched([lost, lost._replace(plight=None)], NOBODY, lambda k: 0.0)
    assert [(one.robot, one.since_s, one.hindrance) for one in told] == [(0, 0.0, Hindrance.NO_WAY)]
    assert not watched([lost, lost], ~NOBODY, lambda k: 0.0)


def test_it_is_told_of_processes_as_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = SENT.format(order="Motion.target = pos(9.0, 0.0, 0.0)")
    text = ONE.replace("HEIGHT", "0") + CAR + ARENA
    code, run, _ = sim(tmp_path, capsys, program, text, "--processes", "--time", "1")
    assert code == Exit.STUCK
    assert [one["why"] for one in run["standing"]] == ["outside"]


def test_who_arrives_is_not_stuck(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ONE.replace("HEIGHT", "0") + CAR + ARENA
    program = SENT.format(order="Motion.target = pos(2.0, 0.0, 0.0)")
    code, run, _ = sim(tmp_path, capsys, program, text)
    assert (code, run["ending"], run["standing"]) == (Exit.OK, "still", [])


def test_another_order_frees_who_was_stuck(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = SENT.format(order="Motion.target = pos(9.0, 0.0, 0.0)") + (
        "Again:\n    pre: n == 1\n    eff:\n        Motion.target = pos(2.0, 0.0, 0.0)\n"
        "        n = 3\n"
    )
    text = ONE.replace("HEIGHT", "0") + CAR + ARENA
    code, run, err = sim(tmp_path, capsys, program, text)
    assert (code, run["standing"]) == (Exit.OK, [])
    assert "stands still since 0.0 s" in err  # as it was then


@pytest.mark.parametrize(
    ("device", "positions", "why"),
    [
        (DRONE, "num_robots: 1\npositions: {0: [0, 0, 1]}\n", ["on_ground"]),
        # One stands at the goal, and the other is not to go where it stands.
        (CAR, "num_robots: 2\npositions: {0: [2, 0, 0], 1: [-2, 0, 0]}\n", ["not_clear"] * 2),
    ],
)
def test_who_waits_for_a_way_for_ever_is_told(
    device: str,
    positions: str,
    why: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, run, _ = sim(tmp_path, capsys, LOOKS, positions + device + ARENA)
    told = [one["why"] for one in run["standing"]]
    assert code == Exit.STUCK
    assert told == why[: len(told)]
    assert told


def test_it_is_told_wherever_the_run_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mcap.reader import make_reader

    file, configuration = tmp_path / "one.krd", tmp_path / "one.yaml"
    file.write_text(SENT.format(order="Motion.target = pos(9.0, 0.0, 0.0)"), "utf-8")
    configuration.write_text(ONE.replace("HEIGHT", "0") + CAR + ARENA, "utf-8")
    page, record = tmp_path / "run.html", tmp_path / "run.mcap"
    flags = ["--html", str(page), "--record", str(record)]
    assert main(["sim", str(file), str(configuration), *flags]) == Exit.STUCK
    out, err = capsys.readouterr()
    story = "robot 0 stands still since 0.0 s: it is to go to (9, 0, 0), and that is outside of the"
    assert f"stuck: {story} world's bounds" in out
    assert "the world reaches from (-4, -4, 0) to (4, 4, 3)" in out
    assert "nothing changes any more; 1 robot stands still" in out
    assert story in err
    with record.open("rb") as raw:
        messages = [json.loads(m.data) for _, _, m in make_reader(raw).iter_messages("/log")]
    assert any(story in message["message"] for message in messages)
    assert page.stat().st_size > 1000


def test_a_campaign_counts_who_stands_still(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = SENT.format(order="Motion.target = pos(9.0, 0.0, 0.0)")
    text = ONE.replace("HEIGHT", "0") + CAR + ARENA
    code, campaign, _ = sim(tmp_path, capsys, program, text, "--runs", "2")
    assert code == Exit.STUCK
    assert [row["stuck"] for row in campaign["runs"]] == [1, 1]


# --- the bounds of the world ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        # The robot at (0, 0), and the place in the program, 9 m away.
        (ONE, [-2, -2, 0], [11, 2, 3]),
        (ONE + "world: {tasks: [[0, 5, 4]]}\n", [-2, -2, 0], [11, 7, 5]),
        (ONE + "world: {start: {low: [-3, 0], high: [0, 0]}}\n", [-5, -2, 0], [11, 2, 3]),
        (
            ONE + "world: {obstacles: [{disc: {centre: [0, -6], radius: 1, high_z: 5}}]}\n",
            [-3, -9, 0],
            [11, 2, 6],
        ),
        (ONE + ARENA, [-4, -4, 0], [4, 4, 3]),
    ],
)
def test_bounds_follow_from_what_is_there(
    text: str,
    low: list[float],
    high: list[float],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    program = SENT.format(order="Motion.target = pos(9.0, 0.0, 0.0)")
    _, run, _ = sim(tmp_path, capsys, program, text.replace("HEIGHT", "0") + CAR, "--rounds", "1")
    assert (run["bounds"]["low"], run["bounds"]["high"]) == (low, high)
    assert run["bounds"]["given"] is (ARENA in text)


def test_bounds_that_follow_are_told_and_are_enough(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, configuration = tmp_path / "one.krd", tmp_path / "one.yaml"
    file.write_text(SENT.format(order="Motion.target = pos(9.0, 0.0, 0.0)"), "utf-8")
    configuration.write_text(ONE.replace("HEIGHT", "0") + CAR, "utf-8")
    assert main(["sim", str(file), str(configuration), "--no-html"]) == Exit.OK
    out = capsys.readouterr().out
    assert "no bounds are given: the world reaches from (-2, -2, 0) to (11, 2, 3)" in out
    configuration.unlink()
    assert main(["sim", str(file), "--no-html", "--robots", "1", "--rounds", "1"]) == Exit.OK
    out = capsys.readouterr().out
    assert "no bounds are given: the world reaches from (-3.5, -4, 0) to (11, 4, 3)" in out


def test_who_moves_nobody_needs_no_bounds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configuration = tmp_path / "three.yaml"
    configuration.write_text("num_robots: 3\n", "utf-8")
    program = str(EXAMPLES / "leader_elect.krd")
    assert main(["sim", program, str(configuration), "--no-html"]) == Exit.OK
    assert "the world reaches" not in capsys.readouterr().out
