"""Vehicles, controllers and planners: what a second of simulated time costs, robot by robot.

Everything of motion runs: positioning, automata, control and vehicles, on one thread; programs and
their rounds do not. Robots drive circles or fly squares, each by itself, and never arrive, so that
nobody rests. Times are CPU seconds inside of a child process, without its start and its first
steps (what is compiled is compiled then). The limits are shares of what whole runs must keep to:
16 drones, 120 s in 3 s; 1,000 robots twice as fast as real time.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Any

from harness import Cell, Column, Report, in_child, limited, main, note

COUNTS = (16, 100, 1_000)

#: Kinds of robot: body, level, controller, and the least speed against real time for 1,000.
KINDS: tuple[tuple[str, str, str, str, float | None], ...] = (
    ("car, MPC", "CAR", "full", "MPC", 2.0),
    ("car, MPC, no contact", "CAR", "simple", "MPC", None),
    ("car, pursuit", "CAR", "full", "PURSUIT", 5.0),
    ("car, pursuit, no contact", "CAR", "simple", "PURSUIT", None),
    ("differential drive", "DIFF", "full", "", 5.0),
    ("differential drive, no contact", "DIFF", "simple", "", None),
    ("drone", "DRONE", "full", "", 5.0),
    ("drone without attitude", "DRONE", "simple", "", None),
    ("ideal point", "POINT", "full", "", 20.0),
)

#: So much simulated time goes before what is told of.
BEGINNING_S = 0.5

#: Bodies that MuJoCo moves, and how many: it takes some hundred times as long.
PHYSICAL, FEW = (("car, MPC", "CAR"), ("differential drive", "DIFF"), ("drone", "DRONE")), (16, 100)

#: The whole of 120 s of 16 drones may take 3 s, rounds and recording included.
DRONES_S = 2.0

PLANNERS = (
    "STRAIGHT",
    "RRT_DRONE",
    "RRT_STAR_DRONE",
    "RRT_CAR",
    "RRT_STAR_CAR",
    "RRT_DIFF",
    "RRT_STAR_DIFF",
)


def advanced(body: str, level: str, steering: str, count: int, seconds: float) -> dict[str, Any]:
    """CPU seconds that a fleet takes for some seconds, and whether all robots still moved."""
    from koord.runtime.motion.automaton import MotionState
    from koord.runtime.motion.bodies import (
        Body,
        Car,
        DifferentialDrive,
        Drone,
        IdealBody,
        Level,
        PlannerName,
        Steering,
    )
    from koord.runtime.motion.world import World
    from koord.sim.fleet import Fleet, Placed
    from koord.sim.squads import DeviceModel

    bodies: dict[str, Body] = {
        "CAR": Car(),
        "DIFF": DifferentialDrive(),
        "DRONE": Drone(),
        "POINT": IdealBody(),
    }
    on_ground = body in ("CAR", "DIFF")
    controller = Steering(steering or "MPC")
    model = DeviceModel(bodies[body], PlannerName.STRAIGHT, Level(level), controller)
    side = math.ceil(math.sqrt(count))
    height = 0.0 if on_ground else 1.0
    places = [(3.0 * (k % side), 3.0 * (k // side), height) for k in range(count)]
    world = World((-3, -3, 0), (3.0 * side, 3.0 * side, 5))
    begun = time.process_time()
    fleet = Fleet(world, [Placed(model, place) for place in places])
    laps = math.ceil((seconds + 1) / 3)
    circle = [(1.1 * math.sin(k / 6), 1.1 - 1.1 * math.cos(k / 6), 0.0) for k in range(37)]
    square = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.5), (1.0, 1.0, 0.0), (0.0, 1.0, 0.5)]
    for robot, (x, y, z) in enumerate(places):
        shape = circle if on_ground else square
        fleet.follow(robot, [(x + a, y + b, z + c) for a, b, c in shape] * laps)
    fleet.advance_to(BEGINNING_S)
    ready = time.process_time()
    fleet.advance_to(BEGINNING_S + seconds)
    return {
        "setup_s": ready - begun,
        "cpu_s": time.process_time() - ready,
        "moving": all(sensed.state is MotionState.MOVING for sensed in fleet.sensed()),
    }


def physical(body: str, count: int, seconds: float) -> dict[str, Any]:
    """What `advanced` tells of a fleet that MuJoCo moves, and the part that are its own steps."""
    import mujoco

    steps, stepped_s = mujoco.mj_step, 0.0

    def timed(*arguments: Any) -> None:
        nonlocal stepped_s
        begun = time.process_time()
        steps(*arguments)
        if arguments[1].time > BEGINNING_S:
            stepped_s += time.process_time() - begun

    mujoco.mj_step = timed
    found = advanced(body, "mujoco", "", count, seconds)
    return found | {"share": stepped_s / found["cpu_s"]}


def planned(name: str, count: int) -> dict[str, Any]:
    """Milliseconds that plans take in the arena with three obstacles, and how many fail."""
    import numpy as np

    from koord.runtime.motion.bodies import Body, Car, DifferentialDrive, Drone, PlannerName
    from koord.runtime.motion.field import field
    from koord.runtime.motion.planners import planner
    from koord.runtime.motion.planning import Pose
    from koord.runtime.motion.world import Box, Disc, Polygon, World

    obstacles = (
        Disc((0.0, 0.0), 0.6),
        Box((1.0, 1.0, 0.0), (1.6, 3.0, 2.0)),
        Polygon(((-2.0, 1.0), (-1.0, 1.0), (-1.0, 2.5))),
    )
    world = World(obstacles=obstacles)
    bodies: dict[str, Body] = {"CAR": Car(), "DIFF": DifferentialDrive()}
    body = bodies.get(name.rpartition("_")[2], Drone())
    on_ground = not isinstance(body, Drone)
    height = 0.0 if on_ground else 1.0
    made, free = planner(PlannerName(name), world, body), field(world, flat=on_ground)
    draw = np.random.default_rng(0)
    places: list[tuple[float, float, float]] = []
    while len(places) < 2 * count:
        x, y = draw.uniform(-3.3, 3.3, 2).tolist()
        if free.clearance(x, y, height) > 0.65:
            places.append((x, y, height))
    took, points, failed = [], [], 0
    for k in range(count):
        pose = Pose(places[2 * k], draw.uniform(-math.pi, math.pi))
        begun = time.process_time()
        path = made.plan(pose, places[2 * k + 1], k)
        took.append(1000 * (time.process_time() - begun))
        if path is None:
            failed += 1
        else:
            points.append(len(path))
    took.sort()
    return {
        "median_ms": took[len(took) // 2],
        "p95_ms": took[math.floor(0.95 * (len(took) - 1))],
        "most_ms": took[-1],
        "points": sorted(points)[len(points) // 2] if points else None,
        "failed": failed,
    }


def vehicles(report: Report) -> None:
    """One row for each kind of robot and number of robots."""
    table = report.table(
        "A second of simulated time",
        Column("kind", "robots of kind"),
        Column("count", "robots", 0),
        Column("times_real", "x real time", 1),
        Column("us", "µs per robot and s", 0),
        Column("setup_s", "set-up s"),
        Column("limit", "limit"),
        Column("met", "met"),
    )
    for kind, body, level, steering, least in KINDS:
        for count in COUNTS[:2] if report.quick else COUNTS:
            note(f"{count} robots: {kind}")
            seconds = 2.0 if report.quick else 20.0 if count < 1_000 else 4.0
            found = in_child(advanced, body, level, steering, count, seconds, timeout_s=300.0)
            report.expect(found["moving"], f"{count} × {kind}: somebody came to rest")
            row: dict[str, Cell] = {
                "kind": kind,
                "count": count,
                "times_real": round(seconds / found["cpu_s"], 1),
                "us": round(1e6 * found["cpu_s"] / seconds / count),
                "setup_s": round(found["setup_s"], 2),
            }
            if count == 1_000 and least is not None:
                row |= limited(found["cpu_s"] / seconds, 1 / least, "s CPU per s")
            if count == 16 and level == "full" and body == "DRONE":
                row |= limited(found["cpu_s"] / seconds * 120, DRONES_S, "s CPU per 120 s")
            table.rows.append(row)


def physics(report: Report) -> None:
    """One row for each kind of robot and number of robots that MuJoCo moves."""
    table = report.table(
        "A second of simulated time at level mujoco",
        Column("kind", "robots of kind"),
        Column("count", "robots", 0),
        Column("times_real", "x real time", 1),
        Column("share", "of the CPU time MuJoCo's own steps, %", 0),
    )
    for kind, body in PHYSICAL:
        for count in FEW[:1] if report.quick else FEW:
            note(f"{count} robots in MuJoCo: {kind}")
            seconds = 1.0 if report.quick else 320.0 / count
            found = in_child(physical, body, count, seconds, timeout_s=300.0)
            report.expect(found["moving"], f"{count} × {kind}: somebody came to rest")
            table.rows.append(
                {
                    "kind": kind,
                    "count": count,
                    "times_real": round(seconds / found["cpu_s"], 1),
                    "share": round(100 * found["share"]),
                }
            )


def planners(report: Report) -> None:
    """One row for each planner."""
    table = report.table(
        "Plans in the arena of 7 × 8 × 3 m with three obstacles",
        Column("planner", "planner"),
        Column("plans", "plans", 0),
        Column("median_ms", "median ms"),
        Column("p95_ms", "95 % ms"),
        Column("most_ms", "most ms"),
        Column("points", "points", 0),
        Column("failed", "no way", 0),
    )
    for name in PLANNERS:
        note(f"planner {name}")
        plans = 10 if report.quick else 60
        found = in_child(planned, name, plans)
        if name.startswith("RRT"):
            report.expect(found["failed"] <= plans // 10, f"{name}: {found['failed']} without way")
        table.rows.append({"planner": name, "plans": plans, **_rounded(found)})


def _rounded(found: dict[str, Any]) -> dict[str, Cell]:
    return {key: round(v, 3) if isinstance(v, float) else v for key, v in found.items()}


def benchmark(report: Report) -> None:
    """Vehicles of all levels, then planners."""
    vehicles(report)
    physics(report)
    planners(report)


if __name__ == "__main__":
    sys.exit(main("vehicles", __doc__, benchmark))
