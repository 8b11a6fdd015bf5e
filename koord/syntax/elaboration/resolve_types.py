"""Resolution of written types."""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.analysis.folding import constant
from koord.syntax.diagnostics import Edit
from koord.syntax.elaboration.body import BodyScope, Where
from koord.syntax.elaboration.phrases import did_you_mean
from koord.syntax.elaboration.recorder import HOLE, TypeSymbol
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    PRESENT,
    STREAM,
    STRING,
    ArrayType,
    FloatType,
    ListType,
    MapType,
    QueueType,
    Robots,
    SequenceType,
    SetType,
    StreamType,
    Type,
    show,
    within,
)

#: The names of types that every program has.
PREDEFINED: dict[str, Type] = {
    "int": INT,
    "float": FLOAT,
    "bool": BOOL,
    "boolean": BOOL,
    "string": STRING,
    "stream": STREAM,
    "pos": POS,
    "Point": POS,
}

#: Types with arguments, and how many they take.
GENERIC = {"List": 1, "Queue": 1, "Set": 1, "Map": 2}

_CELLS = MapType(INT, BOOL)

#: Types that had other names, and what they are today: as text, and as types. [OLD-NAME]
OLD_TYPES: dict[str, tuple[str, Type]] = {
    "ItemPosition": ("pos", POS),
    "PathPlanner": ("string", STRING),
    "GridMap": ("Map<int, bool>", _CELLS),
    "Grid": ("Map<int, bool>", _CELLS),
    "Scan": ("pos[]", ListType(POS)),
}

MAX_TYPE_DEPTH = 20
MAX_SIZE = 1_000_000


def resolve(body: BodyScope, written: ast.TypeExpr, depth: int = 0) -> Type | None:
    """Resolve a type; None if it is wrong (reported by then). ``body`` evaluates sizes."""
    if depth > MAX_TYPE_DEPTH:
        body.error(
            "K231",
            written.span,
            f"this type is nested more than {MAX_TYPE_DEPTH} deep",
            "make records of its parts",
        )
        return None
    match written:
        case ast.ArrayTypeExpr(element=element, size=None):
            inner = resolve(body, element, depth + 1)
            return None if inner is None else ListType(inner)
        case ast.ArrayTypeExpr(element=element, size=size):
            inner = resolve(body, element, depth + 1)
            assert size is not None
            length = _size(body, size)
            return None if inner is None or length is None else ArrayType(inner, length)
        case ast.NamedType():
            return _named(body, written, depth)


def _named(body: BodyScope, written: ast.NamedType, depth: int) -> Type | None:
    name = written.name
    if _is_scans(written) and "Scan" not in body.session.types.declared:
        return _old_type(body, written)
    arguments = [resolve(body, argument, depth + 1) for argument in written.arguments]
    if name in GENERIC:
        _note(body, written, None)
        if len(arguments) != GENERIC[name]:
            many = "a type" if GENERIC[name] == 1 else "two types"
            body.error("K203", written.span, f"`{name}` wants {many} between `<` and `>`")
            return None
        found = [argument for argument in arguments if argument is not None]
        if len(found) < len(arguments):
            return None
        return _generic(body, name, found, written)
    types = body.session.types
    if name == HOLE:
        from koord.syntax.elaboration.candidates import fill_types

        fill_types(body, [*PREDEFINED, *GENERIC, *types.named])
    if name in types.named:
        meant = types.named[name]
    elif name in PREDEFINED:
        meant = PREDEFINED[name]
    elif name in OLD_TYPES and not body.session.partial:
        meant = _old_type(body, written)
    else:
        if not body.session.partial:
            known = [*PREDEFINED, *GENERIC, *types.named]
            body.error(
                "K203", written.span, f"there is no type `{name}`", did_you_mean(name, known)
            )
        return None
    _note(body, written, meant)
    if arguments:
        body.error("K203", written.span, f"`{name}` takes no types between `<` and `>`")
        return None
    return meant


def _note(body: BodyScope, written: ast.NamedType, meant: Type | None) -> None:
    """Tell an editor what the name of a type means, which its arguments are behind."""
    body.note(written.span.beginning(len(written.name)), TypeSymbol(written.name, meant))


def _is_scans(written: ast.NamedType) -> bool:
    """Return whether a type is the old ``List<Point, Scan>``. [OLD-NAME]"""
    parts = [part.name for part in written.arguments if isinstance(part, ast.NamedType)]
    return written.name == "List" and parts in (["Point", "Scan"], ["pos", "Scan"])


def _old_type(body: BodyScope, written: ast.NamedType) -> Type:
    """Resolve a type of an old name. [OLD-NAME]"""
    name = "List<Point, Scan>" if written.arguments else written.name
    today, meant = OLD_TYPES["Scan" if written.arguments else name]
    was, edit = f"`{name}` is the old name of `{today}`", Edit(written.span, today)
    body.findings.old(name, written.span, was, f"write `{today}`", edit)
    return meant


def _generic(body: BodyScope, name: str, found: list[Type], written: ast.NamedType) -> Type | None:
    if name == "List":
        return ListType(found[0])
    if name == "Queue":
        return QueueType(found[0])
    if not _comparable(found[0]):
        each, one = (
            ("elements", "an element of a set") if name == "Set" else ("keys", "the key of a map")
        )
        body.error(
            "K203",
            written.span,
            f"`{show(found[0])}` cannot be {one}",
            f"{each} are numbers, strings, truth values, enumerations or records of these",
        )
        return None
    return SetType(found[0], PRESENT) if name == "Set" else MapType(found[0], found[1])


def _comparable(type_: Type) -> bool:
    unfit = (SequenceType, MapType, StreamType)
    return not any(isinstance(each, unfit) for each in within(type_))


def _size(body: BodyScope, size: ast.Expr) -> int | Robots | None:
    sizes = BodyScope(body.session, Where.CONSTANT, None, body.findings)
    expr = sizes.expr(size, INT)
    if expr is None:
        return None
    if isinstance(expr, core.NumAgents):
        return Robots.ALL
    value = constant(expr)
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_SIZE:
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        body.error(
            "K227",
            size.span,
            f"an array cannot have {value:,} elements: it has from 0 to {MAX_SIZE:,}",
            "make it smaller, or use an array without size, `T[]`, which grows as it is needed",
        )
    else:
        body.error(
            "K227",
            size.span,
            "the size of an array is a whole number that is known before the run",
            "use a number, a `param int`, or `numAgents`; an array without size, `T[]`, may grow",
        )
    return None


def is_numeric(type_: Type) -> bool:
    """Return whether a type is ``int`` or ``float``."""
    return type_ == INT or isinstance(type_, FloatType)


def element_of(type_: Type) -> Type | None:
    """The type of the elements of a list, array or queue."""
    return type_.element if isinstance(type_, SequenceType) else None
