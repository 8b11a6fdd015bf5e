"""Export of a run to a 3D page: one HTML file that loads nothing. Needs ``koord[view]``.

The viewer is viser's own, with the recorded scene put into its page. Violations are drawn where
they are, and marked on the viewer's timeline.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
from collections.abc import Iterable, Sequence
from importlib.resources import files
from itertools import groupby
from typing import Any

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.world import Box, Disc, Obstacle, Point, World
from koord.sim.files.drawing import TASKS, WALL, heights, hue
from koord.sim.run_log import Header, LoggedViolation, RunLog, TaskState, turns_of

#: Labels of places so near are above each other, so far apart.
_NEAR_M, _NEXT_LABEL_M = 1.0, 0.3

_EDGE, _BAD = (120, 130, 145), (204, 41, 54)

#: Poses are shown so often; the viewer draws each of them.
_SHOWN_S = 0.1

#: Of longer trails the file would grow without need: they are thinned to so many points.
_TRAIL_POINTS = 400


def space_of(recording: RunLog) -> bytes:
    """Export a run in three dimensions, as an HTML page."""
    import viser

    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))  # viser likes to talk
        # The server is there because viser's scenes belong to one; nobody is to connect to it.
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        stack.callback(server.stop)
        scene: Any = server.scene
        header = recording.header
        _draw_world(scene, header.world)
        for k in range(len(header.world.tasks)):
            _draw_task(scene, header, k, TaskState.OPEN)
        robots = [_draw_robot(scene, header, k) for k in range(len(header.robots))]
        _draw_trails(scene, recording)
        _look_at(server, header.world)
        _move(robots, recording, 0)
        serializer = server.get_scene_serializer()
        _play(scene, serializer, robots, recording)
        page: str = serializer.as_html()
        return _marked(page, recording).encode()


def told_violations(violations: Iterable[LoggedViolation]) -> list[LoggedViolation]:
    """Violations in order of time, each once: of ``forall i, j`` both orders may be recorded."""
    told: dict[tuple[str, float, frozenset[int]], LoggedViolation] = {}
    for one in sorted(violations, key=lambda one: one.time_s):
        told.setdefault((one.claim, one.time_s, frozenset(one.robots)), one)
    return list(told.values())


def _marked(page: str, recording: RunLog) -> str:
    """The viewer's page, with marks of violations on its timeline and a list of them."""
    shown_s = [recording.times_s[k] for k in _shown_samples(recording)]
    told = [
        {
            "time": round(one.time_s, 2),
            "shown": next((s for s in shown_s if one.time_s <= s + 1e-9), one.time_s),
            "claim": one.claim,
            "story": _story(one),
        }
        for one in told_violations(recording.violations)
    ]
    own = files("koord.sim") / "page"
    style, script = ((own / f"space.{kind}").read_text("utf-8") for kind in ("css", "js"))
    # `<` in a text of the run could end the element
    data = json.dumps({"violations": told}).replace("<", "\\u003c")
    added = (
        f"<style>{style}</style>\n"
        f'<script type="application/json" id="koord-data">{data}</script>\n'
        f'<script type="module">{script}</script>\n'
    )
    before, end, after = page.rpartition("</body>")
    return f"{before}{added}{end}{after}"


def _story(violation: LoggedViolation) -> str:
    """Whose a violation is, and what there is to say of it."""
    whose = " and ".join(map(str, violation.robots))
    if whose:
        whose = f"robot{'s' if len(violation.robots) > 1 else ''} {whose}"
    return ": ".join(filter(None, (whose, violation.words)))


def _shown_samples(recording: RunLog) -> list[int]:
    """The samples whose poses are shown; the last one is."""
    shown: list[int] = []
    shown_s = 0.0
    for k, time_s in enumerate(recording.times_s):
        if time_s - shown_s >= _SHOWN_S - 1e-9 or k == len(recording.times_s) - 1:
            shown.append(k)
            shown_s = time_s
    return shown


def _play(scene: Any, serializer: Any, robots: list[Any], recording: RunLog) -> None:
    """Record poses, tasks and violations in order of time."""
    changes = list(recording.tasks)
    in_time = sorted(recording.violations, key=lambda one: one.time_s)
    broken = [list(those) for _, those in groupby(in_time, lambda one: one.time_s)]
    shown: list[Point] = []
    shown_s = 0.0
    for k in _shown_samples(recording):
        time_s = recording.times_s[k]
        serializer.insert_sleep(time_s - shown_s)
        shown_s = time_s
        while changes and changes[0].time_s <= time_s + 1e-9:
            change = changes.pop(0)
            _draw_task(scene, recording.header, change.task, change.state)
        while broken and broken[0][0].time_s <= time_s + 1e-9:
            _draw_violations(scene, recording, broken.pop(0), k, shown)
        _move(robots, recording, k)


def _draw_violations(
    scene: Any,
    recording: RunLog,
    violations: Sequence[LoggedViolation],
    sample: int,
    shown: list[Point],
) -> None:
    """Draw violations of one time: balls where they are, with their claims and the time.

    One without a place is at each of its robots. ``shown`` has the places of the balls that are
    there, and gets the new ones: labels near to each other are put above each other.
    """
    told = {id(one) for one in told_violations(violations)}
    claims: dict[Point, list[str]] = {}
    for one in violations:
        places = [] if one.place is None else [one.place]
        if not places and recording.poses:
            poses = recording.poses[sample]
            places = [(x, y, z) for x, y, z in poses[list(one.robots), :3].tolist()]
        for k, place in enumerate(places):
            # told at the first of its places
            claims.setdefault(place, []).extend([one.claim] if k == 0 and id(one) in told else [])
    for place, names in claims.items():
        name = f"/violations/{len(shown)}"
        scene.add_icosphere(name, 0.15, color=_BAD, position=place, opacity=0.7)
        if names:
            below = sum(math.dist(place, other) < _NEAR_M for other in shown)
            text = f"▲ {', '.join(dict.fromkeys(names))}, {violations[0].time_s:.1f} s"
            above = (0.0, 0.0, 0.35 + _NEXT_LABEL_M * below)
            scene.add_label(f"{name}/label", text, position=above)
        shown.append(place)


def _move(robots: list[Any], recording: RunLog, sample: int) -> None:
    if not recording.poses:
        return
    poses = recording.poses[sample]
    turns = turns_of(poses).tolist()
    for handle, (x, y, z, *_), turn in zip(robots, poses.tolist(), turns, strict=True):
        handle.position = (x, y, z)
        handle.wxyz = tuple(turn)


def _look_at(server: Any, world: World) -> None:
    low, high = np.array(world.low), np.array(world.high)
    span = float(np.linalg.norm((high - low)[:2]))
    middle = (low + high) / 2
    server.scene.set_up_direction("+z")
    camera = server.initial_camera
    camera.look_at = tuple(middle.tolist())
    camera.position = tuple((middle + span * np.array([0.15, -0.6, 0.45])).tolist())


def _draw_world(scene: Any, world: World) -> None:
    low, high = np.array(world.low), np.array(world.high)
    middle, span = (low + high) / 2, high - low
    scene.add_grid(
        "/ground",
        width=float(span[0]),
        height=float(span[1]),
        plane="xy",
        cell_size=1.0,
        position=(float(middle[0]), float(middle[1]), float(low[2])),
    )
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    edges = [(a, b) for a in corners for b in corners if (b - a).sum() == 1 and (b >= a).all()]
    lines = low + np.array(edges) * span
    scene.add_line_segments(
        "/bounds", points=lines, colors=_EDGE, thickness=1.0, thickness_units="screen"
    )
    for k, obstacle in enumerate(world.obstacles):
        vertices, faces = _prism(obstacle, world)
        scene.add_mesh_simple(
            f"/obstacles/{k}", vertices, faces, color=WALL, opacity=0.75, side="double"
        )


def _prism(obstacle: Obstacle, world: World) -> tuple[Floats, Any]:
    """The surface of an upright prism: vertices ``(2k + 2, 3)`` and triangles."""
    match obstacle:
        case Disc(centre=(x, y), radius_m=radius):
            turn = np.linspace(0, 2 * np.pi, 32, endpoint=False)
            ring = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
        case Box(corners=corners):
            ring = np.array(corners)
        case polygon:
            ring = np.array(polygon.corners)
    k, ends_z = len(ring), heights(obstacle, world.high[2])
    rings = [np.column_stack([ring, np.full(k, z)]) for z in ends_z]
    ends = [np.append(ring.mean(0), z)[None] for z in ends_z]
    following = np.roll(np.arange(k), -1)
    walls = [[a, b, b + k] for a, b in enumerate(following)]
    walls += [[a, b + k, a + k] for a, b in enumerate(following)]
    caps = [[a + s * k, b + s * k, 2 * k + s] for s in (0, 1) for a, b in enumerate(following)]
    return np.concatenate([*rings, *ends]), np.array(walls + caps)


def _draw_task(scene: Any, header: Header, number: int, state: TaskState) -> None:
    """Draw a task as a ball; redrawing replaces it. States differ in size too."""
    radius = {TaskState.OPEN: 0.1, TaskState.ASSIGNED: 0.14, TaskState.DONE: 0.06}[state]
    place = header.world.tasks[number]
    scene.add_icosphere(f"/tasks/{number}", radius, color=TASKS[state], position=place)


def _draw_robot(scene: Any, header: Header, number: int) -> Any:
    """Draw a robot about its frame, which is moved later."""
    robot, colour = header.robots[number], hue(number)
    name = f"/robots/{number}"
    frame = scene.add_frame(name, show_axes=False)
    dark = tuple(part // 2 for part in colour)
    if robot.look.is_box:
        size = (robot.length_m, robot.width_m, 0.12)
        scene.add_box(
            f"{name}/body", dimensions=size, color=colour, position=(robot.middle_m, 0, 0.1)
        )
        cabin = (robot.length_m * 0.4, robot.width_m * 0.8, 0.1)
        behind = robot.middle_m - robot.length_m * 0.05
        scene.add_box(f"{name}/cabin", dimensions=cabin, color=dark, position=(behind, 0, 0.2))
    elif robot.look.tilts:
        arm = robot.radius_m * 0.62
        for k, (sx, sy) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            at = (sx * arm, sy * arm, 0.03)
            tint = dark if sx > 0 else colour  # the front is dark
            scene.add_cylinder(
                f"{name}/rotor {k}",
                radius=robot.radius_m * 0.36,
                height=0.02,
                color=tint,
                position=at,
            )
        size = (robot.radius_m * 0.7, robot.radius_m * 0.5, 0.08)
        scene.add_box(f"{name}/body", dimensions=size, color=colour)
    else:
        scene.add_icosphere(f"{name}/body", robot.radius_m * 0.6, color=colour)
    scene.add_label(f"{name}/label", str(number), position=(0.0, 0.0, 0.3))
    return frame


def _draw_trails(scene: Any, recording: RunLog) -> None:
    poses = recording.stacked()
    if len(poses) < 2:
        return
    stride = max(1, len(poses) // _TRAIL_POINTS)
    for k in range(poses.shape[1]):
        line = poses[::stride, k, :3]
        points = np.stack([line[:-1], line[1:]], axis=1)
        colour = hue(k)
        scene.add_line_segments(
            f"/trails/{k}", points=points, colors=colour, thickness=1.5, thickness_units="screen"
        )
