"""The sensors of a fleet's robots, read at once: only what is another value than before is written.

It comes to the same as asking the host for the readings of each robot, and letting each take them.
Who listens to what robots read asks one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import repeat
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct

from koord.runtime.engine import Measured, Measurement
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.ports import DONE, PLACES, YAW, placed, port_name
from koord.runtime.robot import Robot
from koord.runtime.shapes import BOOL, FLOAT, Record, Shape, from_plain
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
    #: What each of them has been told, or is to be told: places, shape ``(k, 3)``, or Booleans; and
    #: who has not been told so yet.
    told: Floats | Bools
    is_late: Bools
    is_all: bool  #: these are all robots of the fleet, in order

    def rows(self, of_fleet: Any) -> Any:
        """Of an array with a row for each robot of the fleet, those of these robots."""
        return of_fleet if self.is_all else of_fleet[self.robots]


class WholeSensors(Struct, frozen=True):
    """What robots of one kind, which are all, have been told or are to be told.

    ``places`` are sensors of positions: the name, how many coordinates it has, what was told, and
    who has not been told so yet. ``reached`` are those of whether robots have arrived: the name,
    and what was told.
    """

    places: tuple[tuple[str, int, Floats | Bools, Bools], ...]
    reached: tuple[tuple[str, Floats | Bools], ...]


class Reader:
    """A reader of the sensors of all robots of a run, at the end of each round.

    The robots whose readings are more than where they are, and whether they have arrived, are
    asked one by one: those that scan, and those with modules that plug-ins serve. In the first
    round all are that have other sensors: what never changes is not looked at again.

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
        # Who hears radios is asked here, and else by who says what is served.
        asked = host.modules.keys() if read is None else set(host.told_more)
        alone = [
            robot in asked
            or (robot in host.scanners and _senses(host.classes[kind], "pscan"))
            or _senses(host.classes[kind], YAW)
            for robot, kind in enumerate(host.kinds)
        ]
        self._columns: list[_Column] = []
        #: Those of kinds that have no other sensors.
        self._whole: list[list[_Column]] = []
        for kind, program in enumerate(host.classes):
            of_kind = np.flatnonzero((kinds == kind) & present & ~np.array(alone))
            found = _columns(program, of_kind, len(kinds))
            if found is None:
                alone = [one or kind == of for one, of in zip(alone, host.kinds, strict=True)]
            else:
                self._columns += found
                ranging = host.ranging(int(of_kind[0])) if len(of_kind) else ()
                if len(found) + len(ranging) == len(program.SENSORS) and found:
                    self._whole.append(found)
        #: Sensors that say who is in range, and what each has said last.
        self._heard: dict[tuple[int, str], tuple[bool, ...] | None] = {
            (robot, name): None
            for robot in np.flatnonzero(present & ~np.array(alone)).tolist()
            for name in host.ranging(robot)
        }
        self._alone = np.flatnonzero(np.array(alone) & present).tolist()
        self._last: FleetSensors | None = None

    def read(self, robots: Sequence[Robot]) -> Measurement:
        """Let all robots take the environment's turn, without models. [ENV-TRANS]

        Where they are they are told when it is written.
        """
        sensed = self._host.sensed
        is_first, self._last = self._last is None, sensed
        pids = self._first(robots) if is_first else self._alone
        asked = [robots[pid] for pid in pids]
        readings = [self._read(robot) for robot in asked]
        for robot, of_robot in zip(asked, readings, strict=True):
            robot.evolve(of_robot)
        told = (*pids, *self._hear_radios(robots))
        if is_first:
            for column in self._columns:
                _take(column, robots)
        measured = []
        for column in self._columns:
            if column.width:
                measured.append(_see(column, column.rows(sensed.position)))
            else:
                measured += _hear(column, robots, column.rows(sensed.reached))
        return Measurement(tuple(measured), told, partial(self._write_places, robots))

    def _hear_radios(self, robots: Sequence[Robot]) -> list[int]:
        """Tell robots who is in range, where that has changed; return to whom."""
        told = []
        for (pid, name), last in self._heard.items():
            heard = self._host.heard_by(pid, name)
            if heard is not last:
                self._heard[pid, name] = heard
                robot, held = robots[pid], vars(robots[pid])
                value = from_plain(robot.PORTS[name], heard, robot.numAgents)
                if value != held[name]:
                    held[name] = value
                    told.append(pid)
        return told

    def whole(self) -> WholeSensors | None:
        """The sensors, if all of them are columns of all robots, which are of one kind."""
        if self._last is None or self._alone or self._heard:
            return None
        if not all(c.is_all for c in self._columns):
            return None
        places = tuple((c.name, c.width, c.told, c.is_late) for c in self._columns if c.width)
        reached = tuple((c.name, c.told) for c in self._columns if not c.width)
        return WholeSensors(places, reached)

    def pass_idle(
        self, reached: Bools, robots: Sequence[Robot], were: Sequence[Floats | Bools]
    ) -> Measurement:
        """Tell robots whether they have arrived; columns have seen what else there is.

        ``were`` is what had been told of that; where robots are they are told when it is written.
        """
        measured: list[Measured] = []
        for column, before in zip((c for c in self._columns if not c.width), were, strict=True):
            column.told[:] = before
            measured += _hear(column, robots, column.rows(reached))
        return Measurement(tuple(measured), (), partial(self._write_places, robots))

    def pass_sensed(self, sensed: FleetSensors) -> None:
        """Note what was sensed last."""
        self._last = sensed

    def _first(self, robots: Sequence[Robot]) -> list[int]:
        """The robots that are asked in the first round: those of which columns are not all."""
        present = range(len(robots)) if self._only is None else self._only
        known: set[int] = set()
        for columns in self._whole:
            if all([_take(column, robots) for column in columns]):
                known.update(columns[0].robots.tolist())
        return [pid for pid in present if pid not in known]

    def _write_places(self, robots: Sequence[Robot]) -> None:
        """Tell robots where they are, where that is another value than what they have."""
        for column in self._columns:
            if column.width:
                late = np.flatnonzero(column.is_late)
                _write(column, robots, column.robots[late], column.told[late])
                column.is_late[:] = False


def _take(column: _Column, robots: Sequence[Robot]) -> bool:
    """Take over what robots have, and return whether all have something."""
    values = [vars(robots[pid])[column.name] for pid in column.robots.tolist()]
    if None in values:
        return False
    if not values:
        return True
    if not column.width:
        column.told[:] = values
        return True
    places = np.array(values, np.float64).reshape(len(values), -1)
    column.told[:, : column.width] = places
    return not np.isnan(places).any()  # what is not set is none


def _see(column: _Column, places: Floats) -> Measured:
    """Note where robots are; one that is nowhere else keeps what it has, to the sign of a zero."""
    told, width = column.told, column.width
    differ = places != told
    moved: Bools = differ[:, 0]
    for axis in range(1, width):
        moved = moved | differ[:, axis]
    np.copyto(told, places, where=moved[:, None])
    np.logical_or(column.is_late, moved, out=column.is_late)
    return Measured(column.name, column.robots, told)


def _hear(column: _Column, robots: Sequence[Robot], reached: Bools) -> Iterator[Measured]:
    """Tell robots whether they have reached their goals, where that has changed."""
    differ = reached != column.told
    if not differ.any():
        return
    rows = reached[differ]
    changed = column.robots[differ]
    column.told[differ] = rows
    _write(column, robots, changed, rows)
    yield Measured(column.name, changed, rows)


def _write(column: _Column, robots: Sequence[Robot], pids: Ints, rows: Floats | Bools) -> None:
    name = column.name
    for pid, value in zip(pids.tolist(), column.convert(rows), strict=True):
        vars(robots[pid])[name] = value


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
        size = len(robots)
        told = np.zeros((size, 3)) if port in PLACES else np.zeros(size, np.bool_)
        late = np.zeros(size, np.bool_)
        found.append(_Column(name, robots, *known, told, late, size == count))
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


def placed_in(shape: Shape, positions: Floats, robots: int) -> Sequence[Any]:
    """What sensors of a shape say of each of some positions, ``(k, 3)``; there are so many robots.

    Raises ShapeError for shapes that no place has.
    """
    known = _place(shape)
    if known is not None:
        return [*known[1](positions)]
    points = map(tuple, positions.tolist())
    return [from_plain(shape, placed(shape, point), robots) for point in points]
