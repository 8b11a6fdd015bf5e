"""Blocks of statements."""

from __future__ import annotations

from typing import cast

from koord.syntax import ast
from koord.syntax.layout import Part
from koord.syntax.parser_lines import Form, LoopEach, LoopRange
from koord.syntax.parser_reader import Reader
from koord.syntax.source import Span

#: What stands for a condition that could not be read.
_UNKNOWN = ast.BoolLit(True)


def block(reader: Reader, parts: list[Part]) -> ast.Block:
    """The statements of a body; an ``if`` takes the ``elif`` and ``else`` behind it."""
    statements: list[ast.Stmt] = []
    position = 0
    while position < len(parts):
        part = parts[position]
        first = part.tokens[0].type if part.tokens else ""
        position += 1
        match first:
            case "IF":
                rest = position
                while rest < len(parts) and _is(parts[rest], "ELIF"):
                    rest += 1
                if rest < len(parts) and _is(parts[rest], "ELSE"):
                    rest += 1
                statements.append(_if(reader, parts[position - 1 : rest]))
                position = rest
            case "ELIF" | "ELSE":
                reader.report.error(
                    "K116",
                    part.tokens[0].span,
                    f"this `{part.tokens[0].text}` has no `if` before it",
                    "give it the indentation of its `if`",
                )
                statements.extend(block(reader, part.body))
            case "FOR":
                statements.extend(_for(reader, part))
            case "ATOMIC":
                reader.ends(part, 1)
                body = block(reader, reader.body(part))
                statements.append(ast.Atomic(body, span=reach(part)))
            case _:
                statement = _simple(reader, part)
                if statement:
                    statements.append(statement)
    return tuple(statements)


def _is(part: Part, kind: str) -> bool:
    return bool(part.tokens) and part.tokens[0].type == kind


def reach(part: Part) -> Span:
    """From the first token of a part to the last one of its body."""
    last = part
    while last.body:
        last = last.body[-1]
    return part.span.to(last.span)


def _if(reader: Reader, parts: list[Part]) -> ast.If:
    arms: list[tuple[ast.Expr, ast.Block]] = []
    otherwise: ast.Block | None = None
    for part in parts:
        if part.tokens[0].type == "ELSE":
            reader.ends(part, 1)
            otherwise = block(reader, reader.body(part))
            continue
        condition = cast("ast.Expr | None", reader.line(Form.EXPRESSION, part, 1))
        arms.append((condition or _UNKNOWN, block(reader, reader.body(part))))
    return ast.If(tuple(arms), otherwise, span=parts[0].span.to(reach(parts[-1])))


def _for(reader: Reader, part: Part) -> ast.Block:
    head = reader.line(Form.LOOP, part)
    body = block(reader, reader.body(part))
    match head:
        case LoopRange(variable=variable, low=low, high=high):
            return (ast.ForRange(variable, low, high, body, span=reach(part)),)
        case LoopEach(variables=variables, sequence=sequence):
            return (ast.ForEach(variables, sequence, body, span=reach(part)),)
        case _:
            return ()


def _simple(reader: Reader, part: Part) -> ast.Stmt | None:
    reader.no_block(part)
    if _declares(part):
        decl = reader.line(Form.DECLARATION, part)
        return ast.LocalDecl(decl, span=decl.span) if decl else None
    return cast("ast.Stmt | None", reader.line(Form.STATEMENT, part))


def _declares(part: Part) -> bool:
    """Whether a line begins with a type and a name."""
    tokens = part.tokens
    if len(tokens) < 2 or tokens[0].type != "NAME":
        return False
    second = tokens[1].type
    if second == "NAME":
        return True
    if second == "LESS":
        return True
    if second != "LSQB":
        return False
    depth = 0
    for position, token in enumerate(tokens):
        if token.type == "LSQB":
            depth += 1
        elif token.type == "RSQB":
            depth -= 1
            if not depth:
                following = tokens[position + 1].type if position + 1 < len(tokens) else ""
                if following != "LSQB":
                    return following == "NAME"
    return False
