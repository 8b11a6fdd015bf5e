"""A search on machine code, where a system has any. [T-ONE-WINNER] [T-COMMIT] [SYMMETRY]

:mod:`koord.kernels` has what this engine's other files say, for packed states. It finds the states
that show something; the run to one is written down by the road of Python, so that nothing that
machine code says is shown without having been worked out again. Of what is out of its reach there
is no such search: the road of Python goes on from where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.analysis.symmetry import Symmetry
from koord.syntax.budget import BATCH
from koord.syntax.system import System
from koord.verify.engines.explicit.joint_transitions import JointTransition
from koord.verify.engines.explicit.limits import LimitReachedError, Meter
from koord.verify.engines.explicit.orbits import Orbits
from koord.verify.engines.explicit.property_checks import GoalKind, SearchGoal
from koord.verify.engines.explicit.states import State, StateStore

if TYPE_CHECKING:
    from koord.kernels.context import Goals
    from koord.kernels.exploration import Exploration
    from koord.verify.engines.explicit.packing import Packing

#: So many states are looked at in one go at first, and at most. How many they are hangs on no
#: clock, so that a ration of work goes as far on every machine.
_FIRST_BATCH, _MOST_BATCH = 16, 4_096


class CompiledGoal(Struct, frozen=True):
    """A goal, with the statement that says what it is, if one does."""

    goal: SearchGoal
    statement: core.Property | None = None
    inside: bool = False
    on_ports: bool = False


class PythonRoad(Protocol):
    """What the road of Python says of a state, with which machine code is compared."""

    def joints(self, state: State) -> Iterator[JointTransition]: ...

    def successors(self, state: State) -> Iterator[State]: ...

    def shown(self, state: State) -> Iterator[SearchGoal]: ...


class Met(Struct, frozen=True):
    """A goal that was met, with the path to it; ``is_behind``: in the round after the path."""

    goal: SearchGoal
    path: tuple[State, ...]
    is_behind: bool


class CompiledSearch:
    """A search on machine code. ``depth`` and ``states`` say how far it came."""

    def __init__(
        self,
        system: System,
        vault: StateStore,
        goals: Sequence[CompiledGoal],
        orbits: tuple[Symmetry, Orbits] | None,
        starts: Sequence[State],
        road: PythonRoad,
        most_mb: int,
    ) -> None:
        """Raises NoKernelError, or ImportError where there is nothing to make machine code with."""
        from koord.kernels.exploration import Exploration, OutOfRoomError
        from koord.kernels.rounds import Rounds
        from koord.kernels.terms import NoKernelError
        from koord.verify.engines.explicit.packing import Packing
        from koord.verify.engines.explicit.second_look import SecondLook

        self._system, self._road = system, road
        self._orbits = orbits[1] if orbits is not None else None
        symmetry = orbits[0] if orbits is not None else None
        packing = Packing(system, vault, starts, symmetry, tracks_ran=vault.tracks_ran)
        self._packing: Packing = packing
        self._goals = _by_kind(system, goals)
        rounds = Rounds(packing.layout, self._stated(), packing.bits)
        try:
            self._exploration: Exploration = Exploration(rounds, most_mb * 1_000_000)
            for start in packing.starts:
                self._exploration.enter(start)
        except OutOfRoomError:
            raise NoKernelError("there is no memory for tables") from None
        self._look: SecondLook = SecondLook(
            self._exploration, packing.layout, rounds.of.idle, packing.numbers, road.joints
        )
        self._count = self._exploration.states
        self.depth = 0

    @property
    def states(self) -> int:
        """So many states were seen."""
        return self._exploration.states

    def _stated(self) -> Goals:
        from koord.kernels.context import Goals

        statements = [g for g in self._goals if g is not None and g.statement is not None]
        program = self._system.program
        lost = [g.goal.name for g in self._goals if g is not None and _is_lost(g.goal)]
        slots = {x.variable.name: x.variable.slot for x in program.allwrite}
        return Goals(
            tuple((g.statement.condition, g.statement.bound) for g in statements if g.statement),
            frozenset(k for k, g in enumerate(statements) if g.inside),
            frozenset(k for k, g in enumerate(statements) if g.on_ports),
            any(g is not None and g.goal.subject is GoalKind.FAULT for g in self._goals),
            tuple(slots[name] for name in lost),
        )

    # --- searching ------------------------------------------------------------------------------

    def met(self, meter: Meter, tell: Callable[[int, int, int], None]) -> Iterator[Met]:
        """Yield each goal that is met, once, by rounds. Raises LimitReachedError or NoKernelError.

        What machine code says is not believed where a second look says otherwise.
        """
        from koord.kernels.exploration import OutOfRoomError

        exploration, first, batch = self._exploration, 0, _FIRST_BATCH
        yield from self._new()
        while first < exploration.states:
            if self.depth == meter.limits.rounds:
                raise LimitReachedError(f"more than {self.depth} rounds")
            end = exploration.states
            while first < end:
                reached = meter.reached_now(exploration.states, meter.limits.compiled_states)
                if reached:
                    raise LimitReachedError(reached)
                self._system.budget.spend(min(batch, BATCH))
                before = first
                try:
                    first = exploration.expand(first, min(end, first + batch))
                except OutOfRoomError:
                    most = meter.limits.memory_mb
                    raise LimitReachedError(f"more than {most} MB of memory") from None
                batch = min(2 * batch, _MOST_BATCH)
                tell(exploration.states, self.depth, end - first)
                yield from self._new()
                self._look_again(before, first)
            if first < exploration.states:
                self.depth += 1

    def _new(self) -> Iterator[Met]:
        found = self._exploration.found
        for number, goal in enumerate(self._goals):
            where = int(found[number])
            if goal is None or where < 0:
                continue
            self._goals[number] = None
            path = self._exploration.path(where >> 1, self._count)
            yield Met(goal.goal, tuple(self._run(path)), bool(where & 1))

    def _look_again(self, first: int, end: int) -> None:
        """Look at some states once more. Raises DisagreementError."""
        from koord.verify.engines.explicit.second_look import DisagreementError

        for number in self._look.due(first, end):
            state = self._packing.state(self._exploration.numbers(number))
            self._look.look(state)
            # Goals that were met are no longer among these.
            open_ = {goal.goal for goal in self._goals if goal is not None}
            missed = next((goal for goal in self._road.shown(state) if goal in open_), None)
            if missed is not None:
                raise DisagreementError(f"machine code misses {missed.subject.value}")

    # --- runs -----------------------------------------------------------------------------------

    def _run(self, path: list[int]) -> Iterator[State]:
        """States of a run whose representatives are those of a path.

        ``names`` are the places that the names of a representative have in the run.
        """
        from koord.verify.engines.explicit.second_look import DisagreementError

        now = self._exploration.numbers(path[0])
        names = tuple(range(self._packing.layout.names))
        yield self._packing.state(now)
        for number in path[1:]:
            target = self._exploration.numbers(number)
            for after in self._road.successors(self._packing.state(now)):
                kept, renaming = self._look.standing_for(self._packing.numbers(after))
                if kept == target:
                    break
            else:
                raise DisagreementError("a run is not one of the reference")
            yield self._orbits.renamed(after, names) if self._orbits is not None else after
            inverse = {new: old for old, new in enumerate(renaming)}
            names = tuple(names[inverse[i]] for i in range(len(names)))
            now = target


def is_installed() -> bool:
    """Return whether there is anything to make machine code with."""
    return find_spec("llvmlite") is not None


def _is_lost(goal: SearchGoal) -> bool:
    return goal.subject is GoalKind.LOST_UPDATE


def _by_kind(system: System, goals: Sequence[CompiledGoal]) -> list[CompiledGoal | None]:
    """The goals in the order in which machine code numbers them: faults stand in any case."""
    stated: list[CompiledGoal | None] = [g for g in goals if g.statement is not None]
    faults = next((g for g in goals if g.goal.subject is GoalKind.FAULT), None)
    names = {x.variable.slot: x.variable.name for x in system.program.allwrite}
    slots = sorted(set().union(*rewritten(system.program).values()))
    lost = [
        CompiledGoal(SearchGoal(GoalKind.LOST_UPDATE, names[slot]))
        for slot in slots
        if any(_is_lost(g.goal) for g in goals)
    ]
    return [*stated, faults, *lost]
