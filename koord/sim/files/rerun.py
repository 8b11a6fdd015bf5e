"""Export of a run to the Rerun viewer (``.rrd``). Needs ``koord[export]``."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from koord.runtime.motion.world import Obstacle, Polygon, World
from koord.sim.files.drawing import TASKS, WALL, hue, ran, rings, solid_of
from koord.sim.run_log import Header, LogSizes, RunLog, TaskState, reload_words, turns_of

_TIMELINE = "time"


def rrd_of(recording: RunLog) -> bytes:
    """Export a run in Rerun's format; times are seconds on the timeline ``time``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        drawn = PartRrd(recording, path)
        drawn.grow()
        drawn.close()
        return path.read_bytes()


class PartRrd:
    """A Rerun file that grows while the run goes on, and is readable up to its end."""

    def __init__(self, recording: RunLog, path: Path) -> None:
        import rerun

        self._rerun: Any = rerun
        self._recording, self._kept = recording, LogSizes()
        header = recording.header
        self._states = [TaskState.OPEN] * len(header.world.tasks)
        self._stream: Any = rerun.RecordingStream("koord", send_properties=False)
        self._stream.save(path)
        _draw_world(rerun, self._stream, header.world)
        for k in range(len(header.robots)):
            _draw_body(rerun, self._stream, header, k)
        self._stream.set_time(_TIMELINE, duration=0.0)
        self._draw_tasks()
        for line in header.differing:
            self._stream.log("log", rerun.TextLog(line, level="INFO"))

    def grow(self) -> None:
        """Write the new part of the run."""
        now = self._recording.sizes
        self._add(self._recording.since(self._kept))
        self._kept = now
        self._stream.flush()

    def close(self) -> None:
        self._stream.disconnect()

    def _add(self, new: RunLog) -> None:
        rerun, stream = self._rerun, self._stream
        for k in range(len(new.header.robots)):
            _draw_poses(rerun, stream, new, k)
        for change in new.tasks:
            stream.set_time(_TIMELINE, duration=change.time_s)
            self._states[change.task] = change.state
            self._draw_tasks()
        _draw_paths(rerun, stream, new)
        _tell(rerun, stream, new)
        _tell_distance(rerun, stream, new)

    def _draw_tasks(self) -> None:
        tasks = self._recording.header.world.tasks
        if not tasks:
            return
        labels = [f"{k}: {state.name.lower()}" for k, state in enumerate(self._states)]
        colours = [TASKS[state] for state in self._states]
        points = self._rerun.Points3D(tasks, colors=colours, radii=0.1, labels=labels)
        self._stream.log("world/tasks", points)


def _draw_world(rerun: Any, stream: Any, world: World) -> None:
    low, high = np.array(world.low), np.array(world.high)
    stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    bounds = rerun.Boxes3D(mins=[low], sizes=[high - low], colors=[WALL])
    stream.log("world/bounds", bounds, static=True)
    for k, obstacle in enumerate(world.obstacles):
        stream.log(f"world/obstacles/{k}", _prism(rerun, obstacle, world), static=True)


def _prism(rerun: Any, obstacle: Obstacle, world: World) -> Any:
    roof = world.high[2]
    if isinstance(obstacle, Polygon):
        low, high = rings(obstacle, roof)
        walls = zip(low[1:], high[1:], strict=True)
        return rerun.LineStrips3D([low, high, *map(list, walls)], colors=[WALL])
    solid = solid_of(obstacle, roof)
    if solid.is_box:
        return rerun.Boxes3D(
            centers=[solid.middle], sizes=[solid.size], colors=[WALL], fill_mode="solid"
        )
    wide, _, high_m = solid.size
    return rerun.Cylinders3D(
        lengths=[high_m],
        radii=[wide / 2],
        centers=[solid.middle],
        colors=[WALL],
        fill_mode="solid",
    )


def _draw_body(rerun: Any, stream: Any, header: Header, number: int) -> None:
    robot, colour = header.robots[number], hue(number)
    if robot.look.is_box:
        half = (robot.length_m / 2, robot.width_m / 2, 0.08)
        centre = (robot.middle_m, 0.0, 0.08)
    else:
        half, centre = (robot.radius_m * 0.7, robot.radius_m * 0.7, 0.05), (0.0, 0.0, 0.0)
    body = rerun.Boxes3D(
        half_sizes=[half], centers=[centre], colors=[colour], labels=[robot.name], fill_mode="solid"
    )
    stream.log(f"world/robots/{number}/body", body, static=True)


def _draw_poses(rerun: Any, stream: Any, recording: RunLog, number: int) -> None:
    poses = recording.stacked()[:, number]
    if not len(poses):
        return
    turns = turns_of(poses)[:, [1, 2, 3, 0]]  # w is last there
    stream.send_columns(
        f"world/robots/{number}",
        indexes=[rerun.TimeColumn(_TIMELINE, duration=list(recording.times_s))],
        columns=rerun.Transform3D.columns(translation=poses[:, :3], quaternion=turns),
    )


def _draw_paths(rerun: Any, stream: Any, recording: RunLog) -> None:
    for planned in recording.paths:
        stream.set_time(_TIMELINE, duration=planned.time_s)
        colour = hue(planned.robot)
        strip = rerun.LineStrips3D([planned.points], colors=[colour])
        stream.log(f"world/paths/{planned.robot}", strip)


def _tell(rerun: Any, stream: Any, recording: RunLog) -> None:
    """Log events, output and violations as text."""
    header = recording.header
    for done in recording.rounds:
        words = [f"robot {k}: {event}" for k, event in ran(header, done)]
        words += [f"robot {said.robot} {said.stream}: {said.text}" for said in done.said]
        stream.set_time(_TIMELINE, duration=done.time_s)
        for line in words:
            stream.log("log", rerun.TextLog(line, level="INFO"))
    for violation in recording.violations:
        stream.set_time(_TIMELINE, duration=violation.time_s)
        line = f"{violation.claim}: {violation.words}"
        stream.log("log", rerun.TextLog(line, level="ERROR"))
    for entry in recording.reloads:
        stream.set_time(_TIMELINE, duration=entry.time_s)
        level = "ERROR" if entry.text is None else "INFO"
        stream.log("log", rerun.TextLog(reload_words(entry), level=level))


def _tell_distance(rerun: Any, stream: Any, recording: RunLog) -> None:
    apart = np.array(recording.separations_m, dtype=np.float64)
    known = ~np.isnan(apart)
    if not known.any():
        return
    times = np.array(recording.times_s)[known]
    stream.send_columns(
        "separation",
        indexes=[rerun.TimeColumn(_TIMELINE, duration=times)],
        columns=rerun.Scalars.columns(scalars=apart[known]),
    )
