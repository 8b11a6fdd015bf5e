"""Export of a run to a rosbag2 folder, for ROS 2 tools. Needs ``koord[export]``, but no ROS.

Topics: ``/tf``; ``/robots/<i>/pose`` for each robot; ``/scene``, markers for obstacles, tasks and
robots; ``/events``, what robots ran, and ``/violations``, as JSON in strings.
"""

from __future__ import annotations

import copy
import json
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from koord.runtime.motion.world import Point, Polygon
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
from koord.sim.run_log import LogSizes, RunLog, TaskState, turns_of

_WORLD = "world"

#: Of `visualization_msgs/Marker`.
_LINE_STRIP, _CUBE, _SPHERE, _CYLINDER = 4, 1, 2, 3

#: Time in nanoseconds, topic, message.
_Timed = tuple[int, str, Any]


def rosbag_of(recording: RunLog, name: str) -> dict[str, bytes]:
    """Export a run as the files of a rosbag2 folder."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / name
        bag = _Bag(recording, folder)
        bag.add(recording, LogSizes())
        bag.close()
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


class PartBag:
    """A rosbag2 folder that is written while the run goes on, complete after each write."""

    def __init__(self, recording: RunLog, folder: Path) -> None:
        self._recording, self._kept = recording, LogSizes()
        self._bag = _Bag(recording, folder)

    def grow(self) -> None:
        """Write the new part of the run."""
        now = self._recording.sizes
        self._bag.add(self._recording, self._kept)
        self._kept = now
        self._bag.flush()

    def close(self) -> None:
        self._bag.close()


class _Bag:
    """A rosbag2 folder that is being written; a topic is registered with its first message."""

    def __init__(self, recording: RunLog, folder: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        self._store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self._writer: Any = Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3)
        self._writer.open()
        self._connections: dict[str, Any] = {}
        self._write(_Messages(recording, self._store.types).scenery())

    def add(self, recording: RunLog, start: LogSizes) -> None:
        """Add the messages of a recording after a point."""
        self._write(_Messages(recording.since(start), self._store.types).all())

    def _write(self, messages: Iterable[_Timed]) -> None:
        writer, connections = self._writer, self._connections
        for time_ns, topic, message in sorted(messages, key=lambda one: one[0]):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=self._store)
            raw = self._store.serialize_cdr(message, kind)
            writer.write(connections[topic], time_ns, raw)

    def flush(self) -> None:
        """Flush all messages: the folder is complete then, even if this process is killed.

        The library writes what says what is in a bag only where it closes one, so a copy does it.
        """
        ended = copy.copy(self._writer)
        ended.storage = _Open(self._writer.storage)
        ended.close()

    def close(self) -> None:
        self._writer.close()


class _Open:
    """A storage that stays open when it is closed: its writes are committed."""

    def __init__(self, storage: Any) -> None:
        self.path, self._storage = storage.path, storage

    def close(self, version: int, metadata: str) -> None:
        self._storage.conn.commit()


class _Messages:
    """The messages of a run; ``types`` are those of ROS."""

    def __init__(self, recording: RunLog, types: Any) -> None:
        self.recording, self.header = recording, recording.header
        self._types = types

    def scenery(self) -> Iterator[_Timed]:
        """Yield the messages of the initial scene."""
        yield 0, "/scene", self._markers([*self._world(), *self._robots(), *self._tasks()])
        if self.header.differing:
            text = json.dumps({"differing": self.header.differing})
            yield 0, "/events", self._make("std_msgs/msg/String", text)

    def all(self) -> Iterator[_Timed]:
        """Yield the messages of the recording."""
        for time_s, poses in zip(self.recording.times_s, self.recording.poses, strict=True):
            yield from self._poses(time_s, poses.tolist(), turns_of(poses).tolist())
        for change in self.recording.tasks:
            marker = self._task(change.task, change.state, change.time_s)
            yield _ns(change.time_s), "/scene", self._markers([marker])
        for done in self.recording.rounds:
            events = {str(k): event for k, event in ran(self.header, done)}
            if events:
                text = json.dumps({"round": done.number, "ran": events})
                yield _ns(done.time_s), "/events", self._make("std_msgs/msg/String", text)
        for broken in self.recording.violations:
            text = json.dumps(
                {"claim": broken.claim, "words": broken.words, "robots": broken.robots}
            )
            yield _ns(broken.time_s), "/violations", self._make("std_msgs/msg/String", text)
        for entry in self.recording.reloads:
            said = {"program": entry.text, "round": entry.number, "notes": entry.words}
            text = json.dumps(said)
            yield _ns(entry.time_s), "/events", self._make("std_msgs/msg/String", text)

    def _poses(
        self, time_s: float, poses: list[list[float]], turns: list[list[float]]
    ) -> Iterator[_Timed]:
        transforms = []
        for k, ((x, y, z, *_), turned) in enumerate(zip(poses, turns, strict=True)):
            stamped = self._stamp(time_s, _WORLD)
            shift = self._make("geometry_msgs/msg/Vector3", x, y, z)
            turn = self._turn(*turned)
            transform = self._make("geometry_msgs/msg/Transform", shift, turn)
            kind = "geometry_msgs/msg/TransformStamped"
            transforms.append(self._make(kind, stamped, f"robot_{k}", transform))
            pose = self._make("geometry_msgs/msg/PoseStamped", stamped, self._pose(x, y, z, turn))
            yield _ns(time_s), f"/robots/robot_{k}/pose", pose
        yield _ns(time_s), "/tf", self._make("tf2_msgs/msg/TFMessage", transforms)

    # --- markers --------------------------------------------------------------------------------

    def _world(self) -> Iterator[Any]:
        (x0, y0, z), (x1, y1, _) = self.header.world.low, self.header.world.high
        ring = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z), (x0, y0, z)]
        yield self._line("bounds", 0, ring)
        roof = self.header.world.high[2]
        for k, obstacle in enumerate(self.header.world.obstacles):
            if isinstance(obstacle, Polygon):
                yield self._line(
                    "obstacles", k, [at for ring in rings(obstacle, roof) for at in ring]
                )
            else:
                yield self._solid("obstacles", k, solid_of(obstacle, roof), WALL)

    def _robots(self) -> Iterator[Any]:
        for k, robot in enumerate(self.header.robots):
            yield self._solid("robots", k, body_of(robot), hue(k), frame=f"robot_{k}")

    def _tasks(self) -> Iterator[Any]:
        for k in range(len(self.header.world.tasks)):
            yield self._task(k, TaskState.OPEN, 0.0)

    def _task(self, number: int, state: TaskState, time_s: float) -> Any:
        place, size = self.header.world.tasks[number], (0.2, 0.2, 0.2)
        return self._marker("tasks", number, _SPHERE, place, size, TASKS[state], time_s=time_s)

    def _line(self, name: str, number: int, points: list[Point]) -> Any:
        size = (0.03, 0.0, 0.0)
        return self._marker(name, number, _LINE_STRIP, (0, 0, 0), size, WALL, points=points)

    def _solid(
        self, name: str, number: int, solid: Solid, colour: Colour, frame: str = _WORLD
    ) -> Any:
        kind = _CUBE if solid.is_box else _CYLINDER
        return self._marker(name, number, kind, solid.middle, solid.size, colour, frame=frame)

    def _marker(
        self,
        name: str,
        number: int,
        kind: int,
        place: Point,
        size: Point,
        colour: Colour,
        *,
        points: Iterable[Point] = (),
        frame: str = _WORLD,
        time_s: float = 0.0,
    ) -> Any:
        image = self._make(
            "sensor_msgs/msg/CompressedImage", self._stamp(0.0, ""), "", np.zeros(0, np.uint8)
        )
        return self._make(
            "visualization_msgs/msg/Marker",
            header=self._stamp(time_s, frame),
            ns=name,
            id=number,
            type=kind,
            action=0,
            pose=self._pose(*place, self._turn()),
            scale=self._make("geometry_msgs/msg/Vector3", *map(float, size)),
            color=self._make("std_msgs/msg/ColorRGBA", *fractions(colour), 1.0),
            lifetime=self._make("builtin_interfaces/msg/Duration", 0, 0),
            frame_locked=True,
            points=[self._make("geometry_msgs/msg/Point", *p) for p in points],
            colors=[],
            texture_resource="",
            texture=image,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )

    def _markers(self, markers: list[Any]) -> Any:
        return self._make("visualization_msgs/msg/MarkerArray", markers)

    # --- parts ----------------------------------------------------------------------------------

    def _pose(self, x: float, y: float, z: float, turn: Any) -> Any:
        at = self._make("geometry_msgs/msg/Point", float(x), float(y), float(z))
        return self._make("geometry_msgs/msg/Pose", at, turn)

    def _turn(self, w: float = 1.0, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return self._make("geometry_msgs/msg/Quaternion", x, y, z, w)

    def _stamp(self, time_s: float, frame: str) -> Any:
        seconds, rest = divmod(_ns(time_s), 10**9)
        time = self._make("builtin_interfaces/msg/Time", seconds, rest)
        return self._make("std_msgs/msg/Header", time, frame)

    def _make(self, kind: str, *values: Any, **named: Any) -> Any:
        return self._types[kind](*values, **named)


def _ns(time_s: float) -> int:
    return round(time_s * 1e9)
