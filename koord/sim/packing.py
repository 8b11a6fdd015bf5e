"""Packing of recordings: compact binary increments that the page reads.

A pack is the length of a JSON document (four bytes, the least first), the document, and behind it
*planes* of numbers, which the document names (``planes``: name, offset, length). Positions are
kept as whole steps of ``step_m`` from the middle of the world, headings in 4,096 parts of a turn.
Of what runs along in time the second differences are kept, modulo 2¹⁶, and the low and the high
bytes of all of them separately: most high bytes are then zero, and cost nothing once deflated.
"""

from __future__ import annotations

import json
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from koord.runtime.motion.world import Box, Disc, Obstacle, Polygon, World
from koord.runtime.proposals import Plain
from koord.runtime.shapes import (
    Array,
    Enumeration,
    Mapping,
    PerRobot,
    Record,
    Scalar,
    Sequence,
    Shape,
)
from koord.sim.run_log import (
    Header,
    LoggedAgent,
    LoggedRobot,
    LoggedVariable,
    LogSizes,
    RunLog,
    map_variable,
)

#: Headings are kept in so many parts of a turn.
TURN = 4096

#: How far robots tilt, which nobody sees so exactly, in so many.
TILT = 720

#: The finest step that positions are kept in, and how many steps there are in a world.
_STEP_M, _STEPS = 0.001, 60_000

#: Values of variables are kept with so many digits behind the point.
_DIGITS = 4

#: What programs call records whose classes have another name.
_SPELLED = {"Pos": "pos"}

#: How near robots are, where nobody said.
_UNKNOWN_MM = 0xFFFF


def pack(recording: RunLog, since: LogSizes, until: LogSizes) -> bytes:
    """Pack the part of a recording between two points; with the header if it is the first."""
    header = recording.header
    rounds = recording.rounds[since.rounds : until.rounds]
    document: dict[str, Any] = {
        "rounds": [
            [done.number, _ms(done.time_s), [[*c[:3], _rounded(c.value)] for c in done.changes]]
            for done in rounds
        ],
        "said": [[done.number, *said] for done in rounds for said in done.said],
        "tasks": [
            [_ms(change.time_s), change.task, int(change.state), change.robot]
            for change in recording.tasks[since.tasks : until.tasks]
        ],
        "violations": [
            {
                "time": _ms(violation.time_s),
                "claim": violation.claim,
                "words": violation.words,
                "robots": violation.robots,
                "place": _rounded(violation.place),
            }
            for violation in recording.violations[since.violations : until.violations]
        ],
        "still": [
            [_ms(one.time_s), one.robot, _ms(one.since_s), one.words]
            for one in recording.still[since.still : until.still]
        ],
        "ending": recording.ending if until.ended else None,
    }
    if until.reloads > since.reloads:
        reloads = range(since.reloads, until.reloads)
        document["reloads"] = [_reload(recording, number) for number in reloads]
    if since == LogSizes():
        document["header"] = described(header)
    planes = {
        **_poses(recording, since.times, until.times),
        **_paths(recording, since.paths, until.paths),
        "deeds": _deeds(recording, since.rounds, until.rounds),
    }
    return _joined(document, planes)


def step_m(world: World) -> float:
    """The resolution in metres of packed positions in a world."""
    span = max(high - low for low, high in zip(world.low, world.high, strict=True))
    return max(_STEP_M, span * 1.2 / _STEPS)


def middle(world: World) -> tuple[float, ...]:
    """The origin of packed positions, in metres."""
    return tuple((low + high) / 2 for low, high in zip(world.low, world.high, strict=True))


def _reload(recording: RunLog, number: int) -> dict[str, Any]:
    """A change of the program; with what the header has now, for pages that have an older one."""
    entry, header = recording.reloads[number], recording.header
    return {
        "time": _ms(entry.time_s),
        "round": entry.number,
        "text": entry.text,
        "words": entry.words,
        "had": [entry.had.shared, entry.had.agents],
        "has": [entry.has.shared, entry.has.agents],
        "agents": [_agent(agent) for agent in header.agents],
        "shared": [_variable(variable) for variable in header.shared],
    }


# --- planes ---------------------------------------------------------------------------------------


def _poses(recording: RunLog, first: int, last: int) -> dict[str, bytes]:
    world, robots = recording.header.world, len(recording.header.robots)
    poses = recording.poses[first:last]
    stacked = np.stack(poses) if poses else np.zeros((0, robots, 6), np.float32)
    steps = _steps(stacked[..., :3], world)
    turns = np.round(stacked[..., 3] * (TURN / (2 * np.pi))).astype(np.int64)
    whole = np.concatenate([steps, turns[..., None]], axis=2)
    along = whole.transpose(2, 1, 0)  # component, robot, time
    mm = np.round(np.array(recording.separations_m[first:last]) * 1000)
    mm = np.where(np.isnan(mm), _UNKNOWN_MM, np.minimum(mm, _UNKNOWN_MM - 1))
    times = np.round(np.array(recording.times_s[first:last]) * 1000).astype("<u4")
    return {
        "times": times.tobytes(),
        "separations": mm.astype("<u2").tobytes(),
        "poses": _split(_differences(_differences(along))),
        "tilts": _tilts(stacked[:, list(recording.header.tilting), 4:]),
    }


def _tilts(tilts: NDArray[np.float32]) -> bytes:
    """The roll and pitch of tilting robots over time."""
    whole = np.round(tilts * (TILT / (2 * np.pi))).astype(np.int64)
    return _split(_differences(whole.transpose(2, 1, 0)))


def _paths(recording: RunLog, first: int, last: int) -> dict[str, bytes]:
    paths = recording.paths[first:last]
    heads = [(_ms(path.time_s), path.robot, len(path.points)) for path in paths]
    points = [path.points for path in paths if len(path.points)]
    joined = np.concatenate(points) if points else np.zeros((0, 3), np.float32)
    return {
        "path_heads": np.array(heads, "<u4").reshape(-1, 3).T.tobytes(),
        "path_points": _split(_differences(_steps(joined, recording.header.world).T)),
    }


def _deeds(recording: RunLog, first: int, last: int) -> bytes:
    rounds = recording.rounds[first:last]
    if not rounds:
        return b""
    return np.stack([done.deeds for done in rounds]).astype("<i2").T.tobytes()


def _steps(points: NDArray[np.float32], world: World) -> NDArray[np.int64]:
    steps = np.round((points - np.array(middle(world))) / step_m(world))
    whole: NDArray[np.int64] = np.clip(steps, -32_768, 32_767).astype(np.int64)
    return whole


def _differences(whole: NDArray[np.int64]) -> NDArray[np.int64]:
    """First differences along the last axis; the first number stays itself."""
    found: NDArray[np.int64] = np.diff(whole, axis=-1, prepend=0)
    return found


def _split(whole: NDArray[np.int64]) -> bytes:
    """Split 16-bit numbers: all low bytes, then all high bytes."""
    short = (whole & 0xFFFF).astype("<u2").reshape(-1)
    return (short & 0xFF).astype(np.uint8).tobytes() + (short >> 8).astype(np.uint8).tobytes()


def _joined(document: dict[str, Any], planes: dict[str, bytes]) -> bytes:
    named, offset = [], 0
    for name, plane in planes.items():
        named.append([name, offset, len(plane)])
        offset += len(plane)
    text = json.dumps({**document, "planes": named}, separators=(",", ":"), allow_nan=False)
    raw = text.encode()
    return b"".join([len(raw).to_bytes(4, "little"), raw, *planes.values()])


# --- the header -----------------------------------------------------------------------------------


def described(header: Header) -> dict[str, Any]:
    """The header as JSON."""
    world = header.world
    return {
        "program": header.program,
        "text": header.text,
        "delta": header.delta_s,
        "seed": header.seed,
        "differing": header.differing,
        "safety": header.safety_m,
        "visit": header.visit_m,
        "step": step_m(world),
        "middle": middle(world),
        "turn": TURN,
        "tilt": TILT,
        "world": {
            "low": world.low,
            "high": world.high,
            "obstacles": [_obstacle(one, world) for one in world.obstacles],
            "tasks": world.tasks,
        },
        "map": _map(header),
        "agents": [_agent(agent) for agent in header.agents],
        "robots": [_robot(robot) for robot in header.robots],
        "shared": [_variable(variable) for variable in header.shared],
    }


def _obstacle(obstacle: Obstacle, world: World) -> dict[str, Any]:
    heights = {"low": obstacle.low_z, "high": min(obstacle.high_z, world.high[2])}
    match obstacle:
        case Disc(centre=centre, radius_m=radius):
            return {"centre": centre, "radius": radius, **heights}
        case Box(corners=corners) | Polygon(corners=corners):
            return {"corners": corners, **heights}
        case _:
            assert_never(obstacle)


def _agent(agent: LoggedAgent) -> dict[str, Any]:
    own = [_variable(variable) for variable in agent.variables]
    return {"name": agent.name, "events": agent.events, "variables": own}


def _robot(robot: LoggedRobot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "agent": robot.agent,
        "device": robot.device,
        "look": robot.look.name,
        "radius": round(robot.radius_m, 4),
        "length": robot.length_m,
        "width": robot.width_m,
        "middle": robot.middle_m,
        "flies": robot.look.flies,
    }


def _variable(variable: LoggedVariable) -> dict[str, Any]:
    return {"name": variable.name, "home": variable.home.value, "shape": shape_of(variable.shape)}


def shape_of(shape: Shape) -> Any:
    """A shape as JSON, by which the page prints values in the words of the program."""
    match shape:
        case Scalar(kind=kind):
            return kind.value
        case Enumeration(name=name, members=members):
            return {"enum": name, "members": members}
        case Record(make=make, fields=fields):
            names: tuple[str, ...] = getattr(make, "_fields", ())
            parts = [[n, shape_of(field)] for n, field in zip(names, fields, strict=True)]
            return {"record": _SPELLED.get(make.__name__, make.__name__), "fields": parts}
        case Array(element=element, size=size):
            return {"array": shape_of(element), "size": size}
        case PerRobot(element=element):
            return {"robots": shape_of(element)}
        case Sequence(element=element):
            return {"list": shape_of(element)}
        case Mapping(key=key, value=value):
            return {"map": [shape_of(key), shape_of(value)]}
    assert_never(shape)


def _map(header: Header) -> dict[str, Any] | None:
    """The shared variable that is a map of the world's cells, and its encoding."""
    number = map_variable(header)
    if number is None:
        return None
    grid = header.world.grid
    found = {
        "variable": number,
        "origin": grid.origin,
        "cell": grid.cell_m,
        "columns": grid.columns,
        "rows": grid.rows,
    }
    match header.shared[number].shape:
        case Array(element=Enumeration(members=members)):
            return found | {"free": members.index("free"), "unknown": members.index("unknown")}
        case _:
            return found


# --- numbers --------------------------------------------------------------------------------------


def _ms(time_s: float) -> int:
    return round(time_s * 1000)


def _rounded(value: Plain) -> Any:
    """A value as JSON, rounded to significant digits."""
    if isinstance(value, float):
        # What is no number has no JSON either.
        return round(value, _DIGITS) if abs(value) < 1e300 else str(value)
    if isinstance(value, tuple):
        return [_rounded(item) for item in value]
    return value
