"""Unknown names, and suggestions for them."""

from __future__ import annotations

from typing import assert_never

from msgspec import Struct

from koord.syntax import ast
from koord.syntax.core import Direction
from koord.syntax.elaboration.body import SEES_PID, SEES_PORTS, SEES_VARIABLES, BodyScope, Where
from koord.syntax.elaboration.coercion import POISON, accepts
from koord.syntax.elaboration.literals import field_position
from koord.syntax.elaboration.phrases import did_you_mean, otherwise
from koord.syntax.elaboration.symbols import (
    MemberSymbol,
    Named,
    ParamSymbol,
    Pending,
    Poisoned,
    PortNamed,
    PortSymbol,
    Role,
    StreamSymbol,
    VariableSymbol,
)
from koord.syntax.types import FLOAT, INT, ArrayType, EnumType, RecordType, Type


class _Candidate(Struct, frozen=True):
    """A candidate for a misspelt name: its type, as far as it is known, and its use."""

    type: Type | None = None
    is_writable: bool = False


def unknown(
    body: BodyScope,
    e: ast.Name,
    field: str | None = None,
    expected: Type | None = None,
    *,
    is_written: bool = False,
) -> None:
    """Report an unknown name with suggestions: once for each name.

    What would be another mistake in its place is no guess: where a value of the ``expected`` type
    has to stand, a part called ``field``, or something that can be written.
    """
    if body.is_told("K201", e.name, e.span):
        return
    hint = _element_hint(body, e.name, field)
    for module, ports in body.session.library_ports.items():
        if hint is None and e.name in ports:
            hint = f"`{e.name}` is a port of `{module}`: begin the program with `using {module}`"
    fitting = [
        name
        for name, one in _visible(body).items()
        if (one.is_writable or not is_written)
        and (one.type is None or (_fits(one.type, expected) and _has(one.type, field)))
    ]
    hint = hint or otherwise(e.name) or did_you_mean(e.name, fitting)
    if hint is None and field is not None:
        hint = f"if `{e.name}` is a module, begin the program with `using {e.name}:`"
    body.error("K201", e.span, f"`{e.name}` is not declared", hint)


def _fits(given: Type, expected: Type | None) -> bool:
    if expected is None or expected == POISON:
        return True
    return accepts(expected, given) or (expected == FLOAT and given == INT)


def _has(given: Type, field: str | None) -> bool:
    """Return whether a value of a type has a part of that name, or no part is asked for."""
    if field is None:
        return True
    if isinstance(given, ArrayType):  # of all robots the own entry may be meant
        given = given.element
    return isinstance(given, RecordType) and field_position(given, field) is not None


def _element_hint(body: BodyScope, wanted: str, field: str | None) -> str | None:
    """In a loop over a list of records, a name like that of the record may mean the element."""
    for loop in reversed(body.loops):
        element = loop.element
        if loop.over is None or not isinstance(loop.over, ast.Name):
            continue
        named = getattr(element, "name", None)
        if named is None or element is None or isinstance(element, EnumType):
            continue
        fits = named.lower() == wanted.lower()
        if fits and loop.by_position:
            access = f"{loop.over.name}[{loop.variable}]"
            shown = f"{access}.{field}" if field else access
            return f"the element that the loop is at is `{shown}`"
        if fits:
            shown = f"{loop.variable}.{field}" if field else loop.variable
            return f"the element that the loop is at is `{shown}`"
    return None


def _visible(body: BodyScope) -> dict[str, _Candidate]:
    """The names that could stand here. The type of an ambiguous name is unknown."""
    session, found = body.session, dict[str, _Candidate]()

    def add(name: str, candidate: _Candidate) -> None:
        found[name] = candidate if name not in found else _Candidate(is_writable=True)

    sees_variables = body.where in SEES_VARIABLES
    for name, member in session.types.members.items():
        add(name, _Candidate(member[0].type if len(member) == 1 else None))
    for name, symbol in session.shared.items():
        if sees_variables or _is_constant(symbol):
            add(name, _candidate(symbol))
    for agent in [body.agent] if body.agent else session.agents:
        if sees_variables:
            for name, symbol in agent.variables.items():
                add(name, _candidate(symbol))
        if body.where in SEES_PORTS:
            for name, ports in agent.ports.items():
                for port in ports:
                    add(name, _of_port(body, port))
            for module in agent.modules:
                for name in session.library_ports.get(module, ()):
                    found.setdefault(name, _Candidate(is_writable=True))
    for frame in body.frames:
        for name, bound in frame.items():
            variable = bound.variable
            if variable is not None:
                found[name] = _Candidate(variable.type, bound.role is Role.LOCAL)
    if body.where in SEES_PID:
        found["pid"] = _Candidate(INT)
    if body.where is not Where.CONSTANT:
        found |= {"numAgents": _Candidate(INT), "delta": _Candidate(FLOAT)}
    return found


def _candidate(symbol: Named) -> _Candidate:
    match symbol:
        case VariableSymbol(variable=variable):
            return _Candidate(variable.type, is_writable=True)
        case ParamSymbol(value=value):
            return _Candidate(None if value is None else value.type)
        case MemberSymbol(type=type_):
            return _Candidate(type_)
        case Poisoned() | Pending():
            return _Candidate(is_writable=not isinstance(symbol, Pending) or not symbol.is_param)
    assert_never(symbol)


def _of_port(body: BodyScope, port: PortNamed) -> _Candidate:
    match port:
        case PortSymbol(variable=variable, direction=direction):
            inside = body.where is Where.ENVIRONMENT
            written = Direction.SENSOR if inside else Direction.ACTUATOR
            return _Candidate(variable.type, direction is written)
        case StreamSymbol():
            return _Candidate(POISON)  # it is neither read nor assigned
        case Poisoned():
            return _Candidate(is_writable=True)
    assert_never(port)


def _is_constant(found: Named) -> bool:
    """Return whether a name stands for the same value everywhere."""
    return isinstance(found, ParamSymbol | MemberSymbol) or (
        isinstance(found, Pending) and found.is_param
    )


def out_of_reach(body: BodyScope, e: ast.Expr, what: str) -> None:
    match body.where:
        case Where.FUNCTION | Where.SUMMARY | Where.SUMMARY_REQUIRES:
            body.error(
                "K224",
                e.span,
                f"a function knows its parameters only, not {what}",
                "pass it as an argument",
            )
        case Where.ENVIRONMENT:
            body.error(
                "K239",
                e.span,
                f"an `environment:` block knows ports only, not {what}",
                "let the program write what the environment needs to an actuator",
            )
        case Where.REQUIRES | Where.ENSURES:
            body.error(
                "K307",
                e.span,
                f"a contract speaks of ports only, not of {what}",
                "say it in an `invariant`",
            )
        case Where.CONSTANT:
            body.error("K226", e.span, f"{what} is not known before the run", "use a `param`")
        case _:
            body.error(
                "K226",
                e.span,
                f"an initial value cannot use {what}",
                "assign it in `init:`",
            )
