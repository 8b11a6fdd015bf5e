"""Recordings of the runs that an explicit search has found. [RECORDING]

The search remembers, for each state, one state before it, and of both only representatives. To
write a run down, it is run again from INIT on: in each round, the successor is looked for that has
the right representative.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import product

from msgspec.structs import replace

from koord.semantics.recordings import Answer, Recording, Round
from koord.syntax.system import System
from koord.verify.engines.explicit.commits import Commits, StoreOutcome
from koord.verify.engines.explicit.initial_states import InitialState, openings
from koord.verify.engines.explicit.joint_transitions import JointTransition, JointTransitions
from koord.verify.engines.explicit.property_checks import Check, GoalKind, SearchGoal
from koord.verify.engines.explicit.robot_transitions import (
    EnvironmentOutcome,
    FaultingEvent,
    RobotTransition,
)
from koord.verify.engines.explicit.states import State, StateStore

Representative = Callable[[tuple[int, ...], tuple[int, ...]], State]

#: What one robot does in a round, and what the environment then makes of it.
Doing = tuple[RobotTransition, EnvironmentOutcome | None]


class Tracer:
    """A reconstruction of runs from the search's predecessor states."""

    def __init__(
        self,
        system: System,
        vault: StateStore,
        commits: Commits,
        joints: JointTransitions,
        representative: Representative,
    ) -> None:
        self._system = system
        self._vault = vault
        self._commits = commits
        self._joints = joints
        self._representative = representative

    def at_init(self, state: State) -> Recording:
        """INIT that faults and ends in such a state."""
        return Recording(self._opened(state, is_faulted=True).opening())

    def run(
        self, path: Iterable[State], last: Callable[[State], Iterator[Round]] | None = None
    ) -> Recording:
        """The run along the representatives of a path; ``last`` adds a round after it."""
        first, *others = path
        opened = self._opened(first, is_faulted=False)
        recording, state = Recording(opened.opening()), opened.state
        for target in others:
            round_, state = next(self._rounds_to(state, target))
            recording = replace(recording, rounds=(*recording.rounds, round_))
        if last is not None:
            recording = replace(recording, rounds=(*recording.rounds, next(last(state))))
        return recording

    def _opened(self, first: State, *, is_faulted: bool) -> InitialState:
        for opened in openings(self._system, self._vault, self._commits):
            if opened.is_faulted is is_faulted and self._is(opened.state, first):
                return opened
        raise AssertionError("the search has seen a start that there is not")

    def _is(self, state: State, representative: State) -> bool:
        count = self._system.robots
        return self._representative(state[:count], state[count:]) == representative

    # --- rounds ---------------------------------------------------------------------------------

    def rounds(self, state: State) -> Iterator[tuple[Round, State]]:
        """Yield every round from a state, with the state after it."""
        return self._rounds_to(state, None)

    def _rounds_to(self, state: State, target: State | None) -> Iterator[tuple[Round, State]]:
        """Yield the rounds from a state to those that a representative stands for; None: to all."""
        for joint in self._joints.joints(state, self._joints.menus(state)):
            if not joint.is_whole:
                continue
            choices = [list(_doings(joint, i)) for i in range(self._system.robots)]
            for doings in product(*choices):
                robots = tuple(o.robot for _, o in doings if o is not None)
                for end in joint.ends:
                    after = (*robots, *end.shared)
                    if target is None or self._is(after, target):
                        yield self._whole(joint, end, doings), after

    def _whole(self, joint: JointTransition, end: StoreOutcome, doings: tuple[Doing, ...]) -> Round:
        """A whole round: robots that run first, then the environment."""
        order = self._order(joint, end, doings)
        skipping = [i for i in range(self._system.robots) if i not in order]
        readings = tuple(
            replace(reading, robot=i)
            for i, (_, outcome) in enumerate(doings)
            if outcome is not None
            for reading in outcome.readings
        )
        answers = self._answers(doings, range(self._system.robots))
        events = tuple(entry.event for entry, _ in doings)
        return Round((*order, *skipping), events, readings, answers)

    def _order(
        self, joint: JointTransition, end: StoreOutcome, doings: tuple[Doing, ...]
    ) -> tuple[int, ...]:
        """The robots that run, with the writers among them in the order of their writes."""
        writers = [joint.writers[position] for position in end.order]
        running = [i for i, (entry, _) in enumerate(doings) if entry.event is not None]
        return (*writers, *(i for i in running if i not in writers))

    def _answers(self, doings: tuple[Doing, ...], robots: Iterable[int]) -> tuple[Answer, ...]:
        found: list[Answer] = []
        for i in robots:
            entry, outcome = doings[i]
            answers = (*entry.answers, *(outcome.answers if outcome is not None else ()))
            # Turns are worked out once for all robots that they are the same for.
            found += [replace(answer, robot=i) for answer in answers]
        return tuple(found)

    def _cut(
        self, joint: JointTransition, end: StoreOutcome, doings: tuple[Doing, ...], *, inside: bool
    ) -> Round:
        """A round cut before the environment's turn; ``inside``: before all robots have moved."""
        order = self._order(joint, end, doings)
        robots = range(self._system.robots)
        if inside and not order:
            order = (self._first_to_skip(joint),)
        elif not inside:
            order = (*order, *(i for i in robots if i not in order))
        events = tuple(doings[i][0].event if i in order else None for i in robots)
        return Round(order, events, (), self._answers(doings, order), cut=True)

    def _first_to_skip(self, joint: JointTransition) -> int:
        return next(i for i, course in enumerate(joint.courses) if course.may_skip_first)

    # --- violations -----------------------------------------------------------------------------

    def failing(self, state: State) -> Iterator[Round]:
        """Yield rounds that end in a fault of a program turn. [T-FAULT]"""
        for robot, menu in enumerate(self._joints.menus(state)):
            for failure in menu.failures:
                yield self._failed(robot, failure)

    def _failed(self, robot: int, failure: FaultingEvent) -> Round:
        count = self._system.robots
        events = tuple(failure.event if i == robot else None for i in range(count))
        answers = tuple(replace(answer, robot=robot) for answer in failure.answers)
        return Round((robot,), events, (), answers, cut=True)

    def breaking(self, check: Check) -> Callable[[State], Iterator[Round]]:
        """Yield rounds inside which a property does not hold."""

        def found(state: State) -> Iterator[Round]:
            for joint in self._joints.joints(state, self._joints.menus(state)):
                for doings in _program_turns(joint):
                    for end in joint.ends:
                        yield from self._broken(check, joint, end, doings)

        return found

    def _broken(
        self, check: Check, joint: JointTransition, end: StoreOutcome, doings: tuple[Doing, ...]
    ) -> Iterator[Round]:
        before = tuple(entry.robot for entry, _ in doings)
        if joint.is_inside and not check.holds((*before, *end.shared)):
            yield self._cut(joint, end, doings, inside=True)
        if joint.is_whole:
            after = joint.stopped(before)
            if not check.holds((*after, *end.shared)):
                yield self._cut(joint, end, doings, inside=False)

    def evolving(self, claim: SearchGoal) -> Callable[[State], Iterator[Round]]:
        """Yield rounds whose environment's turn faults, or breaks a promise."""

        def found(state: State) -> Iterator[Round]:
            for joint in self._joints.joints(state, self._joints.menus(state)):
                if not joint.is_whole:
                    continue
                choices = [list(_doings(joint, i, every=True)) for i in range(self._system.robots)]
                for doings in product(*choices):
                    if _shows(claim, [outcome for _, outcome in doings if outcome is not None]):
                        for end in joint.ends:
                            yield self._whole(joint, end, doings)

        return found

    def losing(self, name: str) -> Callable[[State], Iterator[Round]]:
        """Yield rounds in which an update of a variable is lost."""

        def found(state: State) -> Iterator[Round]:
            for joint in self._joints.joints(state, self._joints.menus(state)):
                if name not in self._lost(joint):
                    continue
                for doings in _program_turns(joint):
                    inside = not joint.is_whole
                    yield self._cut(joint, joint.ends[0], doings, inside=inside)

        return found

    def _lost(self, joint: JointTransition) -> set[str]:
        program = self._system.program
        slots = self._joints.lost(joint)
        return {program.allwrite[slot].variable.name for slot in slots}


def as_it_is(robots: tuple[int, ...], shared: tuple[int, ...]) -> State:
    """A state that only stands for itself."""
    return (*robots, *shared)


def _program_turns(joint: JointTransition) -> Iterator[tuple[Doing, ...]]:
    """Yield the transitions of all robots in a joint course, before the environment's turn."""
    for chosen in product(*[course.entries for course in joint.courses]):
        yield tuple((entry, None) for entry in chosen)


def _doings(joint: JointTransition, robot: int, *, every: bool = False) -> Iterator[Doing]:
    """Yield a robot's transitions in a joint course; one for each end that it can have."""
    outcomes = joint.endings[robot].outcomes
    seen: set[int] = set()
    for entry, its_outcomes in zip(joint.courses[robot].entries, outcomes, strict=True):
        for outcome in its_outcomes:
            if every:
                yield entry, outcome
            elif outcome.fault is None and outcome.robot not in seen:
                seen.add(outcome.robot)
                yield entry, outcome


def _shows(claim: SearchGoal, outcomes: list[EnvironmentOutcome]) -> bool:
    is_faulted = any(outcome.fault is not None for outcome in outcomes)
    if claim.subject is GoalKind.FAULT:
        return is_faulted
    broken = {contract.name for outcome in outcomes for contract in outcome.broken}
    return not is_faulted and claim.name in broken
