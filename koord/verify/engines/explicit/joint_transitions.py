"""Joint transitions: the moves of all robots in one round. [T-ONE-WINNER] [T-COMMIT] [T-PREFIX]

Orders of robots are not tried: a joint course takes one course from each robot's menu such that no
lock class is entered twice, and tells how the store may end.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from msgspec import Struct

from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.walk import nodes
from koord.verify.engines.explicit.commits import NOTHING, Commits, StoreOutcome
from koord.verify.engines.explicit.robot_transitions import Endings, Menu, Menus, TransitionGroup
from koord.verify.engines.explicit.states import State, StateStore


class JointTransition(Struct, frozen=True):
    """A joint course: one course of each robot.

    ``writers`` are the robots that write, in the order to which the ends of the store refer.
    ``is_whole`` says whether it is the end of a legal round, ``is_inside`` whether it is also, or
    only, seen while some robots have not moved yet, and ``all_stop`` whether END-PROG then stops
    everybody.
    """

    courses: tuple[TransitionGroup, ...]
    writers: tuple[int, ...]
    ends: tuple[StoreOutcome, ...]
    is_whole: bool
    is_inside: bool
    all_stop: bool

    def stopped(self, robots: tuple[int, ...]) -> tuple[int, ...]:
        """The robots' numbers after END-PROG."""
        if not self.all_stop:
            return robots
        pairs = zip(self.courses, robots, strict=True)
        return tuple(course.after_stop(number) for course, number in pairs)

    @property
    def endings(self) -> list[Endings]:
        """The possible results of the environment's turn, for each robot."""
        return [c.stopped if self.all_stop else c.evolved for c in self.courses]

    def successors(self) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
        """Yield the robots' numbers after the round, with the numbers of the store's contents."""
        robots = list(product(*[ending.robots for ending in self.endings]))
        for end in self.ends:
            for numbers in robots:
                yield numbers, end.shared


def needs_relaxed(system: System, properties: tuple[core.Property, ...]) -> bool:
    """Return whether some configuration inside a round is not the end of one. [T-PREFIX]"""
    agents = [system.program.agents[kind] for kind in set(system.kinds)]
    if any(event.urgent for agent in agents for event in agent.events):
        return True
    asks = any(isinstance(node, core.TryStop) for agent in agents for node in nodes(agent.events))
    asks |= any(isinstance(node, core.TryStop) for agent in agents for node in nodes(agent.init))
    sees = any(isinstance(n, core.Stopped) for p in properties for n in nodes(p.condition))
    return asks and sees


class JointTransitions:
    """The joint courses of a system."""

    def __init__(
        self, system: System, vault: StateStore, menus: Menus, commits: Commits, *, relaxed: bool
    ) -> None:
        self._robots = system.robots
        self._vault = vault
        self._menus = menus
        self._commits = commits
        self._relaxed = relaxed

    def menus(self, state: State) -> list[Menu]:
        """Every robot's menu in a state."""
        return [self._menus.menu(robot, state) for robot in range(self._robots)]

    def joints(self, state: State, menus: list[Menu]) -> Iterator[JointTransition]:
        """Yield every joint course in a state."""
        shared = state[self._robots :]
        for courses, taken in self._combined([menu.courses for menu in menus]):
            writers = tuple(i for i, course in enumerate(courses) if course.write != NOTHING)
            ends = self._commits.ends(shared, tuple(courses[i].write for i in writers))
            all_stop = not any(course.running for course in courses)
            if not self._relaxed:
                yield JointTransition(courses, writers, ends, True, False, all_stop)
                continue
            is_whole = _is_whole(courses, taken, menus)
            is_inside = self._is_inside(courses, menus)
            if is_whole or is_inside:
                yield JointTransition(courses, writers, ends, is_whole, is_inside, all_stop)

    def lost(self, joint: JointTransition) -> frozenset[int]:
        """The variables of which an update is lost. [LOST-UPDATE]"""
        writes = [(i, joint.courses[i].write) for i in joint.writers]
        found: Iterator[frozenset[int]] = (
            self._commits.lost(a, b) for i, a in writes for j, b in writes if i != j
        )
        return frozenset().union(*found)

    def _combined(
        self, choices: list[tuple[TransitionGroup, ...]]
    ) -> Iterator[tuple[tuple[TransitionGroup, ...], int]]:
        """Yield combinations of courses with no lock class twice, and the classes taken.
        [ATOMIC]
        """
        partial: list[tuple[tuple[TransitionGroup, ...], int]] = [((), 0)]
        for courses in choices:
            partial = [
                ((*chosen, course), taken | course.entered)
                for chosen, taken in partial
                for course in courses
                if not taken & course.entered
            ]
        return iter(partial)

    def _is_inside(self, courses: tuple[TransitionGroup, ...], menus: list[Menu]) -> bool:
        """Return whether the result is observed before the last robot has moved."""
        if not any(course.skips for course in courses):
            return False
        if any(course.runs for course in courses):
            return True
        may_skip = any(not menu.obligations for menu in menus)
        return self._robots > 1 and may_skip


def _is_whole(courses: tuple[TransitionGroup, ...], taken: int, menus: list[Menu]) -> bool:
    """Return whether every robot that skips may do so once the others have run. [SKIP]"""
    return all(
        course.runs or all(classes & taken for classes in menu.obligations)
        for course, menu in zip(courses, menus, strict=True)
    )
