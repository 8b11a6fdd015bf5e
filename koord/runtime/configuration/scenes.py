"""Scene files of the published simulator: where robots begin, and in what world. (P-SCENE)

A scene is a list of robots with names, types and starts, or has it in ``devices``, beside the name
of a world; or it is a world itself (P-WORLD). It adds to a configuration, or stands for one. What
is taken otherwise than it is written is warned of (K952).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.configuration.checking import load
from koord.runtime.configuration.forms import Coordinates, Name
from koord.runtime.configuration.gazebo import GazeboWorld, is_world, read_world
from koord.runtime.configuration.gazebo_files import finder, world_beside
from koord.runtime.configuration.model import RobotPlace, RunConfiguration
from koord.runtime.configuration.other_files import misread
from koord.runtime.configuration.reading import Document, Path, problem, read_any
from koord.runtime.configuration.typed import FormReader
from koord.runtime.motion.bodies import VEHICLES
from koord.runtime.motion.world import Point, World
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Source, counted

#: Types of the published simulator, in lower case, by the types of vehicles that they are.
_TYPES = {"f1tenth": "CAR"} | {name.lower(): name for name in VEHICLES}

#: Of names in a message, so many are told.
_MOST_NAMES = 5

#: Under this step, the places of a scene are kept in the document of a configuration.
_HERE = "scene"

_FORM = "a scene is a list such as [{bot_name: car0, bot_type: CAR, init_pos: [1, 2, 0]}]"


class _RobotForm(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot in the file of a scene."""

    bot_name: Name
    bot_type: Name
    init_pos: Coordinates
    init_yaw: float = 0.0  #: rad, counter-clockwise from the x axis
    init_lin_vel: Coordinates | None = None  #: m/s


class SceneRobot(Struct, frozen=True):
    """A robot of a scene: its start, its heading, and whether it is moving already."""

    name: str
    type_name: str
    position: Point
    heading_rad: float
    moves: bool
    path: Path  #: where it stands in the file


class SceneFile(Struct, frozen=True):
    """The file of a scene: robots in their order, and the name of a world."""

    document: Document
    robots: tuple[SceneRobot, ...]
    world_name: str | None
    world: GazeboWorld | None = None

    @property
    def source(self) -> Source:
        return self.document.source

    def warning(self, path: Path, message: str, hint: str) -> Diagnostic:
        """Warn of what is taken otherwise than it is written. (K952)"""
        return Diagnostic("K952", Severity.WARNING, self.document.place(path), message, hint)


# --- reading --------------------------------------------------------------------------------------


def read_scene(source: Source) -> SceneFile:
    """Read the file of a scene. Raises KoordError with all mistakes; for other files, K953."""
    if is_world(source):
        world = read_world(source, finder(source.name))
        return SceneFile(Document(source, {}), (), None, world)
    try:
        made = _read(read_any(source))
    except KoordError as error:
        raise KoordError(tuple(_told(source)) or error.diagnostics) from None
    found = None if made.world_name is None else world_beside(source.name, made.world_name)
    if found is None:
        return made
    return replace(made, world=read_world(found, finder(found.name)))


def _told(source: Source) -> Iterator[Diagnostic]:
    """What else a file is that is no scene."""
    for one in misread(source):
        if one.code != "K951":
            yield one
        elif "no configuration" in one.message and "a scene" not in one.message:
            story = one.message.replace("no configuration of a run", "no scene")
            yield problem(one.span, story.replace("no configuration", "no scene"), _FORM, "K953")


def _read(document: Document) -> SceneFile:
    base, listed = _robots_of(document)
    reader = FormReader(document)
    robots = [
        found
        for k, value in enumerate(listed)
        if (found := _robot(reader, value, (*base, k))) is not None
    ]
    world_name = None
    if base:
        for name in document.value:
            if name not in ("world_name", "devices"):
                hint = "a scene has `world_name` and `devices`"
                place = document.name_place((name,))
                reader.problems.append(problem(place, f"there is no field `{name}` here", hint))
        world_name = reader.converted(document.value.get("world_name"), str | None, ("world_name",))
    taken: dict[str, int] = {}
    for robot in robots:
        first = taken.setdefault(robot.name, document.place(robot.path).line)
        if first != document.place(robot.path).line:
            story = f"two robots are called {robot.name}"
            place = document.place((*robot.path, "bot_name"))
            reader.problems.append(problem(place, story, f"the first is in line {first}"))
    if reader.problems:
        raise KoordError(tuple(reader.problems))
    return SceneFile(document, tuple(robots), world_name)


def _robots_of(document: Document) -> tuple[Path, list[Any]]:
    """The list of robots in a file, and where it is. Raises KoordError. (K953)"""
    value = document.value
    if isinstance(value, list) and value:
        return (), value
    devices = value.get("devices") if isinstance(value, dict) else None
    if isinstance(devices, list) and devices and "agents" not in value:
        return ("devices",), devices
    told, hint = "there is no robot with its place in this file", _FORM
    if isinstance(value, dict) and {"agents", "agent", "robot", "num_robots"} & value.keys():
        told = "this is a configuration, which says what robots run on, and no scene"
        hint = "koord sim PROGRAM FILE runs with it; where robots begin, `positions` say"
    raise KoordError((problem(document.place(()), told, hint, "K953"),))


def _robot(reader: FormReader, value: Any, path: Path) -> SceneRobot | None:
    """A robot of a scene; mistakes go to the reader."""
    form: _RobotForm | None = reader.converted(value, _RobotForm, path)
    if form is None:
        return None
    x, y, *rest = form.init_pos
    return SceneRobot(
        form.bot_name,
        form.bot_type,
        (x, y, rest[0] if rest else 0.0),
        form.init_yaw,
        any(form.init_lin_vel or ()),
        path,
    )


# --- a configuration in a scene -------------------------------------------------------------------


def run_of(scene: SceneFile) -> RunConfiguration:
    """The configuration of a run with the robots of a scene. Raises KoordError.

    Their types say what they run on; else all is as where a configuration says nothing.
    """
    if not scene.robots:
        story = "this is a world, which says what stands in it, and nothing of robots"
        hint = "name their configuration, too: koord sim PROGRAM CONFIGURATION --scene FILE"
        raise KoordError((problem(scene.document.place(()), story, hint),))
    unknown = [one for one in scene.robots if one.type_name.lower() not in _TYPES]
    if unknown:
        kinds = ", ".join(dict.fromkeys(one.type_name for one in unknown))
        story = f"there is no vehicle {kinds} here"
        hint = (
            "a configuration says what its robots run on: koord sim PROGRAM CONFIGURATION --scene …"
        )
        place = scene.document.place((*unknown[0].path, "bot_type"))
        raise KoordError((problem(place, story, hint),))
    form = {
        "agents": [{"pid": k, "on_device": one.name} for k, one in enumerate(scene.robots)],
        "devices": {
            one.name: {"bot_type": named, "planner": VEHICLES[named].planners[0].value}
            for one in scene.robots
            for named in [_TYPES[one.type_name.lower()]]
        },
    }
    made = load(Source(scene.source.name, json.dumps(form) + "\n"))
    robots = tuple(replace(robot, vehicle=replace(robot.vehicle, path=())) for robot in made.robots)
    bare = Document(scene.source, {})
    return in_scene(replace(made, robots=robots, document=bare), scene)


def in_scene(configuration: RunConfiguration, scene: SceneFile) -> RunConfiguration:
    """A configuration whose robots begin where a scene says.

    Robots are those of the scene by the names of their devices; where no name is that of a device,
    by their order. Who is not in the scene begins as configured.
    """
    warnings = list[Diagnostic]()
    robots = configuration.robots
    if scene.robots:
        matched = _matched(configuration, scene, warnings)
        robots = tuple(
            _placed(robot, matched[robot.pid], configuration) if robot.pid in matched else robot
            for robot in configuration.robots
        )
        pairs = [(robot, matched[robot.pid]) for robot in robots if robot.pid in matched]
        warnings += _otherwise(scene, pairs)
    document = configuration.document
    spans = {(_HERE, *path): span for path, span in scene.document.spans.items()}
    scenes: tuple[Source, ...] = (scene.source,)
    world = configuration.world
    if (read := scene.world) is not None:
        warnings += read.warnings
        scenes = tuple(dict.fromkeys((*scenes, *read.sources)))
        world = World() if world is None else world
        for k, standing in enumerate(read.obstacles, len(world.obstacles)):
            spans["world", "obstacles", k] = standing.span
        world = replace(
            world, obstacles=(*world.obstacles, *(one.obstacle for one in read.obstacles))
        )
    return replace(
        configuration,
        robots=robots,
        world=world,
        document=replace(document, spans=document.spans | spans, scenes=scenes),
        warnings=(*configuration.warnings, *warnings),
    )


def _matched(
    configuration: RunConfiguration, scene: SceneFile, warnings: list[Diagnostic]
) -> dict[int, SceneRobot]:
    """The robots of a scene by pids; what is odd about them is added to the warnings."""
    places = configuration.robots
    by_name = {one.name: one for one in scene.robots}
    on = [robot.vehicle.name for robot in places]
    named = {r.pid: by_name[r.vehicle.name] for r in places if r.vehicle.name in by_name}
    if not named or len(set(on)) < len(on):  # nor is a device that several share a robot's name
        named = {robot.pid: one for robot, one in zip(places, scene.robots, strict=False)}
        story = "robots are placed in the order of this scene, whose names are none of devices"
        hint = f"devices here are {_names(dict.fromkeys(on))}"
        warnings.append(scene.warning((), story, hint))
    used = {one.name for one in named.values()}
    if idle := [one for one in scene.robots if one.name not in used]:
        are = "is" if len(idle) == 1 else "are"
        story = f"{_names(one.name for one in idle)} {are} in the scene and in no run"
        hint = f"the configuration has {counted(len(places), 'robot')}, on {_names(on)}"
        warnings.append(scene.warning(idle[0].path, story, hint))
    if lost := [robot for robot in places if robot.pid not in named]:
        who, have = ("robot", "has") if len(lost) == 1 else ("robots", "have")
        numbers = _names(str(robot.pid) for robot in lost)
        story = f"{who} {numbers} of the configuration {have} no place in this scene"
        hint = "they begin as configured, or where there is room for them"
        warnings.append(scene.warning((), story, hint))
    return named


def _placed(robot: RobotPlace, one: SceneRobot, configuration: RunConfiguration) -> RobotPlace:
    """A robot where the scene has it; what drives is on the ground, however high it is dropped."""
    x, y, z = one.position
    if robot.vehicle.body.ON_GROUND:
        world = configuration.world
        z = world.ground if world is not None and configuration.bounded else min(z, 0.0)
    path = (_HERE, *one.path, "init_pos")
    return replace(robot, position=(x, y, z), heading_rad=one.heading_rad, path=path)


def _otherwise(
    scene: SceneFile,
    pairs: Sequence[tuple[RobotPlace, SceneRobot]],
) -> Iterator[Diagnostic]:
    """Warn of all else that a scene says and that is taken otherwise, of each kind once."""
    if scene.world_name is not None and scene.world is None:
        story = f"the world {scene.world_name!r} is not found: nothing of it stands in the way"
        hint = "it is looked for beside the scene, in `worlds`, and in GAZEBO_RESOURCE_PATH"
        yield scene.warning(("world_name",), story, hint)
    if moving := [one for _, one in pairs if one.moves]:
        story = f"{_who(moving)} at rest here"
        hint = "`init_lin_vel` has no effect: vehicles are simulated from standing"
        yield scene.warning((*moving[0].path, "init_lin_vel"), story, hint)
    for robot, one in pairs:
        own = robot.vehicle.type_name
        if _TYPES.get(one.type_name.lower()) != own:
            story = f"{one.name} is a {one.type_name} in the scene, and robot {robot.pid} a {own}"
            hint = "the configuration says what its robots run on"
            yield scene.warning((*one.path, "bot_type"), story, hint)
            break
    if high := [one for robot, one in pairs if _z(robot) != one.position[2]]:
        story = f"{_who(high)} on the ground"
        hint = f"the scene has {high[0].name} at z = {high[0].position[2]:g} m, from where it falls"
        yield scene.warning((*high[0].path, "init_pos"), story, hint)


def _z(robot: RobotPlace) -> float:
    assert robot.position is not None
    return robot.position[2]


def _who(robots: Sequence[SceneRobot]) -> str:
    return f"{_names(one.name for one in robots)} {'begins' if len(robots) == 1 else 'begin'}"


def _names(names: Iterable[str]) -> str:
    """Names in a row; of many only the first."""
    listed = list(names)
    more = len(listed) - _MOST_NAMES
    return ", ".join(listed) if more <= 0 else f"{', '.join(listed[:_MOST_NAMES])} and {more} more"
