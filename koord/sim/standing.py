"""Detection of robots that stand still although they have a goal: who, since when, and why.

There are three ways to be stuck. A robot was told to go, and its vehicle cannot: that shows at
once. Or it is on its way and gets no further, because something blocks it: that shows after a
while. Or its program asks for ways again and again, and gets none that it may take: while others
move that may change, and so it counts once nobody has moved for a while.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import dist
from typing import Any

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.planning import Hindrance, Plight, hindrance
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.world_host import WAYS
from koord.runtime.ports import plain_name
from koord.runtime.robot import Forwarding, Host, Key, Robot, Status, Turn
from koord.sim.sensing import FleetSensors

#: A program that has not asked for so long does not ask any more.
_ASKS_S = 1.0

#: Who is on its way, and for so long has moved no further than that, is blocked.
BLOCKED_S, BLOCKED_M = 5.0, 0.05

#: Sums of squares of lengths that are so near to what counts may be either.
DOUBTFUL_M2 = 1e-9


class StandingRobot(Struct, frozen=True):
    """A robot that stands still, since when, and why."""

    robot: int
    since_s: float
    hindrance: Hindrance
    words: str


class Lingering(Struct, frozen=True):
    """Where robots that are on their way have been since when, but for a few centimetres.

    Of those that are not, there is no time. Both are written over.
    """

    at: Floats  #: shape ``(n, 3)``
    since_s: Floats


class Watchman:
    """A detector of robots that stand still. ``still_s`` is how long nobody has moved by now."""

    def __init__(self, world: World, bodies: Sequence[Body]) -> None:
        self.now_s = self.still_s = 0.0
        self.sees_some_go = False  #: whether somebody was on its way in the last round
        self._world, self._bodies = world, tuple(bodies)
        self._stuck: dict[int, StandingRobot] = {}
        self._wants: dict[int, dict[Point, tuple[float, float]]] = {}
        self._unclear: dict[int, tuple[float, float]] = {}
        count = len(bodies)
        self._lingering = Lingering(np.full((count, 3), np.nan), np.full(count, np.nan))

    def hear(self, host: Host) -> Host:
        """Wrap a host, so that its answers are observed."""
        return _Heard(host, self)

    def round(
        self,
        began_s: float,
        ended_s: float,
        sensed: FleetSensors,
        stopped: Bools,
        places: Floats,
        touched: Callable[[int], Sequence[tuple[Hindrance, int]]],
    ) -> Iterator[StandingRobot]:
        """Record the end of a round; yield the robots that stand still since then.

        ``stopped`` is a mask of the robots whose programs have stopped. ``places``, shape
        ``(n, 3)``, are where robots truly are, and ``touched`` is what a robot's vehicle touches.
        """
        self.now_s = ended_s
        if self._wants or self._unclear:
            moving = sensed.state == MotionState.MOVING
            for pid in [pid for pid in {*self._wants, *self._unclear} if moving[pid]]:
                self._wants.pop(pid, None)
                self._unclear.pop(pid, None)
        is_on_the_way = None
        if not (sensed.plights or self._stuck):
            is_on_the_way = self._is_on_the_way(sensed, stopped, places, began_s)
        if is_on_the_way is None:
            on_the_way = sensed.on_the_way > stopped
            blocked, plights = self._blocked(sensed, stopped, places, began_s)
            if plights:
                on_the_way[list(plights)] = False
            if plights or self._stuck or blocked.any():
                yield from self._noted(began_s, plights, blocked, touched)
                on_the_way = on_the_way > blocked
            is_on_the_way = bool(on_the_way.any())
        self.sees_some_go = is_on_the_way
        self.still_s = 0.0 if is_on_the_way else self.still_s + (ended_s - began_s)

    @property
    def is_calm(self) -> bool:
        """Whether nobody is stuck, nor waits for a way."""
        return not (self._stuck or self._wants or self._unclear)

    @property
    def lingering(self) -> Lingering:
        """Where robots linger. It is written over."""
        return self._lingering

    def pass_rounds(self, rounds: int, began_s: float, ended_s: float, *, some_go: bool) -> None:
        """Note rounds in which nobody was blocked, the last of which began and ended at these.

        Somebody went in all of them; in the last one if ``some_go``.
        """
        still_s = 0.0 if rounds > 1 else self.still_s
        self.still_s = 0.0 if some_go else still_s + (ended_s - began_s)
        self.now_s, self.sees_some_go = ended_s, some_go

    def standing(self, robots: Sequence[Robot], still_s: float) -> tuple[StandingRobot, ...]:
        """All robots that stand still by now; those that wait for paths only if all have for
        long.
        """
        found = dict(self._stuck)
        if self.still_s >= still_s - 1e-9:
            for pid, robot in enumerate(robots):
                if pid not in found and robot.status is not Status.STOPPED:
                    found |= {one.robot: one for one in self._waiting(pid)}
        return tuple(found[pid] for pid in sorted(found))

    def answered(self, robot: int, function: str, arguments: tuple[Any, ...], answer: Any) -> None:
        """Record an answer to a program."""
        name = plain_name(function)
        if name in WAYS:
            self._way(robot, _goal(name, arguments), is_found=len(answer) > 0)
        elif name == "pathsClear" and not answer:
            first = self._unclear.get(robot)
            self._unclear[robot] = (self.now_s if first is None else first[0], self.now_s)

    # --- inside ---------------------------------------------------------------------------------

    def _noted(
        self,
        began_s: float,
        plights: Mapping[int, Plight],
        blocked: Bools,
        touched: Callable[[int], Sequence[tuple[Hindrance, int]]],
    ) -> Iterator[StandingRobot]:
        """Note who is stuck now; yield those who were not before."""
        stuck = {*plights, *np.flatnonzero(blocked).tolist()}
        for pid in [pid for pid in self._stuck if pid not in stuck]:
            del self._stuck[pid]
        for pid in sorted(stuck):
            before = self._stuck.get(pid)
            if pid in plights:
                since_s = began_s if before is None else before.since_s
                stands = _standing(pid, since_s, plights[pid])
            else:
                since_s = float(self._lingering.since_s[pid])
                stands = before or _standing(pid, since_s, _no_headway(touched(pid)))
            self._stuck[pid] = stands
            if before is None:
                yield stands

    def _is_on_the_way(
        self, sensed: FleetSensors, stopped: Bools, places: Floats, began_s: float
    ) -> bool | None:
        """Note where robots linger if nobody can be blocked, and say whether some go or plan.

        None: somebody may be blocked, and nothing is noted.
        """
        return None

    def _blocked(
        self, sensed: FleetSensors, stopped: Bools, places: Floats, began_s: float
    ) -> tuple[Bools, dict[int, Plight]]:
        """A mask of the robots among those on their way that have made no progress for long.

        And the plights of those that have not stopped.
        """
        plights = {pid: one for pid, one in sensed.plights.items() if not stopped[pid]}
        # Of masks, ``a > b`` says: a and not b.
        moving: Bools = sensed.state == MotionState.MOVING
        going: Bools = (moving > stopped) > (sensed.short_m < BLOCKED_M)
        if plights:
            going[list(plights)] = False
        at, since_s = self._lingering.at, self._lingering.since_s
        before_s = {pid: since_s[pid] for pid in plights}
        fresh = going & (_are_apart(at, places) | np.isnan(since_s))
        blocked: Bools = (going & ~fresh) & (self.now_s - since_s >= BLOCKED_S - 1e-9)
        np.copyto(at, places, where=fresh[:, None])
        since_s[:] = np.where(going, np.where(fresh, began_s, since_s), np.nan)
        for pid, time_s in before_s.items():  # whose way is another matter
            since_s[pid] = time_s
        return blocked, plights

    def _way(self, robot: int, goal: Point, *, is_found: bool) -> None:
        wants = self._wants.setdefault(robot, {})
        if is_found:
            wants.pop(goal, None)
        else:
            wants[goal] = wants.get(goal, (self.now_s, 0.0))[0], self.now_s

    def _waiting(self, pid: int) -> Iterator[StandingRobot]:
        """Yield a robot that waits for a path: none is clear, or none is found."""
        unclear, recently = self._unclear.get(pid), self.now_s - _ASKS_S - 1e-9
        if unclear is not None and unclear[1] >= recently:
            yield _standing(pid, unclear[0], Plight(Hindrance.NOT_CLEAR))
            return
        asked = self._wants.get(pid, {})
        wants = {g: since for g, (since, last) in asked.items() if last >= recently}
        if not wants:
            return
        goal = min(wants, key=lambda g: (wants[g], g))
        why = hindrance(self._bodies[pid], self._world, goal) or Hindrance.NO_WAY
        more = f"; and so for {len(wants) - 1} more" if len(wants) > 1 else ""
        yield _standing(pid, wants[goal], Plight(why, goal), more)


class _Heard(Forwarding):
    """A host whose answers to programs are observed; those to claims alone are not."""

    def __init__(self, host: Host, watchman: Watchman) -> None:
        super().__init__(host)
        self.watchman = watchman

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        answer = self.host.ask(turn, robot, key, function, arguments)
        if key:
            self.watchman.answered(robot, function, arguments, answer)
        return answer


def _standing(pid: int, since_s: float, plight: Plight, more: str = "") -> StandingRobot:
    return StandingRobot(pid, since_s, plight.hindrance, plight.words + more)


def _are_apart(ones: Floats, others: Floats) -> Bools:
    """A mask of the places, shape ``(n, 3)``, that are further from others than counts as one."""
    gap = others - ones
    square = np.einsum("ij,ij->i", gap, gap)
    found: Bools = square > BLOCKED_M**2 + DOUBTFUL_M2
    # ``dist`` rounds once, and sums of squares several times.
    maybe = square > BLOCKED_M**2 - DOUBTFUL_M2
    if np.count_nonzero(found) != np.count_nonzero(maybe):
        for row in np.flatnonzero(maybe > found).tolist():
            found[row] = dist(ones[row].tolist(), others[row].tolist()) > BLOCKED_M
    return found


def _no_headway(touched: Sequence[tuple[Hindrance, int]]) -> Plight:
    """The reason for a lack of progress: the contacts of the robot, if it has any."""
    if not touched:
        return Plight(Hindrance.NO_HEADWAY)
    return Plight(touched[0][0], by=" and ".join(_called(*one) for one in touched))


def _called(what: Hindrance, number: int) -> str:
    match what:
        case Hindrance.ROBOT:
            return f"robot {number}"
        case Hindrance.OBSTACLE:
            return f"obstacle {number} of the world"
        case _:
            return "the edge of the world"


def _goal(name: str, arguments: tuple[Any, ...]) -> Point:
    """The goal of a path query: a position, or that of a task."""
    if name == "getPathFromTask":
        x, y, z = arguments[-1][0]
    else:
        x, y, z = arguments[1]
    return float(x), float(y), float(z)
