"""Checks of properties on states, cached by the values read; results of a search."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Any, NamedTuple

from msgspec import Struct, field

from koord.semantics.configurations import Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.oracle import Inputs, NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Recording
from koord.semantics.storage import Storage, Tree
from koord.syntax import core
from koord.syntax.analysis.footprint import Reads, reads_of
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.core import Direction, Home
from koord.syntax.source import NOWHERE
from koord.syntax.system import System
from koord.syntax.walk import nodes
from koord.traces.enumeration import UnboundedError
from koord.verify.engines.explicit.cells import (
    CACHE_LIMIT,
    MOST_SCALARS,
    Cells,
    Codes,
    Interner,
    TooLargeError,
)
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.lazy import Decisions, Lazy, LazyDomain, PlaceOf
from koord.verify.engines.explicit.limits import OUT_OF_TIME, LimitReachedError
from koord.verify.engines.explicit.states import State, StateStore, filled, nothing, template


class GoalKind(Enum):
    """The kinds of goals that a search looks for."""

    PROPERTY = "property"
    FAULT = "fault"
    CONTRACT = "contract promise"  #: of a module with a model
    LOST_UPDATE = "lost update"


class SearchGoal(Struct, frozen=True):
    """A goal of the search; ``name`` is that of the property, contract or variable."""

    subject: GoalKind
    name: str = ""


class Exhausted(Struct, frozen=True):
    """The result that every reachable configuration was visited.

    ``states`` counts them at the starts of rounds, up to symmetry; none is more than ``depth``
    rounds away.
    """

    states: int
    depth: int


class OutOfBounds(Struct, frozen=True):
    """The result that a limit was reached; all configurations up to ``depth`` rounds were visited.

    None: not even all ways to start have been.
    """

    reason: str
    states: int
    depth: int | None


#: What ends a search before it has looked at everything.
ENDS = (LimitReachedError, OutOfBudgetError, TooLargeError, UnboundedError)


def end_of(error: Exception, states: int, depth: int | None) -> OutOfBounds | NotFinite:
    """The result of a search that ends with an error."""
    match error:
        case UnboundedError():
            return NotFinite(str(error), NOWHERE)
        case OutOfBudgetError():
            reason = OUT_OF_TIME
        case TooLargeError():
            reason = f"more than {MOST_SCALARS} values in one variable"
        case _:
            reason = str(error)
    return OutOfBounds(reason, states, depth)


class Violated(Struct, frozen=True):
    """A violated claim, with a run that ends in a configuration that shows it.

    No run with fewer rounds shows it.
    """

    claim: SearchGoal
    recording: Recording
    states: int

    @property
    def rounds(self) -> int:
        return len(self.recording.rounds)


class SearchReport(Struct, frozen=True):
    """All violated claims, each once, and the end of the search."""

    violated: tuple[Violated, ...]
    end: Exhausted | OutOfBounds | NotFinite


Closed = core.Property | core.Assumption


class View(NamedTuple):
    """The part of a robot that a statement reads: forms of variables, status, ``ran``, codes."""

    kind: int
    status: int
    ran: int
    forms: tuple[int, ...]
    codes: tuple[Codes, ...]


class Check(Struct):
    """A closed statement with the places that it reads, and cached results."""

    statement: Closed
    kinds: tuple[Reads, ...]
    shared: tuple[int, ...]
    _system: System
    _vault: StateStore
    _views: Interner[View] = field(default_factory=Interner)
    _view_of: dict[int, int] = field(default_factory=dict)
    _views_of: dict[tuple[int, ...], tuple[int, ...]] = field(default_factory=dict)
    _values: dict[tuple[int, ...], bool] = field(default_factory=dict)
    _decisions: Decisions[bool] = field(default_factory=Decisions)
    _templates: dict[tuple[object, ...], Configuration[Lazy]] = field(default_factory=dict)

    def view(self, robot: int) -> int:
        """The number of the part that the statement reads of a robot."""
        known = self._view_of.get(robot)
        if known is None:
            own = self._vault.robots.values[robot]
            reads = self.kinds[own.kind]
            held = list(zip(self._cells(own.kind), self._held(own, reads), strict=True))
            view = View(
                own.kind,
                own.status if reads.status else 0,
                own.ran if reads.ran else 0,
                tuple(cells.forms[number] for cells, number in held),
                tuple(cells.codes[number] for cells, number in held),
            )
            known = self._view_of[robot] = self._views.number(view)
        return known

    def views(self, robots: tuple[int, ...]) -> tuple[int, ...]:
        """The views of robots with some numbers, each once."""
        known = self._views_of.get(robots)
        if known is None:
            known = self._views_of[robots] = tuple(dict.fromkeys(map(self.view, robots)))
        return known

    def _held(self, own: Any, reads: Reads) -> list[int]:
        return [
            *(own.locals[slot] for slot in reads.locals),
            *(own.ports[slot] for slot in reads.ports),
            *(own.entries[slot] for slot in reads.arrays),
        ]

    def _cells(self, kind: int) -> list[Cells]:
        reads, vault = self.kinds[kind], self._vault
        return [
            *(vault.locals[kind][slot] for slot in reads.locals),
            *(vault.ports[kind][slot] for slot in reads.ports),
            *(vault.entries[slot] for slot in reads.arrays),
        ]

    def holds(self, state: State) -> bool:
        """Return whether the statement holds in a state."""
        count = self._system.robots
        return self.holds_for(list(map(self.view, state[:count])), state[count:])

    def holds_for(self, views: Sequence[int], shared: Sequence[int]) -> bool:
        """Return whether the statement holds, from each robot's view and the allwrite contents."""
        key = (*views, *[shared[slot] for slot in self.shared])
        known = self._values.get(key)
        if known is None:
            if len(self._values) > CACHE_LIMIT:
                self._values.clear()
            known = self._values[key] = self._decided(
                [self._views.values[v] for v in views], shared
            )
        return known

    def _decided(self, views: list[View], shared: Sequence[int]) -> bool:
        forms: list[object] = []
        codes: list[Codes] = []
        for view in views:
            forms += view[:4]
            codes += view.codes
        for slot in self.shared:
            cells, number = self._vault.allwrite[slot], shared[slot]
            forms.append(cells.forms[number])
            codes.append(cells.codes[number])
        root = tuple(forms)
        known = self._decisions.find(root, codes)
        return known if known is not None else self._evaluated(views, root, codes, shared)

    def _evaluated(
        self, views: list[View], root: tuple[object, ...], codes: list[Codes], shared: Sequence[int]
    ) -> bool:
        scalars = self._vault.scalars

        def look(place: PlaceOf) -> Constant:
            return scalars.value(codes[place.variable][place.position], place.type)

        d = LazyDomain(look)
        configuration = self._templates.get(root)
        if configuration is None:
            configuration = self._templates[root] = self._configuration(views, shared)
        e, bound = self.statement.condition, self.statement.bound
        inputs: Inputs[Any] = NoInputs()
        value, _ = holds_in(d, self._system, configuration, e, bound, inputs)
        known = d.known(value) is True
        self._decisions.keep(root, codes, d.seen, known)
        return known

    # --- configurations to evaluate on ----------------------------------------------------------

    def _configuration(self, views: list[View], shared: Sequence[int]) -> Configuration[Lazy]:
        """The configuration with places in its variables; those that are not read are unset."""
        vault, count = self._vault, self._system.robots
        variable = 0
        robots: list[Robot[Lazy]] = []
        rows: list[list[Storage[Lazy]]] = [[nothing(cells)] * count for cells in vault.entries]
        none: Store[Lazy] = Store((), ())
        for i, view in enumerate(views):
            reads = self.kinds[view.kind]
            made = []
            for cells, form in zip(self._cells(view.kind), view.forms, strict=True):
                made.append(template(cells, form, variable))
                variable += 1
            held = iter(made)
            locals_ = filled(vault.locals[view.kind], reads.locals, held)
            ports = filled(vault.ports[view.kind], reads.ports, held)
            for slot in reads.arrays:
                rows[slot][i] = next(held)
            robots.append(Robot(view.kind, locals_, ports, none, view.status, view.ran))
        allwrite = [nothing(cells) for cells in vault.allwrite]
        for slot in self.shared:
            cells = vault.allwrite[slot]
            allwrite[slot] = template(cells, cells.forms[shared[slot]], variable)
            variable += 1
        store: Store[Lazy] = Store(tuple(Tree(tuple(row)) for row in rows), tuple(allwrite))
        return Configuration(tuple(robots), store, 0)


def check(system: System, vault: StateStore, statement: Closed) -> Check:
    """The check of one statement."""
    program = system.program
    kinds = tuple(reads_of(program, statement.condition, agent=a) for a in program.agents)
    shared = tuple(sorted({slot for reads in kinds for slot in reads.allwrite}))
    return Check(statement, kinds, shared, system, vault)


def asks_who_ran(statements: Sequence[Closed]) -> bool:
    """Return whether one of some statements reads which events ran."""
    return any(isinstance(node, core.Ran) for s in statements for node in nodes(s.condition))


def sees_the_environment(system: System, statement: Closed) -> bool:
    """Return whether a statement reads a port that the environment's turn may change."""
    agents = [system.program.agents[kind] for kind in set(system.kinds)]
    changing = {name for agent in agents for name in _changing_ports(agent)}
    return any(
        isinstance(node, core.Place)
        and node.variable.home is Home.PORT
        and node.variable.name in changing
        for node in nodes(statement.condition)
    )


def _changing_ports(agent: core.Agent) -> set[str]:
    names = set()
    for module in agent.modules:
        if module.environment is None:
            ports = [agent.ports[position] for position in module.ports]
            names |= {p.declaration.variable.name for p in ports if p.direction is Direction.SENSOR}
        else:
            places = [n for n in nodes(module.environment) if isinstance(n, core.Place)]
            names |= {p.variable.name for p in places if p.variable.home is Home.PORT}
    return names
