"""Texts and places: what an editor counts is what koord counts, whatever the characters."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lsprotocol import types

from koord.api.editing import Source, normalise
from koord.lsp.places import Places
from koord.lsp.texts import changed, offset

ENCODINGS = [
    types.PositionEncodingKind.Utf8,
    types.PositionEncodingKind.Utf16,
    types.PositionEncodingKind.Utf32,
]
TEXTS = st.text(st.sampled_from("ab é∧🤖\n\r\u2028\x0b\t"), max_size=40)


def units(text: str, encoding: types.PositionEncodingKind) -> int:
    match encoding:
        case types.PositionEncodingKind.Utf8:
            return len(text.encode())
        case types.PositionEncodingKind.Utf16:
            return len(text.encode("utf-16-le")) // 2
        case types.PositionEncodingKind.Utf32:
            return len(text)


def positions(text: str, encoding: types.PositionEncodingKind) -> list[types.Position]:
    """The position of each character, and of the end, counted one by one."""
    found = []
    line, start = 0, 0
    for at in range(len(text) + 1):
        found.append(types.Position(line, units(text[start:at], encoding)))
        is_end = text[at : at + 1] == "\n" or (
            text[at : at + 1] == "\r" and text[at + 1 : at + 2] != "\n"
        )
        if is_end:
            line, start = line + 1, at + 1
    return found


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(text=TEXTS)
def test_every_character_is_found_by_its_position(
    encoding: types.PositionEncodingKind, text: str
) -> None:
    for at, position in enumerate(positions(text, encoding)):
        if text[at - 1 : at + 1] == "\r\n":
            continue  # between the two there is no place
        assert offset(text, position, encoding) == at


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(text=TEXTS, ends=st.tuples(st.integers(0, 40), st.integers(0, 40)), new=TEXTS)
def test_a_change_replaces_just_what_it_says(
    encoding: types.PositionEncodingKind, text: str, ends: tuple[int, int], new: str
) -> None:
    start, end = sorted(min(end, len(text)) for end in ends)
    if any(text[at - 1 : at + 1] == "\r\n" for at in (start, end)):
        return
    places = positions(text, encoding)
    change = types.TextDocumentContentChangePartial(types.Range(places[start], places[end]), new)
    assert changed(text, change, encoding) == text[:start] + new + text[end:]


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(text=TEXTS)
def test_places_of_koord_are_those_of_the_editor(
    encoding: types.PositionEncodingKind, text: str
) -> None:
    source = Source("a.krd", normalise(text))
    places = Places(source, encoding)
    for at in range(len(source.text) + 1):
        line, column = source.place(at)
        position = places.position(line, column)
        assert places.line_and_column(position) == (line, column)
        assert positions(source.text, encoding)[at] == position


def test_places_behind_the_end_are_the_end() -> None:
    encoding = types.PositionEncodingKind.Utf16
    assert offset("ab\ncd", types.Position(0, 99), encoding) == 2
    assert offset("ab\ncd", types.Position(9, 0), encoding) == 5
    assert Places(Source("a", "ab\ncd"), encoding).line_and_column(types.Position(9, 3)) == (10, 1)
