"""What ports and functions of compiled programs mean to the world that they run in.

Which port is which is told by its name, as in the library of the language: ``psn`` and ``reached``
(or ``position`` and ``done``) are what a motion module senses, :data:`GOALS` where it is sent.
"""

from __future__ import annotations

import re
from typing import Any

from koord.runtime.motion.world import Point
from koord.runtime.robot import Robot
from koord.runtime.shapes import Record, Scalar, Shape, element_of

#: Actuators that send a robot somewhere.
GOALS = ("path", "route", "target", "waypoint", "goal")

PLACES = ("psn", "position")  #: sensors that say where a robot is
DONE = ("reached", "done")  #: sensors that say whether it is there


def port_name(name: str) -> str:
    """The name of a port without that of its module."""
    return name.rpartition("_")[2]


def is_place(name: str) -> bool:
    """Whether a port says where the robot is."""
    return port_name(name) in PLACES


def plain_name(function: str) -> str:
    """The name of a function in the text: of functions with one name all but the first count."""
    return re.sub(r"_\d+$", "", function)


def shape_of(program: type[Robot], name: str, *, shared: bool) -> Shape:
    """The shape of a variable; of an allread one, that of the robot's own entry if not shared."""
    known = None if shared else program.LOCALS.get(name) or program.PORTS.get(name)
    if known is not None:
        return known
    (shape,) = [v.shape for v in program.SHARED.variables if v.name == name]
    return shape if shared else element_of(shape)


def is_set(place: Any) -> bool:
    """Whether a place has been given, with all its coordinates."""
    return place is not None and not (isinstance(place, tuple) and any(c is None for c in place))


def placed(shape: Shape, point: Point) -> Any:
    """A place as a program has it: a record of two or three coordinates, or one number."""
    if isinstance(shape, Scalar):
        return point[0]
    assert isinstance(shape, Record)
    return point[: len(shape.fields)]


def point_of(place: Any) -> Point:
    """Any of the forms of a place as three coordinates."""
    if isinstance(place, int | float):
        return float(place), 0.0, 0.0
    x, y, *z = place
    return float(x), float(y), float(z[0]) if z else 0.0
