"""`config check`, `sim` and `deploy` refuse the same configurations alike."""

from __future__ import annotations

import copy
import json
import random
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from koord.api.configurations import check_start
from koord.api.deploy_request import DeployRequest
from koord.cli import config, deploy, fitting
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.diagnostics import Diagnostic, KoordError

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Two kinds of robot that go somewhere, and all that a configuration can say of them.
PROGRAM = """\
agent Rover:
    using Motion:
        sensors:
            pos psn
            bool reached
        actuators:
            pos target
    Go:
        eff: Motion.target = pos(away, 0.0, 0.0)

agent Bird:
    using Motion:
        sensors:
            pos psn
            bool reached
        actuators:
            pos target
    Rise:
        eff: Motion.target = pos(1.0, 1.0, 1.0)

param float away = 2.0
"""

WHOLE = """\
agents:
    - {pid: 0, on_device: car, kind: Rover, position: [0, 0], heading: 0.5}
    - {pid: 1, on_device: drone, kind: Bird, position: [1, 2, 1]}
devices:
    car:
        bot_type: CAR
        planner: RRT_CAR
        speed: 0.5
        simulation: {level: simple, noise: {position: 0.01}, visit: {epsilon: 0.1}}
    drone: {bot_type: QUAD, planner: STRAIGHT}
leader_pid: 1
delta: 0.1
seed: 3
params: {away: 3.0}
monitor: {slack: 0.2, safety: 0.9}
world:
    bounds: {low: [-4, -4, 0], high: [4, 4, 3]}
    obstacles:
        - box: {low: [3, 3, 0], high: [3.5, 3.5, 1]}
        - polygon: {corners: [[-3, -3], [-2, -3], [-2, -2]]}
    tasks: [[0, 1, 0]]
network: {transport: unicast, port: 6000, key: sixteen letters ok}
"""

#: What may stand where something else stood.
VALUES: tuple[Any, ...] = (
    None,
    "",
    "XX",
    "CAR",
    -1,
    0,
    1.5,
    10**9,
    True,
    [],
    [1],
    [9, 9, 9],
    {},
    {"a": 1},
)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The places of all fields and items of a document."""
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    for key, inner in items:
        yield (*path, key)
        yield from places(inner, (*path, key))


def mutants(document: Any, most: int | None = None) -> Iterator[str]:
    """The document with one field left out, misspelt, or of another value; so many at most."""
    changes: list[Any] = ["drop", "misspell", *VALUES]
    all_ = [(path, change) for path in places(document) for change in changes]
    for path, change in all_ if most is None else random.Random(7).sample(all_, most):
        made = copy.deepcopy(document)
        holder = made
        for key in path[:-1]:
            holder = holder[key]
        if change == "drop":
            del holder[path[-1]]
        elif change == "misspell":
            if not isinstance(holder, dict):
                continue
            holder[f"{path[-1]}x"] = holder.pop(path[-1])
        else:
            holder[path[-1]] = change
        yield json.dumps(made, indent=1)


def test_a_scene_says_where_robots_begin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its places are checked as those of the configuration are."""
    (tmp_path / "two.yaml").write_text(
        "agents: [{pid: 0, on_device: a}, {pid: 1, on_device: b}]\n"
        "devices: {a: {bot_type: CAR}, b: {bot_type: CAR}}\n"
        "world: {bounds: {low: [0, 0], high: [9, 9]}}\n",
        "utf-8",
    )
    scene = tmp_path / "start.yml"

    def checked(x: int) -> int:
        robots = (
            f"- {{bot_name: {of}, bot_type: CAR, init_pos: [{x}, {y}, 0]}}\n"
            for of, y in (("a", 2), ("b", 7))
        )
        scene.write_text("".join(robots), "utf-8")
        return main(["config", "check", str(tmp_path / "two.yaml"), "--scene", str(scene)])

    assert checked(2) == 0
    assert checked(12) == 2
    assert f"{scene}:1:" in capsys.readouterr().out
    assert main(["config", "key", "--scene", str(scene)]) == 2


def refused(
    folder: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> tuple[list[Diagnostic], list[Diagnostic], list[Diagnostic]]:
    """What is wrong with a configuration, as `config check`, `sim` and `deploy` see it."""
    program, path = folder / "two.krd", folder / "two.yaml"
    program.write_text(PROGRAM, "utf-8")
    path.write_text(text, "utf-8")
    flags: dict[str, Any] = {
        "file": str(program),
        "config": str(path),
        "properties": [],
        "settings": [],
    }
    flags |= {"delta": None, "site": None}
    told = []
    for check in (_by_config, _by_sim, _by_deploy):
        report = DiagnosticReport()
        try:
            check(Namespace(**flags), report)
        except KoordError as error:
            report.add(error.diagnostics)
        told.append(report.diagnostics)
    one, two, three = told
    return one, two, three


def _by_config(arguments: Namespace, report: DiagnosticReport) -> None:
    config.check(arguments.config, None, None, report)


def _by_sim(arguments: Namespace, report: DiagnosticReport) -> None:
    wanted = fitting.fit_request(arguments, report)
    found = None if wanted is None else fitting.fitted(wanted, report)
    if found is not None:
        check_start(found)


def _by_deploy(arguments: Namespace, report: DiagnosticReport) -> None:
    deploy.prepare(arguments, DeployRequest(rounds=1, dry_run=True), report)


def agree(texts: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> int:
    """All three say the same of each; how many are refused."""
    count = 0
    for text in texts:
        one, two, three = refused(folder, text, capsys)
        assert one == two == three, text
        count += bool(one)
    return count


def test_the_whole_is_right(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert agree([WHOLE], tmp_path, capsys) == 0


def test_all_three_tell_of_fields_without_effect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = WHOLE.replace("leader_pid: 1", "leader_pid: 1\nmutex_handler: BaseMutexHandler")
    one, two, three = refused(tmp_path, text, capsys)
    assert [(d.code, d.span.line) for d in one] == [("K938", 12)]
    assert one == two == three


def test_all_three_refuse_the_same_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    some = list(mutants(yaml.safe_load(WHOLE), 20))
    assert agree(some, tmp_path, capsys) > 6


@pytest.mark.slow
def test_all_three_refuse_all_mutants_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = list(mutants(yaml.safe_load(WHOLE)))
    assert agree(made, tmp_path, capsys) > len(made) / 2


@pytest.mark.parametrize(
    ("old", "new", "story"),
    [
        ("planner: RRT_CAR", "planner: RRT_KAR", "no planner RRT_KAR"),
        ("planner: STRAIGHT", "planner: RRT_CAR", "RRT_CAR is no planner for a QUAD"),
        ("kind: Bird", "kind: Fish", "of kind Fish"),
        ("away: 3.0", "away: far", "away"),
        ("away: 3.0", "far: 3.0", "no `param` named `far`"),
        ("position: [0, 0]", "position: [9, 0]", "outside of the world"),
        ("position: [0, 0]", "position: [3.2, 3.2]", "something stands at the start"),
        ("[-2, -3], [-2, -2]", "[-1, -3], [-2, -3]", "no polygon"),
        ("tasks: [[0, 1, 0]]", "tasks: [[0, 9, 0]]", "outside of the world"),
    ],
)
def test_each_command_says_it_as_it_is_called(
    old: str, new: str, story: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "two.krd", tmp_path / "two.yaml"
    program.write_text(PROGRAM, "utf-8")
    assert old in WHOLE
    path.write_text(WHOLE.replace(old, new), "utf-8")
    said = []
    for words in (
        ["config", "check", str(path)],
        ["sim", str(program), str(path), "--no-html", "--rounds", "1"],
        ["deploy", str(program), str(path), "--all-local", "--rounds", "1"],
    ):
        assert main(words) == Exit.BAD_INPUT
        out, err = capsys.readouterr()
        said.append(out + err)
    assert story in said[0]
    assert said[0] == said[1] == said[2]


def test_all_three_see_that_a_run_may_not_begin_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "one.krd", tmp_path / "one.yaml"
    program.write_text(
        "using Motion:\n    sensors:\n        pos psn\n    actuators:\n        pos target\n"
        "Go:\n    eff: Motion.target = Motion.psn\nassume: Motion.psn.x <= 1.0\n",
        "utf-8",
    )
    path.write_text("num_robots: 1\npositions: {0: [2, 0]}\n", "utf-8")
    for words in (
        ["config", "check", str(path)],
        ["sim", str(program), str(path), "--no-html"],
        ["deploy", str(program), str(path), "--all-local", "--rounds", "1"],
    ):
        assert main(words) == Exit.BAD_INPUT
        out, err = capsys.readouterr()
        assert "K934" in out + err


def test_a_configuration_by_itself_is_checked_as_far_as_that_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "alone.yaml"
    path.write_text(WHOLE, "utf-8")
    assert main(["config", "check", str(path)]) == Exit.OK
    assert "suits" not in capsys.readouterr().out
    path.write_text(WHOLE.replace("kind: Bird", "kind: Fish"), "utf-8")
    assert main(["config", "check", str(path)]) == Exit.OK  # who has kinds is the program
    capsys.readouterr()
    program = tmp_path / "other.krd"
    program.write_text(PROGRAM, "utf-8")
    assert main(["config", "check", str(path), "--program", str(program)]) == Exit.BAD_INPUT
    assert "of kind Fish" in capsys.readouterr().out
    path.write_text(WHOLE.replace("[-2, -3], [-2, -2]", "[-1, -3], [-2, -3]"), "utf-8")
    assert main(["config", "check", str(path), "--json"]) == Exit.BAD_INPUT
    assert "no polygon" in json.dumps(json.loads(capsys.readouterr().out))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_examples_suit_their_programs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if path.stem == "expected":
        return
    assert main(["config", "check", str(path)]) == Exit.OK
    assert ("suits" in capsys.readouterr().out) is path.with_suffix(".krd").exists()


@pytest.mark.parametrize(
    ("flags", "place"), [((), "c.yaml:2:10: "), (("--set", "speeed=3"), "--set: ")]
)
def test_an_unknown_param_is_told_where_it_is_set(
    flags: tuple[str, ...],
    place: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.krd").write_text("param int speed = 1\nlocal:\n  int n = speed\n", "utf-8")
    Path("c.yaml").write_text("num_robots: 1\nparams: {speeed: 2}\ndevice: {bot_type: IDEAL}\n")
    assert main(["sim", "p.krd", "c.yaml", "--no-html", *flags]) == Exit.BAD_INPUT
    assert f"{place}error K236" in capsys.readouterr().err


@pytest.mark.parametrize(("kind", "usual"), [("CAR", "RRT_CAR"), ("QUAD", "RRT_DRONE")])
def test_a_device_without_a_planner_has_the_usual_one(
    kind: str, usual: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, path = tmp_path / "goes.krd", tmp_path / "run.yaml"
    program.write_text(PROGRAM.partition("\nagent Bird")[0] + "param float away = 2.0\n", "utf-8")
    text = f"agents: [{{pid: 0, on_device: it}}]\ndevices:\n  it: {{bot_type: {kind}}}\n"
    path.write_text(text + "world: {bounds: {low: [-3, -3, 0], high: [3, 3, 3]}}\n", "utf-8")
    assert main(["config", "check", str(path), "--program", str(program)]) == Exit.OK
    told = f"run.yaml:3:7: warning K949: it is not said how it plans its paths: {usual} is taken"
    assert told in capsys.readouterr().out
    program.write_text("local:\n  int n = 0\nE:\n  eff: n = 1\n", "utf-8")
    assert main(["config", "check", str(path), "--program", str(program)]) == Exit.OK
    assert "plans its paths" not in capsys.readouterr().out  # nobody moves


@pytest.mark.parametrize("placed", ["positions: {0: [0, 0, 1]}", ""])
def test_more_robots_than_have_places_begin_anywhere(
    placed: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Who asks for more robots than have places is told that these begin in no order."""
    program, path = tmp_path / "goes.krd", tmp_path / "run.yaml"
    program.write_text(PROGRAM.partition("\nagent Bird")[0] + "param float away = 2.0\n", "utf-8")
    device = "device: {bot_type: QUAD, planner: STRAIGHT}\nnum_robots: 1\n"
    world = "world: {bounds: {low: [-3, -3, 0], high: [3, 3, 3]}}\n"
    path.write_text(f"{device}{world}{placed}\n", "utf-8")
    words = ["sim", str(program), str(path), "--no-html", "--time", "0.2", "--robots"]
    main([*words, "1"])
    story = "it is said where 1 of 2 robots begin: others do so anywhere"
    assert story not in capsys.readouterr().err
    main([*words, "2"])
    assert (story in capsys.readouterr().err) == bool(placed)


@pytest.mark.parametrize(
    ("driver", "told"),
    [
        ("driver: simm", "no driver simm"),
        ("driver: sim, options: {a: 1}", "unknown field `a`"),
        ("driver: sim, localiser: natnett", "no localiser natnett"),
    ],
)
def test_drivers_and_localisers_and_their_options_are_checked(
    driver: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-LOCATE-NAME)"""
    path = tmp_path / "car.yaml"
    path.write_text(
        f"agents: [{{pid: 0, on_device: car}}]\ndevices:\n  car: {{planner: RRT_CAR, {driver}}}\n"
        "world: {bounds: {low: [-3, -3, 0], high: [3, 3, 3]}}\n",
        encoding="utf-8",
    )
    assert main(["config", "check", str(path)]) == Exit.BAD_INPUT
    assert told in capsys.readouterr().out
