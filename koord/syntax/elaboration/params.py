"""Values of params, from the declaration or the settings."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import ast, core
from koord.syntax.analysis.folding import folded
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.phrases import a
from koord.syntax.elaboration.resolve_types import resolve
from koord.syntax.literals import ParamValue, is_moderate, literal
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    EnumType,
    ListType,
    Type,
)


def param_value(session: Elaboration, decl: ast.VarDecl) -> core.Expr | None:
    """The value of a param as a closed expression, or None if it has none."""
    body = BodyScope(session, Where.CONSTANT, None, session.findings)
    type_ = resolve(body, decl.type)
    if type_ is None:
        return None
    if not _allowed(type_):
        body.error(
            "K234",
            decl.type.span,
            f"a `param` is not {a(type_)}",
            "it is an `int`, `float`, `bool`, `string` or `pos`, a member of an enumeration, or a "
            "list of these",
        )
        return None
    given = session.settings.params.get(decl.name.name)
    if given is not None:
        value = from_setting(given, type_)
        if value is None:
            body.error(
                "K237",
                decl.span,
                f"`{decl.name.name}` is {a(type_)}, but it is set to `{literal(given)[:60]}`",
                f"it is one of {', '.join(type_.members)}" if isinstance(type_, EnumType) else None,
            )
        return value
    if decl.initial is None:
        body.error(
            "K235",
            decl.span,
            f"the param `{decl.name.name}` has no value",
            "give it one here, or set it with `params=`",
        )
        return None
    return _initial(body, decl, decl.initial, type_)


def declared_value(session: Elaboration, decl: ast.VarDecl, initial: ast.Expr) -> core.Expr | None:
    """The value that a declaration gives, whatever the settings say; None if it is wrong."""
    body = BodyScope(session, Where.CONSTANT, None, session.findings)
    type_ = resolve(body, decl.type)
    return None if type_ is None else _initial(body, decl, initial, type_)


def _initial(
    body: BodyScope, decl: ast.VarDecl, initial: ast.Expr, type_: Type
) -> core.Expr | None:
    found = body.expr(initial, type_)
    found = fit(body, found, type_, initial.span, f"`{decl.name.name}`")
    return _constant(body, found, decl) if found is not None else None


def text_value(session: Elaboration, decl: ast.VarDecl) -> core.Expr | None:
    """The value of a param without the settings; None if the text gives it none."""
    if decl.initial is None:
        return None
    body = BodyScope(
        session, Where.CONSTANT, None, DiagnosticLog()
    )  # it may be wrong: it is not used
    type_ = resolve(body, decl.type)
    found = None if type_ is None else body.expr(decl.initial, type_)
    found = fit(body, found, type_, decl.initial.span, f"`{decl.name.name}`")
    return None if found is None else _reduced(found)


def _allowed(type_: Type) -> bool:
    match type_:
        case ListType(element=element) | ArrayType(element=element):
            return _allowed(element)
        case EnumType():
            return True
        case _:
            return type_ in (INT, FLOAT, BOOL, STRING, POS)


def _constant(body: BodyScope, found: core.Expr, decl: ast.VarDecl) -> core.Expr | None:
    value = _reduced(found)
    if value is None:
        body.error(
            "K226",
            decl.initial.span if decl.initial else decl.span,
            "the value of a `param` is known before the run",
            "make it of numbers and other params",
        )
    return value


def _reduced(found: core.Expr) -> core.Expr | None:
    match found:
        case core.MakeList(items=parts) | core.MakeRecord(fields=parts):
            kept = tuple(part for part in map(_reduced, parts) if part is not None)
            if len(kept) < len(parts):
                return None
            make = core.MakeList if isinstance(found, core.MakeList) else core.MakeRecord
            return make(kept, found.type, span=found.span)
        case _:
            value = folded(found)
            return value if isinstance(value, core.Const) else None


def from_setting(given: ParamValue, type_: Type) -> core.Expr | None:
    """A setting as a constant of the type, or None if it is none."""
    match given, type_:
        case bool(), _:
            return core.Const(given, BOOL) if type_ == BOOL else None
        case tuple(), ListType(element=element) | ArrayType(element=element):
            items = [from_setting(item, element) for item in given]
            kept = tuple(item for item in items if item is not None)
            if len(kept) < len(items) or (isinstance(type_, ArrayType) and type_.size != len(kept)):
                return None
            return core.MakeList(kept, type_)
        case tuple(), _ if type_ == POS and len(given) == 3:
            parts = [from_setting(item, FLOAT) for item in given]
            kept = tuple(part for part in parts if part is not None)
            return core.MakeRecord(kept, POS) if len(kept) == 3 else None
        case str(), EnumType(members=members):
            return core.Const(members.index(given), type_) if given in members else None
        case str(), _:
            return core.Const(given, STRING) if type_ == STRING else None
        case int(), _ if type_ == INT and is_moderate(given):
            return core.Const(given, INT)
        case ((int() | Fraction()), _) if type_ == FLOAT and is_moderate(given):
            return core.Const(Fraction(given), FLOAT)
        case _:
            return None
