"""The library's functions in the world of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from koord.runtime.motion.library import Chart, Library
from koord.runtime.motion.planning import Planner, Pose
from koord.runtime.platform.sensors import MotionSensors
from koord.sim.scene import Scene

_USUAL_RANGE_M = 4.0


def library_of(
    scene: Scene,
    planners: Mapping[int, Planner],
    sensors: Callable[[int], MotionSensors],
    keep_rounds: int,
) -> Library:
    """The library of robots with these planners and sensors, by pid.

    A robot that waits gets the same path to the same goal for ``keep_rounds`` rounds. Charts reach
    as far as the furthest-reaching scanner, or the usual one.
    """

    def pose(robot: int) -> Pose:
        sensed = sensors(robot)
        return Pose(sensed.psn, sensed.heading_rad)

    range_m = max((lidar.range_m for lidar in scene.scanners.values()), default=_USUAL_RANGE_M)
    chart = Chart(scene.world.grid, range_m)
    return Library(planners, pose, scene.clearance, chart, scene.seed, keep_rounds=keep_rounds)
