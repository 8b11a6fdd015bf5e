"""Scene files of the published simulator say where robots begin. (P-SCENE)"""

from __future__ import annotations

from pathlib import Path

import pytest

import koord
from koord.api.fitting import configuration_of_scene
from koord.cli.main import main
from koord.runtime.configuration.checking import load
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.configuration.scenes import in_scene, read_scene
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.source import Source

#: A list alone, as most are.
LIST = """\
- {bot_name: "low", bot_type: "f1tenth", init_pos: [-9, 8.5, 0.3]}
- {bot_name: "high", bot_type: "QUAD", init_pos: [5.0, -6.0, 1.25]}
"""

#: With a world, velocities, a heading in quotes, and a space that is missing.
WORLD = """\
world_name: "town.world"
devices:
# - {bot_name: "nobody", bot_type: "QUAD", init_pos: [0, 0, 0]}
- {bot_name: "high", bot_type: "QUAD", init_pos: [0, 1, 2], init_yaw: 1.5, init_lin_vel: [0, 3, 0]}
- {bot_name: "low", bot_type: "PLANE", init_pos:[4, 5], 'init_yaw': -0.5}
"""

CONFIGURATION = """\
agents:
  - {pid: 0, on_device: low, position: [1, 1, 0]}
  - {pid: 1, on_device: high}
devices:
  low: {bot_type: CAR, planner: STRAIGHT}
  high: {bot_type: QUAD, planner: STRAIGHT}
world: {bounds: {low: [-20, -20, 0], high: [20, 20, 5]}}
"""

PROGRAM = """\
using Motion:
    sensors:
        pos psn

local:
    pos seen

Look:
    pre: true
    eff:
        seen = Motion.psn
        stop
"""


def placed(scene: str, configuration: str = CONFIGURATION) -> RunConfiguration:
    return in_scene(load(Source("c.yaml", configuration)), read_scene(Source("s.yml", scene)))


def starts(configuration: RunConfiguration) -> list[tuple[object, float]]:
    return [(robot.position, robot.heading_rad) for robot in configuration.robots]


def warned(configuration: RunConfiguration) -> list[tuple[int, str]]:
    """What is taken otherwise: lines of the scene, and messages."""
    told = [one for one in configuration.warnings if one.code == "K952"]
    assert {one.span.file for one in told} <= {"s.yml"}
    return [(one.span.line, one.message) for one in told]


def refused(scene: str) -> list[Diagnostic]:
    with pytest.raises(KoordError) as error:
        configuration_of_scene(Source("s.yml", scene))
    return list(error.value.diagnostics)


def test_robots_begin_where_their_devices_are_in_the_scene() -> None:
    made = placed(LIST)
    assert starts(made) == [((-9.0, 8.5, 0.0), 0.0), ((5.0, -6.0, 1.25), 0.0)]
    assert [robot.vehicle.type_name for robot in made.robots] == ["CAR", "QUAD"]
    assert warned(made) == [(1, "low begins on the ground")]
    assert [one.name for one in made.document.sources] == ["c.yaml", "s.yml"]


def test_what_a_scene_says_besides_is_told() -> None:
    made = placed(WORLD)
    assert starts(made) == [((4.0, 5.0, 0.0), -0.5), ((0.0, 1.0, 2.0), 1.5)]
    assert warned(made) == [
        (1, "the world 'town.world' is not found: nothing of it stands in the way"),
        (4, "high begins at rest here"),
        (5, "low is a PLANE in the scene, and robot 0 a CAR"),
    ]


def test_who_is_not_in_both_is_told() -> None:
    made = placed(LIST.replace("low", "fleet"))
    assert starts(made) == [((1.0, 1.0, 0.0), 0.0), ((5.0, -6.0, 1.25), 0.0)]
    assert [message for _, message in warned(made)] == [
        "fleet is in the scene and in no run",
        "robot 0 of the configuration has no place in this scene",
    ]


@pytest.mark.parametrize("shared", [True, False])
def test_by_other_names_robots_stand_in_the_order_of_the_scene(shared: bool) -> None:
    own = CONFIGURATION.replace("low:", "a:", 1).replace("on_device: low", "on_device: a")
    own = own.replace("  low: {", "  a: {").replace("high: {bot", "b: {bot")
    own = own.replace("on_device: high", "on_device: b")
    if shared:  # one device, which has the name of a robot in the scene
        own = "num_robots: 2\ndevice: {bot_name: high, bot_type: QUAD, planner: STRAIGHT}\n"
    made = placed(LIST, own)
    assert [robot.position[:2] for robot in made.robots if robot.position] == [(-9, 8.5), (5, -6)]
    assert warned(made)[0][1].startswith("robots are placed in the order of this scene")


def test_a_start_that_cannot_be_is_told_with_its_place_in_the_scene() -> None:
    with pytest.raises(KoordError) as error:
        koord.simulate(
            koord.Source("look.krd", PROGRAM), placed(LIST.replace("5.0", "50")), rounds=1
        )
    *_, found = error.value.diagnostics
    assert (found.span.file, found.span.line) == ("s.yml", 2)
    assert "outside of the world" in found.message


def test_a_scene_without_a_configuration_is_a_run_of_its_robots(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, scene = tmp_path / "look.krd", tmp_path / "scene.yml"
    program.write_text(PROGRAM, "utf-8")
    scene.write_text(LIST, "utf-8")
    assert main(["sim", str(program), "--scene", str(scene), "--no-html"]) == 0
    out, err = capsys.readouterr()
    assert "2 robots (1 low, 1 high)" in out
    assert "K952" in err
    assert f"{scene}:1" in err


@pytest.mark.parametrize(
    ("text", "code", "line", "message"),
    [
        (WORLD, "K931", 5, "there is no vehicle PLANE here"),
        (LIST.replace("high", "low"), "K931", 2, "two robots are called low"),
        (LIST.replace("[5.0, -6.0, 1.25]", "[5.0]"), "K931", 2, "length >= 2"),
        (LIST.replace("init_pos: [5.0", "position: [5.0"), "K931", 2, "no field `position`"),
        (f"wind: 3\n{WORLD}", "K931", 1, "there is no field `wind` here"),
        (WORLD.replace("[0, 1, 2]", "array([0, 1, 2])"), "K930", 4, "NumPy"),
        (CONFIGURATION, "K953", 1, "this is a configuration"),
        ("2020-01-02 03:04:05: {x: 1}\n", "K953", 1, "results of experiments"),
        ("agent: include('agent')\nnum: int(min=0)\n", "K953", 1, "this is a schema"),
        ("[]\n", "K953", 1, "no robot with its place"),
        ("devices: []\n", "K953", 1, "no robot with its place"),
        ("", "K930", 1, "no fields"),
        ("- {", "K930", 1, "not YAML"),
    ],
)
def test_what_is_no_scene_is_told(text: str, code: str, line: int, message: str) -> None:
    found = refused(text)[0]
    assert (found.code, found.span.line) == (code, line)
    assert message in found.message
    assert "no configuration" not in found.message
