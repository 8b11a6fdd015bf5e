"""The place of a cursor in the text of a configuration, which is half written there."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import yaml
from msgspec import Struct, field

from koord.runtime.configuration.loaders import quick_loader
from koord.syntax.source import Source, Span

#: Stands for the word at the cursor while the text is read. It is no letter of any language.
_MARK = "\ue000"

#: What stands before the cursor where a line begins with a word.
_ALONE = re.compile(r"[ ]*(?:-[ ]+)*")

_WORD_BEFORE = re.compile(r"\w[\w.-]*$")
_WORD_BEHIND = re.compile(r"[\w.-]*")
_COLON = re.compile(r"[ \t]*:")


class Cursor(Struct, frozen=True):
    """What the cursor stands in: the names of the fields around, and what stands beside it.

    The last of ``path`` is the field whose value is written there, unless it is a name that is.
    """

    path: tuple[str, ...]
    is_name: bool
    beside: Mapping[str, str]  #: the other fields of its mapping, with those values that are words
    span: Span  #: of the word at the cursor, which may be empty
    is_named: bool  #: a colon stands behind it


class _Level(Struct):
    """A mapping or a list that is open."""

    is_mapping: bool
    at_name: bool = False  #: the next scalar is a name
    name: str | None = None  #: the field that is read
    has_entries: bool = False  #: its value is a list without an indent of its own
    words: dict[str, str] = field(default_factory=dict)


def cursor_at(source: Source, line: int, column: int) -> Cursor | None:
    """The place of the cursor; None in comments, between quotes, and behind what is no YAML."""
    at = source.offset(line, column)
    before = source.text[:at]
    found = _WORD_BEFORE.search(before.rpartition("\n")[2])
    start = at - (len(found[0]) if found is not None else 0)
    behind = _WORD_BEHIND.match(source.text, at)
    end = at if behind is None else behind.end()
    is_named = _COLON.match(source.text, end) is not None
    before, rest = source.text[:start], source.text[end:]
    marks = [_MARK]
    if not is_named and _ALONE.fullmatch(before.rpartition("\n")[2]):
        marks.insert(0, f"{_MARK}:")  # without a colon a line is no field of a mapping
    for mark in marks:
        for more in (rest, ""):  # what comes behind may have a mistake that hides the word
            place = _place(before + mark + more)
            if place is not None:
                path, is_name, beside = place
                span = Span(source.name, line, column - (at - start), line, column + (end - at))
                return Cursor(path, is_name, beside, span, is_named)
    return None


def names_under(text: str, field_name: str) -> list[str]:
    """The names of the fields in an outermost field, as far as the text is YAML."""
    return [
        word
        for levels, word in _words(text)
        if len(levels) == 2
        and levels[1].at_name
        and levels[0].name == field_name
        and not levels[0].has_entries
    ]


def words_under(text: str, field_name: str, inner: str) -> list[str]:
    """The values of a field of what an outermost field is, or has in a list."""
    return [
        word
        for levels, word in _words(text)
        if not levels[-1].at_name and _path(levels) == (field_name, inner)
    ]


def _place(text: str) -> tuple[tuple[str, ...], bool, Mapping[str, str]] | None:
    """The names around the mark, whether it is a name itself, and the fields beside it."""
    found: tuple[tuple[str, ...], bool, dict[str, str]] | None = None
    here: _Level | None = None
    for levels, word in _words(text):
        if here is not None and not any(level is here for level in levels):
            break  # what stands beside it has ended
        if word == _MARK and here is None:
            here = levels[-1]
            is_name = here.is_mapping and here.at_name
            found = (_path(levels[:-1] if is_name else levels), is_name, here.words)
    if found is None:
        return None
    path, is_name, words = found
    return path, is_name, {of: word for of, word in words.items() if _MARK not in (of, word)}


def _path(levels: list[_Level]) -> tuple[str, ...]:
    return tuple(level.name for level in levels if level.is_mapping and level.name is not None)


def _words(text: str) -> Iterator[tuple[list[_Level], str]]:
    """Yield each scalar with the levels around it, until the text is no YAML any more."""
    levels = list[_Level]()
    try:
        for token in yaml.scan(text, Loader=quick_loader(text) or yaml.SafeLoader):
            match token:
                case yaml.BlockMappingStartToken():
                    levels.append(_Level(True))
                case yaml.FlowMappingStartToken():
                    levels.append(_Level(True, at_name=True))
                case yaml.BlockSequenceStartToken() | yaml.FlowSequenceStartToken():
                    levels.append(_Level(False))
                case (
                    yaml.BlockEndToken() | yaml.FlowMappingEndToken() | yaml.FlowSequenceEndToken()
                ):
                    if levels:
                        levels.pop()
                case yaml.KeyToken() | yaml.FlowEntryToken() if levels:
                    levels[-1].at_name = levels[-1].is_mapping
                case yaml.ValueToken() if levels:
                    levels[-1].at_name = False
                    levels[-1].has_entries = False
                case yaml.BlockEntryToken() if levels:
                    levels[-1].has_entries = levels[-1].is_mapping
                case yaml.ScalarToken() if levels:
                    yield levels, token.value
                    level = levels[-1]
                    if level.at_name:
                        level.name = token.value
                        level.words.setdefault(token.value, "")
                    elif level.name is not None:
                        level.words[level.name] = token.value
                case _:
                    pass
    except (yaml.YAMLError, RecursionError):
        return
