"""Name resolution: the meaning of a bare name in its context."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import ast, core
from koord.syntax.diagnostics import Edit
from koord.syntax.elaboration.body import (
    CLOSED,
    CONTRACT,
    SEES_PID,
    SEES_PORTS,
    SEES_VARIABLES,
    BodyScope,
    Where,
)
from koord.syntax.elaboration.coercion import POISON
from koord.syntax.elaboration.phrases import listed
from koord.syntax.elaboration.recorder import HOLE, OwnName
from koord.syntax.elaboration.resolve_types import element_of
from koord.syntax.elaboration.symbols import (
    AgentScope,
    MemberSymbol,
    Named,
    ParamSymbol,
    Pending,
    Poisoned,
    PortNamed,
    PortSymbol,
    StreamSymbol,
    VariableSymbol,
)
from koord.syntax.source import Span
from koord.syntax.types import FLOAT, INT, Type
from koord.syntax.vocabulary import OWN_NAMES

#: The double nearest to π.
_PI = Fraction("3.141592653589793")

#: What a name can stand for: a place, a value, or nothing (told by then).
Meaning = core.Place | core.Expr | None


def name(body: BodyScope, e: ast.Name, expected: Type | None) -> Meaning:
    """Resolve a name."""
    bound = body.lookup(e.name)
    if bound is not None:
        body.note(e.span, bound)
        return None if bound.variable is None else core.Place(bound.variable, span=e.span)
    found, agent = _declared(body, e)
    if found is not None:
        body.note(e.span, found)
        return _symbol(body, e, found, agent)
    ports = _ports(body, e.name)
    if ports:
        return _unqualified(body, e, ports)
    members = body.session.member(e.name)
    if members:
        return _member(body, e, members, expected)
    return _special(body, e, expected)


def _declared(body: BodyScope, e: ast.Name) -> tuple[Named | None, AgentScope | None]:
    """Resolve a declared variable, constant or param."""
    session = body.session
    if e.name in session.shared:
        return session.shared[e.name], None
    agent = _context(body)
    if agent is not None:
        found = agent.variables.get(e.name)
        return found, agent
    owners = [scope for scope in session.agents if e.name in scope.variables]
    return (owners[0].variables[e.name], owners[0]) if owners else (None, None)


def _context(body: BodyScope) -> AgentScope | None:
    """The kind of robot whose names are meant, if it is one kind."""
    if body.robot is not None:
        kind = body.robot.kind
        return None if kind is None else body.session.agents[kind]
    return body.agent


def _symbol(body: BodyScope, e: ast.Name, found: Named, agent: AgentScope | None) -> Meaning:
    body.session.mark_used(found.declared)
    match found:
        case Poisoned():
            return None
        case Pending(is_param=True):
            body.error(
                "K226",
                e.span,
                f"the param `{e.name}` has no value yet here",
                "declare it above what uses it",
            )
            return None
        case Pending():
            from koord.syntax.elaboration.unknown_names import out_of_reach

            out_of_reach(body, e, f"the variable `{e.name}`")
            return None
        case ParamSymbol(value=value):
            return None if value is None else _placed(value, e.span)
        case MemberSymbol(type=type_, position=position):
            return core.Const(position, type_, span=e.span)
        case VariableSymbol(variable=variable):
            return _variable(body, e, variable, agent)


def _placed(value: core.Expr, span: Span) -> core.Expr:
    match value:
        case core.Const(value=constant, type=type_):
            return core.Const(constant, type_, span=span)
        case _:
            return value


def _variable(
    body: BodyScope, e: ast.Name, variable: core.Variable, agent: AgentScope | None
) -> Meaning:
    if body.where not in SEES_VARIABLES:
        from koord.syntax.elaboration.unknown_names import out_of_reach

        out_of_reach(body, e, f"the variable `{e.name}`")
        return None
    if variable.home is not core.Home.LOCAL:
        if variable.home is core.Home.ALLWRITE:
            body.shared_reads.add(variable.slot)
        return core.Place(variable, span=e.span)
    if not _common(body, e, variable, agent):
        return None
    return core.Place(variable, robot=_robot(body, e.span), span=e.span)


def _common(
    body: BodyScope, e: ast.Expr, variable: core.Variable, agent: AgentScope | None
) -> bool:
    """Return whether every robot that may be meant has the variable; reported if not."""
    if body.where not in CLOSED or _context(body) is not None or body.session.single:
        return True
    lacking = []
    for scope in body.session.agents:
        other: Named | PortNamed | None = scope.variables.get(variable.name)
        if variable.home is core.Home.PORT:
            candidates = scope.ports.get(variable.name, [])
            other = candidates[0] if candidates else None
        if not isinstance(other, VariableSymbol | PortSymbol) or other.variable != variable:
            lacking.append(scope.name)
    if not lacking:
        return True
    owner = agent.name if agent else "Kind"
    body.error(
        "K243",
        e.span,
        f"robots of kind {listed(lacking)} have no `{variable.name}` of this type",
        f"say which robots are meant: `forall {owner} i: … {variable.name}@i …`",
    )
    return False


def _robot(body: BodyScope, span: Span) -> core.Expr | None:
    """The robot whose local or port is meant: None for the one that runs."""
    if body.robot is not None:
        body.robot.used = True
        return body.robot.expr
    if body.where in CLOSED:
        return core.Read(core.Place(body.pid(), span=span), span=span)
    return None


def _ports(body: BodyScope, wanted: str) -> list[PortNamed]:
    agent = _context(body)
    if agent is not None:
        found = agent.ports.get(wanted, [])
        own = [port for port in found if _module(port) == body.module]
        return own if body.module and own else found
    for scope in body.session.agents:
        if wanted in scope.ports:
            return scope.ports[wanted]
    return []


def _module(port: PortNamed) -> str | None:
    return None if isinstance(port, Poisoned) else port.module


def _unqualified(body: BodyScope, e: ast.Name, ports: list[PortNamed]) -> Meaning:
    body.note(e.span, ports[0])
    if len(ports) > 1:
        modules = [port.module for port in ports if not isinstance(port, Poisoned)]
        body.error(
            "K210",
            e.span,
            f"`{e.name}` is a port of {listed(modules)}",
            f"write `{modules[0]}.{e.name}`" if modules else None,
        )
        return None
    return port_place(body, e, ports[0])


def port_place(body: BodyScope, e: ast.Expr, port: PortNamed) -> Meaning:
    """The place of a port that was found."""
    match port:
        case Poisoned():
            return None
        case StreamSymbol(stream=stream):
            body.error(
                "K238", e.span, f"`{stream}` is a stream: it is written with `<<` and never read"
            )
            return None
        case PortSymbol(variable=variable):
            if body.where not in SEES_PORTS:
                from koord.syntax.elaboration.unknown_names import out_of_reach

                out_of_reach(body, e, f"the port `{variable.name}`")
                return None
            if not _common(body, e, variable, _owner(body, variable.name)):
                return None
            return core.Place(variable, robot=_robot(body, e.span), primed=body.primed, span=e.span)


def _owner(body: BodyScope, port: str) -> AgentScope | None:
    return next((scope for scope in body.session.agents if port in scope.ports), None)


def _member(
    body: BodyScope, e: ast.Name, members: list[MemberSymbol], expected: Type | None
) -> Meaning:
    if len(members) > 1 and expected == POISON:
        return None
    if len(members) > 1:
        wanted = [member for member in members if member.type == expected]
        if not wanted:
            enums = [member.type.name for member in members]
            body.error(
                "K210",
                e.span,
                f"`{e.name}` is a member of {listed(enums)}",
                f"write `{enums[0]}.{e.name}`",
            )
            return None
        members = wanted
    member = members[0]
    body.note(e.span, member)
    return core.Const(member.position, member.type, span=e.span)


def _special(body: BodyScope, e: ast.Name, expected: Type | None) -> Meaning:
    if e.name == HOLE:
        from koord.syntax.elaboration.candidates import fill

        fill(body, expected)
    elif e.name in OWN_NAMES:
        body.note(e.span, OwnName(e.name))
    match e.name:
        case "pid":
            return _pid(body, e)
        case "numAgents" | "Nsys":
            return core.NumAgents(INT, span=e.span)
        case "numBots" if not body.session.partial:  # [OLD-NAME]
            was = "`numBots` is the old name of `numAgents`"
            cure = "write `numAgents`"
            body.findings.old("numBots", e.span, was, cure, Edit(e.span, "numAgents"))
            return core.NumAgents(INT, span=e.span)
        case "delta":
            return core.Delta(FLOAT, span=e.span)
        case "pi":
            return core.Const(_PI, FLOAT, span=e.span)
        case "stopped" if body.where in CLOSED:
            robot = _robot(body, e.span)
            return None if robot is None else core.Stopped(robot, span=e.span)
        case _:
            if not body.session.partial:
                from koord.syntax.elaboration.unknown_names import unknown

                unknown(body, e, expected=expected)
            return None


def _pid(body: BodyScope, e: ast.Name) -> Meaning:
    if body.where in CLOSED:
        if body.robot is not None:
            body.robot.used = True
            return body.robot.expr
        return core.Place(body.pid(), span=e.span)
    if body.where in SEES_PID:
        if body.where in CONTRACT and body.robot is not None:
            body.robot.used = True
            return body.robot.expr
        return core.Pid(INT, span=e.span)
    if body.where is Where.SHARED_INITIAL:
        body.error(
            "K226",
            e.span,
            "an `allwrite` variable is one for all robots: its initial value cannot use `pid`",
            "declare it under `allread:`, or assign it in `init:`",
        )
    else:
        from koord.syntax.elaboration.unknown_names import out_of_reach

        out_of_reach(body, e, "`pid`")
    return None


def robot_entry(body: BodyScope, found: core.Place, e: ast.Expr) -> core.Place:
    """Elaborate ``x@i``, which is ``x[i]`` for an allread ``x``."""
    assert body.robot is not None
    element = element_of(found.variable.type)
    assert element is not None
    body.robot.used = True
    step = core.IndexStep(body.robot.expr, element, span=e.span)
    return core.Place(found.variable, (step,), span=e.span)
