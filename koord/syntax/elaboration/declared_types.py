"""Elaboration of records and enumerations."""

from __future__ import annotations

from koord.syntax import ast
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.library import library
from koord.syntax.elaboration.literals import field_value
from koord.syntax.elaboration.resolve_types import GENERIC, PREDEFINED, resolve
from koord.syntax.elaboration.symbols import RESERVED, MemberSymbol, RecordInfo
from koord.syntax.types import STREAM, EnumType, RecordType, Type


def declare_types(
    session: Elaboration, enums: list[ast.EnumDef], records: list[ast.RecordDef]
) -> None:
    """Declare all types. `Task` is the library's unless the program has its own."""
    own: dict[str, ast.RecordDef] = {}
    for enum in enums:
        if _is_new(session, enum.name):
            _enum(session, enum)
    for record in records:
        if _is_new(session, record.name):
            session.types.declared[record.name.name] = record.name
            own[record.name.name] = record
    task = library().task
    if task.name.name not in session.types.declared:
        own[task.name.name] = task
    _records(session, own)


def _is_new(session: Elaboration, name: ast.Ident) -> bool:
    if name.name == "?":
        return False
    if name.name in PREDEFINED or name.name in GENERIC:
        session.findings.error(
            "K209", name.span, f"`{name.name}` is a type of the language", "choose another name"
        )
        return False
    first = session.types.declared.get(name.name)
    if first is not None:
        session.findings.error(
            "K208",
            name.span,
            f"the type `{name.name}` is declared twice",
            "leave one of them out, or give it another name",
            (Note(first.span, "first declared here"),),
        )
        return False
    return True


def _enum(session: Elaboration, enum: ast.EnumDef) -> None:
    members: list[ast.Ident] = []
    for member in enum.members:
        if member.name in RESERVED:
            session.findings.error(
                "K209", member.span, f"`{member.name}` is the language's own name"
            )
            continue
        first = next((known for known in members if known.name == member.name), None)
        if first is not None:
            session.findings.error(
                "K208",
                member.span,
                f"`{member.name}` is a member of `{enum.name.name}` already",
                None,
                (Note(first.span, "first declared here"),),
            )
            continue
        members.append(member)
    type_ = EnumType(enum.name.name, tuple(member.name for member in members))
    session.types.declared[enum.name.name] = enum.name
    session.types.named[enum.name.name] = type_
    for position, member in enumerate(members):
        symbol = MemberSymbol(type_, position, member)
        session.types.members.setdefault(member.name, []).append(symbol)


def _records(session: Elaboration, records: dict[str, ast.RecordDef]) -> None:
    """Resolve records, each after those that it contains."""
    done: set[str] = set()
    for name in records:
        path: list[str] = []
        stack: list[tuple[str, bool]] = [(name, False)]
        while stack:
            current, leaving = stack.pop()
            if leaving:
                path.pop()
                if current not in done:
                    done.add(current)
                    _record(session, records[current])
                continue
            if current in done:
                continue
            if current in path:
                _endless(session, records, path[path.index(current) :])
                done.add(current)
                session.types.named[current] = None
                continue
            path.append(current)
            stack.append((current, True))
            parts = [part for decl in records[current].fields for part in _names(decl.type)]
            stack.extend((part, False) for part in reversed(parts) if part in records)


def _names(type_: ast.TypeExpr) -> list[str]:
    """The names of types that a record contains."""
    names: list[str] = []
    stack = [type_]
    while stack:
        part = stack.pop()
        if isinstance(part, ast.NamedType):
            names.append(part.name)
            stack.extend(part.arguments)
        else:
            stack.append(part.element)
    return names


def _endless(session: Elaboration, records: dict[str, ast.RecordDef], cycle: list[str]) -> None:
    name = records[cycle[0]].name
    way = " → ".join(f"`{part}`" for part in [*cycle, cycle[0]])
    session.findings.error(
        "K241",
        name.span,
        f"the record `{name.name}` is a part of itself: {way}",
        "let one of them hold a number that says which other one is meant",
    )


def _record(session: Elaboration, record: ast.RecordDef) -> None:
    body = BodyScope(session, Where.CONSTANT, None, session.findings)
    fields: list[tuple[str, Type]] = []
    defaults: list[ast.Expr | None] = []
    seen: dict[str, ast.Ident] = {}
    sound = True
    for decl in record.fields:
        type_ = resolve(body, decl.type)
        if type_ == STREAM:
            body.error("K238", decl.span, "a stream is a port of a module, not a field")
            type_ = None
        first = seen.get(decl.name.name)
        if first is not None:
            session.findings.error(
                "K208",
                decl.name.span,
                f"the field `{decl.name.name}` is declared twice",
                None,
                (Note(first.span, "first declared here"),),
            )
            continue
        seen[decl.name.name] = decl.name
        if type_ is None:
            sound = False
            continue
        fields.append((decl.name.name, type_))
        defaults.append(decl.initial)
    name = record.name.name
    if not record.fields:
        sound = False  # the parser told that it has no body
    if not sound:
        session.types.named[name] = None
        return
    made = RecordType(name, tuple(fields))
    session.types.named[name] = made
    session.types.records[name] = RecordInfo(made, tuple(defaults), record.name)


def check_defaults(session: Elaboration, records: list[ast.RecordDef]) -> None:
    """Check the initial values of fields, which constructions may leave out."""
    for record in records:
        info = session.types.records.get(record.name.name)
        if info is None or info.declared is not record.name:
            continue
        names = [name for name, _ in info.type.fields]
        for decl in record.fields:
            if decl.initial is None or decl.name.name not in names:
                continue
            body = BodyScope(session, Where.CONSTANT, None, session.findings)
            wanted = info.type.fields[names.index(decl.name.name)][1]
            field_value(body, decl.initial, decl.name.name, wanted)
