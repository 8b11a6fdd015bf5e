"""The meaning of ports and functions of compiled programs to the world that they run in.

Which port is which is told by its name, as in the library of the language: ``psn`` and ``reached``
(or ``position`` and ``done``) are what a motion module senses, :data:`GOALS` where it is sent, and
:data:`TAKEOFF` whether it is to fly.
"""

from __future__ import annotations

import re
from typing import Any

from koord.runtime.motion.world import Point
from koord.runtime.robot import Robot
from koord.runtime.shapes import (
    BOOL,
    PerRobot,
    Record,
    Scalar,
    ScalarKind,
    Sequence,
    Shape,
    default,
    element_of,
)

#: Actuators that send a robot somewhere.
GOALS = ("path", "route", "target", "waypoint", "goal")

#: The actuator by which an aircraft takes off, and lands when it is false again.
TAKEOFF = "takeoff"

PLACES = ("psn", "position")  #: sensors of a robot's position
DONE = ("reached", "done")  #: sensors of whether it has arrived

YAW = "yaw"  #: the sensor of where it points, in radians from the x axis to the y axis

IN_RANGE = "inRange"  #: the sensor of which robots a robot hears, a truth value for each

#: The sensors that vehicles have, by the ends of their names.
SENSED = frozenset({*PLACES, *DONE, YAW, "planner", "pscan"})

#: Those that simulated robots have.
SIMULATED = SENSED | {IN_RANGE}


def port_name(name: str) -> str:
    """Strip the name of its module from a port's."""
    return name.rpartition("_")[2]


def is_place(name: str) -> bool:
    """Return whether a port senses the robot's position."""
    return port_name(name) in PLACES


def is_in_range(name: str, shape: Shape) -> bool:
    """Return whether a sensor says of every robot whether it is in range. [ENV-RANGE]"""
    return port_name(name) == IN_RANGE and shape in (PerRobot(BOOL), Sequence(BOOL))


def plain_name(function: str) -> str:
    """The name of a function in the text: later ones of several with one name are numbered."""
    return re.sub(r"_\d+$", "", function)


def shape_of(program: type[Robot], name: str, *, shared: bool) -> Shape:
    """The shape of a variable; of an allread one, that of the robot's own entry if not shared."""
    known = None if shared else program.LOCALS.get(name) or program.PORTS.get(name)
    if known is not None:
        return known
    (shape,) = [v.shape for v in program.SHARED.variables if v.name == name]
    return shape if shared else element_of(shape)


def is_set(place: Any) -> bool:
    """Return whether a position has been given, with all its coordinates."""
    return place is not None and not (isinstance(place, tuple) and None in place)


def placed(shape: Shape, point: Point) -> Any:
    """Convert a position to the program's form: a record of two or three floats, or one float."""
    if isinstance(shape, Scalar):
        return point[0]
    assert isinstance(shape, Record)
    return point[: len(shape.fields)]


def point_of(place: Any) -> Point:
    """Convert a position in any form to three coordinates, in metres."""
    if isinstance(place, int | float):
        return float(place), 0.0, 0.0
    x, y, *z = place
    return float(x), float(y), float(z[0]) if z else 0.0


def is_task(shape: Shape) -> bool:
    """Return whether a shape is a task: a record that begins with a position."""
    return isinstance(shape, Record) and bool(shape.fields) and isinstance(shape.fields[0], Record)


def task_at(shape: Shape, place: Point | None, robots: int) -> Any:
    """The start of a task at a place, which is nobody's yet."""
    assert isinstance(shape, Record)
    values = list(default(shape, robots))
    for k, part in enumerate(shape.fields):
        if isinstance(part, Scalar) and part.kind is ScalarKind.INT:
            values[k] = -1
    if place is not None:
        values[0] = placed(shape.fields[0], point_of(place))
    return tuple(values)
