from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.cli.diagnostics import excerpt
from koord.cli.terminal import Paint, Style, cells
from koord.syntax.source import Source, Span


def show(text: str, *place: int, width: int = 100) -> list[str]:
    """The excerpt for (line, column, end line, end column), or (line, column, end column)."""
    line, column, *end = place
    end_line, end_column = end if len(end) == 2 else (line, *end)
    span = Span("f", line, column, end_line, end_column)
    return list(excerpt(Source("f", text), span, Style(width), Paint.ERROR))


def test_the_carets_stand_under_the_place() -> None:
    assert show("a = b\n  x = task + 1\n", 2, 7, 11) == [
        "  2 |   x = task + 1",
        "    |       ^^^^",
    ]


def test_a_tab_before_the_place_takes_four_cells() -> None:
    assert show("\tx = 1", 1, 2, 3) == ["  1 |     x = 1", "    |     ^"]
    assert show("\tx = 1", 1, 1, 2) == ["  1 |     x = 1", "    | ^^^^"]


def test_wide_and_combining_characters_are_measured_in_cells() -> None:
    assert show('s = "日本" + y', 1, 12, 13) == ['  1 | s = "日本" + y', "    |              ^"]
    assert show("e\u0301 = y", 1, 6, 7) == ["  1 | e\u0301 = y", "    |     ^"]


def test_an_empty_span_and_one_behind_the_line_have_one_caret() -> None:
    assert show("pre x", 1, 6, 6) == ["  1 | pre x", "    |      ^"]
    assert show("pre x", 1, 4, 4) == ["  1 | pre x", "    |    ^"]
    assert show("pre x", 1, 60, 70) == ["  1 | pre x", "    |      ^"]
    assert show("", 1, 1, 1) == ["  1 |", "    | ^"]


def test_a_place_outside_of_the_text_shows_nothing() -> None:
    assert show("x", 7, 1, 2) == []
    assert show("x", 0, 0, 0) == []


def test_several_lines_show_the_first_and_the_last() -> None:
    text = "eff: x = f(a,\n    b,\n    c) + 1\n"
    assert show(text, 1, 10, 3, 7) == [
        "  1 | eff: x = f(a,",
        "    |          ^^^^",
        "...",
        "  3 |     c) + 1",
        "    |     ^^",
    ]
    assert show(text, 1, 10, 2, 6)[2:] == ["  2 |     b,", "    |     ^"]


def test_a_span_up_to_the_start_of_a_line_ends_on_the_line_before() -> None:
    assert show("ab\ncd\n", 1, 1, 2, 1) == ["  1 | ab", "    | ^^"]


def test_line_numbers_are_aligned() -> None:
    text = "x\n" * 120
    shown = show(text, 9, 1, 110, 2)
    assert shown[0] == "    9 | x"
    assert shown[-2] == "  110 | x"


def test_a_long_line_is_cut_around_the_place() -> None:
    text = "a" * 500 + "HERE" + "b" * 500
    line, marks = show(text, 1, 501, 505, width=60)
    assert line.startswith("  1 | ...a")
    assert line.endswith("b...")
    assert cells(line) <= 60
    assert line[marks.index("^") : marks.rindex("^") + 1] == "HERE"


def test_a_long_line_is_cut_at_one_end_if_the_place_is_at_the_other() -> None:
    line, marks = show("HERE" + "b" * 500, 1, 1, 5, width=60)
    assert line.startswith("  1 | HEREb")
    assert marks == "    | ^^^^"
    line, marks = show("b" * 500 + "HERE", 1, 501, 505, width=60)
    assert line.endswith("bHERE")
    assert marks.endswith("^^^^")
    assert len(marks) == len(line)


def test_a_mark_longer_than_the_line_shown_is_cut_with_it() -> None:
    line, marks = show("x" * 500, 1, 1, 501, width=60)
    assert cells(line) <= 60
    assert cells(marks) <= 60
    assert marks.count("^") > 30


def test_a_very_long_line_costs_no_more_than_a_short_one() -> None:
    text = "(" * 5_000_000
    started = time.process_time()
    for column in range(1, 5_000_000, 100_000):
        assert show(text, 1, column, column + 1)[1].endswith("^")
    assert time.process_time() - started < 20  # about 0.1 s; hours if each looked at all of it


@pytest.mark.parametrize("width", [40, 80])
@given(
    st.text(st.sampled_from("ab \t日e\u0301\x1b\u200d≤"), max_size=120),
    st.integers(1, 130),
    st.integers(0, 130),
)
def test_no_line_is_wider_than_the_terminal(width: int, text: str, column: int, more: int) -> None:
    for line in show(text, 1, column, column + more, width=width):
        assert cells(line) <= width + 1  # a caret may stand behind a line that fills the terminal
        assert "\x1b" not in line
    assert len(show(text, 1, column, column + more, width=width)) == 2
