"""Worlds of Gazebo become obstacles, and what of them does not is told. (P-WORLD)"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest

import koord
from koord.cli.main import main
from koord.runtime.configuration.checking import load
from koord.runtime.configuration.gazebo import GazeboWorld, read_world, told_as_yaml
from koord.runtime.configuration.gazebo_files import finder, world_beside
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.configuration.scenes import in_scene, read_scene, run_of
from koord.runtime.motion.world import Box, Disc, Obstacle, Polygon, World
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

BOX = "<box><size>2 4 6</size></box>"
TUBE = "<cylinder><radius>0.5</radius><length>3</length></cylinder>"


def solid(shape: str, pose: str = "", name: str = "it", link: str = "", more: str = "") -> str:
    """A model with one shape, its pose, and that of its link."""
    return (
        f'<model name="{name}"><static>1</static><pose>{pose}</pose><link name="l"><pose>{link}'
        f'</pose><collision name="c"><geometry>{shape}</geometry>{more}</collision></link></model>'
    )


def world(inner: str) -> str:
    return f'<?xml version="1.0"?>\n<sdf version="1.6"><world name="w">\n{inner}\n</world></sdf>\n'


def read(inner: str, **models: str) -> GazeboWorld:
    def find(uri: str) -> Source | None:
        text = models.get(uri.removeprefix("model://"))
        return None if text is None else Source(uri, f"<sdf version='1.6'>{text}</sdf>")

    return read_world(Source("w.world", world(inner)), find)


def obstacles(inner: str, **models: str) -> list[Obstacle]:
    return [one.obstacle for one in read(inner, **models).obstacles]


def told(inner: str) -> list[str]:
    found = read(inner).warnings
    assert {(one.code, one.span.file) for one in found} <= {("K952", "w.world")}
    return [one.message for one in found]


def refused(text: str) -> tuple[str, int, str]:
    with pytest.raises(KoordError) as error:
        read_world(Source("w.world", text), lambda uri: None)
    (found,) = error.value.diagnostics
    return found.code, found.span.line, found.message


def near(one: Obstacle, other: Obstacle) -> bool:
    """Return whether two obstacles are equal but for rounding."""
    match one, other:
        case Box(), Box():
            pairs = [*zip(one.low, other.low, strict=True), *zip(one.high, other.high, strict=True)]
        case Disc(), Disc():
            pairs = [
                *zip(one.centre, other.centre, strict=True),
                (one.radius_m, other.radius_m),
                (one.low_z, other.low_z),
                (one.high_z, other.high_z),
            ]
        case Polygon(), Polygon():
            pairs = [(one.low_z, other.low_z), (one.high_z, other.high_z)]
            for p in other.corners:
                pairs.append((min(math.dist(p, q) for q in one.corners), 0.0))
            pairs.append((len(one.corners), len(other.corners)))
        case _:
            return False
    return all(abs(a - b) < 1e-6 for a, b in pairs)


HALF = math.sqrt(2) / 2

#: Of a box of 2 m along x and 4 m along y, turned by 45°.
TURNED = Polygon(
    tuple((HALF * (x - y), HALF * (x + y)) for x, y in [(-1, -2), (1, -2), (1, 2), (-1, 2)]),
    -2.0,
    4.0,
)


@pytest.mark.parametrize(
    ("shape", "pose", "link", "expected"),
    [
        (BOX, "", "0 0 3", Box((-1, -2, 0), (1, 2, 6))),
        (BOX, "10 20 1", "1 2 3", Box((10, 20, 1), (12, 24, 7))),
        # The link stands in the frame of its turned model.
        (BOX, "10 0 0 0 0 1.5707963267948966", "5 0 0", Box((8, 4, -3), (12, 6, 3))),
        (BOX, "0 0 1 0 0 0.7853981633974483", "", TURNED),
        # Laid on its side: 6 m along x, 2 m high.
        (BOX, "0 0 1 0 1.5707963267948966 0", "", Box((-3, -2, 0), (3, 2, 2))),
        (BOX, "0 0 3 1.5707963267948966 0 0", "", Box((-1, -3, 1), (1, 3, 5))),
        (TUBE, "1 2 1.5", "", Disc((1, 2), 0.5, 0, 3)),
        (TUBE, "1 2 1.5 3.141592653589793 0 2", "", Disc((1, 2), 0.5, 0, 3)),
        # A tree that fell along x.
        (TUBE, "0 0 1 0 1.5707963267948966 0", "", Box((-1.5, -0.5, 0.5), (1.5, 0.5, 1.5))),
        (TUBE.replace("cylinder", "capsule"), "", "", Disc((0, 0), 0.5, -2, 2)),
        ("<sphere><radius>2</radius></sphere>", "1 0 1", "", Disc((1, 0), 2, -1, 3)),
        (
            "<polyline><point>0 0</point><point>3 0</point><point>0 4</point><point>0 0</point>"
            "<height>2</height></polyline>",
            "0 0 0 0 0 3.141592653589793",
            "",
            Polygon(((0, 0), (-3, 0), (0, -4)), 0, 2),
        ),
    ],
    ids=itertools.count(),
)
def test_shapes_are_the_prisms_around_them(
    shape: str, pose: str, link: str, expected: Obstacle
) -> None:
    (found,) = obstacles(solid(shape, pose, link=link))
    assert near(found, expected), found


def test_poses_may_be_quaternions_or_in_degrees() -> None:
    ways = [
        solid(BOX).replace("<pose></pose>", f"<pose {how}</pose>", 1)
        for how in (
            'rotation_format="quat_xyzw">0 0 1 0 0 0.3826834323650898 0.9238795325112867',
            'degrees="true">0 0 1 0 0 45',
        )
    ]
    assert all(near(found, TURNED) for found in obstacles("".join(ways)))


def test_models_are_nested_and_included_where_they_are_to_be() -> None:
    tower = solid(BOX, "0 0 3", "tower")
    nested = f'<model name="outer"><pose>10 0 0</pose>{tower}</model>'
    include = "<include><uri>model://tower</uri>POSE</include>"
    here = [
        nested,
        include.replace("POSE", ""),
        include.replace("POSE", "<pose>0 50 3</pose>"),  # instead of its own
    ]
    found = obstacles("".join(here), tower=tower)
    lows = [one.low for one in found if isinstance(one, Box)]
    assert lows == [(9, -2, 0), (-1, -2, 0), (-1, 48, 0)]


def test_a_saved_world_says_apart_where_its_models_are() -> None:
    state = '<state world_name="w"><model name="it"><pose>7 0 3 0 0 0</pose></model></state>'
    (found,) = obstacles(solid(BOX, "0 0 3") + state)
    assert isinstance(found, Box)
    assert found.low == (6, -2, 0)


def test_what_is_not_taken_is_told() -> None:
    mesh = "<mesh><uri>model://a.dae</uri></mesh>"
    plane = "<plane><normal>{}</normal></plane>"
    inner = [
        "<include><uri>model://sun</uri></include><include><uri>model://ground_plane</uri></include>",
        solid(plane.format("0 0 1"), name="floor"),
        solid("<empty/>", name="nothing"),
        "<include><uri>model://house</uri></include><include><uri>model://house</uri></include>",
        solid(mesh, name="roof"),
        solid(plane.format("1 0 0"), name="wall"),
        solid("<box><size>50 5 0.02</size></box>", name="road"),
        solid(BOX, name="odd").replace("<pose>", "<pose relative_to='roof'>", 1),
        '<actor name="walker"></actor>',
    ]
    assert told("".join(inner)) == [
        "models that are not found are left out: model://house",
        "shapes that are no boxes, cylinders or the like are left out: roof (mesh)",
        "planes other than the ground are left out: wall",
        "what rises no more than 0.05 m counts as ground: road",
        "poses in frames of other things are not worked out: odd is left out",
        "what moves, and what is made by chance, is left out: walker",
    ]
    assert obstacles("".join(inner)) == []
    many = "".join(solid(mesh, name=f"m{k}") for k in range(9))
    assert told(many)[0].endswith("m4 (mesh) and 4 more")


@pytest.mark.parametrize(
    ("text", "code", "line", "message"),
    [
        (world("<model>"), "K930", 4, "not XML: mismatched tag"),
        ("<kml></kml>", "K953", 1, "no world of Gazebo"),
        ("<sdf></sdf>", "K953", 1, "no world of Gazebo"),
        (world(solid(BOX.replace("4", "four"))), "K931", 3, "`<size>` has 3 numbers"),
        (world(solid(BOX.replace("4", "nan"))), "K931", 3, "`<size>` has 3 numbers"),
        (world(solid(BOX.replace("4", "-4"))), "K931", 3, "more than 0"),
        (world(solid("<box/>")), "K931", 3, "`<size>` is missing"),
        (world(solid(BOX, "1 2")), "K931", 3, "`<pose>` has 3 to 6 numbers"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><sdf/>", "K930", 1, "no declarations"),
        ("<a>" * 1000, "K930", 1, "nested too deep"),
    ],
)
def test_mistakes_in_worlds_have_their_places(
    text: str, code: str, line: int, message: str
) -> None:
    found = refused(text)
    assert found[:2] == (code, line)
    assert message in found[2]


def test_models_that_include_each_other_are_refused() -> None:
    loop = '<model name="m"><include><uri>model://m</uri></include></model>'
    with pytest.raises(KoordError, match="include each other"):
        read("<include><uri>model://m</uri></include>", m=loop)


def test_obstacles_are_written_as_configurations_have_them() -> None:
    tilted = "0 0 1 0 0 0.7853981633974483"
    shapes = [solid(BOX, "0 0 3"), solid(TUBE, "1 2 1.5"), solid(BOX, tilted)]
    made = read("".join(shapes))
    again = load(Source("site.yaml", f"num_robots: 1\n{told_as_yaml(made)}"))
    assert again.world is not None
    pairs = zip(again.world.obstacles, (one.obstacle for one in made.obstacles), strict=True)
    assert all(near(one, other) for one, other in pairs)
    assert load(Source("s.yaml", f"num_robots: 1\n{told_as_yaml(read(''))}")).world == World()


# --- files, and runs ------------------------------------------------------------------------------


CONFIGURATION = """\
agents: [{pid: 0, on_device: a, position: [0, 0, 0]}]
devices: {a: {bot_type: CAR, planner: RRT_CAR}}
world: {obstacles: [{disc: {centre: [5, 5], radius: 0.5}}]}
"""

SCENE = """\
world_name: town.world
devices: [{bot_name: a, bot_type: CAR, init_pos: [-4, 0, 0]}]
"""


def in_(scene: Path) -> RunConfiguration:
    text = Source(str(scene), scene.read_text("utf-8"))
    return in_scene(load(Source("c.yaml", CONFIGURATION)), read_scene(text))


def folder(path: Path) -> Path:
    """A scene beside a world that includes a model."""
    (path / "worlds").mkdir()
    (path / "models" / "tower").mkdir(parents=True)
    tower = solid(BOX, "0 0 3", "tower")
    (path / "models" / "tower" / "model.sdf").write_text(f"<sdf version='1.6'>{tower}</sdf>")
    inner = "<include><uri>model://tower</uri><pose>1.5 0 3</pose></include>"
    (path / "worlds" / "town.world").write_text(world(inner))
    (path / "scene.yml").write_text(SCENE)
    return path


def test_the_world_of_a_scene_stands_in_the_way(tmp_path: Path) -> None:
    made = in_(folder(tmp_path) / "scene.yml")
    assert made.world is not None
    assert made.world.obstacles == (Disc((5, 5), 0.5), Box((0.5, -2, 0), (2.5, 2, 6)))
    assert [robot.position for robot in made.robots] == [(-4, 0, 0)]
    names = [Path(one.name).name for one in made.document.sources]
    assert names == ["c.yaml", "scene.yml", "town.world", "model.sdf"]
    assert made.place("world", "obstacles", 1).file.endswith("model.sdf")
    assert made.warnings == ()


def test_a_world_alone_is_no_run(tmp_path: Path) -> None:
    path = folder(tmp_path) / "worlds" / "town.world"
    made = in_(path)
    assert made.world is not None
    assert len(made.world.obstacles) == 2
    assert [robot.position for robot in made.robots] == [(0, 0, 0)]
    with pytest.raises(KoordError, match="nothing of robots"):
        run_of(read_scene(Source(str(path), path.read_text("utf-8"))))


def test_models_and_worlds_are_where_gazebo_looks(tmp_path: Path) -> None:
    folder(tmp_path)
    there = str(tmp_path / "models")
    elsewhere = str(tmp_path / "a" / "b" / "c.world")
    assert finder(elsewhere, {})("model://tower") is None
    found = finder(elsewhere, {"GAZEBO_MODEL_PATH": f"/no:{there}"})("model://tower")
    assert found is not None
    assert found.name.endswith("tower/model.sdf")
    assert finder(elsewhere, {"GAZEBO_MODEL_PATH": there})("https://a.b/tower") is None
    assert world_beside(elsewhere, "town.world", {}) is None
    assert world_beside(elsewhere, "town.world", {"GAZEBO_RESOURCE_PATH": str(tmp_path)})


def test_a_world_is_printed_for_the_file_of_a_site(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder(tmp_path) / "worlds" / "town.world"
    assert main(["config", "world", str(path)]) == 0
    out, err = capsys.readouterr()
    box = '{"box": {"low": [0.5, -2.0, 0.0], "high": [2.5, 2.0, 6.0]}}'
    assert out == f"world:\n  obstacles:\n    - {box}\n"
    assert err == ""
    path.write_text(world(solid("<mesh/>")))
    assert main(["config", "world", str(path)]) == 0
    out, err = capsys.readouterr()
    assert (out, "K952" in err) == ("world:\n  obstacles: []\n", True)
    path.write_text("agents: []\n")
    assert main(["config", "world", str(path)]) == 2
    assert "not XML" in capsys.readouterr()[1]
    assert main(["config", "world"]) == 2


def test_a_robot_that_begins_in_an_obstacle_is_told(tmp_path: Path) -> None:
    path = folder(tmp_path) / "scene.yml"
    path.write_text(SCENE.replace("-4", "1"))
    program = koord.Source("go.krd", "using Motion:\n    actuators:\n        pos target\n\n" + GO)
    with pytest.raises(KoordError, match="something stands at the start"):
        koord.simulate(program, in_(path), rounds=1)


GO = "Go:\n    pre: true\n    eff:\n        Motion.target = pos(3.5, 0, 0)\n"
