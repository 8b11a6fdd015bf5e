"""Parts of lines to nodes, with errors told once: what the parsers of blocks and sections share."""

from __future__ import annotations

from typing import Any, cast

from koord.syntax import ast
from koord.syntax.layout import Part
from koord.syntax.parser_lines import Form, Misplaced, Unexpected, parse_line
from koord.syntax.parser_messages import explain
from koord.syntax.report import Report


class Reader:
    """Reads single lines; a line with a mistake is told and gives None."""

    __slots__ = ("report",)

    def __init__(self, report: Report) -> None:
        self.report = report

    def line(self, form: Form, part: Part, start: int = 0) -> Any | None:
        """The node of a part's tokens from number ``start`` on."""
        tokens = part.tokens[start:] if start else part.tokens
        try:
            return parse_line(form, tokens, part.end)
        except Unexpected as error:
            if not part.broken:
                explain(self.report, form, part, start, error)
        except Misplaced as error:
            self.report.error(error.code, error.span, error.message, error.hint)
        part.broken = True
        return None

    def expression(self, part: Part, start: int = 0) -> ast.Expr | None:
        """The expression that a part is."""
        self.no_block(part)
        return cast("ast.Expr | None", self.line(Form.EXPRESSION, part, start))

    def declarations(self, part: Part) -> tuple[ast.VarDecl, ...]:
        """A declaration for each part of the body."""
        found = []
        for line in self.body(part):
            self.no_block(line)
            decl = self.line(Form.DECLARATION, line)
            if decl:
                found.append(decl)
        return tuple(found)

    def body(self, part: Part) -> list[Part]:
        """The body of a part that must have one."""
        if part.colon is None and not part.broken:
            self.report.error(
                "K114", part.end.span, f"`:` is missing behind {_named(part)}", "write `:` here"
            )
            part.broken = True
        elif not part.body and not part.broken:
            self.report.error(
                "K113",
                part.span,
                f"{_named(part)} has no body",
                "write it behind the `:` or in deeper-indented lines below",
            )
        return part.body

    def no_block(self, part: Part) -> None:
        """Complain if a part has a body where none can be."""
        if part.colon and not part.broken:
            self.report.error("K115", part.colon.span, "no block can begin here")
            part.broken = True

    def ends(self, part: Part, length: int) -> None:
        """Complain if a part goes on behind its first ``length`` words."""
        if len(part.tokens) > length and not part.broken:
            token = part.tokens[length]
            self.report.error("K130", token.span, f"`:` is expected here, not `{token.text}`")
            part.broken = True

    def name(self, part: Part, at: int, what: str, then: int = 0) -> ast.Ident:
        """The name that stands as word number ``at``; ``then`` words more end the part."""
        if at < len(part.tokens) and part.tokens[at].type == "NAME":
            self.ends(part, at + 1 + then)
            token = part.tokens[at]
            return ast.Ident(token.text, span=token.span)
        token = part.tokens[at] if at < len(part.tokens) else part.end
        if not part.broken:
            self.report.error("K130", token.span, f"the name of {what} is expected here")
            part.broken = True
        return ast.Ident("?", span=token.span)

    def expressions(self, part: Part) -> list[ast.Expr]:
        """The expressions that the body of a part lists, one a line."""
        found = [self.expression(line) for line in self.joined(self.body(part))]
        return [expression for expression in found if expression]

    def conjunction(self, part: Part) -> ast.Expr | None:
        """The expression that the body of a part is; several lines must all hold."""
        found = self.expressions(part)
        if not found:
            return None
        whole = found[0]
        for more in found[1:]:
            span = whole.span.to(more.span)
            whole = ast.Binary(ast.BinaryOp.AND, whole, more, span=span)
        return whole

    def joined(self, parts: list[Part]) -> list[Part]:
        """The lines of an expression that goes on over several lines put together."""
        return parts

    def stray(self, part: Part, allowed: str) -> None:
        """Complain about a part that does not belong where it is."""
        if not part.broken:
            self.report.error("K141", part.span, "this does not belong here", allowed)

    def no_section(self, part: Part) -> None:
        """Complain about a line at the left margin that begins no section."""
        self.report.error("K140", part.span, "a section or an event is expected here")


def _named(part: Part) -> str:
    return f"`{part.tokens[0].text}`" if part.tokens else "this"
