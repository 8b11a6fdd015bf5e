"""Export of a run to MCAP: transforms, a scene, events, variables and a log.

Transforms, scene and log have the well-known schemas of the Foxglove viewers (``foxglove.…``, JSON
encoding), so that these draw them; the rest is JSON with schemas of its own. Times are nanoseconds
from the beginning of the run.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator
from typing import IO

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
    ran,
    rings,
    solid_of,
)
from koord.sim.files.schemas import CHANGES, LOG, ROUND, SCENE, TRANSFORMS, Message, named
from koord.sim.run_log import (
    SHARED,
    WHOLE,
    Header,
    Idle,
    LoggedChange,
    LoggedPath,
    LoggedRobot,
    LoggedRound,
    LogSizes,
    RunLog,
    TaskState,
    turns_of,
)

_INFO, _ERROR = 2, 4
_WORLD = "world"

#: Straight paths are drawn at most so often; some programs give a new one in every round.
_STRAIGHT_S = 1.0


def mcap_of(recording: RunLog) -> bytes:
    """Export a run as an MCAP file."""
    raw = io.BytesIO()
    file = _begun(recording, raw)
    _add(file, [*_scenery(recording.header), *_messages(recording)])
    file.close()
    return raw.getvalue()


class PartRecord:
    """An MCAP file that is written while the run goes on, and is readable up to its end."""

    def __init__(self, recording: RunLog, file: IO[bytes]) -> None:
        self._recording, self._kept = recording, LogSizes()
        self._file = _begun(recording, file)
        _add(self._file, _scenery(recording.header))

    def grow(self) -> None:
        """Write the new part of the run."""
        now = self._recording.sizes
        _add(self._file, _messages(self._recording.since(self._kept)))
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
    for time_s, topic, schema, message, sequence in sorted(messages, key=lambda one: one[0]):
        file.add(topic, schema, message, round(time_s * 1e9), sequence)


#: Time, topic, schema, message, round.
_Timed = tuple[float, str, tuple[str, Message], Message, int]


def _scenery(header: Header) -> Iterator[_Timed]:
    """Yield the messages of the initial scene."""
    entities = [*_world(header), *_vehicles(header), *_tasks(header)]
    yield 0.0, "/scene", SCENE, _scene(entities), 0


def _messages(recording: RunLog) -> Iterator[_Timed]:
    header = recording.header
    for time_s, poses in zip(recording.times_s, recording.poses, strict=True):
        stamp = _stamp(time_s)
        turns = turns_of(poses).tolist()
        transforms = [
            _transform(k, stamp, pose[:3], turn)
            for k, (pose, turn) in enumerate(zip(poses.tolist(), turns, strict=True))
        ]
        yield time_s, "/tf", TRANSFORMS, {"transforms": transforms}, 0
    for done in recording.rounds:
        yield from _round(header, done)
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
    for planned in _seldom(recording.paths):
        entity = _path(planned)
        yield planned.time_s, "/paths", SCENE, _scene([entity]), 0


def _round(header: Header, done: LoggedRound) -> Iterator[_Timed]:
    message = {
        "round": done.number,
        "ran": [{"robot": k, "event": event} for k, event in ran(header, done)],
        "blocked": np.flatnonzero(done.deeds == Idle.BLOCKED).tolist(),
        "stopped": np.flatnonzero(done.deeds == Idle.STOPPED).tolist(),
    }
    yield done.time_s, "/rounds", ROUND, message, done.number
    for topic, is_shared in (("/shared", True), ("/local", False)):
        changes = [_change(header, c) for c in done.changes if (c.robot == SHARED) is is_shared]
        if changes:
            message = {"round": done.number, "changes": changes}
            yield done.time_s, topic, CHANGES, message, done.number
    for said in done.said:
        name = f"robot {said.robot} {said.stream}"
        yield _log(header, done.time_s, name, _INFO, said.text)


def _change(header: Header, change: LoggedChange) -> Message:
    if change.robot == SHARED:
        variable, whose = header.shared[change.variable], {}
    else:
        agent = header.agents[header.robots[change.robot].agent]
        variable, whose = agent.variables[change.variable], {"robot": change.robot}
    shape = variable.shape
    if change.part != WHOLE:
        assert isinstance(shape, Array | PerRobot | Sequence)
        shape, whose = element_of(shape), {**whose, "index": change.part}
    return {**whose, "variable": variable.name, "value": named(shape, change.value)}


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


def _transform(robot: int, stamp: Message, place: list[float], turn: list[float]) -> Message:
    w, x, y, z = turn
    return {
        "timestamp": stamp,
        "parent_frame_id": _WORLD,
        "child_frame_id": f"robot {robot}",
        "translation": _vector(*place),
        "rotation": {"x": _fine(x), "y": _fine(y), "z": _fine(z), "w": _fine(w)},
    }


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
    return _entity(
        f"robot {k}", f"robot {k}", texts=[text], **_body(body_of(robot), _colour(hue(k)))
    )


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


def _path(planned: LoggedPath) -> Message:
    points = [_vector(*point) for point in planned.points.tolist()]
    line = _lines(points, hue(planned.robot))
    return _entity(f"path {planned.robot}", time_s=planned.time_s, lines=[line])


def _seldom(paths: list[LoggedPath]) -> Iterator[LoggedPath]:
    """Drop straight paths that come soon after the last."""
    last: dict[int, float] = {}
    for planned in paths:
        since = planned.time_s - last.get(planned.robot, -math.inf)
        if len(planned.points) > 2 or since > _STRAIGHT_S - 1e-9:
            last[planned.robot] = planned.time_s
            yield planned


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


def _fine(value: float) -> float:
    """Round a number to visible digits: a turn to a tenth of a degree."""
    return round(value, 3) or 0


def _colour(shade: Colour, alpha: float = 1.0) -> Message:
    red, green, blue = fractions(shade)
    return {"r": red, "g": green, "b": blue, "a": alpha}


def _stamp(time_s: float) -> Message:
    nanoseconds = round(time_s * 1e9)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}
