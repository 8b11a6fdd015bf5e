"""Auxiliary variables: written, and read only by variables of the same sort.

A run that repeats itself need not come back to what they hold. [AUXILIARY] This is read off the
text on the safe side: whatever is not plainly so counts as depended on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.analysis.always_met import always_met, primed, promises_of
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import Home, slot_in
from koord.syntax.system import System
from koord.syntax.walk import operands, reached, statements, written


class Var(Struct, frozen=True):
    """A variable of a program: ``kind`` is that of the robots whose local or port it is."""

    home: Home
    kind: int | None
    slot: int


def auxiliary(system: System, stated: Iterable[core.Property]) -> frozenset[Var]:
    """The auxiliary variables: no round depends on them, nor do some liveness statements."""
    program = system.program
    reading = _Reading(system)
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            reading.use(event.guard, kind)
            for statement in statements(event.effect):
                reading.statement(statement, kind)
        for module in agent.modules:
            if module.environment is not None:
                reading.use((module.environment, module.contracts), kind)
        reading.promises(kind, agent)
    for each in (*stated, *program.expectations):
        reading.use((each.trigger, each.condition), None)
    return frozenset(variables(program)) - reading.depended_on()


def variables(program: core.Program) -> Iterator[Var]:
    """All variables of a program."""
    for kind, agent in enumerate(program.agents):
        yield from (Var(Home.LOCAL, kind, slot) for slot in range(len(agent.locals)))
        yield from (Var(Home.PORT, kind, slot) for slot in range(len(agent.ports)))
    yield from (Var(Home.ALLREAD, None, slot) for slot in range(len(program.allread)))
    yield from (Var(Home.ALLWRITE, None, slot) for slot in range(len(program.allwrite)))


def variables_of(program: core.Program, variable: core.Variable, kind: int | None) -> Iterator[Var]:
    """Yield the variables for an unbound one: in a property, one for each kind that has it."""
    match variable.home:
        case Home.BOUND:
            pass
        case Home.ALLREAD | Home.ALLWRITE:
            yield Var(variable.home, None, variable.slot)
        case Home.LOCAL | Home.PORT:
            for k in range(len(program.agents)) if kind is None else (kind,):
                slot = slot_in(program.agents[k], variable)
                if slot is not None:
                    yield Var(variable.home, k, slot)


class _Reading(Struct, frozen=True):
    """A data-flow analysis: variables that something depends on, and flows between variables."""

    system: System
    used: set[Var] = field(default_factory=set)
    flows: list[tuple[frozenset[Var], frozenset[Var]]] = field(default_factory=list)

    def use(self, part: object, kind: int | None) -> None:
        self.used.update(self._reads(part, kind))

    def statement(self, s: core.Stmt, kind: int) -> None:
        """Add the dependences of a statement itself, apart from those in it."""
        match s:
            case core.Assign(value=value) | core.Append(value=value) | core.Remove(value=value):
                self._written(s, value, kind)
            case core.Output(values=values) if not self._matters(s, values, kind):
                pass
            case _:
                self.use(tuple(operands(s)), kind)

    def promises(self, kind: int, agent: core.Agent) -> None:
        """Add the dependences of contracts, unless some reading always meets them."""
        met = always_met(self.system, kind)
        for contract, promise in promises_of(agent):
            read = (contract.requires, promise)
            about = primed(promise)
            if not about or not about <= met:
                self.use(read, kind)
                continue
            target = frozenset(Var(Home.PORT, kind, slot) for slot in about)
            self.flows.append((target, self._reads(read, kind)))

    def _written(self, s: core.Stmt, value: core.Expr, kind: int) -> None:
        """Add the flow into a written variable; it is used if something else can happen."""
        (place,) = written(s)
        if place.variable.home is Home.BOUND or self._matters(s, value, kind):
            self.use((place, value), kind)
            return
        self.use(place.steps, kind)
        target = frozenset(variables_of(self.system.program, place.variable, kind))
        self.flows.append((target, self._reads(value, kind)))

    def _matters(self, s: core.Stmt, evaluated: object, kind: int) -> bool:
        """Return whether a statement may fault, or may lack an answer."""
        asked = (core.Choose, core.ExternalCall)
        below = reached(self.system.program, evaluated)
        return not Sure(self.system, kind).of_statement(s) or any(
            isinstance(node, asked) for node in below
        )

    def depended_on(self) -> set[Var]:
        """The variables that matter, closed under the flows into them."""
        found = set(self.used)
        grows = True
        while grows:
            new = {x for targets, reads in self.flows if targets & found for x in reads - found}
            grows = bool(new)
            found |= new
        return found

    def _reads(self, part: object, kind: int | None) -> frozenset[Var]:
        nodes = reached(self.system.program, part)
        found = (node for node in nodes if isinstance(node, core.Variable))
        return frozenset(
            chain.from_iterable(variables_of(self.system.program, v, kind) for v in found)
        )
