"""``koord sim``, as it is called: the examples in their worlds, mistakes, and what is broken."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from tests.sampling import first

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"


def simulated(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, Any]:
    """A run as JSON."""
    code = main(["sim", *arguments, "--json", "--no-html"])
    out, err = capsys.readouterr()
    assert code in (Exit.OK, Exit.VIOLATED), err
    return code, json.loads(out)


def example(name: str) -> str:
    return str(EXAMPLES / name)


# --- the examples ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("program", "configuration", "time_s", "ending"),
    first(
        3,
        [
            ("follow_path", "follow_path", 60, "stopped"),
            ("waypoints", "waypoints", 20, "limit"),
            ("lineform", "lineform", 12, "limit"),
            ("shapeform", "shapeform", 12, "limit"),
            ("task", "task_mixed", 60, "stopped"),
            ("cars_and_drones", "cars_and_drones", 60, "still"),
            ("mapping", "mapping", 60, "still"),
            ("shapeform", "shapeform_9", 12, "limit"),
            ("shapeform", "shapeform_36", 12, "limit"),
            ("follow_points", "follow_points", 60, "stopped"),
            ("delivery", "delivery", 60, "stopped"),
        ],
    ),
)
def test_an_example_does_what_it_is_for(
    program: str,
    configuration: str,
    time_s: int,
    ending: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = (example(f"{program}.krd"), example(f"{configuration}.yaml"))
    code, run = simulated(capsys, *files, "--time", str(time_s))
    assert (code, run["broken"], run["fault"]) == (Exit.OK, [], None)
    assert run["ending"] == ending
    assert all(task["visited_s"] is not None for task in run["tasks"])
    assert run["nearest"]["distance_m"] > run["safety_m"]
    assert run["claims"]
    assert all(looked > 0 for looked in run["claims"].values())
    if program != "waypoints":
        assert min(robot["distance_m"] for robot in run["robots"][1:-1] or run["robots"]) > 0.3


def test_task_by_itself_is_the_one_of_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", example("task.krd"), "--time", "2", "--no-html"]) == Exit.OK
    out, _ = capsys.readouterr()
    values = "δ = 0.1 s, tasks = 20 (4 in the text), 20 tasks of the world, seed 0"
    assert f"task.yaml: 3 robots (2 car, 1 drone), {values}" in out
    assert "0 of 20 visited" in out
    assert "done: the time was up" in out


def test_equal_seeds_give_equal_runs_and_others_do_not(capsys: pytest.CaptureFixture[str]) -> None:
    files = (example("task.krd"), example("task_mixed.yaml"), "--time", "2")
    first, again, other = (simulated(capsys, *files, "--seed", seed)[1] for seed in ("3", "3", "4"))
    for run in (first, again):
        del run["wall_s"]
    assert first == again
    assert first["digest"] != other["digest"]


def test_robots_and_params_may_be_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, five = simulated(capsys, example("task.krd"), "--robots", "5", "--time", "1")
    assert five["devices"] == ["car", "drone", "car", "car", "drone"]
    _, few = simulated(capsys, example("task.krd"), "--set", "tasks=20", "--rounds", "3")
    assert (len(few["tasks"]), few["rounds"]) == (20, 3)
    program = tmp_path / "task.krd"
    program.write_text((EXAMPLES / "task.krd").read_text("utf-8"), encoding="utf-8")
    _, plain = simulated(capsys, str(program), "--set", "tasks=4", "--rounds", "3")
    assert len(plain["tasks"]) == 4
    _, slow = simulated(capsys, str(program), "--set", "tasks=4", "--delta", "0.5", "--rounds", "3")
    assert (slow["rounds"], slow["time_s"]) == (3, 1.5)


# --- what is broken -------------------------------------------------------------------------------

CARS = """\
num_robots: 2
device: {bot_type: IDEAL, planner: STRAIGHT}
positions: {0: [-2, 0, 1], 1: [2, 0, 1]}
"""

#: Robots that run into each other, and an invariant that this breaks.
CRASH = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
    contract Ahead:
        ensures: psn'.x <= {most}

init:
    Motion.target = Motion.psn

Go:
    eff: Motion.target = pos(0.0, 0.0, 1.0)

invariant Apart: forall i, j: i < j implies Motion.psn@j.x - Motion.psn@i.x >= {gap}
"""


def crash(folder: Path, most: float, gap: float) -> tuple[str, str]:
    program, configuration = folder / "crash.krd", folder / "crash.yaml"
    program.write_text(CRASH.format(most=most, gap=gap), encoding="utf-8")
    configuration.write_text(CARS, encoding="utf-8")
    return str(program), str(configuration)


@pytest.mark.parametrize(
    ("most", "gap", "claim", "robots", "time_s"),
    [
        (9.0, 0.0, "separation", [0, 1], 1.95),
        (9.0, 2.0, "invariant Apart", [0, 1], 1.2),
        (2.0, -9.0, "separation", [0, 1], 1.95),
        (1.9, -9.0, "contract Ahead", [1], 0.05),
    ],
)
def test_what_is_broken_ends_the_run_with_its_time_and_place(
    most: float,
    gap: float,
    claim: str,
    robots: list[int],
    time_s: float,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, run = simulated(capsys, *crash(tmp_path, most, gap))
    assert (code, run["ending"]) == (Exit.VIOLATED, "violated")
    first = run["broken"][0]
    assert (first["claim"], first["robots"]) == (claim, robots)
    assert first["time_s"] == pytest.approx(time_s, abs=0.15)
    assert first["place"][1:] == pytest.approx([0, 1])


def test_what_is_broken_is_counted_if_the_run_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = crash(tmp_path, 1.9, 2.0)
    assert main(["sim", *files, "--keep-going", "--time", "4", "--no-html"]) == Exit.VIOLATED
    out, _ = capsys.readouterr()
    assert out.count("broken: ") == 3  # the contract, the invariant and the separation
    assert "3 claims broken" in out


def test_a_fault_ends_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "fault.krd"
    program.write_text(
        "local:\n    int n = 3\nCount:\n    eff: n = 6 / (pid - 1)\n", encoding="utf-8"
    )
    assert main(["sim", str(program), "--no-html"]) == Exit.VIOLATED
    out, _ = capsys.readouterr()
    assert "fault: division by zero of robot 1" in out


# --- mistakes -------------------------------------------------------------------------------------

ONE = "num_robots: 1\n"
ARENA = "world: {bounds: {low: [-4, -4, 0], high: [4, 4, 3]}}\n"


@pytest.mark.parametrize(
    ("text", "line", "message", "hint"),
    [
        (ONE + "device:\n  planner: RRT_KAR", 3, "no planner RRT_KAR", "did you mean RRT_CAR"),
        (
            ONE + "device:\n  bot_type: QUAD\n  planner: RRT_CAR",
            4,
            "no planner for a QUAD",
            "RRT_D",
        ),
        ("agents:\n  - {pid: 0, on_device: cat}\ndevices:\n  car: {}", 2, "no device cat", "car"),
        (ONE + "positions:\n  0: [9, 0]\n" + ARENA, 3, "outside of the world", None),
        ("num_robots: 2\npositions:\n  0: [0, 0]\n  1: [0.1, 0]", 4, "0.10 m from robot 0", None),
        (ONE + "positions:\n  0: [0, 0, 1]", 3, "starts on the ground", None),
        (
            ONE + "positions: {0: [0, 0]}\nworld:\n  obstacles:\n    - disc: {centre: [0, 0], "
            "radius: 1}",
            2,
            "something stands at the start",
            None,
        ),
        (
            ONE + "positions: {0: [2, 2]}\nworld:\n  obstacles:\n"
            "    - polygon: {corners: [[0, 0], [1, 1], [1, 0], [0, 1]]}",
            5,
            "no polygon",
            None,
        ),
        (ONE + "world:\n  start: {low: [0, 0], high: [-9, 0]}", 3, "no part of the world", None),
        (
            ONE + "world:\n  bounds: {low: [-4, -4], high: [4, 4]}\n"
            "  start: {low: [0, 0], high: [9, 0]}",
            4,
            "no part of the world",
            None,
        ),
        (ONE + "world: {scattered: 3}", 2, "how large the world is, nor where robot 0", "bounds"),
        ("num_robots: 90\nworld:\n  start: {low: [0, 0], high: [1, 1]}", 3, "no room", "position"),
        ("a: &a {b: *a}", 1, "this contains itself", None),
        (ONE + "params:\n  tasks: {}", 3, "no value of a param", "number"),
        (ONE + "device: {planner: RRT_CAR, simulation: {level: fancy}}", 2, "'fancy'", "full"),
        (ONE + "params:\n  taks: 3", 0, "no `param` named `taks`", "tasks"),
        ("agents:\n  - {pid: 0, kind: Boat}\n" + ARENA, 0, "kind Boat", "leave `kind` out"),
    ],
)
def test_a_bad_configuration_is_told_with_its_line(
    text: str,
    line: int,
    message: str,
    hint: str | None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    assert main(["sim", example("task.krd"), str(path)]) == Exit.BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    if line:
        assert f"bad.yaml:{line}:" in err
    if hint is not None:
        assert hint in err


def test_a_start_that_the_program_does_not_assume_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "low.yaml"
    path.write_text(
        "num_robots: 4\ndevice: {bot_type: QUAD, planner: RRT_DRONE}\n"
        "positions:\n  0: [0, 0, 10]\n  1: [0, 2, 10]\n  2: [2, 0, 10]\n  3: [2, 2, 9]\n"
        "world: {bounds: {low: [-8, -8, 0], high: [8, 8, 12]}}\n",
        encoding="utf-8",
    )
    assert main(["sim", example("shapeform.krd"), str(path)]) == Exit.BAD_INPUT
    _, err = capsys.readouterr()
    assert "low.yaml:7:" in err
    assert "K934" in err
    assert "of robot 3" in err


def test_a_program_with_mistakes_is_not_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "bad.krd"
    program.write_text("Go:\n    eff: x = 1\n", encoding="utf-8")
    assert main(["sim", str(program)]) == Exit.BAD_INPUT
    assert "bad.krd:2:" in capsys.readouterr().err


# --- what no world answers ------------------------------------------------------------------------


def test_a_function_that_no_world_answers_is_answered_by_chance(
    capsys: pytest.CaptureFixture[str],
) -> None:
    runs = [
        simulated(capsys, example("shortest_path_any_graph.krd"), "--seed", str(seed))
        for seed in (1, 1, 2, 3, 4)
    ]
    assert all(code == Exit.OK and run["by_chance"] == ["linked"] for code, run in runs)
    assert runs[0][1]["digest"] == runs[1][1]["digest"]
    # Graphs differ, and so does who runs what.
    assert len({run["digest"] for _, run in runs}) > 1


@pytest.mark.parametrize("time_s", first(1, ["1", "20"]))
def test_programs_without_vehicles_begin_as_they_assume(
    time_s: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = str(tmp_path / "trace.json")
    quick = ("--robots", "3", "--delta", "0.1", "--time", time_s)
    code, run = simulated(capsys, example("hvac.krd"), *quick, "--trace", trace)
    assert (code, run["ending"], run["by_chance"]) == (Exit.OK, "limit", [])
    assert run["claims"]["invariant Comfort"] > 0
    assert main(["replay", trace]) == Exit.OK
    capsys.readouterr()
    # Of rounds that are too long it says itself that a room gets too warm.
    slow = ("--robots", "1", "--delta", "125", "--time", "250")
    code, run = simulated(capsys, example("hvac.krd"), *slow)
    assert code == Exit.VIOLATED
    assert run["broken"][0]["claim"] == "invariant Comfort"


SENSED = """\
using Gate:
    sensors:
        bool open
        float width
    contract Kept:
        ensures: 0.0 <= width' and width' <= 2.0
allwrite:
    int passed = 0
Pass:
    pre: Gate.open
    eff:
        atomic: passed = passed + 1
invariant Narrow: forall i: Gate.width@i <= 2.0
"""


def test_sensors_of_no_vehicle_read_what_contracts_allow(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, trace = tmp_path / "gate.krd", str(tmp_path / "trace.json")
    program.write_text(SENSED, "utf-8")
    flags = ("--time", "4", "--trace", trace)
    code, run = simulated(capsys, str(program), *flags)
    assert (code, run["broken"]) == (Exit.OK, [])
    assert run["by_chance"] == ["Gate.open", "Gate.width"]
    events = sum(robot["events"] for robot in run["robots"])
    assert 0 < events < 120
    assert main(["replay", trace]) == Exit.OK
    capsys.readouterr()


def test_a_list_has_the_tasks_that_its_program_assumes(capsys: pytest.CaptureFixture[str]) -> None:
    code, run = simulated(capsys, example("task_as_printed.krd"), "--time", "1")
    assert len(run["tasks"]) == 20
    # What the verifier says of the program as it is printed shows at once: a car finds no way
    # to the last of the tasks, and so it drops those that it took before.
    assert code == Exit.VIOLATED
    assert run["broken"][0]["claim"] == "invariant Moving"


def test_a_level_without_its_library_is_refused_with_the_cure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "koord.sim.vehicles.physics", raising=False)
    config = tmp_path / "task.yaml"
    config.write_text(
        "robot: {pid: 0, on_device: car}\n"
        "device: {bot_name: car, bot_type: CAR, planner: RRT_CAR, simulation: {level: mujoco}}\n"
        "num_robots: 2\n" + ARENA
    )
    assert main(["sim", example("task.krd"), str(config), "--no-html"]) == Exit.BAD_INPUT
    err = capsys.readouterr().err
    assert "K950" in err
    assert "pip install 'koord[mujoco]'" in err


@pytest.mark.parametrize(
    ("flags", "story"),
    [
        (["--runs", "2", "--processes"], "--processes is of one run"),
        (["--runs", "2", "--planners", "2"], "--planners is of one run"),
        (["--planners", "-1"], "planners must be from 0"),
        (["--runs", "2", "--live", "--record", "a.mcap"], "--record and --live are of one run"),
        (["--sweep", "robots=2..3", "--pace", "2"], "--pace is of one run"),
        (["--jobs", "2"], "--jobs is of campaigns"),
        (["--reload"], "--reload: only runs that are looked at take edits: say `--live`"),
        (
            ["--live", "--reload", "--processes"],
            "edits are taken in one process: leave out `--processes`",
        ),
        (["--schedule", "t.json", "--reload"], "leave out --reload"),
        (["--cluster", "tcp://localhost:1"], "--cluster is of campaigns"),
        (["--csv", "a.csv"], "--csv is of campaigns"),
        (["--schedule", "t.json", "--processes"], "leave out --processes"),
        (["--schedule", "t.json", "--planners", "1"], "leave out --planners"),
        (["--schedule", "t.json", "--seed", "0"], "leave out --seed"),
        (["--schedule", "t.json", "--set", "tasks=3"], "leave out --set"),
        (["--schedule", "t.json", "--jobs", "2"], "--jobs is of campaigns"),
    ],
)
def test_flags_that_do_not_go_together_are_refused(
    flags: list[str], story: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", example("task.krd"), *flags]) == Exit.BAD_INPUT
    assert story in capsys.readouterr().err


# --- the instance that a program states -----------------------------------------------------------

STATED = """\
param int numAgents = 2
param float delta = 0.5
local:
    int n = 0
Count:
    pre: n < 3
    eff: n = n + 1
"""


def stated(tmp_path: Path, configuration: str | None = None) -> list[str]:
    program = tmp_path / "stated.krd"
    program.write_text(STATED, encoding="utf-8")
    if configuration is not None:
        program.with_suffix(".yaml").write_text(configuration, encoding="utf-8")
    return ["sim", str(program), "--rounds", "2", "--no-html"]


def test_what_a_program_states_is_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(stated(tmp_path)) == Exit.OK
    out, err = capsys.readouterr()
    assert "2 robots (1 car, 1 drone), δ = 0.5 s" in out
    assert err == ""


def test_a_configuration_wins_over_what_a_program_states_and_that_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    device = "device: {bot_type: IDEAL, planner: STRAIGHT}\n"
    assert main(stated(tmp_path, f"num_robots: 3\ndelta: 0.1\n{device}")) == Exit.OK
    out, err = capsys.readouterr()
    assert "3 robots" in out
    assert "δ = 0.1 s" in out
    assert "K936: the program is meant for 2 robots; here are 3 robots" in err
    assert "stated.yaml:2:8: warning K936: the program is meant for δ = 0.5 s; it is 0.1 s" in err
    # flags are wished for, and what is not said is no difference
    assert main([*stated(tmp_path), "--robots", "4", "--delta", "0.2"]) == Exit.OK
    out, err = capsys.readouterr()
    assert "4 robots" in out
    assert "δ = 0.2 s" in out
    assert err == ""
    assert main(stated(tmp_path, f"num_robots: 2\n{device}")) == Exit.OK
    out, err = capsys.readouterr()
    assert "δ = 0.5 s" in out
    assert err == ""


def test_how_robots_are_divided_among_kinds_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--robots", "3", "--rounds", "1", "--no-html")
    main(["sim", example("cars_and_drones.krd"), *words])
    out, _ = capsys.readouterr()
    assert "3 robots (2 Car, 1 Drone; on 2 car, 1 drone)" in out
