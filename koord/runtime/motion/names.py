"""The names of path planners, known without any of them. (paper, III-D and VI-C)"""

from __future__ import annotations

from enum import Enum


class PlannerName(Enum):
    """What a configuration may say behind ``planner:``."""

    STRAIGHT = "STRAIGHT"
    RRT_CAR = "RRT_CAR"
    RRT_STAR_CAR = "RRT_STAR_CAR"
    RRT_DRONE = "RRT_DRONE"
    RRT_STAR_DRONE = "RRT_STAR_DRONE"

    @property
    def optimal(self) -> bool:
        return self in (PlannerName.RRT_STAR_CAR, PlannerName.RRT_STAR_DRONE)
