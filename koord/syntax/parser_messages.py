"""What to say about a line that no form of the language allows."""

from __future__ import annotations

from koord.syntax.layout import Part
from koord.syntax.parser_lines import Form, Unexpected
from koord.syntax.report import Report


def explain(report: Report, form: Form, part: Part, start: int, error: Unexpected) -> None:
    """Tell what is wrong with the part, once."""
    report.error(
        "K130",
        error.token.span,
        f"unexpected `{error.token.text}`" if error.token.text else "unexpected end of line",
    )
