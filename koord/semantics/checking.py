"""Properties of states: each is evaluated once for all that it reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from koord.semantics.canonical import Interner, State, Vault
from koord.semantics.configurations import System
from koord.semantics.dependence import Reads, reads_of
from koord.semantics.domain import EXACT, Constant
from koord.semantics.oracle import NoOracle, Oracle, Phase
from koord.semantics.recording import Concrete
from koord.semantics.turns import holds_in
from koord.syntax import core
from koord.syntax.core import Direction, Home
from koord.syntax.walk import nodes


class NoInputs:
    """Inputs for what leaves nothing open."""

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        raise AssertionError(declaration.variable.name)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        raise AssertionError(port.declaration.variable.name)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return NoOracle()


Closed = core.Property | core.Assumption


@dataclass(slots=True)
class Check:
    """A closed statement with what it reads, and its value for whatever it was asked about.

    A *view* of a robot is the number of what the statement reads of it.
    """

    statement: Closed
    kinds: tuple[Reads, ...]
    shared: tuple[int, ...]
    _system: System
    _vault: Vault
    _views: Interner[tuple[int, ...]] = field(default_factory=Interner)
    _view_of: dict[int, int] = field(default_factory=dict)
    _values: dict[tuple[int, ...], bool] = field(default_factory=dict)

    def view(self, robot: int) -> int:
        """The view of a robot with that number."""
        known = self._view_of.get(robot)
        if known is None:
            own = self._vault.robots.values[robot]
            reads = self.kinds[own.kind]
            parts = [own.kind, own.status if reads.status else 0, own.ran if reads.ran else 0]
            parts += [own.locals[slot] for slot in reads.locals]
            parts += [own.ports[slot] for slot in reads.ports]
            parts += [own.entries[slot] for slot in reads.arrays]
            known = self._view_of[robot] = self._views.number(tuple(parts))
        return known

    def holds(self, state: State) -> bool:
        """Whether the statement holds in a state."""
        count = self._system.robots
        view = self.view
        key = (
            *[view(robot) for robot in state[:count]],
            *[state[count + slot] for slot in self.shared],
        )
        known = self._values.get(key)
        if known is None:
            configuration = self._vault.configuration(state)
            e, bound = self.statement.condition, self.statement.bound
            value, _ = holds_in(EXACT, self._system, configuration, e, bound, NoInputs())
            known = self._values[key] = value is True
        return known


def check(system: System, vault: Vault, statement: Closed) -> Check:
    """The check of one statement."""
    program = system.program
    kinds = tuple(reads_of(program, statement.condition, agent=a) for a in program.agents)
    shared = tuple(sorted({slot for reads in kinds for slot in reads.allwrite}))
    return Check(statement, kinds, shared, system, vault)


def asks_who_ran(statements: Sequence[Closed]) -> bool:
    """Whether one of some statements mentions what robots ran."""
    return any(isinstance(node, core.Ran) for s in statements for node in nodes(s.condition))


def sees_the_environment(system: System, statement: Closed) -> bool:
    """Whether a statement reads a port that the environment's turn may change."""
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
