"""Export of a run to MCAP: transforms, a scene, events, variables and a log.

Transforms, scene and log have the well-known schemas of the Foxglove viewers (``foxglove.…``, JSON
encoding), so that these draw them; the rest is JSON with schemas of its own. Times are nanoseconds
from the beginning of the run.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator
from operator import itemgetter
from typing import IO

import msgspec
import numpy as np

from koord.runtime.motion.world import Obstacle, Polygon
from koord.runtime.records import RecordFile
from koord.runtime.shapes import Array, PerRobot, Sequence, element_of
from koord.sim.files.drawing import (
    TASKS,
    WALL,
    Colour,
    Solid,
    body_of,
    fractions,
    hue,
    rings,
    solid_of,
)
from koord.sim.files.rows import Pattern, hole, texts, to_parts
from koord.sim.files.schemas import (
    CHANGES,
    LOG,
    PROGRAM,
    ROUND,
    SCENE,
    TRANSFORMS,
    Message,
    Naming,
    naming,
)
from koord.sim.run_log import (
    SHARED,
    WHOLE,
    Header,
    Idle,
    LoggedChange,
    LoggedPath,
    LoggedReload,
    LoggedRobot,
    LoggedRound,
    LogSizes,
    RunLog,
    TaskState,
    reload_words,
    turns_of,
)

_INFO, _ERROR = 2, 4
_WORLD = "world"

#: Straight paths are drawn at most so often; some programs give a new one in every round.
_STRAIGHT_S = 1.0

#: So many transforms are made at once, or those of one time.
_AT_ONCE = 4_096


def mcap_of(recording: RunLog) -> bytes:
    """Export a run as an MCAP file."""
    raw = io.BytesIO()
    file = _begun(recording, raw)
    messages = _Messages(recording.header)
    _add(file, [*_scenery(recording.header), *messages.of(recording)])
    file.close()
    return raw.getvalue()


class PartRecord:
    """An MCAP file that is written while the run goes on, and is readable up to its end."""

    def __init__(self, recording: RunLog, file: IO[bytes]) -> None:
        self._recording, self._kept = recording, LogSizes()
        self._file, self._messages = _begun(recording, file), _Messages(recording.header)
        _add(self._file, _scenery(recording.header))

    def grow(self) -> None:
        """Write the new part of the run."""
        now = self._recording.sizes
        _add(self._file, self._messages.of(self._recording.since(self._kept)))
        self._kept = now
        self._file.flush()


def _begun(recording: RunLog, raw: IO[bytes]) -> RecordFile:
    file = RecordFile(raw)
    header = recording.header
    facts = {
        "program": header.program,
        "delta_s": repr(header.delta_s),
        "seed": str(header.seed),
        "robots": str(len(header.robots)),
        "differing": ", ".join(header.differing),
        "ending": recording.ending or "",
    }
    file.describe("koord", facts)
    file.attach(header.program, "text/plain", header.text.encode())
    return file


def _add(file: RecordFile, messages: Iterable[_Timed]) -> None:
    for time_s, topic, schema, message, sequence in sorted(messages, key=_time_of):
        file.add(topic, schema, message, round(time_s * 1e9), sequence)


#: Time, topic, schema, message, round.
_Timed = tuple[float, str, tuple[str, Message], Message | bytes, int]

_time_of = itemgetter(0)


def _scenery(header: Header) -> Iterator[_Timed]:
    """Yield the messages of the initial scene."""
    entities = [*_world(header), *_vehicles(header), *_tasks(header)]
    yield 0.0, "/scene", SCENE, _scene(entities), 0


class _Messages:
    """The messages about what a run adds to its recording.

    What there are many of is text already: transforms, paths, who ran what.
    """

    def __init__(self, header: Header) -> None:
        self._set(header)
        self._frames = texts(msgspec.json.encode(_frame(k)) for k in range(len(header.robots)))
        self._namings: dict[tuple[int, int, bool], tuple[str, Naming]] = {}
        self._paths: dict[int, tuple[bytes, bytes, bytes]] = {}
        self._planned_s: dict[int, float] = {}  #: when the last path of a robot was drawn

    def _set(self, header: Header) -> None:
        self._header = header
        self._ran = [_ran(k, header.agents[r.agent].events) for k, r in enumerate(header.robots)]

    def of(self, recording: RunLog) -> Iterator[_Timed]:
        """Yield the messages of a part of a recording."""
        if recording.header is not self._header:  # the program has changed
            self._set(recording.header)
        header = self._header
        yield from self._transforms(recording)
        for done in recording.rounds:
            yield from self._round(done)
        for change in recording.tasks:
            entity = _task(header, change.task, change.state, change.time_s)
            yield change.time_s, "/scene", SCENE, _scene([entity]), 0
            verb = "is done by" if change.state is TaskState.DONE else "is assigned to"
            words = f"task {change.task} {verb} robot {change.robot}"
            yield _log(header, change.time_s, "tasks", _INFO, words)
        for violation in recording.violations:
            words = f"{violation.claim}: {violation.words}"
            yield _log(header, violation.time_s, "claims", _ERROR, words)
        for one in recording.still:
            words = f"robot {one.robot} stands still since {one.since_s:.1f} s: {one.words}"
            yield _log(header, one.time_s, "standing still", _ERROR, words)
        for entry in recording.reloads:
            yield from _reload(header, entry)
        yield from self._planned([*self._seldom(recording.paths)])

    def _transforms(self, recording: RunLog) -> Iterator[_Timed]:
        robots, times = len(self._header.robots), recording.times_s
        step = max(1, _AT_ONCE // max(robots, 1))
        for first in range(0, len(times), step):
            some = times[first : first + step]
            poses = np.concatenate(recording.poses[first : first + step])
            stamps = texts(msgspec.json.encode(_stamp(time_s)) for time_s in some)
            numbers = [*poses[:, :3].T, *turns_of(poses).T]
            rows = _TRANSFORM.filled(
                stamp=stamps.repeat(robots),
                frame=np.tile(self._frames, len(some)),
                **dict(zip(_PLACED, map(to_parts, numbers), strict=True)),
            )
            for k, time_s in enumerate(some):
                transforms = rows.between(k * robots, (k + 1) * robots)
                message = b'{"transforms":[' + transforms + b"]}"
                yield time_s, "/tf", TRANSFORMS, message, 0

    def _round(self, done: LoggedRound) -> Iterator[_Timed]:
        deeds, ran = done.deeds, np.flatnonzero(done.deeds >= 0).tolist()
        did = [self._ran[k][deed] for k, deed in zip(ran, deeds[ran].tolist(), strict=True)]
        message = {
            "round": done.number,
            "ran": msgspec.Raw(b"[" + b",".join(did) + b"]"),
            "blocked": np.flatnonzero(deeds == Idle.BLOCKED).tolist(),
            "stopped": np.flatnonzero(deeds == Idle.STOPPED).tolist(),
        }
        yield done.time_s, "/rounds", ROUND, message, done.number
        shared = [self._change(c) for c in done.changes if c.robot == SHARED]
        local = [self._change(c) for c in done.changes if c.robot != SHARED]
        for topic, changes in (("/shared", shared), ("/local", local)):
            if changes:
                message = {"round": done.number, "changes": changes}
                yield done.time_s, topic, CHANGES, message, done.number
        for said in done.said:
            name = f"robot {said.robot} {said.stream}"
            yield _log(self._header, done.time_s, name, _INFO, said.text)

    def _change(self, change: LoggedChange) -> Message:
        robot, variable, part, value = change
        agent = SHARED if robot == SHARED else self._header.robots[robot].agent
        key = agent, variable, part == WHOLE
        if key not in self._namings:
            self._namings[key] = self._naming(*key)
        name, of = self._namings[key]
        whose = {} if robot == SHARED else {"robot": robot}
        if part != WHOLE:
            whose["index"] = part
        return {**whose, "variable": name, "value": of(value)}

    def _naming(self, agent: int, number: int, is_whole: bool) -> tuple[str, Naming]:
        header = self._header
        own = header.shared if agent == SHARED else header.agents[agent].variables
        shape = own[number].shape
        if not is_whole:
            assert isinstance(shape, Array | PerRobot | Sequence)
            shape = element_of(shape)
        return own[number].name, naming(shape)

    def _seldom(self, paths: list[LoggedPath]) -> Iterator[LoggedPath]:
        """Drop straight paths that come soon after the last."""
        last = self._planned_s
        for planned in paths:
            since = planned.time_s - last.get(planned.robot, -math.inf)
            if len(planned.points) > 2 or since > _STRAIGHT_S - 1e-9:
                last[planned.robot] = planned.time_s
                yield planned

    def _planned(self, paths: list[LoggedPath]) -> Iterator[_Timed]:
        if not paths:
            return
        every = np.concatenate([planned.points for planned in paths]).reshape(-1, 3)
        rows = _POINT.filled(**dict(zip("xyz", map(to_parts, every.T), strict=True)))
        first = 0
        for planned in paths:
            last = first + len(planned.points)
            begin, middle, end = self._path(planned.robot)
            stamp = msgspec.json.encode(_stamp(planned.time_s))
            points = b"[" + rows.between(first, last) + b"]"
            message = b"".join([begin, stamp, middle, points, end])
            yield planned.time_s, "/paths", SCENE, message, 0
            first = last

    def _path(self, robot: int) -> tuple[bytes, bytes, bytes]:
        """The text of a scene with a path: before its stamp, between it and the points, behind."""
        if robot not in self._paths:
            line = _lines([], hue(robot)) | {"points": hole("points")}
            entity = _entity(f"path {robot}", lines=[line]) | {"timestamp": hole("stamp")}
            text = msgspec.json.encode(_scene([entity]))
            begin, _, rest = text.partition(b'"@stamp"')
            middle, _, end = rest.partition(b'"@points"')
            self._paths[robot] = begin, middle, end
        return self._paths[robot]


def _reload(header: Header, entry: LoggedReload) -> Iterator[_Timed]:
    """Yield the messages about a change of the program, or an edit that was refused."""
    number, time_s = entry.number, entry.time_s
    level = _INFO if entry.text is not None else _ERROR
    yield _log(header, time_s, "program", level, reload_words(entry))
    message = {"round": number, "accepted": entry.text is not None, "notes": list(entry.words)}
    if entry.text is not None:
        message["text"] = entry.text
    yield time_s, "/program", PROGRAM, message, number


def _ran(robot: int, events: tuple[str, ...]) -> list[bytes]:
    """For each event: that a robot ran it."""
    return [msgspec.json.encode({"robot": robot, "event": event}) for event in events]


def _log(header: Header, time_s: float, name: str, level: int, words: str) -> _Timed:
    message = {
        "timestamp": _stamp(time_s),
        "level": level,
        "message": words,
        "name": name,
        "file": header.program,
        "line": 0,
    }
    return time_s, "/log", LOG, message, 0


# --- geometry -------------------------------------------------------------------------------------


def _frame(robot: int) -> str:
    return f"robot {robot}"


#: Place and turn, as poses have them.
_PLACED = ("x", "y", "z", "rw", "rx", "ry", "rz")

_POINT = Pattern({axis: hole(axis) for axis in "xyz"})
_TRANSFORM = Pattern(
    {
        "timestamp": hole("stamp"),
        "parent_frame_id": _WORLD,
        "child_frame_id": hole("frame"),
        "translation": {axis: hole(axis) for axis in "xyz"},
        "rotation": {axis: hole(f"r{axis}") for axis in "xyzw"},
    }
)


def _world(header: Header) -> Iterator[Message]:
    (x0, y0, z0), (x1, y1, z1) = header.world.low, header.world.high
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    edges = [(a, corners[(k + 1) % 4]) for k, a in enumerate(corners)]
    points = [_vector(*at, z) for z in (z0, z1) for edge in edges for at in edge]
    points += [_vector(*at, z) for at in corners for z in (z0, z1)]
    yield _entity("bounds", lines=[_lines(points, WALL, pairs=True)])
    for k, obstacle in enumerate(header.world.obstacles):
        yield _obstacle(f"obstacle {k}", obstacle, z1)


def _obstacle(name: str, obstacle: Obstacle, roof: float) -> Message:
    if not isinstance(obstacle, Polygon):
        return _entity(name, **_body(solid_of(obstacle, roof), _colour(WALL, 0.6)))
    low, high = rings(obstacle, roof)
    edges = [_lines([_vector(*at) for at in ring], WALL) for ring in (low, high)]
    walls = [_vector(*at) for wall in zip(low[1:], high[1:], strict=True) for at in wall]
    return _entity(name, lines=[*edges, _lines(walls, WALL, pairs=True)])


def _body(solid: Solid, colour: Message) -> Message:
    """A solid as a part of an entity."""
    ends = {} if solid.is_box else {"bottom_scale": 1.0, "top_scale": 1.0}
    made = _placed(*solid.middle) | {"size": _vector(*solid.size), **ends, "color": colour}
    return {"cubes" if solid.is_box else "cylinders": [made]}


def _vehicles(header: Header) -> Iterator[Message]:
    for k, robot in enumerate(header.robots):
        yield _vehicle(k, robot)


def _vehicle(k: int, robot: LoggedRobot) -> Message:
    text = _placed(0.0, 0.0, 0.35) | {
        "billboard": True,
        "font_size": 14.0,
        "scale_invariant": True,
        "color": _colour((255, 255, 255)),
        "text": str(k),
    }
    return _entity(_frame(k), _frame(k), texts=[text], **_body(body_of(robot), _colour(hue(k))))


def _tasks(header: Header) -> Iterator[Message]:
    for k in range(len(header.world.tasks)):
        yield _task(header, k, TaskState.OPEN, 0.0)


def _task(header: Header, number: int, state: TaskState, time_s: float) -> Message:
    x, y, z = header.world.tasks[number]
    sphere = _placed(x, y, z) | {
        "size": _vector(0.2, 0.2, 0.2),
        "color": _colour(TASKS[state]),
    }
    state_words = {"key": "state", "value": state.name.lower()}
    return _entity(f"task {number}", time_s=time_s, spheres=[sphere], metadata=[state_words])


# --- parts of messages ----------------------------------------------------------------------------


def _scene(entities: list[Message]) -> Message:
    return {"deletions": [], "entities": entities}


def _entity(name: str, frame: str = _WORLD, time_s: float = 0.0, **parts: list[Message]) -> Message:
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": _stamp(time_s),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: [] for kind in kinds},
        **parts,
    }


def _lines(points: list[Message], shade: Colour, *, pairs: bool = False) -> Message:
    """Lines through points; ``pairs``: one between every two of them."""
    return {
        "type": 2 if pairs else 0,
        **_placed(0.0, 0.0, 0.0),
        "thickness": 2.0,
        "scale_invariant": True,
        "points": points,
        "color": _colour(shade),
        "colors": [],
        "indices": [],
    }


def _placed(x: float, y: float, z: float) -> Message:
    return {"pose": {"position": _vector(x, y, z), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}}


def _vector(x: float, y: float, z: float) -> Message:
    return {"x": round(x, 3), "y": round(y, 3), "z": round(z, 3)}


def _colour(shade: Colour, alpha: float = 1.0) -> Message:
    red, green, blue = fractions(shade)
    return {"r": red, "g": green, "b": blue, "a": alpha}


def _stamp(time_s: float) -> Message:
    nanoseconds = round(time_s * 1e9)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}
