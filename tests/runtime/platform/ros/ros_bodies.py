"""Vehicles as nodes in processes of their own are: bodies that move, without koord.

Nodes of rospy and of rclpy move them, each in the Python that has its library.
"""

from __future__ import annotations

import math

PERIOD_S = 0.01
DEAD_MAN_S = 0.5


class Body:
    """A body in the plane."""

    def __init__(self) -> None:
        self.x = self.y = self.z = self.heading = self.speed = self.rate = 0.0

    def move(self, dt_s: float) -> None:
        self.heading += self.rate * dt_s
        self.x += self.speed * math.cos(self.heading) * dt_s
        self.y += self.speed * math.sin(self.heading) * dt_s


class Driven(Body):
    """It does what it is told, and stops by itself when it is told nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.silent_s = 0.0

    def drive(self, speed: float, rate: float) -> None:
        self.speed, self.rate, self.silent_s = speed, rate, 0.0

    def move(self, dt_s: float) -> None:
        self.silent_s += dt_s
        if self.silent_s > DEAD_MAN_S:
            self.speed = self.rate = 0.0
        super().move(dt_s)


class Follower(Body):
    """It goes straight to each place that is new, and has reached it once."""

    FASTEST_MPS = 0.5

    def __init__(self) -> None:
        super().__init__()
        self.aim: tuple[float, float, float] | None = None
        self.heard: tuple[float, float, float] | None = None

    def go(self, x: float, y: float, z: float) -> None:
        if (x, y, z) != self.heard:
            self.aim = self.heard = x, y, z

    def step(self, dt_s: float) -> bool:
        """Move on; True when it has just come to its place."""
        if self.aim is None:
            return False
        way = [to - at for to, at in zip(self.aim, (self.x, self.y, self.z), strict=True)]
        far_m = math.hypot(*way)
        if far_m <= 0.005:
            self.aim = None
            return True
        share = min(1.0, self.FASTEST_MPS * dt_s / far_m)
        if math.hypot(way[0], way[1]) > 1e-6:
            self.heading = math.atan2(way[1], way[0])
        self.x, self.y, self.z = (
            at + share * d for at, d in zip((self.x, self.y, self.z), way, strict=True)
        )
        return False
