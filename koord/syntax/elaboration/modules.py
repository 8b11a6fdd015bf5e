"""Elaboration of modules: their ports, environments and contracts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec import Struct, field

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.library import PORT_ALIASES, library
from koord.syntax.elaboration.resolve_types import resolve
from koord.syntax.elaboration.starts import initial_value
from koord.syntax.elaboration.symbols import (
    RESERVED,
    AgentScope,
    ModuleScope,
    Poisoned,
    PortNamed,
    PortSymbol,
    StreamSymbol,
)
from koord.syntax.elaboration.variables import common_names, declared_twice, reserved
from koord.syntax.source import Span
from koord.syntax.types import BOOL, STREAM, Type


class _Port(Struct):
    decl: ast.VarDecl
    direction: core.Direction
    own: bool  #: declared by the program, not the library
    spelling: str  #: of its names the one that the program uses


class UsedModule(Struct):
    """A module in use by one kind of robot, its sections merged."""

    name: str
    declared: ast.Ident
    ports: dict[str, _Port] = field(default_factory=dict)
    environment: ast.Block | None = None
    contracts: list[ast.ContractDef] = field(default_factory=list)


def merge(
    session: Elaboration, sections: list[ast.Using], mentioned: Mapping[str, Span]
) -> list[UsedModule]:
    """The modules that one kind of robot uses.

    Ports of library modules that the program neither declares nor mentions are left out: nothing
    can depend on them.
    """
    merged: dict[str, UsedModule] = {}
    for section in sections:
        name = section.module.name
        module = merged.setdefault(name, UsedModule(name, section.module))
        if section.environment is not None:
            if module.environment is not None:
                session.findings.error(
                    "K208",
                    section.span,
                    f"`{name}` has two `environment:` blocks",
                    "put them together",
                )
            module.environment = section.environment
        module.contracts.extend(section.contracts)
        _own_ports(session, module, section.sensors, core.Direction.SENSOR)
        _own_ports(session, module, section.actuators, core.Direction.ACTUATOR)
    for module in merged.values():
        _library_ports(module, mentioned)
    return list(merged.values())


def canonical(module: str, port: str) -> str:
    """The name that a port is kept by."""
    return PORT_ALIASES.get(module, {}).get(port, port)


def _own_ports(
    session: Elaboration,
    module: UsedModule,
    decls: tuple[ast.VarDecl, ...],
    direction: core.Direction,
) -> None:
    for decl in decls:
        name = canonical(module.name, decl.name.name)
        if name in RESERVED:
            reserved(session, decl.name)
        elif name in module.ports:
            declared_twice(session, decl.name, module.ports[name].decl.name)
        elif name != "?":
            module.ports[name] = _Port(decl, direction, own=True, spelling=decl.name.name)


def _library_ports(module: UsedModule, mentioned: Mapping[str, Span]) -> None:
    known = library().modules.get(module.name)
    if known is None:
        return
    aliases = PORT_ALIASES.get(module.name, {})
    own_model = module.environment is not None or module.contracts
    if known.environment is not None and not own_model:
        module.environment = known.environment
    modelled = known.environment is not None and module.environment is known.environment
    for decls, direction in (
        (known.sensors, core.Direction.SENSOR),
        (known.actuators, core.Direction.ACTUATOR),
    ):
        for decl in decls:
            name = decl.name.name
            spellings = {name, *(alias for alias, kept in aliases.items() if kept == name)}
            used = sorted(spellings & mentioned.keys(), key=lambda s: _place(mentioned[s]))
            if name not in module.ports and (modelled or used):
                spelling = used[0] if used else name
                module.ports[name] = _Port(decl, direction, own=False, spelling=spelling)


def _place(span: Span) -> tuple[int, int]:
    return span.line, span.column


def declare_ports(
    session: Elaboration, kinds: Sequence[tuple[AgentScope, Sequence[UsedModule]]]
) -> None:
    """Declare the ports of every kind of robot; common ones come first, in one order."""
    types: dict[int, Type | None] = {}
    per_kind: list[dict[str, Type]] = []
    for scope, modules in kinds:
        found: dict[str, Type] = {}
        for module in modules:
            scope.modules[module.name] = ModuleScope(module.name, module.declared)
            for name, port in module.ports.items():
                if id(port.decl) not in types:
                    types[id(port.decl)] = resolve(
                        BodyScope(session, Where.CONSTANT, None, session.findings), port.decl.type
                    )
                type_ = types[id(port.decl)]
                if type_ is None:
                    _enter(scope, module, name, Poisoned(port.decl.name))
                elif type_ == STREAM:
                    stream = name if name == "stdout" else f"{module.name}.{name}"
                    _enter(scope, module, name, StreamSymbol(stream, module.name, port.decl.name))
                else:
                    found[f"{module.name}.{name}"] = type_
        per_kind.append(found)
    shared = common_names(per_kind)
    for (scope, modules), found in zip(kinds, per_kind, strict=True):
        order = [*shared, *(name for name in found if name not in shared)]
        slots = {name: slot for slot, name in enumerate(order)}
        for module in modules:
            for name, port in module.ports.items():
                slot = slots.get(f"{module.name}.{name}")
                if slot is None:
                    continue
                type_ = found[f"{module.name}.{name}"]
                variable = core.Variable(core.Home.PORT, slot, name, type_)
                symbol = PortSymbol(variable, module.name, port.direction, port.decl.name)
                scope.slots[slot] = symbol
                _enter(scope, module, name, symbol)


def _enter(scope: AgentScope, module: UsedModule, name: str, symbol: PortNamed) -> None:
    aliases = PORT_ALIASES.get(module.name, {})
    for spelling in [name, *(alias for alias, kept in aliases.items() if kept == name)]:
        scope.modules[module.name].ports[spelling] = symbol
        scope.ports.setdefault(spelling, []).append(symbol)


def ports(
    session: Elaboration, scope: AgentScope, modules: Sequence[UsedModule]
) -> tuple[core.Port, ...]:
    """The ports of a kind of robot in the order of their slots."""
    result: list[core.Port] = []
    by_name = {module.name: module for module in modules}
    for slot in sorted(scope.slots):
        symbol = scope.slots[slot]
        port = by_name[symbol.module].ports[symbol.variable.name]
        start = core.Start.UNSET
        if symbol.direction is core.Direction.SENSOR:
            start = core.Start.ARBITRARY
        body = BodyScope(session, Where.INITIAL, scope, session.findings)
        initial = initial_value(body, port.decl, symbol.variable.type, start)
        declaration = core.Declaration(symbol.variable, initial, span=port.decl.span)
        spelling = port.spelling if port.spelling != symbol.variable.name else ""
        result.append(
            core.Port(symbol.module, symbol.direction, declaration, spelling, span=port.decl.span)
        )
    return tuple(result)


def module(session: Elaboration, scope: AgentScope, used: UsedModule) -> core.Module:
    """Elaborate a module: its environment and contracts."""
    positions = tuple(slot for slot in sorted(scope.slots) if scope.slots[slot].module == used.name)
    environment: core.Block | None = None
    bound = 0
    if used.environment is not None:
        body = BodyScope(session, Where.ENVIRONMENT, scope, session.findings, module=used.name)
        environment = body.block(used.environment)
        bound = body.bound
    return core.Module(
        used.name,
        positions,
        environment,
        bound,
        _contracts(session, scope, used),
        span=used.declared.span,
    )


def _contracts(
    session: Elaboration, scope: AgentScope, used: UsedModule
) -> tuple[core.Contract, ...]:
    result: list[core.Contract] = []
    seen: dict[str, ast.Ident] = {}
    for contract in used.contracts:
        name = contract.name.name
        if name in seen:
            session.findings.error(
                "K208",
                contract.name.span,
                f"`{used.name}` has two contracts named `{name}`",
                "choose another name",
                (Note(seen[name].span, "first declared here"),),
            )
        seen[name] = contract.name
        requires, before = _conditions(session, scope, used, contract.requires, Where.REQUIRES)
        ensures, after = _conditions(session, scope, used, contract.ensures, Where.ENSURES)
        bound = max(before, after)
        result.append(core.Contract(name, requires, ensures, bound, span=contract.span))
    return tuple(result)


def _conditions(
    session: Elaboration,
    scope: AgentScope,
    used: UsedModule,
    conditions: tuple[ast.Expr, ...],
    where: Where,
) -> tuple[tuple[core.Expr, ...], int]:
    """Elaborate conditions; return them with the number of bound slots that they need."""
    result: list[core.Expr] = []
    bound = 0
    for condition in conditions:
        body = BodyScope(session, where, scope, session.findings, module=used.name)
        made = fit(body, body.expr(condition, BOOL), BOOL, condition.span, "what a contract says")
        bound = max(bound, body.bound)
        if made is not None:
            result.append(made)
    return tuple(result), bound
