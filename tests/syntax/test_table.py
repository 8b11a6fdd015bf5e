"""The prepared table of the line grammar is that of the grammar."""

from __future__ import annotations

import pytest

from koord.syntax.parsing.line_forms import UnexpectedError, parse_line
from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.nodes import Builder
from koord.syntax.parsing.table import Machine, RefusedError, table
from koord.syntax.parsing.table_maker import made


def test_the_table_is_made_of_the_grammar() -> None:
    assert table() == made(), "run `python -m koord.syntax.parsing.table_maker`"


def test_each_rule_has_a_method_and_no_rule_is_empty() -> None:
    for rule in table().rules:
        assert callable(getattr(Builder, rule.method)), rule
        assert rule.size > 0


def test_what_may_come_next_is_told_without_tables_ending_rules_too_soon() -> None:
    makers = tuple((lambda nodes: nodes) for _ in table().rules)
    machine = Machine(LineKind.SIGNATURE.value, makers)
    first = machine.possible()
    assert "NAME" in first
    assert "OPERATOR" not in first
    with pytest.raises(RefusedError):
        machine.feed("OPERATOR", None)
    machine = Machine(LineKind.EXPRESSION.value, makers)
    machine.feed("LPAR", None)
    machine.feed("NAME", None)
    assert {"RPAR", "OPERATOR", "DOT"} <= machine.possible()
    assert machine.possible().isdisjoint({"$END", "RSQB", "NAME"})


def test_a_line_that_is_too_short_is_refused_at_its_end() -> None:
    with pytest.raises(UnexpectedError) as caught:
        parse_line(LineKind.EXPRESSION, [], quantified=False)
    assert caught.value.position == 0
    assert {"NAME", "INT", "LPAR"} <= caught.value.expected
