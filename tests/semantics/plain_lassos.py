"""The yardstick of liveness: lassos found by walking, with what each round does noted on the way.

States and rounds are those of the plain search, turn by turn in every order. A loop is looked for
from every state by itself: a walk that remembers which conditions of fairness were met, asked for
and granted so far, and comes home. No components, no merging of edges, nothing left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from koord.semantics.configurations import Configuration, Turn
from koord.semantics.domain import EXACT, Constant
from koord.semantics.liveness import Response, expected, locks_of, responses
from koord.semantics.rounds import run_event, run_skip
from koord.semantics.turns import guard_of
from koord.syntax import core
from koord.syntax.system import System
from tests.semantics.plain_search import PlainSearch, every_outcome

Events = tuple[int | None, ...]


@dataclass(frozen=True)
class Way:
    """A round: where it leads, and who runs what in it."""

    target: int
    events: Events


class PlainLassos(PlainSearch):
    """All states of a system, and whether properties are broken by a fair run."""

    def __init__(
        self, system: System, properties: tuple[core.Property, ...], *, limit: int
    ) -> None:
        super().__init__(system, (), limit=limit)
        self.tracks_ran = "Ran(" in repr((properties, system.program.expectations))
        self.states: list[Configuration[Constant]] = []
        self.ways: list[list[Way]] = []
        self.starts: list[int] = []
        self._numbers: dict[Configuration[Constant], int] = {}
        self._known: dict[int, tuple[core.Property, dict[int, bool]]] = {}
        self._known_able: dict[tuple[int, int], tuple[bool, frozenset[int]]] = {}
        self._expected = expected(system)
        for first in self._initial():
            self.starts.append(self._number(self._plain(first)))
        while len(self.ways) < len(self.states):
            start = self.states[len(self.ways)]
            found = {Way(self._number(c), events): None for c, events in self._whole_rounds(start)}
            self.ways.append(list(found))

    def _number(self, c: Configuration[Constant]) -> int:
        number = self._numbers.setdefault(c, len(self.states))
        if number == len(self.states):
            self.states.append(c)
        return number

    def _whole_rounds(
        self, start: Configuration[Constant]
    ) -> Iterator[tuple[Configuration[Constant], Events]]:
        nobody: Events = (None,) * self.system.robots
        reached, done = {(start, nobody)}, set()
        while reached:
            at = c, events = reached.pop()
            if at in done:
                continue
            done.add(at)
            if c.turn is Turn.ENV:
                yield from ((after, events) for after in self._environment(c))
                continue
            for robot, state in enumerate(c.robots):
                if state.turn is not Turn.PROG:
                    continue
                options: list[int | None] = [None]
                if state.status != 2:
                    options += range(len(self.system.agent(robot).events))
                for position in options:
                    step = (
                        partial(run_skip, EXACT, self.system, c, robot)
                        if position is None
                        else partial(run_event, EXACT, self.system, c, robot, position)
                    )
                    for stepped in every_outcome(step):
                        self._count()
                        if stepped.configuration.fault is None:
                            then = (*events[:robot], position, *events[robot + 1 :])
                            reached.add((stepped.configuration, then))

    # --- fairness -------------------------------------------------------------------------------

    def able(self, state: int, robot: int) -> tuple[bool, frozenset[int]]:
        """Whether a robot is ready, and which lock classes it asks for."""
        if (state, robot) not in self._known_able:
            self._known_able[state, robot] = self._able(state, robot)
        return self._known_able[state, robot]

    def _able(self, state: int, robot: int) -> tuple[bool, frozenset[int]]:
        c = self.states[state]
        if c.robots[robot].status == 2:
            return False, frozenset()
        ready, asked = False, None
        for event in self.system.agent(robot).events:
            asking = partial(guard_of, EXACT, self.system, robot, c.robots[robot], event)
            said = list(every_outcome(asking))
            ready = ready or all(holds is True for holds, _ in said)
            if any(holds is True or sound is not True for holds, sound in said):
                classes = event.lock_classes
                asked = classes if asked is None else asked & classes
        return ready, (asked or frozenset()) if ready else frozenset()

    def is_broken(self, stated: core.Property) -> bool:
        """Whether some fair run breaks a property."""
        return any(self._breaks(response) for response in responses(self.system, stated))

    def has_fair_run(self) -> bool:
        """Whether there is a fair run at all."""
        nodes = self._reached(self._begun())
        return any(self._loops(node, set(nodes)) for node in nodes)

    def _breaks(self, response: Response) -> bool:
        begun = self._begun()
        if response.trigger is None:
            starts = [n for n in begun if not self._is(response.goal, n[0])]
        else:
            starts = [
                n
                for n in self._reached(begun)
                if self._is(response.trigger, n[0]) and not self._is(response.goal, n[0])
            ]
        nodes = self._reached(starts, avoiding=response.goal)
        return any(self._loops(node, set(nodes)) for node in nodes)

    def _is(self, statement: core.Property, state: int) -> bool:
        _, known = self._known.setdefault(id(statement), (statement, {}))
        if state not in known:
            c = self.states[state]
            known[state] = self._holds(statement.condition, statement.bound, c)
        return known[state]

    def _owed(self, state: int, before: frozenset[int]) -> frozenset[int]:
        """Which expectations wait for their goal, at a state, if those did in the one before."""
        owed = set(before)
        for k, response in enumerate(self._expected):
            assert response.trigger is not None
            if self._is(response.trigger, state):
                owed.add(k)
            if self._is(response.goal, state):
                owed.discard(k)
        return frozenset(owed)

    def _begun(self) -> list[tuple[int, frozenset[int]]]:
        return list(dict.fromkeys((s, self._owed(s, frozenset())) for s in self.starts))

    def _reached(
        self, starts: list[tuple[int, frozenset[int]]], avoiding: core.Property | None = None
    ) -> list[tuple[int, frozenset[int]]]:
        found = dict.fromkeys(starts)
        queue = list(found)
        for state, owed in queue:
            for way in self.ways[state]:
                after = (way.target, self._owed(way.target, owed))
                if after in found or (avoiding and self._is(avoiding, way.target)):
                    continue
                found[after] = None
                queue.append(after)
        return queue

    def _loops(
        self, home: tuple[int, frozenset[int]], among: set[tuple[int, frozenset[int]]]
    ) -> bool:
        """Whether a fair walk leads from a node back to it."""
        every = {("robot", i) for i in range(self.system.robots)}
        every |= {("expected", k) for k in range(len(self._expected))}
        nothing = frozenset[tuple[str, int]]()
        begin = (home, nothing, frozenset[tuple[int, int]](), frozenset[tuple[int, int]]())
        found, queue = {begin}, [begin]
        for (state, owed), met, asked, granted in queue:
            self._count()
            here = set(met) | {c for c in every if c[0] == "expected" and c[1] not in owed}
            wants = set(asked)
            for i in range(self.system.robots):
                ready, classes = self.able(state, i)
                wants |= {(i, k) for k in classes}
                if not ready:
                    here.add(("robot", i))
            for way in self.ways[state]:
                after = (way.target, self._owed(way.target, owed))
                if after not in among:
                    continue
                ran = {i for i, position in enumerate(way.events) if position is not None}
                got = set(granted) | {
                    (i, k) for i, k in locks_of(self.system) if i in ran and k in self._of(way, i)
                }
                now = frozenset(here | {("robot", i) for i in ran})
                if after == home and now >= every and wants <= got:
                    return True
                step = (after, now, frozenset(wants), frozenset(got))
                if step not in found:
                    found.add(step)
                    queue.append(step)
        return False

    def _of(self, way: Way, robot: int) -> frozenset[int]:
        position = way.events[robot]
        assert position is not None
        return self.system.agent(robot).events[position].lock_classes
