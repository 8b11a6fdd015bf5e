"""Elaboration of a program: names first, then bodies, then the whole with its lock classes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import ast, core
from koord.syntax.analysis.limits import excesses
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration import (
    cautions,
    declared_types,
    functions,
    instance,
    modules,
    properties,
    starts,
    variables,
)
from koord.syntax.elaboration.body import AtomicBlock, BodyScope, Elaboration, Where
from koord.syntax.elaboration.cautions import lost_updates, never_enabled
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.library import library_ports, mentioned
from koord.syntax.elaboration.operators import expression
from koord.syntax.elaboration.recorder import Recorder
from koord.syntax.elaboration.sections import AgentSections, Sections, sort
from koord.syntax.elaboration.settings import Elaborated, Settings
from koord.syntax.elaboration.starts import assumed
from koord.syntax.elaboration.statements import block
from koord.syntax.elaboration.symbols import AgentScope, FunctionTable, Named, VariableSymbol
from koord.syntax.source import NOWHERE
from koord.syntax.types import BOOL
from koord.syntax.walk import nodes, with_blocks


def lock_classes(
    blocks: Iterable[AtomicBlock],
) -> tuple[tuple[core.LockClass, ...], dict[int, int]]:
    """The classes, in order of their first block, and the class of each block."""
    ordered = sorted(blocks, key=lambda atomic: atomic.number)
    parent = {atomic.number: atomic.number for atomic in ordered}

    def root(number: int) -> int:
        while parent[number] != number:
            parent[number] = parent[parent[number]]
            number = parent[number]
        return number

    writer: dict[int, int] = {}
    for atomic in ordered:
        for slot in atomic.writes:
            one, other = sorted((root(writer.setdefault(slot, atomic.number)), root(atomic.number)))
            parent[other] = one
    roots = sorted({root(atomic.number) for atomic in ordered})
    index = {number: position for position, number in enumerate(roots)}
    class_of = {atomic.number: index[root(atomic.number)] for atomic in ordered}
    names: list[dict[int, str]] = [{} for _ in roots]
    for atomic in ordered:
        for slot, variable in atomic.writes.items():
            names[class_of[atomic.number]][slot] = variable.name
    classes = tuple(
        core.LockClass(position, tuple(known[slot] for slot in sorted(known)))
        for position, known in enumerate(names)
    )
    return classes, class_of


def classified(
    blocks: Iterable[AtomicBlock], agents: list[core.Agent]
) -> tuple[tuple[core.LockClass, ...], list[core.Agent]]:
    """The lock classes, and the agents with them in place of the numbers of atomic blocks."""
    classes, class_of = lock_classes(blocks)
    if not classes:
        return classes, agents
    return classes, [
        replace(agent, events=tuple(_event(event, class_of) for event in agent.events))
        for agent in agents
    ]


def _event(event: core.Event, class_of: dict[int, int]) -> core.Event:
    entered: set[int] = set()
    effect = relabelled(event.effect, class_of, entered)
    return replace(event, effect=effect, lock_classes=frozenset(entered)) if entered else event


def relabelled(block: core.Block, class_of: dict[int, int], entered: set[int]) -> core.Block:
    """The statements with lock classes in place of the numbers of blocks."""

    def inner(block: core.Block) -> core.Block:
        return tuple(with_blocks(relabel(s), inner) for s in block)

    def relabel(s: core.Stmt) -> core.Stmt:
        if not isinstance(s, core.Atomic):
            return s
        entered.add(class_of[s.lock_class])
        return replace(s, lock_class=class_of[s.lock_class])

    return inner(block)


def name_events(session: Elaboration, scope: AgentScope, events: list[ast.Event]) -> None:
    """Assign the events their positions."""
    for position, event in enumerate(events):
        name = event.name.name
        if name in scope.events and name != "?":
            first = events[scope.events[name]].name
            session.findings.error(
                "K208",
                event.name.span,
                f"there are two events named `{name}`",
                "choose another name",
                (Note(first.span, "first declared here"),),
            )
        scope.events.setdefault(name, position)


def event(session: Elaboration, scope: AgentScope, section: ast.Event) -> core.Event:
    """Elaborate an event. Its lock classes are still numbers of atomic blocks."""
    body = BodyScope(session, Where.GUARD, scope, session.findings)
    guard: core.Expr = core.Const(True, BOOL, span=section.name.span)
    if section.pre is not None:
        found = fit(body, body.expr(section.pre, BOOL), BOOL, section.pre.span, "a guard")
        if found is not None:
            guard = found
            never_enabled(session, section, guard)
    body.where = Where.EFFECT
    guarded = frozenset(body.shared_reads)
    body.shared_reads.clear()
    effect = body.block(section.eff)
    lost_updates(body, guarded, effect)
    return core.Event(
        section.name.name,
        section.urgent,
        guard,
        effect,
        body.bound,
        frozenset(),
        span=section.span,
    )


def initialisation(
    session: Elaboration, scope: AgentScope, sections: list[ast.Init]
) -> tuple[core.Block, int]:
    """Elaborate INIT: its block, and the number of bound slots that it needs."""
    body = BodyScope(session, Where.INIT, scope, session.findings)
    statements: list[core.Stmt] = []
    for section in sections:
        statements.extend(body.block(section.body))
    return tuple(statements), body.bound


_DEFAULTS = Settings()


def elaborate(
    program: ast.Program, settings: Settings = _DEFAULTS, recorder: Recorder | None = None
) -> Elaborated:
    """Elaborate a tree to a core program, with errors and warnings.

    A ``recorder`` is told what names mean.

    A tree that holds properties alone is checked as far as that goes, and gives no program.
    """
    findings = DiagnosticLog()
    sections = sort(program.sections, findings)
    session = Elaboration(settings, findings, expression, block, FunctionTable())
    session.library_ports = library_ports()
    if recorder is not None:
        session.recorder, recorder.program = recorder, program
        recorder.functions = session.functions
    session.partial = sections.only_properties
    session.whole = program.span
    if sections.is_empty:
        findings.warning(
            "K405", program.span, "the program is empty", "declare variables and events"
        )
    robots = [
        _Robots(AgentScope(index, kind.name), kind) for index, kind in enumerate(_kinds(sections))
    ]
    session.agents = [each.scope for each in robots]
    _declare(session, sections, robots, program)
    made = _define(session, sections, robots, program)
    cautions.missing_functions(session)
    if findings.errors or session.partial:
        return Elaborated(None, findings.in_order())
    # One robot of each kind: what is too much for them is too much for all.
    found = excesses(made, range(len(made.agents)))
    for excess in found:
        findings.error(excess.code, excess.span, excess.message, excess.hint)
    return Elaborated(None if found else made, findings.in_order())


class _Robots(Struct):
    """One kind of robot: its names, and its sections."""

    scope: AgentScope
    kind: AgentSections
    modules: tuple[modules.UsedModule, ...] = ()


def _kinds(sections: Sections) -> list[AgentSections]:
    """The kinds of robot. Sections outside of `agent` blocks are for all of them."""
    common = sections.common
    if not sections.kinds:
        return [common]
    return [
        AgentSections(
            kind.name,
            kind.declared,
            [*common.locals, *kind.locals],
            [*common.using, *kind.using],
            [*common.init, *kind.init],
            [*common.events, *kind.events],
            kind.assumptions,
            kind.expectations,
            kind.properties,
        )
        for kind in sections.kinds
    ]


def _declare(
    session: Elaboration, sections: Sections, robots: list[_Robots], program: ast.Program
) -> None:
    """Declare every name."""
    declared_types.declare_types(session, sections.enums, sections.records)
    variables.enter_names(session, _entries(session, sections, robots))
    session.parameters = variables.declare_params(session, sections.params)
    variables.declare_shared(session, sections.allread, sections.allwrite)
    variables.declare_locals(session, [(each.scope, each.kind.locals) for each in robots])
    uses_library = any(
        section.module.name in session.library_ports
        for each in robots
        for section in each.kind.using
    )
    names = mentioned(program, _variables(session, robots)) if uses_library else {}
    for each in robots:
        each.modules = tuple(modules.merge(session, each.kind.using, names))
    modules.declare_ports(session, [(each.scope, each.modules) for each in robots])
    functions.declare_functions(session, sections.functions)
    declared_types.check_defaults(session, sections.records)
    for each in robots:
        name_events(session, each.scope, each.kind.events)


def _variables(session: Elaboration, robots: list[_Robots]) -> frozenset[str]:
    """The names that are variables of every kind of robot."""
    scopes = [frozenset(each.scope.variables) for each in robots]
    return frozenset(session.shared) | frozenset.intersection(*scopes)


def _entries(
    session: Elaboration, sections: Sections, robots: list[_Robots]
) -> Iterator[variables.ScopedDeclaration]:
    """Every declaration of a variable or param."""
    for decl in sections.params:
        yield variables.ScopedDeclaration(decl, (session.shared,), is_param=True)
    for decl in (*sections.allread, *sections.allwrite):
        yield variables.ScopedDeclaration(decl, (session.shared,))
    scopes: dict[int, tuple[ast.VarDecl, list[dict[str, Named]]]] = {}
    for each in robots:
        for decl in each.kind.locals:
            scopes.setdefault(id(decl), (decl, []))[1].append(each.scope.variables)
    for decl, found in scopes.values():
        yield variables.ScopedDeclaration(decl, tuple(found))


def _define(
    session: Elaboration, sections: Sections, robots: list[_Robots], program: ast.Program
) -> core.Program:
    """Elaborate every body, and assemble the program."""
    allwrite = _shared(session, sections.allwrite, Where.SHARED_INITIAL)
    allread = _shared(session, sections.allread, Where.INITIAL)
    agents = [_agent(session, each) for each in robots]
    assumptions = _assumptions(session, sections)
    expectations = _expectations(session, sections)
    stated = _properties(session, sections)
    functions.define_functions(session)
    ordered = functions.in_order(session)
    functions.check_logical_calls(session)
    externals = tuple(made for made in ordered if isinstance(made, core.External))
    cautions.contradictions(session, agents, assumptions, externals)
    cautions.confused(session)
    if not session.partial:
        cautions.unused(session, [session.shared, *(each.scope.variables for each in robots)])
    starts.check_tasks(allwrite, session.settings, session.findings)
    classes, agents = classified(session.atomic_blocks.values(), agents)
    if session.recorder is not None:
        _record_locks(session.recorder, classes, agents)
    known = assumed(assumptions, len(agents))
    made = core.Program(
        _stem(program.span.file),
        tuple(starts.agent(each, number, known) for number, each in enumerate(agents)),
        starts.settle(allread, None, known, session.settings),
        starts.settle(allwrite, None, known, session.settings),
        tuple(made for made in ordered if isinstance(made, core.Function)),
        externals,
        classes,
        assumptions,
        stated,
        session.parameters,
        expectations,
        instance.instance(session, sections),
        session.settings.tasks if _starts_with_tasks(session, allwrite) else None,
        span=program.span,
    )
    if not session.partial and not session.findings.errors:
        cautions.never_set(session, made)
    return made


def _record_locks(
    recorder: Recorder, classes: tuple[core.LockClass, ...], agents: list[core.Agent]
) -> None:
    """Tell an editor which class each block of ``atomic`` locks."""
    for agent in agents:
        for event in agent.events:
            for node in nodes(event.effect):
                if isinstance(node, core.Atomic):
                    recorder.locked[node.span] = classes[node.lock_class]


def _starts_with_tasks(session: Elaboration, allwrite: tuple[core.Declaration, ...]) -> bool:
    """Return whether a variable starts with the world's tasks."""
    cautions = (d for d in allwrite if d.initial is core.Start.UNSET)
    return any(starts.tasks(d.variable, session.settings) is not None for d in cautions)


def _shared(
    session: Elaboration, decls: list[ast.VarDecl], where: Where
) -> tuple[core.Declaration, ...]:
    result = []
    for decl in decls:
        symbol = session.shared.get(decl.name.name)
        if not isinstance(symbol, VariableSymbol) or symbol.declared is not decl.name:
            continue
        type_ = symbol.variable.own_type
        body = BodyScope(session, where, None, session.findings)
        initial = starts.initial_value(body, decl, type_, core.Start.UNSET)
        result.append(core.Declaration(symbol.variable, initial, span=decl.span))
    return tuple(result)


def _agent(session: Elaboration, robots: _Robots) -> core.Agent:
    scope = robots.scope
    init, init_bound = initialisation(session, scope, robots.kind.init)
    return core.Agent(
        scope.name,
        _locals(session, robots),
        modules.ports(session, scope, robots.modules),
        tuple(modules.module(session, scope, used) for used in robots.modules),
        init,
        init_bound,
        tuple(event(session, scope, section) for section in robots.kind.events),
        span=robots.kind.declared.span if robots.kind.declared else NOWHERE,
    )


def _locals(session: Elaboration, robots: _Robots) -> tuple[core.Declaration, ...]:
    by_slot: dict[int, core.Declaration] = {}
    for decl in robots.kind.locals:
        symbol = robots.scope.variables.get(decl.name.name)
        if not isinstance(symbol, VariableSymbol) or symbol.declared is not decl.name:
            continue
        body = BodyScope(session, Where.INITIAL, robots.scope, session.findings)
        initial = starts.initial_value(body, decl, symbol.variable.type, core.Start.UNSET)
        declaration = core.Declaration(symbol.variable, initial, span=decl.span)
        by_slot[symbol.variable.slot] = declaration
    return tuple(by_slot[slot] for slot in sorted(by_slot))


def _sources(sections: Sections) -> list[tuple[int | None, AgentSections]]:
    """Sections with assumptions and properties: outside of kinds first, then in each kind."""
    inside = [(number, kind) for number, kind in enumerate(sections.kinds)]
    return [(None, sections.common), *inside]


def _assumptions(session: Elaboration, sections: Sections) -> tuple[core.Assumption, ...]:
    result: list[core.Assumption | None] = []
    for kind, source in _sources(sections):
        for section in source.assumptions:
            number = len(result) + 1
            result.append(properties.assumption(session, section, number, kind))
    return tuple(made for made in result if made is not None)


def _expectations(session: Elaboration, sections: Sections) -> tuple[core.Property, ...]:
    result: list[core.Property | None] = []
    for kind, source in _sources(sections):
        for section in source.expectations:
            name = section.name.name if section.name else f"leadsto_{len(result) + 1}"
            result.append(properties.property_(session, section, name, kind))
    return tuple(made for made in result if made is not None)


def _properties(session: Elaboration, sections: Sections) -> tuple[core.Property, ...]:
    stated = [
        (kind, section) for kind, source in _sources(sections) for section in source.properties
    ]
    named = properties.names(session, [section for _, section in stated])
    made = [
        properties.property_(session, section, name, kind)
        for (kind, section), name in zip(stated, named, strict=True)
    ]
    return tuple(property_ for property_ in made if property_ is not None)


def _stem(path: str) -> str:
    """The name of a file without its suffix, as pathlib has it, which takes a while to load."""
    name = os.path.basename(path)
    at = name.rfind(".")
    return name[:at] if 0 < at < len(name) - 1 else name
