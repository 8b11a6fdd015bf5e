"""Parsing of blocks of statements."""

from __future__ import annotations

from typing import cast

from msgspec.structs import replace

from koord.syntax import ast
from koord.syntax.parsing.line_forms import type_end
from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.lines import LinePart
from koord.syntax.parsing.reader import LineReader
from koord.syntax.parsing.tokens import ARMS, BLOCKS, KEYWORDS, LOOPS, Token, shown, words
from koord.syntax.source import Span

#: What stands for a condition that could not be read.
_UNKNOWN = ast.BoolLit(True)

#: Sections and their pieces: none of them stands among statements.
_SECTIONS = words(
    """AGENT ALLREAD ALLWRITE ASSUME DEF EFF ENUM EVENTUALLY INIT INVARIANT LOCAL PARAM PRE URGENT
    USING"""
)
_ELIF = frozenset(["elseif", "elsif"])
#: Words that begin a block of statements, and how much of one a misspelt one shares.
_BLOCKS = sorted(word.lower() for word in BLOCKS | ARMS)
_ALIKE = 0.65
_OTHER_BLOCKS = words("while loop do switch case match try with until when")


def block(reader: LineReader, parts: list[LinePart]) -> ast.Block:
    """Parse the statements of a body; an ``if`` takes the ``elif`` and ``else`` behind it."""
    statements: list[ast.Stmt] = []
    position = 0
    while position < len(parts):
        part = parts[position]
        first = part.first
        position += 1
        if first == "IF":
            arms = [part]
            while position < len(parts) and _continues(reader, arms[-1], parts[position]):
                arms.append(parts[position])
                position += 1
            statements.append(_if(reader, arms))
        elif first in LOOPS:
            statements.extend(_loop(reader, part))
        elif first == "ATOMIC":
            reader.ends(part, 1)
            body = block(reader, reader.body(part))
            statements.append(ast.Atomic(body, span=reach(part)))
        elif (part.colon or part.body) and reader.is_displaced(part):
            pass
        elif part.colon or first in _SECTIONS or first == "ELSE" or first == "ELIF":
            statements.extend(_misplaced(reader, part))
        else:
            statements.extend(_simple(reader, part))
    return tuple(statements)


def reach(part: LinePart) -> Span:
    """The span from the first token of a part to the last one of its body."""
    last = part
    while last.body:
        last = last.body[-1]
    return part.span.to(last.span)


def _continues(reader: LineReader, before: LinePart, part: LinePart) -> bool:
    """Return whether a part is a further arm of the ``if`` whose last arm so far is ``before``."""
    if before.first == "ELSE":
        return False
    word = part.tokens[0] if part.tokens else None
    if word is None:
        return False
    if part.colon and word.text in _ELIF:
        count = 1
    elif word.type == "ELSE" and len(part.tokens) > 1 and part.tokens[1].type == "IF":
        count = 2
    else:
        return word.type in ("ELIF", "ELSE")
    span = word.span.to(part.tokens[count - 1].span)
    written = " ".join(token.text for token in part.tokens[:count])
    reader.complain(
        part, "K133", span, f"`{written}` is not a word of the language", "write `elif`"
    )
    part.tokens = [word.meant("elif"), *part.tokens[count:]]
    return True


def _if(reader: LineReader, parts: list[LinePart]) -> ast.If:
    arms: list[tuple[ast.Expr, ast.Block]] = []
    otherwise: ast.Block | None = None
    for part in parts:
        if part.first == "ELSE":
            reader.head(part)
            otherwise = block(reader, reader.body(part))
        else:
            condition = reader.condition(part)
            arms.append((condition or _UNKNOWN, block(reader, reader.body(part))))
    return ast.If(tuple(arms), otherwise, span=parts[0].span.to(reach(parts[-1])))


def _loop(reader: LineReader, part: LinePart) -> ast.Block:
    head = reader.line(LineKind.LOOP, part, opens=True)
    body = block(reader, reader.body(part))
    if not isinstance(head, ast.ForRange | ast.ForEach | ast.Repeat):
        return body
    return (replace(head, body=body, span=reach(part)),)


def _simple(reader: LineReader, part: LinePart) -> list[ast.Stmt]:
    if _declares(part.tokens):
        decls = reader.declaration(part)
        return [ast.LocalDecl(decl, span=decl.span) for decl in decls]
    statement = cast("ast.Stmt | None", reader.line(LineKind.STATEMENT, part))
    return [statement] if statement else []


def _declares(tokens: list[Token]) -> bool:
    """Return whether a line begins with a type and a name, or a keyword used as a name."""
    if len(tokens) < 2 or tokens[0].type != "NAME":
        return False
    at = type_end(tokens, 0)
    if at is None or at >= len(tokens):
        return False
    if tokens[at].type == "NAME":
        return True
    return tokens[at].text in KEYWORDS and [t.type for t in tokens[at + 1 : at + 2]] in (
        [],
        ["ASSIGN"],
    )


def _misplaced(reader: LineReader, part: LinePart) -> ast.Block:
    """Report a part that is no statement; if it has a body of statements, they stay."""
    first = part.first
    word = shown(part.tokens[0].text) if part.tokens else ":"
    place = part.tokens[0].span if part.tokens else part.span
    if first in ("ELSE", "ELIF") or word in _ELIF:
        reader.complain(
            part,
            "K116",
            place,
            f"this `{word}` has no `if` before it",
            "give it the indentation of its `if`",
        )
        return block(reader, part.body)
    if first in _SECTIONS:
        if not part.colon and not part.body:
            return tuple(_simple(reader, part))  # a keyword used as a name
        reader.complain(
            part, "K141", place, f"`{word}` cannot stand among statements", "indent it less"
        )
        reader.lose(part, body=True)
        return ()
    if word in _OTHER_BLOCKS:
        hint = "loops are bounded: `for i = 0, n:`, left with `break`"
        message = f"`{word}` is not a word of the language"
        reader.complain(part, "K133", place, message, hint if word != "switch" else None)
    elif word in ("requires", "ensures"):
        hint = "external functions have them: `def fun f(int a) -> int: extern`"
        message = f"`{word}:` belongs below `extern`, or to a contract"
        reader.complain(part, "K141", place, message, hint)
        reader.lose(part, body=True)
        return ()
    elif part.colon:
        from difflib import get_close_matches  # seldom needed

        message, near = "no block can begin here", get_close_matches(word, _BLOCKS, 1, _ALIKE)
        hint = f"did you mean `{near[0]}`?" if near else "leave `:` out, or indent less"
        reader.complain(part, "K115", part.colon.span, message, hint)
    return block(reader, part.body)
