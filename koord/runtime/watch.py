"""Monitors of robots: the base of the class that a program's claims compile to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from koord.runtime.operations import FaultError
from koord.runtime.robot import Host, Key, Robot, Status, Turn
from koord.runtime.shapes import Record, Scalar, Shape, from_plain
from koord.syntax.faults import FaultKind

#: Of a path, so many points are tried on a summary that speaks of all positions.
_SAMPLES = 3


class Watch(Robot):
    """A monitor of claims. Shared variables are its attributes; ``robots`` are the robots checked.

    In a contract its attributes are a robot's own as well, and ``after`` has what its ports hold
    after the environment's turn. ``points`` are tried where a summary speaks of all positions.
    """

    __slots__ = ("after", "points", "robots")

    def __init__(self, kinds: Sequence[int], delta: float, host: Host) -> None:
        super().__init__(0, kinds, delta, host)
        self.robots: Sequence[Robot] = ()
        self.after: Mapping[str, Any] = {}
        self.points: Sequence[Any] = ()

    def look(self, robots: Sequence[Any], shared: Mapping[str, Any]) -> None:
        """Set the robots to check, and the variables that they share."""
        self.robots = robots
        self.__dict__ = dict(shared)

    def look_at(self, pid: int, held: Mapping[str, Any], after: Mapping[str, Any]) -> None:
        """Set one robot to check between two rounds: what it held, and its ports after that."""
        self.pid = pid
        self.__dict__ = held if isinstance(held, dict) else dict(held)
        self.after = after

    def holds(self, method: str, *arguments: Any) -> bool:
        """Return whether a claim holds; one that faults does not. [PROP-FAULT]"""
        try:
            return bool(getattr(self, method)(*arguments))
        except FaultError:
            return False

    def meets(self, method: str, arguments: Sequence[Any], answer: Any) -> bool:
        """Return whether an answer of an external function meets its summary. [EXTERNAL]"""
        self._in_summary = True  # what functions require that it mentions is nobody's concern
        self.points = points_in([*arguments, answer])
        try:
            return self.holds(method, *arguments, answer)
        finally:
            self._in_summary = False

    # --- what claims ask --------------------------------------------------------------------------

    def held(self, robot: int, names: tuple[str | None, ...], place: str) -> Any:
        """The value of a robot's variable, by the name that its kind gives it. [PROP-READ]"""
        name = names[self.kinds[robot]] if 0 <= robot < self.numAgents else None
        if name is None:
            raise FaultError(FaultKind.INDEX, place, str(robot))
        return self.robots[robot].__dict__[name]

    def has_run(self, robot: int, events: tuple[tuple[int, int], ...]) -> bool:
        """Return whether a robot's last program turn ran one of some events. [PROP-RAN]"""
        if not 0 <= robot < self.numAgents:
            return False
        return (self.kinds[robot], self.robots[robot].ran) in events

    def has_stopped(self, robot: int) -> bool:
        """Return whether a robot has stopped. [PROP-STOPPED]"""
        return 0 <= robot < self.numAgents and self.robots[robot].status is Status.STOPPED

    def samples(self, shape: Shape) -> Sequence[Any]:
        """Sample values of a shape, for summaries that quantify over all of them: points only."""
        if isinstance(shape, Record) and len(shape.fields) == 3:
            return [shape.make(*point) for point in self.points]
        return ()

    def ask(self, function: str, key: Key, *arguments: Any) -> Any:
        """Ask the library; checks of claims are no turn, so no answers are recorded. [EXTERNAL]"""
        shape = self.EXTERNALS[function]
        answer = self.host.ask(Turn.ENV, self.pid, key, function, arguments)
        return answer if isinstance(shape, Scalar) else from_plain(shape, answer, self.numAgents)


def points_in(values: Sequence[Any]) -> list[Any]:
    """Sample points in some values, and points halfway along the paths in them."""
    found: list[Any] = []
    for value in values:
        if _is_point(value):
            found.append(value)
        elif isinstance(value, tuple) and value and all(map(_is_point, value)):
            found += _some(value)
            halfway = [
                tuple((x + y) / 2 for x, y in zip(a, b, strict=True)) for a, b in pairwise(value)
            ]
            found += _some(halfway)
    return found


def _some(points: Sequence[Any]) -> list[Any]:
    """The first, the last and some elements between."""
    if len(points) <= _SAMPLES:
        return list(points)
    return [points[round(k * (len(points) - 1) / (_SAMPLES - 1))] for k in range(_SAMPLES)]


def _is_point(value: Any) -> bool:
    return isinstance(value, tuple) and [type(part) for part in value] == [float] * 3
