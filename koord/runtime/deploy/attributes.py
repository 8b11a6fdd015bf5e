"""What is a robot's own, as plain values: for its journal, and for who watches it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from koord.runtime.deploy.journal import Attributes
from koord.runtime.robot import Robot
from koord.runtime.shapes import Shape, to_plain


def own_shapes(robot: Robot) -> Mapping[str, Shape]:
    """The shapes of a robot's variables and ports, by name."""
    return robot._own


def own_values(robot: Robot, state: Mapping[str, Any]) -> Attributes:
    """The values of these in a state of the robot, in their order."""
    return tuple([to_plain(shape, state[name]) for name, shape in robot._own.items()])
