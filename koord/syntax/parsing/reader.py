"""A reader of parts of lines, which reports each mistake once: shared by blocks and sections."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, cast

from koord.syntax import ast
from koord.syntax.diagnostics import Edit
from koord.syntax.parsing.line_forms import MAX_DEPTH, UnexpectedError, parse_line
from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.lines import GOES_ON, UNFINISHED, LinePart
from koord.syntax.parsing.operands import MisplacedError
from koord.syntax.parsing.report import ErrorLog
from koord.syntax.parsing.tokens import ARMS, BLOCKS, KEYWORDS, Token, shown, words
from koord.syntax.source import Span

#: A line is mended and read again so often.
_MAX_REPAIRS = 10

#: Forms that may go on over several lines without brackets: the expressions of properties.
_OVER_LINES = frozenset([LineKind.EXPRESSION, LineKind.GOAL, LineKind.MEMBERS])
#: Complaints that may as well mean a missing colon.
_NO_COLON = frozenset(["K130", "K131", "K135"])
#: Words that are the whole head of a block: without a colon its body begins behind them.
_ONE_WORD = words(
    "pre eff local allread allwrite init sensors actuators environment requires ensures"
)
#: First words of statements with a body: a missing colon there may as well be another mistake.
_STATEMENTS = BLOCKS | ARMS
#: First words of sections: nothing else begins so.
_SECTIONS = words(
    "AGENT ALLREAD ALLWRITE ASSUME DEF ENUM EVENTUALLY INIT INVARIANT LOCAL PARAM URGENT USING"
)


class LineReader:
    """A reader of parts; a wrong part is reported, and None where no node can be made."""

    __slots__ = ("around", "displaced", "heads", "lost", "report")

    def __init__(self, report: ErrorLog) -> None:
        self.report = report
        #: Words that begin a block but have no node of their own.
        self.heads: list[ast.Ident] = []
        #: Names in what could not be read.
        self.lost: set[str] = set()
        #: The section that is being read, beside which others stand.
        self.around: LinePart | None = None
        #: Sections that stood inside of others, to be read as if they stood beside them.
        self.displaced: list[LinePart] = []

    # --- sections in sections

    def is_displaced(self, part: LinePart, *, or_named: bool = False) -> bool:
        """Return whether a part inside of a section is itself a section, which is reported.

        ``or_named`` says that a word with a block can be nothing but an event here.
        """
        named = or_named and part.first == "NAME" and len(part.tokens) == 1
        named = named and any(line.end.line > part.end.line for line in part.body)
        if part.first not in _SECTIONS and not named and not has_pieces(part):
            return False
        around = self.around
        if around is None:
            return False
        word = f"`{shown(part.start.text)}`" if part.first in _SECTIONS else "an event"
        head = shown(" ".join(token.text for token in around.tokens))
        by = part.start.column - around.start.column
        cure = f"dedent it by {by} space{'s' * (by != 1)}: it stands beside `{head}`, not in it"
        if by <= 0 or part.start.line == around.start.line:
            cure = f"write it on a line of its own, beside `{head}`"
        self.complain(part, "K141", part.span, f"{word} cannot stand inside of `{head}`", cure)
        self.displaced.append(part)
        return True

    # --- lines

    def line(
        self, form: LineKind, part: LinePart, start: int = 0, *, opens: bool = False
    ) -> Any | None:
        """Parse a part's tokens from number ``start`` on.

        ``opens`` tells that a body follows, so that ``:`` may be what is missing.
        """
        if part.joint and (opens or form not in _OVER_LINES):
            self.complain(
                part,
                "K119",
                part.joint.span,
                "a line goes on below only inside brackets",
                "put what stands on both lines in `(` `)`",
            )
        tokens = part.tokens[start:]
        for _ in range(_MAX_REPAIRS):
            try:
                return parse_line(form, tokens, quantified=part.quantified)
            except MisplacedError as error:
                self.complain(part, error.code, error.span, error.message, error.hint)
                break
            except UnexpectedError as error:
                from koord.syntax.parsing.messages import explain  # of mistakes

                complaint = explain(form, tokens, error, part.end)
                at = start + error.position
                if opens and complaint.code in _NO_COLON and self._splits(part, at):
                    tokens = part.tokens[start:]
                    continue
            self.complain(part, complaint.code, complaint.span, complaint.message, complaint.hint)
            if complaint.repaired is None:
                break
            if complaint.code == "K131":
                self.lost.add(complaint.token.text)
            tokens = complaint.repaired
        part.broken = True
        self.lose(part)
        return None

    def lose(self, part: LinePart, *, body: bool = False) -> None:
        """Remember the names in a part, or in its whole body, that no node is made of."""
        waiting = [part]
        while waiting:
            one = waiting.pop()
            self.lost.update(token.text for token in one.tokens if token.type == "NAME")
            if body:
                waiting.extend(one.body)

    def complain(
        self, part: LinePart, code: str, span: Span, message: str, hint: str | None = None
    ) -> None:
        """Report a mistake in a part, unless it is likely a consequence of an earlier one."""
        if part.broken or part.told not in (None, code):
            return
        if any(token.line in self.report.damaged for token in part.tokens):
            return
        part.told = code
        self.report.error(code, span, message, hint)

    def old(self, part: LinePart, span: Span, message: str, hint: str, *edits: Edit) -> None:
        """Warn of an old form in a part of which nothing else was told. [OLD-FORM]"""
        if not part.broken and part.told is None:
            self.report.old(span, message, hint, edits)

    def _no_colon(self, part: LinePart, behind: Token, span: Span) -> None:
        """Warn that a colon is missing behind a token, where that is an old form. [OLD-COLON]"""
        word = shown(behind.text)
        message, hint = (
            f"`:` is missing behind `{word}`; it is read as if it were there",
            "write `:`",
        )
        edits = [Edit(_behind(behind), ":")]
        if part.semicolon:
            message, hint = "a guard is written `pre: c`, without `;`", "write `:`, and no `;`"
            edits.append(Edit(part.semicolon.span, ""))
            part.semicolon = None
        self.old(part, span, message, hint, *edits)

    def expression(self, part: LinePart) -> ast.Expr | None:
        """Parse a part that is an expression."""
        self.no_block(part)
        return cast("ast.Expr | None", self.line(LineKind.EXPRESSION, part))

    def condition(self, part: LinePart) -> ast.Expr | None:
        """Parse the expression behind the first word of a part that has a body."""
        return cast("ast.Expr | None", self.line(LineKind.EXPRESSION, part, 1, opens=True))

    # --- declarations

    def declarations(self, part: LinePart) -> tuple[ast.VarDecl, ...]:
        """Parse the declarations in the body of a part."""
        if part.colon is None:
            self.body(part)
        lines = [line for line in part.body if not self.is_displaced(line, or_named=True)]
        return tuple(decl for line in lines for decl in self.declaration(line))

    def declaration(self, part: LinePart, start: int = 0) -> list[ast.VarDecl]:
        """Parse a line of declarations: one variable, unless it is wrong."""
        if part.colon:
            self.complain(
                part,
                "K115",
                part.colon.span,
                "no `:` stands in a declaration",
                _typed(part) or "leave the `:` out; a value stands behind `=`: `int x = 3`",
            )
        decl = self.line(LineKind.DECLARATION, part, start)
        if decl:
            return [decl, *_others(decl, part.tokens)] if part.told == "K137" else [decl]
        tokens = part.tokens[start:]
        for position, token in enumerate(tokens):
            if token.type == "ASSIGN":  # without its value the variable may be readable
                part = LinePart(tokens[:position], broken=True)
                decl = self.line(LineKind.DECLARATION, part) if position else None
                break
        return [decl] if decl else []

    # --- heads of blocks

    def ends(self, part: LinePart, length: int) -> None:
        """Report a part that goes on behind its first ``length`` words."""
        if len(part.tokens) <= length or self._splits(part, length):
            return
        token = part.tokens[length]
        hint = "a condition stands behind `elif`" if part.first == "ELSE" else None
        self.complain(
            part, "K130", token.span, f"`:` is expected here, but found `{shown(token.text)}`", hint
        )

    def name(self, part: LinePart, at: int, what: str, then: int = 0) -> ast.Ident:
        """Parse the name at word number ``at``; ``then`` words more end the part."""
        token = part.tokens[at] if at < len(part.tokens) else part.end
        if token.type == "NAME":
            self.ends(part, at + 1 + then)
        elif token.text in KEYWORDS:
            self.lost.add(token.text)
            self.complain(
                part,
                "K131",
                token.span,
                f"`{token.text}` is a keyword and cannot be used as a name",
                f"choose another name, such as `{token.text}_`",
            )
        else:
            self.complain(part, "K130", token.span, f"the name of {what} is expected here")
            return ast.Ident("?", span=token.span)
        return ast.Ident(token.text, span=token.span)

    def _splits(self, part: LinePart, at: int) -> bool:
        """Take word number ``at`` for the beginning of the body, if ``:`` is missing before it."""
        if at >= len(part.tokens) or not at:
            return False
        token = part.tokens[at]
        if part.colon and token.type not in BLOCKS:
            return False
        if at == 1 and not part.colon and part.tokens[0].text in _ONE_WORD:
            self._no_colon(part, part.tokens[0], token.span)
        else:
            message = f"`:` is missing before `{shown(token.text)}`"
            self.complain(part, "K114", token.span, message, "write `:`")
        rest = LinePart(part.tokens[at:], part.colon, quantified=part.quantified)
        rest.broken = part.broken
        if part.colon:
            rest.body, part.body = part.body, [rest]
        else:
            part.body = [rest, *part.body]
        part.tokens, part.colon = part.tokens[:at], token
        return True

    def head(self, part: LinePart) -> None:
        """Read a part that is one word and has no node; remember where it stands."""
        self.ends(part, 1)
        token = part.tokens[0]
        self.heads.append(ast.Ident(token.text, span=token.span))

    def no_semicolon(self, part: LinePart) -> None:
        """Warn of the ``;`` behind a guard. [OLD-COLON]"""
        if part.semicolon:
            span = part.semicolon.span
            self.old(part, span, "no `;` ends a guard", "leave it out", Edit(span, ""))

    # --- bodies

    def body(self, part: LinePart) -> list[LinePart]:
        """Read the body of a part that must have one."""
        word = f"`{shown(part.tokens[-1].text)}`" if part.tokens else "this"
        if part.colon is None and part.body and part.first not in _STATEMENTS:
            end = part.end
            self._no_colon(part, part.tokens[-1], end.span)
            part.colon = end
        elif part.colon is None:
            self.complain(part, "K114", part.end.span, f"`:` is missing behind {word}", "write `:`")
        elif not part.body:
            first = f"`{shown(part.tokens[0].text)}`" if part.tokens else "this"
            self.complain(
                part,
                "K113",
                part.span,
                f"{first} has no body",
                "write it behind the `:` or in deeper-indented lines below; `pass` does nothing",
            )
        return part.body

    def no_block(self, part: LinePart) -> None:
        """Report a part that has a body where none is allowed."""
        if part.colon:
            self.complain(part, "K115", part.colon.span, "no block can begin here", "leave `:` out")

    def expressions(self, part: LinePart) -> list[ast.Expr]:
        """Read the expressions in the body of a part, one a line."""
        found = [self.expression(line) for line in self.joined(self.body(part))]
        return [expression for expression in found if expression]

    def conjunction(self, part: LinePart) -> ast.Expr | None:
        """Read the body of a part as one condition; several lines must all hold."""
        found = self.expressions(part)
        if not found:
            return None
        if len(found) > MAX_DEPTH:
            message = f"more than {MAX_DEPTH} conditions"
            self.complain(part, "K109", part.span, message, "make functions of some of them")
            return None
        whole = found[0]
        for more in found[1:]:
            span = whole.span.to(more.span)
            whole = ast.Binary(ast.BinaryOp.AND, whole, more, span=span)
        return whole

    def joined(self, parts: list[LinePart]) -> list[LinePart]:
        """Join lines of expressions; one that is unfinished goes on with the next."""
        lines: list[LinePart] = []
        for part in parts:
            last = lines[-1] if lines else None
            if (
                last
                and last.tokens
                and not last.colon
                and part.tokens
                and (last.tokens[-1].type in UNFINISHED or part.first in GOES_ON)
            ):
                lines[-1] = LinePart(
                    last.tokens + part.tokens,
                    part.colon,
                    part.body,
                    broken=last.broken or part.broken,
                    quantified=last.quantified or part.quantified,
                )
            else:
                lines.append(part)
        return lines


def _behind(token: Token) -> Span:
    """The place just behind a token."""
    return Span(token.file, token.line, token.end_column, token.line, token.end_column)


def _others(decl: ast.VarDecl, tokens: list[Token]) -> list[ast.VarDecl]:
    """The further names of a declaration that has several."""
    found = []
    depth = 0
    for token, following in pairwise(tokens):
        depth += token.type in ("LPAR", "LSQB", "LBRACE", "LESS")
        depth -= token.type in ("RPAR", "RSQB", "RBRACE", "GREATER")
        if token.type == "COMMA" and following.type == "NAME" and not depth:
            name = ast.Ident(following.text, span=following.span)
            found.append(ast.VarDecl(decl.type, name, span=following.span))
    return found


def _typed(part: LinePart) -> str | None:
    """A hint for ``x: int``, as other languages declare."""
    inside = [token for line in part.body for token in line.tokens]
    if len(part.tokens) != 1 or not inside or inside[0].type != "NAME":
        return None
    at = next((k for k, token in enumerate(inside) if token.type == "ASSIGN"), len(inside))
    type_ = "".join(f"{shown(token.text)}{' ' * (token.text == ',')}" for token in inside[:at])
    value = " …" if at < len(inside) else ""
    return f"write `{type_} {shown(part.tokens[0].text)}{' =' * bool(value)}{value}`"


def has_pieces(part: LinePart) -> bool:
    """Return whether a part contains a guard or an effect."""
    return any(line.first in ("PRE", "EFF") for line in part.body)
