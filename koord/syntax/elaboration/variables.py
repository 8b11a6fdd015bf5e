"""Elaboration of params and variables: names, homes, slots."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct

from koord.syntax import ast, core
from koord.syntax.diagnostics import Edit, Note
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.params import param_value, text_value
from koord.syntax.elaboration.phrases import did_you_mean
from koord.syntax.elaboration.resolve_types import resolve
from koord.syntax.elaboration.sections import ARGUMENTS
from koord.syntax.elaboration.symbols import (
    RESERVED,
    AgentScope,
    Named,
    ParamSymbol,
    Pending,
    Poisoned,
    VariableSymbol,
)
from koord.syntax.literals import ParamValue
from koord.syntax.source import whole_file
from koord.syntax.types import STREAM, ArrayType, EnumType, ListType, Robots, Type, show


class ScopedDeclaration(Struct, frozen=True):
    """A declaration, and the scopes that it enters: those of some kinds of robot, or all."""

    decl: ast.VarDecl
    scopes: tuple[dict[str, Named], ...]
    is_param: bool = False


def enter_names(session: Elaboration, entries: Iterable[ScopedDeclaration]) -> None:
    """Declare all names in the order of the text. One that is declared twice is poisoned."""
    for entry in sorted(entries, key=lambda entry: _place(entry.decl.name)):
        name = entry.decl.name
        if name.name == "?":
            continue
        first = _known(session, entry)
        if name.name in RESERVED:
            reserved(session, name)
        elif first is not None:
            declared_twice(session, name, first)
            session.ambiguous.add(name.name)
        for scope in entry.scopes:
            if name.name in RESERVED or first is not None:
                scope[name.name] = Poisoned(name)
            else:
                scope[name.name] = Pending(name, entry.is_param)
        if first is not None and name.name in session.shared:
            session.shared[name.name] = Poisoned(name)


def _place(name: ast.Ident) -> tuple[str, int, int]:
    return name.span.file, name.span.line, name.span.column


def _known(session: Elaboration, entry: ScopedDeclaration) -> ast.Ident | None:
    name = entry.decl.name.name
    everywhere = any(scope is session.shared for scope in entry.scopes)
    inner = [agent.variables for agent in session.agents] if everywhere else list(entry.scopes)
    for scope in (session.shared, *inner):
        if name in scope:
            return scope[name].declared
    members = session.member(name)
    return members[0].declared if members else None


def is_pending(scope: dict[str, Named], decl: ast.VarDecl) -> bool:
    """Return whether the name is declared here, and not yet resolved."""
    found = scope.get(decl.name.name)
    return isinstance(found, Pending) and found.declared is decl.name


def reserved(session: Elaboration, name: ast.Ident) -> None:
    """Report that a name is reserved."""
    session.findings.error(
        "K209",
        name.span,
        f"`{name.name}` is the language's own name, and has a meaning everywhere",
        "choose another name",
    )


def declared_twice(session: Elaboration, name: ast.Ident, first: ast.Ident) -> None:
    """Report that a name is taken."""
    session.findings.error(
        "K208",
        name.span,
        f"`{name.name}` is declared already",
        "choose another name, or leave one of the declarations out",
        (Note(first.span, "first declared here"),),
    )


def declare_params(session: Elaboration, decls: list[ast.VarDecl]) -> tuple[core.Parameter, ...]:
    """Declare the params, with their values from the settings."""
    used: list[core.Parameter] = []
    for decl in decls:
        if not is_pending(session.shared, decl):
            continue
        value = param_value(session, decl)
        session.shared[decl.name.name] = ParamSymbol(value, decl.name)
        if value is not None:
            is_set = decl.name.name in session.settings.params
            written = text_value(session, decl) if is_set else value
            own = None if written is None else plain(written)
            used.append(core.Parameter(decl.name.name, plain(value), own))
    for name in session.settings.params:
        place = session.settings.places.get(name) or whole_file("<params>")
        if name in ARGUMENTS:
            session.findings.error(
                "K236",
                place,
                f"`{name}` is of the run, and no `param` of the program",
                f"say it with `{ARGUMENTS[name]}`",
            )
        elif not isinstance(session.shared.get(name), ParamSymbol) and not session.partial:
            known = [decl.name.name for decl in decls]
            hint = did_you_mean(name, known) or f"declare it: `param int {name} = …`"
            session.findings.error(
                "K236",
                place,
                f"the program has no `param` named `{name}`",
                hint,
            )
    return tuple(used)


def plain(value: core.Expr) -> ParamValue:
    """A setting as a plain constant."""
    match value:
        case core.Const(value=int() as position, type=EnumType(members=members)):
            return members[position]
        case core.Const(value=constant):
            return constant
        case core.MakeList(items=items):
            return tuple(plain(item) for item in items)
        case core.MakeRecord(fields=fields):
            return tuple(plain(field) for field in fields)
        case _:
            raise AssertionError(f"{value!r} is no value of a param")


def variable_type(session: Elaboration, decl: ast.VarDecl) -> Type | None:
    """The type of a variable."""
    body = BodyScope(session, Where.CONSTANT, None, session.findings)
    type_ = resolve(body, decl.type)
    if type_ == STREAM:
        session.findings.error(
            "K238",
            decl.span,
            "a stream is a port of a module, not a variable",
            "write to `stdout`, or declare it under `actuators:` of a module",
        )
        return None
    return type_


def declare_shared(
    session: Elaboration, allread: list[ast.VarDecl], allwrite: list[ast.VarDecl]
) -> None:
    """Declare the shared variables."""
    _declare(session, core.Home.ALLWRITE, allwrite)
    _declare(session, core.Home.ALLREAD, allread)


def _declare(session: Elaboration, home: core.Home, decls: Iterable[ast.VarDecl]) -> None:
    slot = 0
    for decl in decls:
        if not is_pending(session.shared, decl):
            continue
        type_ = variable_type(session, decl)
        if home is core.Home.ALLREAD and type_ is not None:
            type_ = _per_robot(session, decl, type_)
        if type_ is None:
            session.shared[decl.name.name] = Poisoned(decl.name)
            continue
        variable = core.Variable(home, slot, decl.name.name, type_)
        session.shared[decl.name.name] = VariableSymbol(variable, decl.name, decl.type.span)
        slot += 1


def _per_robot(session: Elaboration, decl: ast.VarDecl, type_: Type) -> Type | None:
    """The type of an allread variable: an array with one element per robot."""
    match type_:
        case ListType(element=element) | ArrayType(element=element, size=Robots.ALL):
            return ArrayType(element, Robots.ALL)
        case ArrayType(element=ArrayType(element=element, size=Robots.ALL), size=size):
            message = "the last brackets of an `allread` variable are those of the robots"
            meant = show(ArrayType(ArrayType(element, size), Robots.ALL))
            cure = f"write `{meant} {decl.name.name}`"
        case ArrayType(element=element):
            message = "an `allread` variable has as many entries as there are robots"
            own = show(type_)
            cure = f"write `{own}[] {decl.name.name}`: one `{own}` for each robot"
            if not isinstance(element, ArrayType | ListType):
                cure = (
                    f"write `{show(element)}[] {decl.name.name}`, or {cure.removeprefix('write ')}"
                )
        case _:  # one value is one for each robot [OLD-ALLREAD]
            session.findings.old(
                "allread",
                decl.span,
                f"`{decl.name.name}` has one entry for each robot: it is an array",
                f"write `{show(type_)}[] {decl.name.name}`",
                Edit(decl.type.span.end, "[]"),
            )
            return ArrayType(type_, Robots.ALL)
    session.findings.error("K211", decl.span, message, cure)
    return None


def declare_locals(
    session: Elaboration, scopes: list[tuple[AgentScope, list[ast.VarDecl]]]
) -> None:
    """Declare the locals of every kind of robot.

    What all kinds have, by name and type, comes first and in one order: the same slot in each, so
    that ``v@i`` needs no knowledge of robot i's kind.
    """
    types: dict[int, Type | None] = {}
    per_scope: list[dict[str, tuple[ast.VarDecl, Type]]] = []
    for scope, decls in scopes:
        found: dict[str, tuple[ast.VarDecl, Type]] = {}
        for decl in decls:
            if not is_pending(scope.variables, decl):
                continue
            if id(decl) not in types:
                types[id(decl)] = variable_type(session, decl)
            type_ = types[id(decl)]
            if type_ is not None:
                found[decl.name.name] = (decl, type_)
            else:
                scope.variables[decl.name.name] = Poisoned(decl.name)
        per_scope.append(found)
    shared = common_names([{n: t for n, (_, t) in found.items()} for found in per_scope])
    for (scope, _), found in zip(scopes, per_scope, strict=True):
        rest = [name for name in found if name not in shared]
        for slot, name in enumerate([*shared, *rest]):
            decl, type_ = found[name]
            variable = core.Variable(core.Home.LOCAL, slot, name, type_)
            scope.variables[name] = VariableSymbol(variable, decl.name, decl.type.span)


def common_names(kinds: list[dict[str, Type]]) -> list[str]:
    """The names that all have with one type, in the order of the first."""
    first, *others = kinds
    return [
        name for name, type_ in first.items() if all(other.get(name) == type_ for other in others)
    ]
