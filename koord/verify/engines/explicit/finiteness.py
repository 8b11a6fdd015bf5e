"""Finiteness: static check that every input of a system has finitely many values.

If so, every state has finitely many successors, which is what an explicit search needs; whether
finitely many states can be reached it finds out by itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from koord.semantics.domain import EXACT, Constant
from koord.semantics.machine import Machine
from koord.semantics.oracle import NoOracle
from koord.semantics.statements import machine
from koord.syntax import core
from koord.syntax.core import Direction, ExternalKind, Home, PropertyKind, Start
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import INT, Type
from koord.syntax.walk import nodes, reached, statements, written
from koord.traces.enumeration import result_reader, sensors_reader, starts_reader
from koord.traces.value_bounds import Found, StatementReader, candidates


class NotFinite(Struct, frozen=True):
    """The reason why a system cannot be enumerated, and the place in the text.

    ``name`` is what has the values that are too many: a variable, ``Module.sensor`` or a function.
    """

    reason: str
    span: Span
    name: str = ""


def not_finite(system: System, properties: Sequence[core.Property]) -> NotFinite | None:
    """The first input with infinitely many values, or construct that search does not track."""
    return next(_complaints(system, properties), None)


def _complaints(system: System, properties: Sequence[core.Property]) -> Iterator[NotFinite]:
    program = system.program
    for p in properties:
        if p.kind in (PropertyKind.EVENTUALLY, PropertyKind.LEADS_TO):
            yield NotFinite(f"{p.name} is about whole runs", p.span)
        yield from _open_statement(program, p)
    for assumption in program.assumptions:
        yield from _open_statement(program, assumption)
    agents = [program.agents[kind] for kind in sorted(set(system.kinds))]
    yield from _starts(system)
    for agent in agents:
        for module in agent.modules:
            if module.environment is None:
                yield from _sensors(system, agent, module)
    yield from _calls(system, (agents, program.functions, program.allread, program.allwrite))


def _open_statement(
    program: core.Program, statement: core.Property | core.Assumption
) -> Iterator[NotFinite]:
    """Refuse statements with inputs, which are not evaluated here."""
    for node in reached(program, statement.condition):
        if isinstance(node, core.Choose | core.ExternalCall):
            what = "choose" if isinstance(node, core.Choose) else node.function
            yield NotFinite(f"{statement.name} leaves open what {what} gives", node.span)


# --- starts ---------------------------------------------------------------------------------------


def _starts(system: System) -> Iterator[NotFinite]:
    program = system.program
    found = known_starts(system)
    owned: list[tuple[str, core.Declaration, list[int | None]]] = [
        (entry.variable.name, entry, [None]) for entry in program.allwrite
    ]
    everybody: list[int | None] = list(range(system.robots))
    owned += [(entry.variable.name, entry, everybody) for entry in program.allread]
    for kind, agent in enumerate(program.agents):
        robots: list[int | None] = [i for i, k in enumerate(system.kinds) if k == kind]
        owned += [(entry.variable.name, entry, robots) for entry in agent.locals]
        for module in agent.modules:
            ports = (agent.ports[position] for position in module.ports)
            owned += [(f"{module.name}.{p.shown}", p.declaration, robots) for p in ports]
    for name, entry, robots in owned:
        variable = entry.variable
        if entry.initial is not Start.ARBITRARY:
            continue
        for robot in robots:
            where = (variable.home, variable.slot, robot)
            type_ = variable.own_type
            if candidates(type_, where, found, system.robots, entry.length) is None:
                reason = f"{name} may start with any number of values"
                yield NotFinite(reason, entry.span, name)
                break


def known_starts(system: System) -> Found:
    """The values of arbitrary starts that the assumptions allow.

    About those that INIT writes they say nothing: they hold after it.
    """
    program = system.program
    conditions = [assumption.condition for assumption in program.assumptions]
    found = starts_reader(system).restrictions(conditions)
    set_in_init = {
        (place.variable.home, place.variable.slot, robot)
        for robot, kind in enumerate(system.kinds)
        for statement in statements(program.agents[kind].init)
        for place in written(statement)
    }
    shared = {(home, slot, None) for home, slot, _ in set_in_init if home is Home.ALLWRITE}
    known = set_in_init | shared
    return {where: bounds for where, bounds in found.items() if where[:3] not in known}


# --- sensors --------------------------------------------------------------------------------------


def _sensors(system: System, agent: core.Agent, module: core.Module) -> Iterator[NotFinite]:
    m: Machine[Constant] = machine(EXACT, system, NoOracle(), robot=0)
    reader = _abstract(sensors_reader(m))
    # A contract that promises something only on a condition need not bound anything.
    ensured = [e for c in module.contracts if _is_free(c) for e in c.ensures]
    found = reader.restrictions(ensured)
    for position in module.ports:
        port = agent.ports[position]
        variable = port.declaration.variable
        if port.direction is Direction.SENSOR:
            values = candidates(variable.type, (variable.slot,), found, system.robots)
            if values is None:
                reason = f"{module.name}.{variable.name} may read any number of values"
                yield NotFinite(reason, port.span, f"{module.name}.{port.shown}")


def _is_free(contract: core.Contract) -> bool:
    return all(isinstance(e, core.Const) and e.value is True for e in contract.requires)


def _abstract(reader: StatementReader) -> StatementReader:
    """A reader of statements that treats every number as known, whatever it is."""

    def some(e: core.Expr, bound: Mapping[int, int]) -> Constant | None:
        return 0 if e.type == INT else None

    return StatementReader(reader.kinds, reader.is_open, reader.address, some)


# --- calls ----------------------------------------------------------------------------------------


def _calls(system: System, parts: object) -> Iterator[NotFinite]:
    seen: set[str] = set()
    for part in parts if isinstance(parts, tuple) else ():
        for node in nodes(tuple(part) if isinstance(part, list) else part):
            match node:
                case core.Choose(low=low, high=high, type=type_):
                    if type_ != INT and low != high:
                        yield NotFinite(
                            "choose has infinitely many floats to choose from", node.span
                        )
                case core.ExternalCall(function=name) if name not in seen:
                    seen.add(name)
                    yield from _external(system, system.program.external(name), node.span)
                case _:
                    pass


def _external(system: System, function: core.External, span: Span) -> Iterator[NotFinite]:
    name = function.name
    if function.kind is ExternalKind.FUNCTION:
        yield NotFinite(
            f"{name} is a mathematical function, which no search keeps a table of",
            span,
            name,
        )
        return
    m: Machine[Constant] = machine(EXACT, system, NoOracle(), bound=function.bound)
    found = _abstract(result_reader(m, function.result)).restrictions(function.ensures)
    if candidates(function.result.type, (), found, system.robots) is None:
        yield NotFinite(f"{name} may give any number of answers", span, name)
    for node in nodes((function.requires, function.ensures)):
        match node:
            case core.ExternalCall(function=other):
                yield NotFinite(f"the summary of {name} speaks of {other}", node.span)
            case core.AllValues(type=type_) if not _has_few(type_, system.robots):
                yield NotFinite(f"the summary of {name} speaks of every value of a type", span)
            case _:
                pass


def _has_few(type_: Type, robots: int) -> bool:
    return candidates(type_, (), {}, robots) is not None
