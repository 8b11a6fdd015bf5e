"""Groups of robots of one kind: their orders, routes and motion automata.

Orders come in one robot at a time; :meth:`Group.plan` finds ways to targets, :meth:`Group.update`
steps the automata. What the robots' actuators are to do then is the business of a law of motion
(:mod:`.driving`, :mod:`.flying`), which moves ``s`` along the routes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import index

import numpy as np
from msgspec import Struct

from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.automaton import ROUNDING_S, MotionState, Orders, Visit
from koord.runtime.motion.bodies import Body, Pace
from koord.runtime.motion.field import field
from koord.runtime.motion.geometry import as_path
from koord.runtime.motion.planning import (
    CLOSE,
    Hindrance,
    LateSeed,
    Planner,
    Plight,
    Pose,
    Room,
    all_suit,
    hindrance,
    suits,
)
from koord.runtime.motion.routes import Routes
from koord.runtime.motion.workers import Job, Workers
from koord.runtime.motion.world import Point, World
from koord.runtime.plugins.calls import PlugInError

#: A tick of control, of simulated robots and of deployed ones.
TICK_S = 0.05

#: The height above the ground to which aircraft rise if nobody says another.
TAKEOFF_M = 1.0

#: A path that begins so near to a robot begins where it is.
_BESIDE_M = 0.1


class _Asked(Struct, frozen=True):
    """A plan that was asked for, and when it is followed."""

    job: Job
    due_s: float


class Group:
    """Motion automata of ``count`` robots with one body, one planner and one world."""

    def __init__(
        self,
        count: int,
        body: Body,
        world: World,
        planner: Planner,
        visit: Visit,
        seeds: Sequence[int] | None = None,
        room: Room = CLOSE,
        takes_s: float = 0.0,
        workers: Workers | None = None,
        routes: Callable[[int, Pace], Routes] = Routes,
    ) -> None:
        """Make a group; ``seeds`` are the planners', one for each robot.

        ``room`` is what ways keep from walls and obstacles besides what the body needs, ``takes_s``
        the time that passes from asking a planner for a way until the way is there. ``workers``
        plan meanwhile. ``routes`` makes routes for so many robots of a pace.
        """
        self.body, self.world, self.planner, self.visit = body, world, planner, visit
        self.count = count
        self.automata = automaton.initial(count)
        self.routes = routes(count, body.pace)
        self.s: Floats = np.zeros(count)  #: how far along its route each robot is
        self.speed: Floats = np.zeros(count)  #: at which it is to move along it
        self.targets: dict[int, Point] = {}  #: for which there is no path yet
        self.plights: dict[int, Plight] = {}  #: of robots that cannot do what they were told last
        self._beside_m = 1e-9 if body.IS_EXACT else _BESIDE_M
        self._told: Bools = np.zeros((len(Orders.__struct_fields__), count), np.bool_)
        self._orders = Orders(*self._told)  # its masks are the rows
        self._field = field(world, flat=body.ON_GROUND)
        self._reach_m = max(body.radius_m, room.wide_m)
        self._seeds: Sequence[int] = [0] * count if seeds is None else seeds
        self._plans = np.zeros(count, np.int64)
        self._takes_s = takes_s
        self._asked: dict[int, _Asked] = {}  #: of robots that have targets
        self._workers = Workers() if workers is None else workers
        self._planner_number = self._workers.know(planner)

    def reseed(self, seeds: Sequence[int]) -> None:
        """Let plans that are asked for from now on hang on other seeds, one for each robot."""
        self._seeds = seeds

    # --- orders ---------------------------------------------------------------------------------

    def follow(
        self,
        robot: int,
        path: Floats,
        heading_rad: float = 0.0,
        psn: Floats | None = None,
    ) -> None:
        """Let a robot follow a path, shape ``(k, 3)``, in metres.

        One without points leaves the robot where it is, and it never reaches its end. From ``psn``
        a robot goes to the path's start first.
        """
        if self.state(robot) is MotionState.STOPPED:
            return
        self.targets.pop(robot, None)
        self._give_up(robot)
        self.plights.pop(robot, None)
        if not len(path):
            self.plights[robot] = Plight(Hindrance.NO_POINTS)
            self._orders.failed[robot], self._orders.routed[robot] = True, False
            return
        if psn is not None and np.linalg.norm(psn - path[0]) > self._beside_m:
            path = np.concatenate([psn[None], path])
        moves = self.speed[robot] > 0
        velocity = self._velocity(np.array([robot]))[0] if moves else None
        self.routes.put(robot, path, heading_rad)
        self.s[robot] = 0.0
        along = 0.0 if velocity is None else float(velocity @ self.routes.tangent[robot, 0])
        self.speed[robot] = max(0.0, along)
        self._orders.routed[robot], self._orders.failed[robot] = True, False
        self._orders.asked[robot] = False

    def go_to(self, robot: int, target: Point) -> None:
        """Set a target: a path to it is planned and followed.

        A plan for another target is given up; one for the same goes on.
        """
        if self.automata.state.item(robot) == MotionState.STOPPED:
            return
        if robot in self._asked and self._asked[robot].job.goal != target:
            self._give_up(robot)
        self.targets[robot] = target
        self.plights.pop(robot, None)
        self._orders.asked[robot], self._orders.routed[robot] = True, False
        self._orders.failed[robot] = False

    def go_to_all(self, targets: Mapping[int, Point]) -> None:
        """Set targets of some robots, as :meth:`go_to` does of one."""
        rows = np.fromiter(targets, np.int64, len(targets))
        if self._asked or self.plights or (self.automata.state == MotionState.STOPPED).any():
            for robot, target in targets.items():
                self.go_to(robot, target)
            return
        self.targets.update(targets)
        self._orders.asked[rows], self._orders.routed[rows] = True, False
        self._orders.failed[rows] = False

    def hold(self, robot: int) -> None:
        """Stay in place until released."""
        self._orders.held[robot], self._orders.released[robot] = True, False

    def release(self, robot: int) -> None:
        """Resume what was interrupted by holding."""
        self._orders.released[robot], self._orders.held[robot] = True, False

    def stop(self, robot: int) -> None:
        """Stop for good."""
        self._orders.stopped[robot] = True

    # --- steps ----------------------------------------------------------------------------------

    def plan(self, psn: Floats, heading_rad: Floats, now_s: float = 0.0) -> None:
        """Plan paths to the targets from the robots' positions.

        They are straight where a body that can move in any direction meets no obstacle, and there
        at once. Else the planner is asked, and its paths are there when planning has taken its
        time; what they are made of is that of the time of asking.
        """
        if not self.targets:
            return
        robots = np.array(sorted(self.targets.keys() - self._asked.keys()), np.int64)
        if self.body.turning_m == 0 and len(robots):
            robots = self._plan_straight(robots, psn)
        for robot in robots.tolist():
            self._ask(robot, psn, float(heading_rad[robot]), now_s)
        late_s = now_s + ROUNDING_S
        for robot in sorted(k for k, asked in self._asked.items() if asked.due_s <= late_s):
            self._answer(robot, psn)

    def update(self, psn: Floats, now_s: float) -> None:
        """Step the automata on orders and measured positions, shape ``(count, 3)``."""
        end = self.routes.end
        self.automata = automaton.step(self.automata, self._orders, psn, end, now_s, self.visit)
        self._told[:] = False

    @property
    def orders(self) -> Bools:
        """The orders since the automata were stepped: a row for each field of :class:`Orders`."""
        return self._told

    def replan(self, robots: Sequence[int]) -> None:
        """Find new ways to the ends of routes, for robots that have missed them."""
        for robot in robots:
            x, y, z = self.routes.end[robot].tolist()
            self.go_to(robot, (x, y, z))

    def state(self, robot: int) -> MotionState:
        return MotionState(int(self.automata.state[robot]))

    def path(self, robot: int) -> Floats:
        """The path that a robot follows, shape ``(k, 3)``; a copy."""
        return self.routes.points[robot, : self.routes.size[robot] + 1].copy()

    def paths(self, robots: Ints) -> list[Floats]:
        """The paths that some robots follow, as :meth:`path` has each."""
        sizes = self.routes.size[robots]
        if not len(robots) or (sizes != sizes[0]).any():
            return [self.path(robot) for robot in robots.tolist()]
        return [*self.routes.points[robots, : sizes[0] + 1]]

    # --- inside ---------------------------------------------------------------------------------

    def _velocity(self, robots: Ints) -> Floats:
        k = self.routes.segment(robots, self.s[robots])
        velocity: Floats = self.speed[robots, None] * self.routes.tangent[robots, k]
        return velocity

    def _plan_straight(self, robots: Ints, psn: Floats) -> Ints:
        """Plan straight paths where they are free; return the robots that need a planner."""
        goals = np.array([self.targets[robot] for robot in robots.tolist()], np.float64)
        fits = all_suit(self.body, self.world, goals)
        free = fits & self._field.segments_free(psn[robots], goals, self._reach_m)
        gone = robots[free]
        velocity = self._velocity(gone)
        self.routes.put_straight(gone, psn[gone], goals[free])
        self.s[gone] = 0.0
        along = np.einsum("ki,ki->k", velocity, self.routes.tangent[gone, 0])
        self.speed[gone] = np.maximum(along, 0.0)
        self._orders.routed[gone] = True
        for robot in gone.tolist():
            del self.targets[robot]
        return robots[~free]

    def _ask(self, robot: int, psn: Floats, heading_rad: float, now_s: float) -> None:
        x, y, z = psn[robot].tolist()
        seed = self._next_seed(robot)
        start = Pose((x, y, z), heading_rad)
        job = self._workers.ask(self._planner_number, start, self.targets[robot], seed)
        self._asked[robot] = _Asked(job, now_s + self._takes_s)

    def way(self, robot: int, start: Point, target: Point) -> Floats | None:
        """Find a way from a place, for a body that can move in every direction, or None.

        It is the straight one where that is free, as for a target.
        """
        straight = as_path([start, target])
        if suits(self.body, self.world, target) and self._field.path_free(straight, self._reach_m):
            return straight
        return self.planner.plan(Pose(start, 0.0), target, index(self._next_seed(robot)))

    def fail(self, robot: int, target: Point) -> None:
        """Note that a robot has no way to a target."""
        self._orders.failed[robot] = True
        why = hindrance(self.body, self.world, target) or Hindrance.NO_WAY
        self.plights[robot] = Plight(why, target)

    def _next_seed(self, robot: int) -> LateSeed:
        """The seed of a robot's next plan."""
        self._plans[robot] += 1
        return LateSeed(self._seeds, robot, int(self._plans[robot]))

    def _give_up(self, robot: int) -> None:
        """Follow no plan that was asked for."""
        if robot in self._asked:
            self._workers.forget(self._asked.pop(robot).job)

    def _answer(self, robot: int, psn: Floats) -> None:
        """Let a robot follow the path that was planned for it, if there is one."""
        job = self._asked.pop(robot).job
        target = self.targets.pop(robot)
        try:
            path = self._workers.answer(job)
        except PlugInError as error:
            error.row = robot
            raise
        if path is None:
            self.fail(robot, target)
            return
        # Who moved on meanwhile goes to where its way begins. A car has its way beside it: it stops
        # along the line that it was on.
        here = psn[robot] if self.body.turning_m == 0 and self._takes_s > 0 else None
        self.follow(robot, path, job.start.heading_rad, here)
