"""Drivers: how long a message takes there and back, and a vehicle from its pose to its command.

Vehicles are nodes in processes of their own, which tell poses a hundred times a second. There and
back: a place is published, a node publishes it again, and it is looked for all the time. A tick:
a guarded robot drives a car to a place, twenty ticks a second; *tick* is what one takes, *sensed to
told* is from the stamp of the pose that a tick knows to when its command has left. What is not
installed on this machine is left out (`.ci/peers` installs it).
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

from harness import ROOT, Column, Report, limited, main, measure, note

#: What is wanted: there and back as a median; from a pose to its command within a tick.
ROUND_TRIP_S, TICK_S = 0.005, 0.05

#: Transports of koord's end, and what the vehicle is.
CASES = (
    ("ros2", "cyclonedds", "cyclonedds"),
    ("ros2", "cyclonedds", "rclpy"),
    ("ros2", "rclpy", "rclpy"),
    ("ros1", "rospy", "rospy"),
)

TRIPS, TICKS = 2_000, 300
QUICK = 100, 40

Nodes = Callable[[str, str], AbstractContextManager[Any]]


def nodes(vehicle: str, stack: ExitStack) -> Nodes:
    """What starts a node of a kind under a prefix."""
    if vehicle == "rospy":
        from tests.runtime.platform.ros1 import peers as ros1

        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ |= ros1.environment(folder)
        stack.enter_context(ros1.master(folder))
        return lambda kind, prefix: ros1.node(kind, prefix, folder)
    from tests.runtime.platform.ros2 import peers as dds
    from tests.runtime.platform.ros2 import rclpy_peers as ros2

    os.environ |= {**ros2.environment(dds.DOMAIN), "CYCLONEDDS_URI": dds.LOOPBACK}
    if vehicle == "cyclonedds":
        return dds.peer
    return lambda kind, prefix: ros2.node(kind, prefix, dds.DOMAIN)


def graph_of(transport: str) -> Any:
    """A part in the graph, for nobody's vehicle."""
    if transport == "rospy":
        from koord.runtime.drivers.ros1.graph import RospyGraph

        return RospyGraph(None, 10)
    from koord.runtime.drivers.ros2.client import RclpyGraph
    from koord.runtime.drivers.ros2.dds import DdsGraph

    return (RclpyGraph if transport == "rclpy" else DdsGraph)(None, 10)


def trips(transport: str, prefix: str, many: int) -> list[float]:
    """Seconds there and back, of each message."""
    from koord.runtime.drivers.ros.options import Wire
    from tests.runtime.platform.ros.driving import there_and_back

    graph = graph_of(transport)
    echo = graph.listen(Wire(f"{prefix}/echo", "PoseStamped"))
    sender = graph.publish(Wire(f"{prefix}/waypoint", "PoseStamped"))
    took: list[float] = []
    ends_s = time.monotonic() + 60.0
    while len(took) < many and time.monotonic() < ends_s:
        sent = {"pose": {"position": {"x": 1.0}}}
        back, trip_s = there_and_back(sender, echo, sent, most_s=0.2)
        if back is not None:
            took.append(trip_s)
        time.sleep(0.002)
    graph.close()
    return took[many // 10 :]  # not those of the start


def ticks(driver: str, transport: str, prefix: str, many: int) -> tuple[list[float], list[float]]:
    """Seconds that each tick of a car took, and from the stamp of its pose to its command."""
    from koord.api.drivers import registry
    from koord.runtime.configuration.model import Vehicle
    from koord.runtime.drivers.driver import Device
    from koord.runtime.drivers.registry import options_of
    from tests.runtime.platform.ros.driving import WORLD, Driven

    made = registry().load(driver)
    topics: dict[str, Any] = {"positioning_topic": {"topic": "pose", "type": "PoseStamped"}}
    given = topics | {"ros_node_prefix": prefix, "wait": 30}
    if driver == "ros2":
        given["transport"] = transport
    options = options_of(made, json.dumps(given).encode())
    car: Any = made(Device(0, Vehicle("car", "DIFF"), WORLD, (0.0, 0.0, 0.0), options=options))
    one = Driven(car)
    one.until(one.started)
    took, late = [], []
    for k in range(many):
        if k % 100 == 0:
            one.driven.go_to((1.5, 0.5, 0.0) if k % 200 == 0 else (-1.5, -0.5, 0.0))
        begun_s = time.perf_counter()
        one.driven.tick(time.monotonic(), 0.0)
        took.append(time.perf_counter() - begun_s)
        late.append(time.time() - car._fix.stamp_s)
        time.sleep(max(0.0, TICK_S - took[-1]))
    one.driven.close()
    return took, late


def measured(driver: str, transport: str, vehicle: str, many: int, many_ticks: int) -> Any:
    """All of one case, in a process of its own; why not, if something is not installed."""
    import pytest

    with ExitStack() as stack:
        try:
            node = nodes(vehicle, stack)
            with node("echo", "echoing"):
                back = trips(transport, "echoing", many)
            with node("car", "driving"):
                took, late = ticks(driver, transport, "driving", many_ticks)
        except pytest.skip.Exception as missing:
            return {"missing": str(missing)}
    if len(back) < many // 2:
        raise RuntimeError(f"{len(back)} of {many} came back")
    return {"trips": back, "ticks": took, "late": late}


def in_python(transport: str, *arguments: Any) -> Any:
    """What :func:`measured` returns, by a Python that has the transport. Raises RuntimeError."""
    import pytest

    from tests.runtime.platform.ros2.rclpy_peers import rclpy_python

    try:
        python = rclpy_python() if transport == "rclpy" else sys.executable
    except pytest.skip.Exception as missing:
        return {"missing": str(missing)}
    here = [path for path in sys.path if path.endswith("site-packages")]
    os.environ["PYTHONPATH"] = os.pathsep.join(here)
    told = json.dumps(arguments)
    program = (
        "import json, sys, drivers; print(json.dumps(drivers.measured(*json.loads(sys.argv[1]))))"
    )
    done = measure([python, "-c", program, told], timeout_s=240)
    if done.code != 0:
        raise RuntimeError(done.errors.strip()[-2000:])
    return json.loads(done.output.strip().splitlines()[-1])


def spread(seconds: list[float]) -> dict[str, float]:
    """Median, and what 99 of 100 keep to, in ms."""
    sorted_ms = [1e3 * one for one in sorted(seconds)]
    return {"median": sorted_ms[len(sorted_ms) // 2], "p99": sorted_ms[len(sorted_ms) * 99 // 100]}


def benchmark(report: Report) -> None:
    ends = Column("driver", "driver"), Column("by", "by"), Column("vehicle", "vehicle")
    limits = Column("limit", "limit"), Column("met", "met")
    there = report.table(
        "There and back through a node, ms",
        *ends,
        Column("median", "median", 2),
        Column("p99", "99 %", 2),
        *limits,
    )
    told = report.table(
        "A tick of 50 ms, ms",
        *ends,
        Column("tick", "tick", 2),
        Column("tick_p99", "99 %", 2),
        Column("median", "sensed to told", 2),
        Column("p99", "99 %", 2),
        *limits,
    )
    many, many_ticks = QUICK if report.quick else (TRIPS, TICKS)
    sys.path.insert(0, str(ROOT))
    for driver, transport, vehicle in CASES:
        note(f"{driver} by {transport}, a vehicle of {vehicle}")
        row = {"driver": driver, "by": transport, "vehicle": vehicle}
        try:
            found = in_python(transport, driver, transport, vehicle, many, many_ticks)
        except RuntimeError as error:
            report.expect(False, f"{driver} by {transport}: {error}")
            continue
        if "missing" in found:
            there.rows.append({**row, "limit": found["missing"]})
            continue
        back, late, took = (spread(found[key]) for key in ("trips", "late", "ticks"))
        there.rows.append(
            {**row, **back, **limited(back["median"] / 1e3, ROUND_TRIP_S, "s median")}
        )
        beside = {"tick": took["median"], "tick_p99": took["p99"]}
        told.rows.append({**row, **beside, **late, **limited(late["p99"] / 1e3, TICK_S, "s, 99 %")})


if __name__ == "__main__":
    sys.exit(main("drivers", __doc__ or "", benchmark))
