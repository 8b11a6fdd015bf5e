"""Shadow modules, whose sensors show an instant between the ends of rounds. [ENV-INSTANT]"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, Home, PropertyKind
from koord.syntax.types import BOOL, FLOAT
from koord.syntax.walk import last_site, nodes, rebuilt

#: The external function that stands for the instant, in seconds from the start of the turn.
INSTANT = "the instant"

#: What the claims about instants are called, behind the names of those that they stem from.
BETWEEN = "between rounds"


def ports_of(part: object) -> frozenset[int]:
    """The slots of the ports that an expression reads."""
    found = (n for n in nodes(part) if isinstance(n, core.Variable) and n.home is Home.PORT)
    return frozenset(variable.slot for variable in found)


def between(name: str) -> str:
    """The name of the claim about instants for an invariant's name."""
    return f"{name} {BETWEEN}"


def is_asked_between(stated: core.Property) -> bool:
    """Return whether an invariant is checked at instants: it reads a port."""
    return stated.kind is PropertyKind.INVARIANT and bool(ports_of(stated.condition))


def with_primed(program: core.Program, slots: set[int]) -> set[int]:
    """Ports, closed under the primed ports in contracts of their modules."""
    found = set(slots)
    while True:
        primed = {
            node.variable.slot
            for agent in program.agents
            for module in agent.modules
            if found & set(module.ports)
            for node in nodes(module.contracts)
            if isinstance(node, core.Place) and node.primed
        }
        if primed <= found:
            return found
        found |= primed


class Shadows(Struct, frozen=True):
    """The shadows of a program's modules: ``slots`` maps each sensor to its shadow.

    Ports that robots of several kinds have in common stand in the same slots, and so do their
    shadows: each slot has one, behind all ports of all kinds.
    """

    original: core.Program
    slots: dict[int, int]
    modules: dict[str, tuple[int, ...]]  #: the sensors of the modules that have shadows
    last_site: int  #: of the calls of the program; those of shadows have numbers behind it

    @staticmethod
    def of(program: core.Program, wanted: set[int]) -> Shadows:
        """Make shadows of the modules that have one of the ports."""
        most = max(len(agent.ports) for agent in program.agents)
        slots: dict[int, int] = {}
        modules: dict[str, tuple[int, ...]] = {}
        for agent in program.agents:
            for module in agent.modules:
                if not wanted & set(module.ports):
                    continue
                sensors = [k for k in module.ports if agent.ports[k].direction is Direction.SENSOR]
                modules[module.name] = tuple({*modules.get(module.name, ()), *sensors})
                for sensor in sensors:
                    alone = len(program.agents) == 1
                    slots.setdefault(sensor, most + (len(slots) if alone else sensor))
        sensing = {name: sensors for name, sensors in modules.items() if sensors}
        return Shadows(program, slots, sensing, last_site(program))

    def program(self) -> core.Program:
        """The program with shadows."""
        result = core.Variable(Home.BOUND, 0, "result", FLOAT)
        low = core.Binary(BinaryOp.LE, core.Const(Fraction(0), FLOAT), _read(result), BOOL)
        high = core.Binary(BinaryOp.LE, _read(result), core.Delta(FLOAT), BOOL)
        instant = core.External(INSTANT, (), result, core.ExternalKind.FUNCTION, (), (low, high), 1)
        return replace(
            self.original,
            agents=tuple(self._agent(agent) for agent in self.original.agents),
            externals=(instant, *self.original.externals),
        )

    def statement(self, stated: core.Property) -> core.Property | None:
        """An invariant as a claim about instants; None if it reads no sensor."""
        condition = self._after(stated.condition)
        if condition == stated.condition:
            return None
        name = between(stated.name)
        return replace(stated, name=name, kind=PropertyKind.AT_ROUND, condition=condition)

    def promises(self, lost: set[int]) -> Iterator[str]:
        """The claims that shadow modules with models keep their contracts."""
        for agent in self.original.agents:
            for module in agent.modules:
                known = module.environment is not None and not lost & set(module.ports)
                if known and module.name in self.modules:
                    yield from (f"contract {c.name} {BETWEEN}" for c in module.contracts)

    def shadow(self, variable: core.Variable) -> core.Variable:
        """The shadow of a sensor."""
        return replace(variable, slot=self.slots[variable.slot])

    def _agent(self, agent: core.Agent) -> core.Agent:
        by_slot = {self.slots[k]: agent.ports[k] for k in self.slots if k < len(agent.ports)}
        by_slot = {k: port for k, port in by_slot.items() if port.module in self.modules}
        ports = [
            self._port(by_slot[slot]) if slot in by_slot else _unused(slot)
            for slot in range(len(agent.ports), max(by_slot, default=-1) + 1)
        ]
        modules = [self._module(agent, m) for m in agent.modules if m.name in self.modules]
        return replace(agent, ports=(*agent.ports, *ports), modules=(*agent.modules, *modules))

    def _port(self, port: core.Port) -> core.Port:
        """A sensor's shadow, which starts as the sensor does."""
        variable = port.declaration.variable
        declaration = core.Declaration(self.shadow(variable), _read(variable))
        return replace(port, module=_within(port.module), declaration=declaration)

    def _module(self, agent: core.Agent, module: core.Module) -> core.Module:
        sensors = [k for k in module.ports if agent.ports[k].direction is Direction.SENSOR]
        environment = module.environment
        if environment is not None:
            variables = [agent.ports[k].declaration.variable for k in sensors]
            # What the model does not write stays, as it does in the module itself.
            kept = [core.Assign(core.Place(self.shadow(v)), _read(v)) for v in variables]
            environment = (*kept, *self._shorter(environment))
        contracts = tuple(
            replace(
                contract,
                name=f"{contract.name} {BETWEEN}",
                ensures=tuple(self._afterwards(e) for e in contract.ensures),
            )
            for contract in module.contracts
        )
        return replace(
            module,
            name=_within(module.name),
            ports=tuple(self.slots[k] for k in sensors),
            environment=environment,
            contracts=contracts,
        )

    # --- rewriting --------------------------------------------------------------------------------

    def _after(self, node: Any) -> Any:
        """A statement about ports as one about their shadows."""
        return rebuilt(self._moved(node), self._after)

    def _afterwards(self, node: Any) -> Any:
        """A contract's expression about ports after the turn, as one about their shadows."""
        is_after = isinstance(node, core.Place) and node.primed
        return rebuilt(self._moved(node) if is_after else node, self._afterwards)

    def _shorter(self, node: Any) -> Any:
        """A model's block on shadows, for a turn that ends at the instant."""
        match node:
            case core.Delta():
                site = 2 * self.last_site + 1
                return core.ExternalCall(INSTANT, (), FLOAT, site, span=node.span)
            case core.Read(place=place):
                # Ports are read as they were before the turn; shadows have nothing to do with that.
                return replace(node, place=rebuilt(place, self._shorter))
            case core.Call() | core.ExternalCall() | core.Choose():
                node = replace(node, site=node.site + self.last_site)
            case _:
                node = self._moved(node)
        return rebuilt(node, self._shorter)

    def _moved(self, node: Any) -> Any:
        """A place of a sensor replaced by its shadow's; other nodes are unchanged."""
        if not isinstance(node, core.Place) or node.variable.home is not Home.PORT:
            return node
        shadowed = node.variable.slot in self.slots
        return replace(node, variable=self.shadow(node.variable)) if shadowed else node


def _within(module: str) -> str:
    """The name of a module's shadow."""
    return f"{module} between"


def _read(variable: core.Variable) -> core.Read:
    return core.Read(core.Place(variable))


def _unused(slot: int) -> core.Port:
    """A port that only fills a slot."""
    variable = core.Variable(Home.PORT, slot, f"unused{slot}", BOOL)
    start = core.Declaration(variable, core.Const(False, BOOL))
    return core.Port("", Direction.ACTUATOR, start)
