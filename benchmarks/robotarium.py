"""The Robotarium's Python simulator beside koord's: three applications, on the same robots.

The Robotarium's simulator is not part of this project: ``ROBOTARIUM`` is the folder of a checkout
(robotarium/robotarium_python_simulator), run by ``ROBOTARIUM_PYTHON`` (else by this Python; it
needs NumPy, Matplotlib and CVXOPT). Without it its rows say *not there*.

Both have the robots, places, arena and distance of specs/examples/systems/robotarium_*.yaml: those
of the original are set to the size and speed of koord's robots on two wheels, and its applications
are made of its own controllers, barrier certificates and graphs, with their usual gains. Runs of
both are judged alike, by where robots are: *settled* is when each is within 10 cm of where it is at
the end of its minute (koord's runs end sooner where nothing changes any more), and *off* how far
that is from what was wanted: the farthest from its place of those who cross the ring twice; from
the middle of all who meet; the worst distance in the formation. Koord's robots turn back where
their program says so; the original's when within 5 cm: its applications call that arrived.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import sys
import time
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

#: How long runs are, in seconds; and the distance that certificates keep, in metres.
RUN_S, QUICK_S, DISTANCE_M = 60.0, 10.0, 0.4

#: Who is so near to its place at the end has settled; who is so near to a goal has arrived.
SETTLED_M, ARRIVED_M = 0.1, 0.05

APPLICATIONS = ("points", "consensus", "formation")

#: The places of the formation: three to the right, three back, a metre apart.
SHAPE = ((0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1))


def _example(name: str) -> tuple[Path, Path]:
    folder = Path(__file__).resolve().parent.parent / "specs" / "examples" / "systems"
    return folder / f"robotarium_{name}.krd", folder / f"robotarium_{name}.yaml"


# --- in processes of their own --------------------------------------------------------------------


def work(side: str, name: str, time_s: float) -> int:
    """Run an application, and print where robots were, as JSON."""
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = _theirs(name, time_s) if side == "peer" else _ours(name, time_s)
    json.dump(made, sys.stdout)
    return 0


def _ours(name: str, time_s: float) -> dict[str, Any]:
    import koord

    files = _example(name)
    koord.simulate(*files, duration_s=0.2)  # what is loaded and compiled once
    began_s = time.process_time()
    run = koord.simulate(*files, duration_s=time_s)
    cpu_s = time.process_time() - began_s
    log, nearest = run.recording, run.figures.nearest
    assert nearest is not None
    return {
        "cpu_s": cpu_s,
        "times_s": list(log.times_s),
        "places": [pose[:, :2].tolist() for pose in log.poses],
        "nearest_m": nearest.distance_m,
    }


def _theirs(name: str, time_s: float) -> dict[str, Any]:
    import matplotlib

    matplotlib.use("Agg")
    sys.path.insert(0, os.environ["ROBOTARIUM"])
    import numpy as np

    base = _part("robotarium_abc").ARobotarium
    given = json.loads(os.environ["ROBOTARIUM_SETTING"])
    speed, half, radius_m = given["speed_mps"], given["half_m"], given["radius_m"]
    arena = np.array([-half, half, -half, half])
    # The size and speed of koord's robots.
    base.BOUNDARIES, base.ROBOT_DIAMETER = arena, 2 * radius_m
    base.COLLISION_DIAMETER, base.COLLISION_OFFSET = 2 * radius_m, 0.0
    base.BASE_LENGTH, base.MAX_LINEAR_VELOCITY = given["track_m"], speed
    base.MAX_WHEEL_VELOCITY = given["wheel_mps"] / base.WHEEL_RADIUS
    at = np.array(given["places"]).T
    count = at.shape[1]
    poses = np.vstack([at, np.zeros(count)])
    robots = _part("robotarium").Robotarium(
        number_of_robots=count,
        initial_conditions=poses,
        show_figure=False,
        sim_in_real_time=False,
        skip_initialization=True,
    )
    barriers = _part("utilities.barrier_certificates")
    keep_apart = barriers.create_si_barrier_certificate_with_boundary(
        safety_radius=DISTANCE_M, magnitude_limit=speed, boundary_points=arena
    )
    to_wheels = _part("utilities.transformations").create_si_to_uni_dynamics()
    wanted = _wishes(name, at, speed)
    steps = round(time_s / base.TIME_STEP)
    places, nearest_m = [], math.inf
    began_s = time.process_time()
    for _ in range(steps):
        pose = robots.get_poses()
        velocities = keep_apart(wanted(pose[:2]), pose)
        robots.set_velocities(np.arange(count), to_wheels(velocities, pose))
        robots.step()
        places.append(pose[:2].T.tolist())
    cpu_s = time.process_time() - began_s
    for there in places:
        pairs = [math.dist(a, b) for i, a in enumerate(there) for b in there[:i]]
        nearest_m = min(nearest_m, *pairs)
    times_s = [step * base.TIME_STEP for step in range(steps)]
    return {"cpu_s": cpu_s, "times_s": times_s, "places": places, "nearest_m": nearest_m}


def _part(name: str) -> Any:
    """A module of the Robotarium's simulator, which says nothing of its types."""
    return import_module(f"rps.{name}")


def _wishes(name: str, start: Any, speed: float) -> Any:
    """The velocities that an application wants, of where robots are: arrays of shape (2, n)."""
    import numpy as np

    controllers, graph = _part("utilities.controllers"), _part("utilities.graph")
    count = start.shape[1]
    around = [graph.topological_neighbors(graph.cycleGL(count), robot) for robot in range(count)]
    go = controllers.create_si_position_controller(velocity_magnitude_limit=speed)
    half_done = np.zeros(count, bool)

    def pulled(at: Any) -> Any:
        """What each is away from its two neighbours, added up."""
        return np.array([sum(at[:, j] - at[:, i] for j in around[i]) for i in range(count)]).T

    def points(at: Any) -> Any:
        """Across the ring, and back, each for itself."""
        nonlocal half_done
        half_done |= np.linalg.norm(at + start, axis=0) < ARRIVED_M
        return go(at, np.where(half_done, start, -start))

    def consensus(at: Any) -> Any:
        return _limited(pulled(at), speed)

    def formation(at: Any) -> Any:
        shape = np.array(SHAPE, float).T
        moved = pulled(at - shape)
        moved[:, 0] = 0.0  # the first stays, as in koord's program
        return _limited(moved, speed)

    return {"points": points, "consensus": consensus, "formation": formation}[name]


def _limited(velocities: Any, speed: float) -> Any:
    import numpy as np

    size = np.linalg.norm(velocities, axis=0)
    return velocities * np.minimum(1.0, speed / np.maximum(size, 1e-9))


# --- tables ---------------------------------------------------------------------------------------


def _setting(name: str) -> dict[str, Any]:
    """What both have: robots as koord's, and the places and arena of the configuration."""
    import yaml

    from koord.runtime.motion.bodies import DifferentialDrive

    told = yaml.safe_load(_example(name)[1].read_text("utf-8"))
    body = DifferentialDrive()
    return {
        "places": [told["positions"][robot] for robot in range(told["num_robots"])],
        "half_m": told["world"]["bounds"]["high"][0],
        "speed_mps": body.cruise_mps,
        "wheel_mps": body.wheel_mps,
        "radius_m": body.radius_m,
        "track_m": body.track_m,
    }


def off_m(name: str, start: list[list[float]], end: list[list[float]]) -> float:
    """How far the end of a run is from what was wanted."""
    if name == "points":  # across and back is where each began
        return max(math.dist(a, b) for a, b in zip(start, end, strict=True))
    if name == "consensus":
        middle = [sum(at[axis] for at in end) / len(end) for axis in (0, 1)]
        return max(math.dist(at, middle) for at in end)
    return max(
        abs(math.dist(end[i], end[j]) - math.dist(SHAPE[i], SHAPE[j]))
        for i in range(len(end))
        for j in range(i)
    )


def settled_s(times_s: list[float], places: list[list[list[float]]]) -> float:
    """From when on each robot is within 10 cm of where it is at the end."""
    end, found = places[-1], times_s[-1]
    for now_s, there in zip(reversed(times_s), reversed(places), strict=True):
        if any(math.dist(a, b) > SETTLED_M for a, b in zip(there, end, strict=True)):
            break
        found = now_s
    return found


def robotarium(report: Any) -> None:
    from harness import Cell, Column, measure, note

    table = report.table(
        "Six robots on two wheels, kept 0.4 m apart by barrier certificates",
        Column("application", "application"),
        Column("of", "of"),
        Column("nearest_m", "least m"),
        Column("settled_s", "settled s", 1),
        Column("off_m", "off m"),
        Column("cpu_s", "CPU s"),
        Column("factor", "× real time", 0),
    )
    time_s = QUICK_S if report.quick else RUN_S
    for name in APPLICATIONS:
        setting = _setting(name)
        os.environ["ROBOTARIUM_SETTING"] = json.dumps(setting)
        for side in ("peer", "own"):
            of = "Robotarium" if side == "peer" else "koord"
            row: dict[str, Cell] = {"application": name, "of": of}
            table.rows.append(row)
            if side == "peer" and not os.environ.get("ROBOTARIUM"):
                row["nearest_m"] = "not there"
                continue
            note(f"{name}, {of}")
            python = os.environ.get("ROBOTARIUM_PYTHON") if side == "peer" else None
            command = [python or sys.executable, str(Path(__file__).resolve())]
            done = measure([*command, side, name, str(time_s)], timeout_s=900.0)
            made = done.json()
            if not report.expect(made is not None, f"{name}, {of}: {done.errors[-500:]}"):
                continue
            row |= {
                "nearest_m": made["nearest_m"],
                "settled_s": settled_s(made["times_s"], made["places"]),
                "off_m": off_m(name, setting["places"], made["places"][-1]),
                "cpu_s": made["cpu_s"],
                "factor": made["times_s"][-1] / made["cpu_s"],
            }
            kept = made["nearest_m"] >= DISTANCE_M - 0.01
            report.expect(side == "peer" or kept, f"{name}: koord's robots come too near")


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] in {"peer", "own"}:
        sys.exit(work(sys.argv[1], sys.argv[2], float(sys.argv[3])))
    from harness import main

    sys.exit(main("robotarium", __doc__ or "", robotarium))
