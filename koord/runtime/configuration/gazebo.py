"""Worlds of Gazebo (SDFormat) as obstacles: what stands in the way, as upright prisms. (P-WORLD)

Shapes of collisions are taken: boxes, cylinders, capsules, spheres, polylines, and a level plane
for the ground. What is tilted is taken as the prism around it, so nothing that is in the way is
free. What cannot be taken (meshes, files that are not found) is told. (K952)
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeAlias, assert_never
from xml.parsers import expat

from msgspec import Struct, field

from koord.runtime.configuration.reading import problem
from koord.runtime.motion.world import Box, Disc, Flat, Obstacle, Point, Polygon
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Source, Span

#: What does not rise further above the ground is part of it: roads, floors, lawns.
FLAT_M = 0.05

#: Numbers are off by so much at most where angles are written with a few digits.
_EXACT = 1e-6

#: Models are included or nested this deep at most.
_DEEPEST = 50

#: A world with more shapes than this is none.
MOST_SHAPES = 100_000

#: Of things in a message, so many are told.
_MOST_NAMES = 5

#: Models that every Gazebo has, and that are no obstacle.
_KNOWN = {"sun", "ground_plane"}

#: Finds the file of an included model by its URI; None if there is none.
Find: TypeAlias = Callable[[str], Source | None]


class Standing(Struct, frozen=True):
    """An obstacle, and where it stands in the file of its world."""

    obstacle: Obstacle
    span: Span


class GazeboWorld(Struct, frozen=True):
    """The obstacles of a world, and what of it is taken otherwise or not at all."""

    source: Source
    obstacles: tuple[Standing, ...]
    warnings: tuple[Diagnostic, ...]
    sources: tuple[Source, ...]  #: files that it is read from


def is_world(source: Source) -> bool:
    """Return whether a text looks like XML, as worlds do and configurations do not."""
    return source.text.lstrip("\ufeff \t\n").startswith("<")


def read_world(source: Source, find: Find) -> GazeboWorld:
    """Read the obstacles of a world, or of a model. Raises KoordError for what is none. (K953)"""
    reader = _WorldReader(find)
    reader.file(source, _HERE, None, 0)
    return GazeboWorld(
        source, tuple(reader.standing), tuple(reader.warnings()), tuple(reader.sources)
    )


def told_as_yaml(world: GazeboWorld) -> str:
    """The obstacles of a world as the `world:` of a configuration or a site."""
    lines = ["world:", "  obstacles:" if world.obstacles else "  obstacles: []"]
    lines += [f"    - {json.dumps(_fields(one.obstacle))}" for one in world.obstacles]
    return "\n".join(lines) + "\n"


def _fields(obstacle: Obstacle) -> dict[str, dict[str, object]]:
    low, high = _short(obstacle.low_z), _short(obstacle.high_z)
    match obstacle:
        case Box():
            return {"box": {"low": _short(*obstacle.low), "high": _short(*obstacle.high)}}
        case Disc(centre=(x, y), radius_m=radius):
            round_ = {"centre": _short(x, y), "radius": _short(radius)[0]}
            return {"disc": round_ | {"low_z": low[0], "high_z": high[0]}}
        case Polygon():
            corners = [_short(*one) for one in obstacle.corners]
            return {"polygon": {"corners": corners, "low_z": low[0], "high_z": high[0]}}
        case _:
            assert_never(obstacle)


def _short(*numbers: float) -> list[float]:
    """Numbers to the micrometre."""
    return [round(one, 6) + 0.0 for one in numbers]


# --- XML ------------------------------------------------------------------------------------------


class _Element(Struct):
    tag: str
    attributes: dict[str, str]
    span: Span
    inner: list[_Element] = field(default_factory=list)
    text: str = ""

    def all(self, *tags: str) -> Iterator[_Element]:
        return (one for one in self.inner if one.tag in tags)

    def first(self, tag: str) -> _Element | None:
        return next(self.all(tag), None)

    def word(self, tag: str) -> str:
        found = self.first(tag)
        return "" if found is None else found.text.strip()

    @property
    def name(self) -> str:
        return self.attributes.get("name") or self.word("name") or self.tag


def _parsed(source: Source) -> _Element:
    """The outermost element of an XML file. Raises KoordError.

    Entities of its own are refused: they grow without bound, or are other files.
    """
    parser = expat.ParserCreate()
    lines = source.text.splitlines() or [""]
    root = _Element("", {}, Span(source.name, 1, 1, 1, 1))
    open_ = [root]

    def here() -> Span:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        end = len(lines[line - 1]) + 1 if line <= len(lines) else column
        return Span(source.name, line, column, line, max(end, column))

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if len(open_) > 4 * _DEEPEST:
            raise KoordError((problem(here(), "nested too deep", code="K930"),))
        element = _Element(tag, attributes, here())
        open_[-1].inner.append(element)
        open_.append(element)

    def end(_tag: str) -> None:
        open_.pop()

    def text(found: str) -> None:
        open_[-1].text += found

    def declare(*_: object) -> None:
        story = "a world has no declarations of document types, and no entities of its own"
        raise KoordError((problem(here(), story, code="K930"),))

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = text, declare
    try:
        parser.Parse(source.text, True)
    except expat.ExpatError as error:
        span = Span(source.name, error.lineno, error.offset + 1, error.lineno, error.offset + 2)
        story = f"not XML: {expat.ErrorString(error.code)}"
        raise KoordError((problem(span, story, code="K930"),)) from None
    return root.inner[0]


# --- poses ----------------------------------------------------------------------------------------


class _Pose(Struct, frozen=True):
    """A place and a rotation, row by row."""

    at: Point
    rows: tuple[Point, Point, Point]

    def point(self, p: Point) -> Point:
        x, y, z = (
            c + sum(a * b for a, b in zip(row, p, strict=True))
            for c, row in zip(self.at, self.rows, strict=True)
        )
        return x, y, z

    def then(self, inner: _Pose) -> _Pose:
        """The pose of what stands at ``inner`` in here."""
        columns = zip(*inner.rows, strict=True)
        turned = [self._turned((x, y, z)) for x, y, z in columns]
        a, b, c = turned
        rows = ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))
        return _Pose(self.point(inner.at), rows)

    def _turned(self, p: Point) -> Point:
        x, y, z = (sum(a * b for a, b in zip(row, p, strict=True)) for row in self.rows)
        return x, y, z

    @property
    def is_upright(self) -> bool:
        return abs(self.rows[2][2]) > 1 - _EXACT


_NO_STATES: Mapping[str, _Pose] = {}

_HERE = _Pose((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


def _numbers(element: _Element, least: int, most: int) -> list[float]:
    """The numbers in an element. Raises KoordError."""
    words = element.text.split()
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = []
    if not least <= len(found) <= most or not all(map(math.isfinite, found)):
        many = f"{least}" if least == most else f"{least} to {most}"
        story = f"`<{element.tag}>` has {many} numbers, not `{' '.join(words)[:60]}`"
        raise KoordError((problem(element.span, story),))
    return found


def _posed(element: _Element | None) -> _Pose:
    """The pose that an element states. Raises KoordError."""
    if element is None or not element.text.split():
        return _HERE
    if element.attributes.get("rotation_format") == "quat_xyzw":
        x, y, z, *turn = _numbers(element, 7, 7)
        return _Pose((x, y, z), _turned_by(turn, element))
    x, y, z, *angles = (*_numbers(element, 3, 6), 0.0, 0.0, 0.0)
    if element.attributes.get("degrees") in ("true", "1"):
        angles = [math.radians(one) for one in angles]
    (cr, cp, cy), (sr, sp, sy) = zip(*((math.cos(a), math.sin(a)) for a in angles[:3]), strict=True)
    return _Pose(
        (x, y, z),
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        ),
    )


def _turned_by(turn: list[float], element: _Element) -> tuple[Point, Point, Point]:
    """The rotation of a quaternion. Raises KoordError."""
    length = math.hypot(*turn)
    if length < _EXACT:
        raise KoordError((problem(element.span, "this is no rotation"),))
    x, y, z, w = (one / length for one in turn)
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


# --- worlds ---------------------------------------------------------------------------------------


class _WorldReader:
    """Walks through worlds and models, and keeps what stands there."""

    def __init__(self, find: Find) -> None:
        self.standing: list[Standing] = []
        self.sources: list[Source] = []
        self._find = find
        self._left_out: dict[str, list[tuple[str, Span]]] = {}

    def warnings(self) -> Iterator[Diagnostic]:
        """What is not taken, of each kind once, at its first place."""
        for kind, found in self._left_out.items():
            names = list(dict.fromkeys(name for name, _ in found))
            more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
            told = f"{', '.join(names[:_MOST_NAMES])}{more}"
            story, hint = _STORIES[kind]
            yield Diagnostic("K952", Severity.WARNING, found[0][1], story.format(names=told), hint)

    def _leave_out(self, kind: str, name: str, span: Span) -> None:
        self._left_out.setdefault(kind, []).append((name, span))

    def file(self, source: Source, outer: _Pose, pose: _Pose | None, depth: int) -> None:
        """Walk through a file; a ``pose`` is instead of that of its model. Raises KoordError."""
        root = _parsed(source)
        self.sources.append(source)
        found = next(root.all("world"), None) or next(root.all("model"), None)
        if root.tag not in ("sdf", "gazebo") or found is None:
            hint = "worlds begin with <sdf version=…> and have one <world>, or one <model>"
            raise KoordError((problem(root.span, "this is no world of Gazebo", hint, "K953"),))
        if found.tag == "model":
            self._model(found, outer, pose, depth)
        else:  # where models are when it was saved, it says apart
            kept = [one for state in found.all("state") for one in state.all("model")]
            states = {one.name: _posed(own) for one in kept if (own := one.first("pose"))}
            self._within(found, outer, depth, states)

    def _within(
        self, place: _Element, pose: _Pose, depth: int, states: Mapping[str, _Pose] = _NO_STATES
    ) -> None:
        """Walk through what stands in a world or a model."""
        if depth > _DEEPEST:
            raise KoordError((problem(place.span, "models are nested too deep"),))
        for one in place.inner:
            match one.tag:
                case "model":
                    self._model(one, pose, states.get(one.name), depth + 1)
                case "include":
                    self._include(one, pose, states.get(one.name), depth + 1)
                case "link":
                    self._link(one, place.name, pose)
                case "actor" | "population" | "road":
                    self._leave_out("thing", one.name, one.span)
                case _:
                    pass

    def _model(self, model: _Element, outer: _Pose, pose: _Pose | None, depth: int) -> None:
        own = model.first("pose")
        if pose is None and not self._is_plain(model, own):
            return
        self._within(model, outer.then(_posed(own) if pose is None else pose), depth)

    def _is_plain(self, of: _Element, pose: _Element | None) -> bool:
        """Return whether a pose is one in what surrounds it; another frame is not looked for."""
        frame = "" if pose is None else pose.attributes.get("relative_to", "")
        frame = frame or ("" if pose is None else pose.attributes.get("frame", ""))
        if frame not in ("", "world", "__model__"):
            self._leave_out("frame", of.name, of.span)
            return False
        return True

    def _include(self, include: _Element, outer: _Pose, state: _Pose | None, depth: int) -> None:
        uri = include.word("uri")
        name = uri.rstrip("/").rpartition("/")[2]
        found = None if name in _KNOWN else self._find(uri)
        if name in _KNOWN or not self._is_plain(include, include.first("pose")):
            return
        if found is None:
            self._leave_out("include", uri or include.name, include.span)
            return
        if depth > _DEEPEST:
            raise KoordError((problem(include.span, "models include each other"),))
        own = include.first("pose")
        pose = None if own is None else _posed(own)
        self.file(found, outer, pose if state is None else state, depth)

    def _link(self, link: _Element, model: str, outer: _Pose) -> None:
        own = link.first("pose")
        if not self._is_plain(link, own):
            return
        pose = outer.then(_posed(own))
        for collision in link.all("collision"):
            placed = collision.first("pose")
            geometry = collision.first("geometry")
            if geometry is not None and self._is_plain(collision, placed):
                self._shape(geometry, model, pose.then(_posed(placed)))

    def _shape(self, geometry: _Element, model: str, pose: _Pose) -> None:
        """Keep the obstacle that a geometry is. Raises KoordError."""
        if len(self.standing) >= MOST_SHAPES:
            raise KoordError((problem(geometry.span, "the world has too many shapes"),))
        for shape in geometry.inner:
            if shape.tag == "plane":
                self._plane(shape, model, pose)
                continue
            obstacle = _obstacle(shape, pose)
            if obstacle is None:
                if shape.tag != "empty":
                    self._leave_out("shape", f"{model} ({shape.tag})", shape.span)
            elif _top(obstacle) <= FLAT_M:
                self._leave_out("flat", model, shape.span)
            else:
                self.standing.append(Standing(obstacle, shape.span))

    def _plane(self, shape: _Element, model: str, pose: _Pose) -> None:
        """The ground is where it is; other planes are no obstacles here."""
        normal = shape.first("normal")
        x, y, z = (0.0, 0.0, 1.0) if normal is None else _numbers(normal, 3, 3)
        (ax, ay, az), (bx, by, bz) = pose.point((x, y, z)), pose.at
        up, length = az - bz, math.dist((ax, ay, az), (bx, by, bz))
        level = length > 0 and up > (1 - _EXACT) * length and abs(bz) <= FLAT_M
        if not level:
            self._leave_out("plane", model, shape.span)


_WRITE = "what is in the way there, `world: {obstacles: …}` of a configuration or of a site says"

#: What is not taken, and what can be done.
_STORIES = {
    "include": (
        "models that are not found are left out: {names}",
        "they are looked for beside the world, in `models`, and in GAZEBO_MODEL_PATH",
    ),
    "shape": ("shapes that are no boxes, cylinders or the like are left out: {names}", _WRITE),
    "thing": ("what moves, and what is made by chance, is left out: {names}", _WRITE),
    "frame": (
        "poses in frames of other things are not worked out: {names} is left out",
        "Gazebo writes poses in the world: gz sdf -p FILE",
    ),
    "plane": ("planes other than the ground are left out: {names}", _WRITE),
    "flat": (
        f"what rises no more than {FLAT_M:g} m counts as ground: {{names}}",
        "robots drive over it, and fly above",
    ),
}


# --- shapes ---------------------------------------------------------------------------------------


def _obstacle(shape: _Element, pose: _Pose) -> Obstacle | None:
    """The prism around a shape; None if it is not known. Raises KoordError."""
    match shape.tag:
        case "box":
            x, y, z = (one / 2 for one in _sizes(shape, "size", 3))
            return _prism(pose, _rectangle(x, y), -z, z)
        case "cylinder":
            (radius,), (length,) = _sizes(shape, "radius", 1), _sizes(shape, "length", 1)
            return _cylinder(pose, radius, length / 2)
        case "capsule":
            (radius,), (length,) = _sizes(shape, "radius", 1), _sizes(shape, "length", 1)
            return _cylinder(pose, radius, length / 2 + radius)
        case "sphere":
            (radius,) = _sizes(shape, "radius", 1)
            x, y, z = pose.at
            return Disc((x, y), radius, z - radius, z + radius)
        case "polyline":
            (height,) = _sizes(shape, "height", 1)
            points = [tuple(_numbers(one, 2, 2)) for one in shape.all("point")]
            corners = [(x, y) for x, y in points]
            if len(corners) > 1 and corners[0] == corners[-1]:
                corners.pop()
            if len(corners) < 3:
                story = "a polyline has at least three corners"
                raise KoordError((problem(shape.span, story),))
            return _prism(pose, corners, 0.0, height)
        case _:
            return None


def _sizes(shape: _Element, tag: str, count: int) -> list[float]:
    """Measures of a shape, in metres. Raises KoordError."""
    found = shape.first(tag)
    if found is None:
        raise KoordError((problem(shape.span, f"`<{tag}>` is missing in this {shape.tag}"),))
    numbers = _numbers(found, count, count)
    if min(numbers) <= 0:
        raise KoordError((problem(found.span, f"`<{tag}>` of a {shape.tag} is more than 0"),))
    return numbers


def _rectangle(x: float, y: float) -> list[Flat]:
    return [(-x, -y), (x, -y), (x, y), (-x, y)]


def _cylinder(pose: _Pose, radius: float, half: float) -> Obstacle:
    if not pose.is_upright:
        return _prism(pose, _rectangle(radius, radius), -half, half)
    x, y, z = pose.at
    return Disc((x, y), radius, z - half, z + half)


def _prism(pose: _Pose, corners: list[Flat], low: float, high: float) -> Obstacle:
    """The prism over corners at a pose; one that is tilted is in the upright one around it."""
    at = [pose.point((x, y, z)) for z in (low, high) for x, y in corners]
    bottom, top = min(z for *_, z in at), max(z for *_, z in at)
    flat = [(x, y) for x, y, _ in at]
    shape = flat[: len(corners)] if pose.is_upright else _hull(flat)
    xs, ys = [x for x, _ in shape], [y for _, y in shape]
    lows, highs = (min(xs), min(ys)), (max(xs), max(ys))
    if len(shape) == 4 and all(
        _near(x, lows[0], highs[0]) and _near(y, lows[1], highs[1]) for x, y in shape
    ):
        return Box((*lows, bottom), (*highs, top))
    return Polygon(tuple(shape), bottom, top)


def _near(value: float, *marks: float) -> bool:
    return any(abs(value - mark) <= 1e-4 for mark in marks)


def _hull(points: Iterable[Flat]) -> list[Flat]:
    """The corners of the convex hull, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted(set(points))
    half: list[list[Flat]] = []
    for chain in (ordered, ordered[::-1]):
        found: list[Flat] = []
        for p in chain:
            while len(found) > 1 and _cross(found[-2], found[-1], p) <= _EXACT**2:
                found.pop()
            found.append(p)
        half.append(found[:-1])
    return half[0] + half[1]


def _cross(a: Flat, b: Flat, c: Flat) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _top(obstacle: Obstacle) -> float:
    return obstacle.high_z
