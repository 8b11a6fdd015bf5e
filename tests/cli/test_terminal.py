from __future__ import annotations

import io

from hypothesis import given
from hypothesis import strategies as st

from koord.cli.terminal import WIDTH_OF_FILES, Paint, Style, cells, style_of, visible


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_colour_needs_a_terminal_that_is_not_told_otherwise() -> None:
    assert style_of(Terminal(), {}).colour
    assert style_of(Terminal(), {"NO_COLOR": ""}).colour
    assert not style_of(Terminal(), {"NO_COLOR": "1"}).colour
    assert not style_of(Terminal(), {"TERM": "dumb"}).colour
    assert not style_of(io.StringIO(), {}).colour
    assert not style_of(None, {}).colour


def test_the_width_is_that_of_the_terminal_within_reason() -> None:
    assert style_of(Terminal(), {"COLUMNS": "120"}).width == 120
    assert style_of(Terminal(), {"COLUMNS": "3"}).width == 40
    assert style_of(Terminal(), {"COLUMNS": "wide"}).width == 80
    assert style_of(io.StringIO(), {"COLUMNS": "120"}).width == WIDTH_OF_FILES


def test_a_closed_stream_is_no_terminal() -> None:
    stream = Terminal()
    stream.close()
    assert style_of(io.StringIO(), {}) == Style()


def test_paint_is_nothing_without_colour() -> None:
    assert Style(colour=False).paint("x", Paint.ERROR) == "x"
    assert Style(colour=True).paint("x", Paint.ERROR) == "\x1b[1;31mx\x1b[0m"
    assert Style(colour=True).paint("", Paint.ERROR) == ""


def test_what_would_steer_the_terminal_is_shown_instead() -> None:
    assert visible("\x1b[2Jx") == "␛[2Jx"
    assert visible("a\tb") == "a    b"
    assert visible("\x00\x7f\x9b\u202e\u2028\ufeff") == "␀␡\ufffd\ufffd\ufffd\ufffd"
    assert visible("x ≤ 日本") == "x ≤ 日本"


def test_cells() -> None:
    assert cells("abc") == 3
    assert cells("日本") == 4
    assert cells("e\u0301") == 1
    assert cells("≤≠") == 2


@given(st.text())
def test_visible_text_has_no_control_characters(text: str) -> None:
    shown = visible(text)
    assert "\x1b" not in shown
    assert len(shown.splitlines()) <= 1
    assert visible(shown) == shown
