"""Parsing of sections: declarations, modules, functions, events, properties."""

from __future__ import annotations

from koord.syntax import ast
from koord.syntax.parsing.blocks import block, reach
from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.lines import LinePart
from koord.syntax.parsing.nodes import FunctionHead, LeadsTo
from koord.syntax.parsing.reader import LineReader, has_pieces
from koord.syntax.parsing.strays import (
    OPENING,
    PIECES,
    Strays,
    adopted,
    misspelt_section,
    stray_piece,
    stray_port,
    stray_section,
)
from koord.syntax.parsing.tokens import KEYWORDS, words


def sections(
    reader: LineReader, parts: list[LinePart], *, agent: bool = False
) -> tuple[ast.Section, ...]:
    """Parse the sections of a file or of an ``agent``."""
    found: list[ast.Section] = []
    strays = Strays(reader)
    for part in adopted(reader, parts):
        if agent and part.first == "AGENT":
            strays.add(part, "`agent` cannot stand inside `agent`", None)
            continue
        read = _section(reader, part)
        if read is None:
            strays.add(part, *stray_section(part))
            continue
        strays.over()
        found.extend(read)
        while reader.displaced:
            found.extend(_section(reader, reader.displaced.pop(0)) or ())
    return tuple(found)


def _section(reader: LineReader, part: LinePart) -> tuple[ast.Section, ...] | None:
    """Parse a part to sections; None if it is none."""
    if part.first != "AGENT":
        reader.around = part
    match part.first:
        case "LOCAL" | "ALLREAD" | "ALLWRITE":
            reader.ends(part, 1)
            kind = ast.VarKind(part.tokens[0].text)
            return (ast.VarSection(kind, reader.declarations(part), span=reach(part)),)
        case "PARAM":
            decls = reader.declaration(part, 1)
            return tuple(ast.ParamDecl(decl, span=part.span) for decl in decls)
        case "USING":
            return (_using(reader, part),)
        case "DEF":
            return _def(reader, part)
        case "ENUM":
            return (_enum(reader, part),)
        case "AGENT":
            name = reader.name(part, 1, "a kind of robot")
            inner = sections(reader, reader.body(part), agent=True)
            return (ast.Agent(name, inner, span=reach(part)),)
        case "INIT":
            reader.ends(part, 1)
            return (ast.Init(block(reader, reader.body(part)), span=reach(part)),)
        case "ASSUME":
            given = _property_name(reader, part)
            reader.heads.append(ast.Ident("assume", span=part.tokens[0].span))
            lines = reader.joined(reader.body(part))
            return tuple(made for line in lines if (made := _assumed(reader, given, line)))
        case "INVARIANT":
            return _invariant(reader, part)
        case "EVENTUALLY":
            return _eventually(reader, part)
        case "URGENT":
            return (_event(reader, part, urgent=True),)
        case "NAME" if _is_event(part):
            return (_event(reader, part, urgent=False),)
        case _ if part.tokens and part.tokens[0].text in KEYWORDS and _is_misnamed(part):
            return (_event(reader, part, urgent=False),)  # which tells of the name
        case _:
            return None


# --- events -------------------------------------------------------------------------------------


def _is_event(part: LinePart) -> bool:
    if not (part.colon or part.body) or len(part.tokens) != 1:
        return False
    if part.tokens[0].text not in PIECES:
        return has_pieces(part) or misspelt_section(part) is None
    return has_pieces(part)


def _is_misnamed(part: LinePart) -> bool:
    """Return whether a part is an event that has a keyword for its name."""
    if len(part.tokens) != 1 or not part.colon:
        return False
    return has_pieces(part) or part.first not in OPENING | words("PRE EFF")


def _event(reader: LineReader, part: LinePart, *, urgent: bool) -> ast.Event:
    name = reader.name(part, 1 if urgent else 0, "an event")
    pre: ast.Expr | None = None
    eff: ast.Block = ()
    strays = Strays(reader)
    seen: set[str] = set()
    loose: list[LinePart] = []
    for line in reader.body(part):
        match line.first:
            case "PRE":
                strays.once(line, seen)
                reader.head(line)
                reader.no_semicolon(line)
                pre = reader.conjunction(line)
            case "EFF":
                strays.once(line, seen)
                reader.head(line)
                eff += block(reader, reader.body(line))
            case _ if reader.is_displaced(line):
                pass
            case _:
                strays.add(line, *stray_piece(line), lost=False)
                loose.append(line)
                continue
        strays.over()
    if loose:
        quiet(loose)
        eff += block(reader, loose)
    elif "EFF" not in seen and part.body:
        message = f"the event `{name.name}` has no `eff:`"
        reader.complain(part, "K143", part.span, message, "write `eff: pass` if it does nothing")
    return ast.Event(name, urgent, pre, eff, span=reach(part))


def quiet(parts: list[LinePart]) -> None:
    """Report nothing more about parts that do not belong where they are."""
    waiting = list(parts)
    while waiting:
        part = waiting.pop()
        part.broken = True
        waiting.extend(part.body)


# --- modules and functions ----------------------------------------------------------------------


def _using(reader: LineReader, part: LinePart) -> ast.Using:
    words = part.tokens
    at = 2 if len(words) > 2 and words[1].text == "module" else 1
    name = reader.name(part, at, "a module")
    sensors: list[ast.VarDecl] = []
    actuators: list[ast.VarDecl] = []
    environment: ast.Block | None = None
    contracts: list[ast.ContractDef] = []
    strays = Strays(reader)
    seen: set[str] = set()
    for line in reader.body(part) if part.body and not part.colon else part.body:
        match line.tokens[0].text if line.tokens else "":
            case "sensors":
                reader.head(line)
                sensors.extend(reader.declarations(line))
            case "actuators":
                reader.head(line)
                actuators.extend(reader.declarations(line))
            case "environment":
                strays.once(line, seen)
                reader.head(line)
                environment = (environment or ()) + block(reader, reader.body(line))
            case "contract":
                contract = reader.name(line, 1, "a contract")
                requires, ensures = _summary(reader, reader.body(line))
                contracts.append(ast.ContractDef(contract, requires, ensures, span=reach(line)))
            case _ if reader.is_displaced(line):
                pass
            case _:
                strays.add(line, *stray_port(line))
                continue
        strays.over()
    return ast.Using(
        name, tuple(sensors), tuple(actuators), environment, tuple(contracts), span=reach(part)
    )


def _summary(
    reader: LineReader, parts: list[LinePart]
) -> tuple[tuple[ast.Expr, ...], tuple[ast.Expr, ...]]:
    requires: list[ast.Expr] = []
    ensures: list[ast.Expr] = []
    strays = Strays(reader)
    for line in parts:
        match line.tokens[0].text if line.tokens else "":
            case "requires":
                reader.head(line)
                requires.extend(reader.expressions(line))
            case "ensures":
                reader.head(line)
                ensures.extend(reader.expressions(line))
            case _:
                strays.add(line, "`requires:` or `ensures:` is expected here", None)
                continue
        strays.over()
    return tuple(requires), tuple(ensures)


def _def(reader: LineReader, part: LinePart) -> tuple[ast.Section, ...]:
    words = [token.text for token in part.tokens]
    if "(" in words or (words[1:2] == ["fun"] and len(words) > 2):
        return _function(reader, part, 2 if words[1] == "fun" and words[2:3] != ["("] else 1)
    at = 2 if len(words) > 2 and words[1] == "adt" else 1
    name = reader.name(part, at, "a record or `fun`")
    reader.body(part)
    return (ast.RecordDef(name, reader.declarations(part), span=reach(part)),)


def _function(reader: LineReader, part: LinePart, at: int) -> tuple[ast.Section, ...]:
    head = reader.line(LineKind.SIGNATURE, part, at, opens=True)
    body = reader.body(part)
    first = [token.text for token in body[0].tokens] if body else []
    requires: tuple[ast.Expr, ...] = ()
    ensures: tuple[ast.Expr, ...] = ()
    answer: ast.Block | ast.External
    if first in (["extern"], ["extern", "fresh"]) and not body[0].colon:
        reader.heads.append(ast.Ident("extern", span=body[0].span))
        answer = ast.External(" ".join(first))
        requires, ensures = _summary(reader, body[1:])
    else:
        answer = block(reader, body)
    if not isinstance(head, FunctionHead):
        reader.lose(part, body=True)
        return ()
    return (
        ast.FunDef(
            head.name,
            head.parameters,
            head.result,
            answer,
            requires,
            ensures,
            span=reach(part),
        ),
    )


def _enum(reader: LineReader, part: LinePart) -> ast.EnumDef:
    name = reader.name(part, 1, "an enumeration")
    members: list[ast.Ident] = []
    for line in reader.joined(reader.body(part)):
        reader.no_block(line)
        found = reader.line(LineKind.MEMBERS, line)
        members.extend(found or _names(line))
    return ast.EnumDef(name, tuple(members), span=reach(part))


def _names(part: LinePart) -> list[ast.Ident]:
    tokens = (token for token in part.tokens if token.type == "NAME")
    return [ast.Ident(token.text, span=token.span) for token in tokens]


# --- properties ---------------------------------------------------------------------------------


def _property_name(reader: LineReader, part: LinePart, then: int = 0) -> ast.Ident | None:
    if len(part.tokens) - then < 2:
        return None
    if part.colon is None and not (len(part.tokens) == 2 and part.body):
        reader.ends(part, 1)  # the expression stands where `:` is missing
        return None
    return reader.name(part, 1, "a property", then)


def _invariant(reader: LineReader, part: LinePart) -> tuple[ast.Section, ...]:
    words = part.tokens
    at_round = [token.text for token in words[-2:]] == ["at", "round"] and len(words) > 2
    name = _property_name(reader, part, 2 if at_round else 0)
    condition = reader.conjunction(part)
    if condition is None:
        return ()
    return (ast.Invariant(name, at_round, condition, span=reach(part)),)


def _assumed(
    reader: LineReader, name: ast.Ident | None, line: LinePart
) -> ast.Assume | ast.LeadsTo | None:
    reader.no_block(line)
    match reader.line(LineKind.GOAL, line):
        case LeadsTo(trigger=trigger, goal=goal):
            span = trigger.span.to(goal.span)
            return ast.LeadsTo(name, trigger, goal, assumed=True, span=span)
        case None:
            return None
        case condition:
            return ast.Assume(name, condition, span=condition.span)


def _eventually(reader: LineReader, part: LinePart) -> tuple[ast.Section, ...]:
    name = _property_name(reader, part)
    lines = reader.joined(reader.body(part))
    for more in lines[1:]:
        reader.complain(
            more,
            "K135",
            more.span,
            "`eventually` has one property",
            "join the lines with `and`, or write `eventually` twice",
        )
    for line in lines[:1]:
        reader.no_block(line)
        match reader.line(LineKind.GOAL, line):
            case LeadsTo(trigger=trigger, goal=goal):
                return (ast.LeadsTo(name, trigger, goal, span=reach(part)),)
            case None:
                return ()
            case goal:
                return (ast.Eventually(name, goal, span=reach(part)),)
    return ()
