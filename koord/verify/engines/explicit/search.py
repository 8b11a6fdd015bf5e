"""Explicit-state search: breadth-first over all reachable configurations, if they are finite.

States are configurations at the starts of rounds (:mod:`canonical`). A round is not taken apart
into turns: what each robot can do is worked out for itself (:mod:`menus`), and combined without
regard to order, except for who wins which race (:mod:`joint`, :mod:`commits`). Robots that may
change places are told apart by what they are only (:mod:`symmetry`, :mod:`orbits`). The search goes
by rounds, so what it finds violated is shown by a run with the fewest rounds.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice, product
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.recordings import Recording, Round
from koord.syntax import core
from koord.syntax.analysis.symmetry import Symmetry, reachable_symmetry
from koord.syntax.budget import Budget, Count
from koord.syntax.core import PropertyKind
from koord.syntax.system import System
from koord.verify.engines.explicit.commits import Commits
from koord.verify.engines.explicit.compiled import (
    CompiledGoal,
    CompiledSearch,
    is_installed,
)
from koord.verify.engines.explicit.cost import Cost
from koord.verify.engines.explicit.finiteness import NotFinite, not_finite
from koord.verify.engines.explicit.found_runs import Tracer, as_it_is
from koord.verify.engines.explicit.initial_states import openings
from koord.verify.engines.explicit.joint_transitions import (
    JointTransition,
    JointTransitions,
    needs_relaxed,
)
from koord.verify.engines.explicit.limits import LimitReachedError, Limits, Meter
from koord.verify.engines.explicit.orbits import Orbits
from koord.verify.engines.explicit.property_checks import (
    ENDS,
    Check,
    Exhausted,
    GoalKind,
    OutOfBounds,
    SearchGoal,
    SearchReport,
    Violated,
    asks_who_ran,
    check,
    end_of,
    sees_the_environment,
)
from koord.verify.engines.explicit.robot_transitions import Menu, Menus
from koord.verify.engines.explicit.states import State, StateStore

#: So many ways to start, most of them assumed away, are tried for each state that is allowed.
_STARTS_PER_STATE = 20

#: Where machine code is held against Python, so many ways to go on are.
_MOST_SHOWN = 400

#: What it takes to begin with what robots do together, in steps of evaluation, and how many of the
#: ways to go on from there one takes.
_PER_JOINT, _WAYS_PER_STEP = 2, 16

#: Told now and then: states seen, rounds finished, states waiting in this round.
Progress = Callable[[int, int, int], None]

if TYPE_CHECKING:
    from koord.kernels.terms import NoKernelError

#: What is looked for without being asked.
ALWAYS = frozenset({GoalKind.FAULT, GoalKind.CONTRACT})


def survey(
    system: System,
    properties: Sequence[core.Property],
    limits: Limits | None = None,
    *,
    subjects: frozenset[GoalKind] = ALWAYS,
    symmetry: bool = True,
    order_reduction: bool = True,
    compiled_from: int | None = None,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> SearchReport:
    """Search for all violations: of each claim one with the fewest rounds.

    Where Python has cost more than ``compiled_from`` (see :mod:`cost`) machine code is
    used, if there is any; None: it is not.
    """
    made = begun(
        system,
        properties,
        limits,
        subjects=subjects,
        symmetry=symmetry,
        order_reduction=order_reduction,
        compiled_from=compiled_from,
        progress=progress,
        clock=clock,
    )
    if isinstance(made, NotFinite):
        return SearchReport((), made)
    return SearchReport(tuple(made.violations()), made.end)


def begun(
    system: System,
    properties: Sequence[core.Property],
    limits: Limits | None = None,
    *,
    subjects: frozenset[GoalKind] = ALWAYS,
    symmetry: bool = True,
    order_reduction: bool = True,
    compiled_from: int | None = None,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Search | NotFinite:
    """Begin a search that yields violations as they are found, if the system allows one."""
    reason = not_finite(system, properties)
    if reason is not None:
        return reason
    meter = Meter(limits if limits is not None else Limits(), clock)
    return Search(
        system,
        tuple(properties),
        meter,
        subjects,
        symmetry,
        order_reduction,
        progress,
        compiled_from,
    )


class _Found(Struct, frozen=True):
    """A violation in the search, as a path of representatives.

    ``last`` is the check that fails inside the round behind the path; None if the path's last state
    shows the violation itself or the claim says what to look for. ``path`` is that to the state,
    of configurations as they are, where machine code found it.
    """

    claim: SearchGoal
    state: State
    is_behind: bool = False
    check: Check | None = None
    path: tuple[State, ...] = ()


#: Why a search ends that found everything it is asked about.
NOTHING_LEFT = "all claims are violated"


class Search:
    """A search in progress. ``violations`` drives it; ``end`` gives its result or depth.

    Where a limit ended it, :meth:`resume` lets it go on with others: a configuration that it was at
    is looked at once more, and what was found and not yet written down by then comes first.
    """

    def __init__(
        self,
        system: System,
        properties: tuple[core.Property, ...],
        meter: Meter,
        subjects: frozenset[GoalKind],
        symmetry: bool,
        order_reduction: bool,
        progress: Progress | None,
        compiled_from: int | None,
    ) -> None:
        self._cost = Cost()
        self._count = Count(system.budget)
        self._budget = Budget(self._count.is_over, system.budget)
        system = replace(system, budget=self._budget)
        relaxed = not order_reduction or needs_relaxed(system, properties)
        vault = StateStore(system, tracks_ran=asks_who_ran(properties))
        self._system = system
        self._vault = vault
        self._meter = meter
        self._progress = progress
        self._subjects = subjects
        self._commits = Commits(vault, every_order=not order_reduction)
        menus = Menus(system, vault, self._commits, relaxed=relaxed)
        self._joints = JointTransitions(system, vault, menus, self._commits, relaxed=relaxed)
        found = reachable_symmetry(system, properties) if symmetry else None
        orbits = Orbits(vault, found, self._cost) if isinstance(found, Symmetry) else None
        self._representative = orbits.representative if orbits is not None else as_it_is
        self._orbits = (found, orbits) if isinstance(found, Symmetry) and orbits else None
        # Configurations inside of rounds that no round ends in are left to Python.
        self._has_machine_code = not relaxed and order_reduction and is_installed()
        self._compiled_from = compiled_from if self._has_machine_code else None
        self._compiled: CompiledSearch | None = None
        self._left: NoKernelError | None = None
        self._checks = {
            SearchGoal(GoalKind.PROPERTY, p.name): check(system, vault, p) for p in properties
        }
        self._inside = {
            claim: each
            for (claim, each), p in zip(self._checks.items(), properties, strict=True)
            if p.kind is PropertyKind.INVARIANT
        }
        self._on_ports = {
            claim for claim, c in self._inside.items() if sees_the_environment(system, c.statement)
        }
        self._assumptions = [check(system, vault, a) for a in system.program.assumptions]
        self._seen: dict[State, State | None] = {}
        self._settled: set[SearchGoal] = set()
        self._pending: deque[_Found] = deque()  #: found, and not yet written down
        self._frontier: list[State] | None = None  #: None: not all ways to start were tried
        self._position = 0  #: in the frontier
        self._waiting: list[State] = []  #: the next frontier, so far
        self._depth = 0
        self._through: int | None = None  #: the last round that was looked at whole
        self._end: Exhausted | OutOfBounds | NotFinite | None = None

    def resume(
        self,
        budget: Budget,
        limits: Limits,
        progress: Progress | None = None,
        compiled_from: int | None = None,
    ) -> None:
        """Have :meth:`violations` go on where they stopped, within other limits.

        One that has gone over to machine code is at its end.
        """
        self._count.whole = self._budget.whole = budget
        self._meter.limits = limits
        self._progress = progress
        goes_over = self._has_machine_code and self._left is None
        self._compiled_from = compiled_from if goes_over else None
        self._end = None

    def leave_out(self, goals: Iterable[SearchGoal]) -> None:
        """Look for these no more: somebody else knows."""
        self._settled.update(goals)

    @property
    def end(self) -> Exhausted | OutOfBounds | NotFinite:
        """The result of the search: exhausted, out of bounds, or not finite."""
        return self._end or OutOfBounds("interrupted", self._states, self._through)

    @property
    def vault(self) -> StateStore:
        """The tables of numbers of which states consist."""
        return self._vault

    @property
    def seen(self) -> Mapping[State, State | None]:
        """The states that the road of Python has seen, each with one before it."""
        return self._seen

    @property
    def is_compiled(self) -> bool:
        """Return whether the result is that of machine code."""
        return self._compiled is not None

    @property
    def left(self) -> NoKernelError | None:
        """Why machine code was not used to the end; None if it was, or nobody asked for it."""
        return self._left

    @property
    def _states(self) -> int:
        """So many states were seen."""
        return len(self._seen) if self._compiled is None else self._compiled.states

    def violations(self) -> Iterator[Violated]:
        """Yield every violation, each claim once, by rounds."""
        try:
            if self._settled and self._has_all():
                raise LimitReachedError(NOTHING_LEFT)
            for found in self._found():
                if found.claim not in self._settled:
                    recording = self._recording(found)
                    self._settled.add(found.claim)
                    yield Violated(found.claim, recording, self._states)
                    if self._has_all():
                        raise LimitReachedError(NOTHING_LEFT)
        except ENDS as error:
            self._end = end_of(error, self._states, self._through)
        else:
            self._end = Exhausted(self._states, self._depth)

    def _has_all(self) -> bool:
        """Return whether all goals are violated already, so that the search can end."""
        asked = set(self._checks)
        if self._subjects & {GoalKind.LOST_UPDATE, GoalKind.CONTRACT}:
            return False  # nobody knows how many of these there are
        if GoalKind.FAULT in self._subjects:
            asked.add(SearchGoal(GoalKind.FAULT))
        return asked <= self._settled

    # --- the search -----------------------------------------------------------------------------

    def _found(self) -> Iterator[_Found]:
        yield from self._told()
        if self._frontier is None:
            yield from self._begin()
            self._frontier, self._waiting, self._through = self._waiting, [], 0
        while self._frontier:
            if self._depth == self._meter.limits.rounds:
                raise LimitReachedError(f"more than {self._depth} rounds")
            while self._position < len(self._frontier):
                state = self._frontier[self._position]
                if not self._is_due():
                    self._tick(len(self._frontier) - self._position)
                    yield from self._expanded(state)
                if self._is_due():
                    self._compiled_from = None
                    yield from self._on_machine_code()
                    if self._compiled is not None:
                        return
                    yield from self._expanded(state)  # what was left of it
                self._position += 1
            self._frontier, self._waiting, self._position = self._waiting, [], 0
            if self._frontier:
                self._depth = self._through = self._depth + 1

    def _told(self) -> Iterator[_Found]:
        """Yield what was found, and forget it once it was written down."""
        while self._pending:
            yield self._pending[0]
            self._pending.popleft()

    def _is_due(self) -> bool:
        """Return whether to go over to machine code: it costs less than what Python has done."""
        if self._compiled_from is None:
            return False
        states = len(self._seen)
        cost = self._cost.of(states, self._count.steps)
        return cost > self._compiled_from or states > self._meter.limits.states

    def _on_machine_code(self) -> Iterator[_Found]:
        """Search by machine code from the start, if there is any that gets to the end."""
        from koord.kernels.terms import NoKernelError

        depth, through = self._depth, self._through
        try:
            starts = [state for state, before in self._seen.items() if before is None]
            goals = self._compiled_goals()
            most_mb = self._meter.limits.memory_mb
            made = CompiledSearch(
                self._system, self._vault, goals, self._orbits, starts, self, most_mb
            )
            self._compiled = made
            for met in made.met(self._meter, self._tell_of):
                self._depth = self._through = max(depth, made.depth)
                yield _Found(
                    met.goal,
                    met.path[-1],
                    met.is_behind,
                    self._checks.get(met.goal) if met.is_behind else None,
                    met.path,
                )
            self._depth = self._through = made.depth
        except NoKernelError as error:
            self._compiled, self._depth, self._through = None, depth, through
            self._left = error
        except LimitReachedError:
            assert self._compiled is not None
            self._depth = self._through = max(depth, self._compiled.depth)
            raise

    def _compiled_goals(self) -> list[CompiledGoal]:
        """What is looked for and not settled yet. Raises NoKernelError where it cannot be."""
        from koord.kernels.terms import NoKernelError

        agents = [self._system.program.agents[kind] for kind in set(self._system.kinds)]
        models = [m for agent in agents for m in agent.modules if m.environment is not None]
        if GoalKind.CONTRACT in self._subjects and any(m.contracts for m in models):
            raise NoKernelError("what models promise is looked at")
        goals = [
            CompiledGoal(goal, each.statement, goal in self._inside, goal in self._on_ports)
            for goal, each in self._checks.items()
            if goal not in self._settled and isinstance(each.statement, core.Property)
        ]
        others = [
            CompiledGoal(SearchGoal(subject))
            for subject in (GoalKind.FAULT, GoalKind.LOST_UPDATE)
            if subject in self._subjects
        ]
        return goals + others

    # --- what machine code is held against ------------------------------------------------------

    def joints(self, state: State) -> Iterator[JointTransition]:
        """Yield every joint course in a configuration as it is."""
        return self._joints.joints(state, self._joints.menus(state))

    def successors(self, state: State) -> Iterator[State]:
        """Yield the configurations after rounds from one, as they are."""
        for joint in self.joints(state):
            if joint.is_whole:
                yield from ((*robots, *shared) for robots, shared in joint.successors())

    def shown(self, state: State) -> Iterator[SearchGoal]:
        """Yield what a configuration shows to be violated, or some rounds behind it."""
        yield from (goal for goal, each in self._checks.items() if not each.holds(state))
        yield from (found.claim for found in self._failures(state, self._joints.menus(state)))
        for joint in islice(self.joints(state), _MOST_SHOWN):
            yield from (found.claim for found in self._looked_inside(state, joint))
            if joint.is_whole:
                yield from (found.claim for found in self._evolved(state, joint))

    def _begin(self) -> Iterator[_Found]:
        count = self._system.robots
        most = _STARTS_PER_STATE * self._meter.limits.states
        self._seen.clear()
        self._waiting.clear()
        for tried, opened in enumerate(openings(self._system, self._vault, self._commits)):
            self._system.budget.spend()
            self._tick(0)
            if tried > most:
                raise LimitReachedError(f"more than {most} ways to start")
            if not all(each.holds(opened.state) for each in self._assumptions):
                continue
            state = self._representative(opened.state[:count], opened.state[count:])
            if opened.is_faulted:
                if GoalKind.FAULT in self._subjects:
                    yield _Found(SearchGoal(GoalKind.FAULT), state)
            elif state not in self._seen:
                yield from self._entered(state, None)

    def _entered(self, state: State, before: State | None) -> Iterator[_Found]:
        """Yield the violations of a new state. [PROP-INVARIANT] [PROP-ROUND]"""
        shown = [
            _Found(claim, state)
            for claim, each in self._checks.items()
            if claim not in self._settled and not each.holds(state)
        ]
        # From here on it is known: whatever ends the search now, this is not looked at again.
        self._seen[state] = before
        self._waiting.append(state)
        self._pending += shown
        yield from self._told()

    def _expanded(self, state: State) -> Iterator[_Found]:
        menus = self._joints.menus(state)
        yield from self._failures(state, menus)
        seen, representative = self._seen, self._representative
        for joint in self._joints.joints(state, menus):
            if self._is_due():
                return
            self._system.budget.spend(_PER_JOINT)
            self._cost.joints += 1
            yield from self._looked_inside(state, joint)
            if not joint.is_whole:
                continue
            yield from self._evolved(state, joint)
            for number, (robots, shared) in enumerate(joint.successors()):
                if number % _WAYS_PER_STEP == 0:
                    self._system.budget.spend()
                self._cost.ways += 1
                after = representative(robots, shared)
                if after not in seen:
                    yield from self._entered(after, state)

    def _tick(self, waiting: int) -> None:
        reached = self._meter.reached(len(self._seen))
        if reached:
            raise LimitReachedError(reached)
        self._tell_of(len(self._seen), self._depth, waiting)

    def _tell_of(self, states: int, rounds: int, waiting: int) -> None:
        if self._progress is not None and self._meter.is_time_to_tell():
            self._progress(states, rounds, waiting)

    # --- what is looked at ----------------------------------------------------------------------

    def _failures(self, state: State, menus: list[Menu]) -> Iterator[_Found]:
        if GoalKind.FAULT in self._subjects and any(menu.failures for menu in menus):
            yield _Found(SearchGoal(GoalKind.FAULT), state, is_behind=True)

    def _looked_inside(self, state: State, joint: JointTransition) -> Iterator[_Found]:
        """Yield the violations between program turns, and before the environment's. [T-PREFIX]"""
        for claim, each in self._inside.items():
            if claim in self._settled:
                continue
            if (joint.is_inside and not _holds(each, joint, stopped=False)) or (
                joint.is_whole
                and (claim in self._on_ports or _is_last(joint))
                and not _holds(each, joint, stopped=joint.all_stop)
            ):
                yield _Found(claim, state, is_behind=True, check=each)
        if GoalKind.LOST_UPDATE in self._subjects and len(joint.writers) > 1:
            for slot in sorted(self._joints.lost(joint)):
                name = self._system.program.allwrite[slot].variable.name
                yield _Found(SearchGoal(GoalKind.LOST_UPDATE, name), state, is_behind=True)

    def _evolved(self, state: State, joint: JointTransition) -> Iterator[_Found]:
        """Yield the faults of models, and the promises that they break."""
        endings = joint.endings
        if not any(ending.has_news for ending in endings):
            return
        outcomes = [ending.all for ending in endings]
        if not all(outcomes):
            return
        if GoalKind.FAULT in self._subjects and any(o.fault for each in outcomes for o in each):
            yield _Found(SearchGoal(GoalKind.FAULT), state, is_behind=True)
        if GoalKind.CONTRACT in self._subjects:
            sound = [[o for o in each if o.fault is None] for each in outcomes]
            if all(sound):
                for name in dict.fromkeys(c.name for each in sound for o in each for c in o.broken):
                    yield _Found(SearchGoal(GoalKind.CONTRACT, name), state, is_behind=True)

    # --- recordings -----------------------------------------------------------------------------

    def _tracer(
        self, representative: Callable[[tuple[int, ...], tuple[int, ...]], State]
    ) -> Tracer:
        return Tracer(self._system, self._vault, self._commits, self._joints, representative)

    def _recording(self, found: _Found) -> Recording:
        tracer = self._tracer(as_it_is if found.path else self._representative)
        claim = found.claim
        if claim.subject is GoalKind.FAULT and not found.is_behind:
            return tracer.at_init(found.state)
        path = list(found.path) or self._path(found.state)
        if not found.is_behind:
            return tracer.run(path)
        return tracer.run(path, self._last_round(tracer, found))

    def _last_round(self, tracer: Tracer, found: _Found) -> Callable[[State], Iterator[Round]]:
        claim = found.claim
        if found.check is not None:
            return tracer.breaking(found.check)
        match claim.subject:
            case GoalKind.LOST_UPDATE:
                return tracer.losing(claim.name)
            case GoalKind.CONTRACT:
                return tracer.evolving(claim)
            case _:
                return lambda state: chain(tracer.failing(state), tracer.evolving(claim)(state))

    def _path(self, state: State) -> list[State]:
        path = [state]
        while (before := self._seen[path[-1]]) is not None:
            path.append(before)
        return path[::-1]


def _is_last(joint: JointTransition) -> bool:
    """Return whether the environment may have no turn, so that properties are checked before it."""
    return any(ending.may_be_last for ending in joint.endings)


def _holds(each: Check, joint: JointTransition, *, stopped: bool) -> bool:
    """Return whether a statement holds wherever robots may be after their program turns."""
    # What looks the same to the statement need be tried once only.
    courses = joint.courses
    views = [each.views(c.stopped_robots if stopped else c.robots) for c in courses]
    return all(
        each.holds_for(chosen, end.shared) for chosen in product(*views) for end in joint.ends
    )
