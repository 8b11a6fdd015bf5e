"""``python -m koord.syntax.parsing.table_maker`` prepares the table of the line grammar.

To be run after each change of ``grammar.lark``; a test sees whether it was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lark import Lark
from lark.lexer import Lexer
from lark.parsers.lalr_analysis import Shift
from msgspec.json import encode, format

from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.table import FILE, Form, Rule, Table


class _NoLexer(Lexer):
    """A lexer for lark that does nothing: tokens are made elsewhere."""

    def __init__(self, conf: Any) -> None:
        pass

    def lex(self, *_: Any) -> Any:
        return iter(())


def made() -> Table:
    """The table of the grammar. States have the order in which they are met."""
    lark = Lark(
        Path(__file__).with_name("grammar.lark").read_text("utf-8"),
        parser="lalr",
        lexer=_NoLexer,
        start=[form.value for form in LineKind],
        maybe_placeholders=False,
    )
    parser: Any = lark.parser
    found = parser.parser._parse_table
    order: dict[int, int] = {}
    waiting = [found.start_states[form.value] for form in LineKind]
    for state in waiting:  # it grows on the way
        if state not in order:
            order[state] = len(order)
            after = sorted(found.states[state].items())
            waiting += [to for _, (action, to) in after if action is Shift]
    number = {rule: n for n, rule in enumerate(lark.rules)}

    def action(kind: object, to: Any) -> int:
        return order[to] if kind is Shift else -1 - number[to]

    return Table(
        {
            form.value: Form(
                order[found.start_states[form.value]], order[found.end_states[form.value]]
            )
            for form in LineKind
        },
        tuple(
            Rule(str(rule.origin.name), len(rule.expansion), str(rule.alias or rule.origin.name))
            for rule in lark.rules
        ),
        tuple(
            {str(symbol): action(*to) for symbol, to in sorted(found.states[state].items())}
            for state in order
        ),
    )


def main() -> None:
    Path(FILE).write_bytes(format(encode(made()), indent=0) + b"\n")


if __name__ == "__main__":
    main()
