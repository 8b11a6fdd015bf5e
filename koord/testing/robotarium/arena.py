"""An arena with the interface of `rps.robotarium.Robotarium`: unicycles, without walls.

The bridge takes it with `--arena koord.testing.robotarium.arena:Arena`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

STEP_S, WHEEL_RADIUS_M, TRACK_M, WHEEL_RADPS = 0.033, 0.016, 0.105, 12.5


class Arena:
    """Robots that are moved a step at a time; poses have to be asked for once in between."""

    def __init__(
        self, number_of_robots: int, show_figure: bool, initial_conditions: Floats
    ) -> None:
        self.number_of_robots = number_of_robots
        self.poses = np.zeros((3, number_of_robots))
        self.poses[0] = np.linspace(-1, 1, number_of_robots)
        if initial_conditions.size:
            self.poses = initial_conditions.astype(float)
        self.velocities = np.zeros((2, number_of_robots))
        self.errors: list[str] = []  #: as the simulator counts them
        self._asked = False

    def get_poses(self) -> Floats:
        """x, y and heading of each robot."""
        assert not self._asked, "Can only call get_poses() once per call of step()."
        self._asked = True
        return self.poses.copy()

    def set_velocities(self, ids: npt.NDArray[np.int64], velocities: Floats) -> None:
        """Set speeds and yaw rates, until the next step."""
        assert velocities.shape == (2, self.number_of_robots)
        self.velocities[:, ids] = velocities

    def step(self) -> None:
        """Move by a step."""
        assert self._asked, "Make sure to call get_poses before calling step() again."
        self._asked = False
        speed, rate = self.velocities
        wheels = np.abs(speed) / WHEEL_RADIUS_M + TRACK_M / (2 * WHEEL_RADIUS_M) * np.abs(rate)
        if np.any(wheels > WHEEL_RADPS * (1 + 1e-9)):
            self.errors.append("exceeded_actuator_limits")
        x, y, heading = self.poses
        if np.any(np.abs(x) > 1.6) or np.any(np.abs(y) > 1.0):
            self.errors.append("robots_outside_boundaries")
        self.poses[0] = x + STEP_S * np.cos(heading) * speed
        self.poses[1] = y + STEP_S * np.sin(heading) * speed
        turned = heading + STEP_S * rate
        self.poses[2] = np.arctan2(np.sin(turned), np.cos(turned))
