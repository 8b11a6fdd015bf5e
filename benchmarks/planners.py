"""PythonRobotics' planners beside koord's, on the same worlds.

PythonRobotics is code to read, and is not part of this project: ``PYTHONROBOTICS`` is the folder of
a checkout of it, run by ``PYTHONROBOTICS_PYTHON`` (else by this Python; it needs NumPy, SciPy and
Matplotlib). Without it the rows of its planners say *not there*.

Worlds are discs in a square of 15 m, of which one is between start and goal. A robot is a disc of
0.5 m; one that cannot turn on the spot turns with a radius of 1 m, and arrives in any heading. Each
planner has the steps that it has by default; of PythonRobotics' the other parameters are those of
its own examples, and those that go on improving do so until their steps are used up. Paths of both
are judged alike: *clear* is one that keeps the robot from all discs, looked at every centimetre.
CPU is that of planning alone, without start-up.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import random
import sys
import time
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import Any, TypeAlias

#: Whose middle is at x and y, with a radius: all in metres.
Disc: TypeAlias = tuple[float, float, float]
#: Points of a path: x and y in metres.
Path2: TypeAlias = list[tuple[float, float]]

#: Sides of a world, the radius of a robot, and that of its turns, in metres.
SIDE_M, ROBOT_M, TURN_M = 15.0, 0.5, 1.0

START, GOAL = (1.5, 1.5), (13.5, 13.5)

#: A path may come so much nearer than the robot's radius, for numbers are rounded.
_ROUNDED_M = 0.01

#: In so many worlds plans are made, one in each; in so many by planners that take long.
WORLDS, FEW_WORLDS = 20, 4

#: PythonRobotics' classes whose plans take seconds.
SLOW = ("RRTStarDubins", "RRTStarReedsShepp")

#: Of both sides' planners: the row's name, PythonRobotics' file and class, and koord's name.
PAIRS: tuple[tuple[str, tuple[str, str] | None, str | None], ...] = (
    ("RRT, turns on the spot", ("RRT.rrt", "RRT"), "RRT_DIFF"),
    ("RRT*, turns on the spot", ("RRTStar.rrt_star", "RRTStar"), "RRT_STAR_DIFF"),
    ("RRT, Dubins", ("RRTDubins.rrt_dubins", "RRTDubins"), "RRT_DUB_CAR"),
    ("RRT*, Dubins", ("RRTStarDubins.rrt_star_dubins", "RRTStarDubins"), None),
    ("RRT, Reeds–Shepp", None, "RRT_CAR"),
    (
        "RRT*, Reeds–Shepp",
        ("RRTStarReedsShepp.rrt_star_reeds_shepp", "RRTStarReedsShepp"),
        "RRT_STAR_CAR",
    ),
)


def worlds(count: int) -> list[list[Disc]]:
    """Discs of so many worlds; start and goal are free, and one stands between them."""
    made: list[list[Disc]] = []
    for seed in range(count):
        chance = random.Random(seed)
        middle = SIDE_M / 2
        discs: list[Disc] = [(middle, middle, chance.uniform(1.0, 2.0))]
        while len(discs) < 9:
            x, y = chance.uniform(0, SIDE_M), chance.uniform(0, SIDE_M)
            disc = x, y, chance.uniform(0.4, 1.2)
            if all(math.dist(at, (x, y)) - disc[2] > 4 * ROBOT_M for at in (START, GOAL)):
                discs.append(disc)
        made.append(discs)
    return made


def judged(path: Path2, discs: list[Disc]) -> tuple[float, float]:
    """The length of a path, and how near its robot's edge comes to a disc, in metres."""
    length_m = sum(math.dist(one, other) for one, other in pairwise(path))
    near_m = math.inf
    for (x0, y0), (x1, y1) in pairwise(path):
        steps = max(1, math.ceil(math.dist((x0, y0), (x1, y1)) / 0.01))
        for k in range(steps + 1):
            x, y = x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps
            near_m = min(near_m, *(math.dist((x, y), (a, b)) - r for a, b, r in discs))
    return length_m, near_m - ROBOT_M


# --- in processes of their own --------------------------------------------------------------------


def work(side: str, name: str) -> int:
    """Plan in each world that stands in the input, and print what came of it, as JSON."""
    given: list[list[Disc]] = json.load(sys.stdin)
    plan = _peer(*name.split()) if side == "peer" else _own(name)
    found = []
    with contextlib.redirect_stdout(io.StringIO()):
        if side == "own":
            plan(given[0], 0)  # OMPL is loaded when it is wanted
        for seed, discs in enumerate(given):
            began_s = time.process_time()
            path = plan(discs, seed)
            cpu_s = time.process_time() - began_s
            found.append({"path": path, "cpu_s": cpu_s})
    json.dump(found, sys.stdout)
    return 0


def _peer(module: str, kind: str) -> Any:
    """A planner of PythonRobotics: from the discs of a world and a seed to a path, or None."""
    import importlib

    import matplotlib

    matplotlib.use("Agg")
    sys.path[:0] = [os.environ["PYTHONROBOTICS"], f"{os.environ['PYTHONROBOTICS']}/PathPlanning"]
    made = getattr(importlib.import_module(module), kind)

    def plan(discs: list[Disc], seed: int) -> Path2 | None:
        random.seed(seed)
        area, around = [0.0, SIDE_M], {"robot_radius": ROBOT_M}
        if kind == "RRT":
            bounds = [0.0, SIDE_M] * 2
            planner = made(list(START), list(GOAL), discs, area, play_area=bounds, **around)
        elif kind == "RRTStar":
            more = {"expand_dis": 1, "search_until_max_iter": True}
            planner = made(list(START), list(GOAL), discs, area, **more, **around)
        else:
            planner = made([*START, 0.0], [*GOAL, 0.0], discs, area, **around)
            planner.curvature = 1 / TURN_M
            planner.goal_yaw_th = 2 * math.pi  # any heading, as koord's
        path = planner.planning(animation=False)
        return None if path is None else [(float(one[0]), float(one[1])) for one in path][::-1]

    return plan


def _own(name: str) -> Any:
    """A planner of koord: from the discs of a world and a seed to a path, or None."""
    from koord.runtime.motion.bodies import Car, DifferentialDrive, PlannerName
    from koord.runtime.motion.planners import planner
    from koord.runtime.motion.planning import PlanningEffort, Pose, Room
    from koord.runtime.motion.rrt import _WIDER
    from koord.runtime.motion.world import Disc as Cylinder
    from koord.runtime.motion.world import World

    # Bodies are within the robot's disc, which ways keep clear of obstacles.
    steering_rad = math.atan(Car().wheelbase_m * _WIDER / TURN_M)
    car = Car(length_m=0.4, width_m=0.3, steering_rad=steering_rad)
    body = DifferentialDrive() if "DIFF" in name else car
    edge = ROBOT_M, SIDE_M + ROBOT_M

    def plan(discs: list[Disc], seed: int) -> Path2 | None:
        obstacles = tuple(Cylinder((x, y), radius_m) for x, y, radius_m in discs)
        world = World((-edge[0], -edge[0], 0.0), (edge[1], edge[1], 1.0), obstacles)
        room = Room(least_m=ROBOT_M)
        made = planner(PlannerName(name), world, body, PlanningEffort(), room=room)
        path = made.plan(Pose((*START, 0.0)), (*GOAL, 0.0), seed)
        return None if path is None else [(x, y) for x, y, _ in path.tolist()]

    return plan


# --- tables ---------------------------------------------------------------------------------------


def planners(report: Any) -> None:
    from harness import NOTHING, Cell, Column, measure, note

    table = report.table(
        "Planners: PythonRobotics' beside koord's",
        Column("planner", "planner"),
        Column("of", "of"),
        Column("worlds", "worlds", 0),
        Column("found", "found", 0),
        Column("clear", "clear", 0),
        Column("length_m", "mean m", 1),
        Column("spare_m", "least spare m"),
        Column("cpu_ms", "CPU ms a plan", 1),
    )
    folder = os.environ.get("PYTHONROBOTICS")
    for name, theirs, ours in PAIRS[:3] if report.quick else PAIRS:
        slow = theirs is not None and theirs[1] in SLOW
        given = worlds(FEW_WORLDS if slow or report.quick else WORLDS)
        text = json.dumps(given).encode()
        for side, what in (("peer", theirs), ("own", ours)):
            of = "PythonRobotics" if side == "peer" else "koord"
            row: dict[str, Cell] = {"planner": name, "of": of}
            table.rows.append(row)
            if what is None:
                row["found"] = "it has none"
            elif side == "peer" and not folder:
                row["found"] = "not there"
            else:
                note(f"{name}, {of}")
                python = os.environ.get("PYTHONROBOTICS_PYTHON") if side == "peer" else None
                words = what if isinstance(what, str) else " ".join(what)
                command = [python or sys.executable, str(Path(__file__).resolve()), side, words]
                done = measure(command, timeout_s=1_800.0, stdin=text)
                made = done.json()
                if report.expect(made is not None, f"{name}, {of}: {done.errors[-500:]}"):
                    row |= _cells(made, given)
                    clear = row["clear"] == row["found"]
                    report.expect(side == "peer" or clear, f"{name}: paths of koord touch")
            row.setdefault("clear", NOTHING)


def _cells(made: list[dict[str, Any]], given: list[list[Disc]]) -> dict[str, Any]:
    """What is told of the plans of a planner."""
    told = [
        judged([(x, y) for x, y in one["path"]], discs)
        for one, discs in zip(made, given, strict=True)
        if one["path"] is not None
    ]
    cells = {
        "worlds": len(given),
        "found": len(told),
        "clear": sum(spare_m >= -_ROUNDED_M for _, spare_m in told),
        "cpu_ms": 1e3 * fmean(one["cpu_s"] for one in made),
    }
    if told:
        cells["length_m"] = fmean(length_m for length_m, _ in told)
        cells["spare_m"] = min(spare_m for _, spare_m in told)
    return cells


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] in {"peer", "own"}:
        sys.exit(work(sys.argv[1], sys.argv[2]))
    from harness import main

    sys.exit(main("planners", __doc__ or "", planners))
