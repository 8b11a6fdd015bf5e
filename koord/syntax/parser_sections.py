"""Sections: declarations, modules, functions, events, properties."""

from __future__ import annotations

from koord.syntax import ast
from koord.syntax.layout import Part
from koord.syntax.parser_blocks import block, reach
from koord.syntax.parser_lines import Form, Signature
from koord.syntax.parser_reader import Reader


def sections(reader: Reader, parts: list[Part]) -> tuple[ast.Section, ...]:
    """The sections of a file or of an ``agent``."""
    found: list[ast.Section] = []
    for part in parts:
        found.extend(_section(reader, part))
    return tuple(found)


def _section(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    match part.tokens[0].type if part.tokens else "":
        case "LOCAL" | "ALLREAD" | "ALLWRITE":
            reader.ends(part, 1)
            kind = ast.VarKind(part.tokens[0].text)
            return (ast.VarSection(kind, reader.declarations(part), span=reach(part)),)
        case "PARAM":
            reader.no_block(part)
            decl = reader.line(Form.DECLARATION, part, 1)
            return (ast.ParamDecl(decl, span=part.span),) if decl else ()
        case "USING":
            return _using(reader, part)
        case "DEF":
            return _def(reader, part)
        case "ENUM":
            return _enum(reader, part)
        case "AGENT":
            name = reader.name(part, 1, "a kind of robot")
            inner = sections(reader, reader.body(part))
            return (ast.Agent(name, inner, span=reach(part)),)
        case "INIT":
            reader.ends(part, 1)
            return (ast.Init(block(reader, reader.body(part)), span=reach(part)),)
        case "ASSUME":
            return _assume(reader, part)
        case "INVARIANT":
            return _invariant(reader, part)
        case "EVENTUALLY":
            return _eventually(reader, part)
        case "URGENT":
            return _event(reader, part, urgent=True)
        case "NAME" if part.colon or part.body:
            return _event(reader, part, urgent=False)
        case _:
            reader.no_section(part)
            return ()


# --- events -------------------------------------------------------------------------------------


def _event(reader: Reader, part: Part, *, urgent: bool) -> tuple[ast.Section, ...]:
    at = 1 if urgent else 0
    name = reader.name(part, at, "an event")
    pre: ast.Expr | None = None
    eff: ast.Block | None = None
    for line in reader.body(part):
        match line.tokens[0].type if line.tokens else "":
            case "PRE":
                reader.ends(line, 1)
                pre = reader.conjunction(line)
            case "EFF":
                reader.ends(line, 1)
                eff = block(reader, reader.body(line))
            case _:
                reader.stray(line, "an event has `pre:` and `eff:`")
    return (ast.Event(name, urgent, pre, eff or (), span=reach(part)),)


# --- modules and functions ----------------------------------------------------------------------


def _using(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    words = part.tokens
    at = 2 if len(words) > 2 and words[1].text == "module" else 1
    name = reader.name(part, at, "a module")
    sensors: list[ast.VarDecl] = []
    actuators: list[ast.VarDecl] = []
    environment: ast.Block | None = None
    contracts: list[ast.ContractDef] = []
    for line in reader.body(part) if part.colon or part.body else ():
        match line.tokens[0].text if line.tokens else "":
            case "sensors":
                sensors.extend(reader.declarations(line))
            case "actuators":
                actuators.extend(reader.declarations(line))
            case "environment":
                environment = block(reader, reader.body(line))
            case "contract":
                contracts.append(_contract(reader, line))
            case _:
                reader.stray(
                    line, "a module has `sensors:`, `actuators:`, `environment:`, `contract NAME:`"
                )
    return (
        ast.Using(
            name,
            tuple(sensors),
            tuple(actuators),
            environment,
            tuple(contracts),
            span=reach(part),
        ),
    )


def _contract(reader: Reader, part: Part) -> ast.ContractDef:
    name = reader.name(part, 1, "a contract")
    requires, ensures = _summary(reader, reader.body(part))
    return ast.ContractDef(name, requires, ensures, span=reach(part))


def _summary(
    reader: Reader, parts: list[Part]
) -> tuple[tuple[ast.Expr, ...], tuple[ast.Expr, ...]]:
    requires: list[ast.Expr] = []
    ensures: list[ast.Expr] = []
    for line in parts:
        match line.tokens[0].text if line.tokens else "":
            case "requires":
                requires.extend(reader.expressions(line))
            case "ensures":
                ensures.extend(reader.expressions(line))
            case _:
                reader.stray(line, "`requires:` and `ensures:` stand here")
    return tuple(requires), tuple(ensures)


def _def(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    words = [token.text for token in part.tokens]
    if "(" in words:
        return _function(reader, part, 2 if words[1] == "fun" and words[2] != "(" else 1)
    at = 2 if len(words) > 2 and words[1] == "adt" else 1
    name = reader.name(part, at, "a record")
    return (ast.RecordDef(name, reader.declarations(part), span=reach(part)),)


def _function(reader: Reader, part: Part, at: int) -> tuple[ast.Section, ...]:
    head = reader.line(Form.SIGNATURE, part, at)
    body = reader.body(part)
    if not isinstance(head, Signature):
        return ()
    first = [token.text for token in body[0].tokens] if body else []
    if first in (["extern"], ["extern", "fresh"]) and not body[0].colon:
        requires, ensures = _summary(reader, body[1:])
        kind = ast.External(" ".join(first))
        return (
            ast.FunDef(
                head.name,
                head.parameters,
                head.result,
                kind,
                requires,
                ensures,
                span=reach(part),
            ),
        )
    statements = block(reader, body)
    return (ast.FunDef(head.name, head.parameters, head.result, statements, span=reach(part)),)


def _enum(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    name = reader.name(part, 1, "an enumeration")
    members: list[ast.Ident] = []
    for line in reader.body(part):
        members.extend(reader.line(Form.MEMBERS, line) or ())
    return (ast.EnumDef(name, tuple(members), span=reach(part)),)


# --- properties ---------------------------------------------------------------------------------


def _property_name(reader: Reader, part: Part, then: int = 0) -> ast.Ident | None:
    if len(part.tokens) - then < 2:
        return None
    return reader.name(part, 1, "a property", then)


def _assume(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    name = _property_name(reader, part)
    return tuple(ast.Assume(name, e, span=e.span) for e in reader.expressions(part))


def _invariant(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    words = part.tokens
    at_round = [token.text for token in words[-2:]] == ["at", "round"] and len(words) > 2
    name = _property_name(reader, part, 2 if at_round else 0)
    condition = reader.conjunction(part)
    if condition is None:
        return ()
    return (ast.Invariant(name, at_round, condition, span=reach(part)),)


def _eventually(reader: Reader, part: Part) -> tuple[ast.Section, ...]:
    name = _property_name(reader, part)
    for line in reader.joined(reader.body(part)):
        found = reader.line(Form.LEADS_TO, line)
        if found and len(found) == 1:
            return (ast.Eventually(name, found[0], span=reach(part)),)
        if found:
            return (ast.LeadsTo(name, found[0], found[1], span=reach(part)),)
    return ()
