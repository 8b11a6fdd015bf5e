"""The sensors of a fleet's robots, read at once: only what is another value than before is written.

It comes to the same as asking the host for the readings of each robot, and letting each take them.
Who listens to what robots read asks one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import repeat
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct

from koord.runtime.engine import Measured, Measurement
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.ports import DONE, PLACES, YAW, port_name
from koord.runtime.robot import Robot
from koord.runtime.shapes import BOOL, FLOAT, Record, Shape
from koord.sim.hosting import Hosted
from koord.sim.sensing import FleetSensors

#: What makes values of rows of a column: positions, shape ``(k, 3)``, or Booleans.
_Convert: TypeAlias = Callable[[Any], Iterable[Any]]


class _Column(Struct, frozen=True):
    """A sensor of robots of one kind, and how many coordinates it has; of ``reached``, none."""

    name: str
    robots: Ints
    width: int
    convert: _Convert
    #: Of all robots of the fleet, where it is, and whether it has not been told so yet; of
    #: ``reached``, of nobody.
    places: Floats
    is_late: Bools


class Reader:
    """A reader of the sensors of all robots of a run, at the end of each round.

    The robots whose readings are more than where they are, and whether they have arrived, are
    asked one by one: those that scan, and those with modules that plug-ins serve. In the first
    round all are: what never changes is not looked at again.

    ``read`` is asked instead of the host, if it is given, and ``only`` are the robots whose sensors
    are read.
    """

    def __init__(
        self,
        host: Hosted,
        read: Callable[[Robot], Mapping[str, Any]] | None = None,
        only: Sequence[int] | None = None,
    ) -> None:
        self._host, self._only = host, only
        self._read = host.read if read is None else read
        present = np.full(len(host.kinds), only is None)
        present[[] if only is None else list(only)] = True
        kinds = np.array(host.kinds)
        alone = [
            robot in host.modules
            or (robot in host.scanners and _senses(host.classes[kind], "pscan"))
            or _senses(host.classes[kind], YAW)
            for robot, kind in enumerate(host.kinds)
        ]
        self._columns: list[_Column] = []
        for kind, program in enumerate(host.classes):
            of_kind = np.flatnonzero((kinds == kind) & present & ~np.array(alone))
            found = _columns(program, of_kind, len(kinds))
            if found is None:
                alone = [one or kind == of for one, of in zip(alone, host.kinds, strict=True)]
            else:
                self._columns += found
        self._alone = np.flatnonzero(np.array(alone) & present).tolist()
        self._last: FleetSensors | None = None

    def read(self, robots: Sequence[Robot]) -> Measurement:
        """Let all robots take the environment's turn, without models. [ENV-TRANS]

        Where they are they are told when it is written.
        """
        sensed, last = self._host.sensed, self._last
        if last is not None:
            asked: Sequence[Robot] = [robots[pid] for pid in self._alone]
        else:
            asked = robots if self._only is None else [robots[pid] for pid in self._only]
        readings = [self._read(robot) for robot in asked]
        for robot, of_robot in zip(asked, readings, strict=True):
            robot.evolve(of_robot)
        self._last = sensed
        told = tuple(robot.pid for robot in asked)
        if last is None:
            return Measurement((), told, _written)
        moved = sensed.position != last.position
        arrived = sensed.reached != last.reached
        # Robots that differ in so many of their first coordinates.
        differ = {0: arrived, 1: moved[:, 0], 2: moved[:, 0] | moved[:, 1]}
        differ[3] = differ[2] | moved[:, 2]
        measured = []
        for column in self._columns:
            changed = column.robots[differ[column.width][column.robots]]
            source = sensed.position if column.width else sensed.reached
            rows = source[changed]
            if column.width:
                column.places[changed], column.is_late[changed] = rows, True
            else:
                _write(column, robots, changed, rows)
            measured.append(Measured(column.name, changed, rows))
        return Measurement(tuple(measured), told, partial(self._write_places, robots))

    def _write_places(self, robots: Sequence[Robot]) -> None:
        """Tell robots where they are, where that is another value than what they have."""
        for column in self._columns:
            if column.width:
                late = np.flatnonzero(column.is_late)
                _write(column, robots, late, column.places[late])
                column.is_late[:] = False


def _write(column: _Column, robots: Sequence[Robot], pids: Ints, rows: Floats | Bools) -> None:
    name = column.name
    for pid, value in zip(pids.tolist(), column.convert(rows), strict=True):
        vars(robots[pid])[name] = value


def _written() -> None:
    """Robots have everything."""


def _senses(program: type[Robot], port: str) -> bool:
    return any(port_name(name) == port for name in program.SENSORS)


def _columns(program: type[Robot], robots: Ints, count: int) -> list[_Column] | None:
    """The sensors of a program whose values change; None if some have shapes of their own."""
    found = []
    for name in program.SENSORS:
        shape, port = program.PORTS[name], port_name(name)
        if port in PLACES:
            known = _place(shape)
        elif port in DONE:
            known = (0, np.ndarray.tolist) if shape == BOOL else None
        else:
            continue
        if known is None:
            return None
        kept = count * (port in PLACES)
        found.append(_Column(name, robots, *known, np.zeros((kept, 3)), np.zeros(kept, np.bool_)))
    return found


def _place(shape: Shape) -> tuple[int, _Convert] | None:
    """How many coordinates a position of a shape has, and what makes one; None for odd ones."""
    if shape == FLOAT:
        return 1, lambda rows: rows[:, 0].tolist()
    types = shape.types if isinstance(shape, Record) else None
    if not isinstance(shape, Record) or types is None or types != (float,) * len(types[:3]):
        return None
    make, width = shape.make, len(types)
    return width, lambda rows: map(tuple.__new__, repeat(make), rows[:, :width].tolist())
