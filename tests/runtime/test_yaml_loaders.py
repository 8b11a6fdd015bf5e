"""libyaml's loader and PyYAML's own: equal values, places and messages for all texts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from unittest import mock

import pytest
import yaml
from hypothesis import event, given
from hypothesis import strategies as st

from koord.runtime.configuration import loaders, reading
from koord.runtime.configuration.checking import load
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source
from tests.environments import ROOT
from tests.sampling import examples, first

needs_libyaml = pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML without libyaml")

#: Every configuration that lies in the repository, and other YAML.
FILES = sorted(
    path
    for folder in (".github", "specs", "tests")
    for path in (ROOT / folder).rglob("*.y*ml")
    if ".venv" not in path.parts
)


def _told(text: str, quick: Any) -> str:
    """All that is made of a text: the document, the configuration, or what is wrong."""
    source = Source("fleet.yaml", text)
    with mock.patch.object(reading, "quick_loader", quick):
        try:
            document = reading.read(source)
        except KoordError as error:
            return f"unreadable: {error.diagnostics}"
        read = (document.value, document.spans, document.names, document.words)
        try:
            made = load(source)
        except KoordError as error:
            return f"{read} refused: {error.diagnostics}"
    return f"{read} {made.robots} {made.world} {made.params} {made.warnings}"


def _is_quick(text: str) -> bool:
    """Hold what both loaders make of a text against each other; was libyaml's asked at all?"""
    by_libyaml = _told(text, loaders.quick_loader)
    assert by_libyaml == _told(text, lambda _: None)
    return loaders.quick_loader(text) is not None


@needs_libyaml
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_files_of_the_repository_are_read_alike(path: Any) -> None:
    _is_quick(path.read_text("utf-8"))


@needs_libyaml
def test_most_configurations_are_read_quickly() -> None:
    quick = [loaders.quick_loader(path.read_text("utf-8")) is not None for path in FILES]
    assert sum(quick) > 0.8 * len(FILES)


@needs_libyaml
@pytest.mark.parametrize(
    "text",
    first(
        9,
        [
            "a: b",
            "a: {b: ,c: 1}\n",
            "a: {b: # c\n  }\n",
            "a: [b?: 1]\n",
            "a: [1, b? c]\n",
            "a: >#\n  b\n",
            "a: !\n",
            "a: ! b\n",
            "a: b\t\n",
            "a: b\ufeff\n",
            "\ufeffa: b\n",
            "a: b\xa0\n",
            "a: b\u2028c: d\n",
            "a: b\x85c: d\n",
            "a: 'b\n  c'\nd: e\n",
            "%YAML 1.1\n---\na: b\n",
            "a: {<<: {b: 1}, c: 2}\n",
            "a: &a {b: 1}\nc: *a\n",
            "a: " + "[" * 60 + "]" * 60 + "\n",
            "a: " + "[" * 1_500 + "]" * 1_500 + "\n",
            "- " * 1_500 + "\n",
            "a" * 2_000 + ": b\n",
            "a: 'b\n",
            "a: {b\n",
            "a: b: c\n",
            "a: 1_\nb: 2001-13-01\n",
            "a: !!bool b\nc: !!int d\ne: !!timestamp f\ng: !!int\nh: !!float\n",
        ],
    ),
)
def test_texts_that_loaders_take_differently_are_read_alike(text: str) -> None:
    _is_quick(text)


def test_without_libyaml_the_loader_in_python_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert loaders.quick_loader("num_robots: 2\n") is None
    assert len(load(Source("fleet.yaml", "num_robots: 2\n")).robots) == 2


@needs_libyaml
def test_long_texts_are_looked_through_in_one_go() -> None:
    for text in (
        ":" * 200_000,
        ": \n" * 50_000,
        "a: # #\n" * 50_000,
        "# !\n" * 50_000,
        " " * 200_000,
    ):
        assert loaders.quick_loader(text + "\n") is not None
        assert loaders.quick_loader(text + "\n}\t\n") is None


# --- generated ones -------------------------------------------------------------------------------

#: Where they could differ, by what the two are known for and by what fuzzing found.
_ODD = st.sampled_from(
    [
        *(
            " ",
            "  ",
            "\n",
            "\n\n",
            "\t",
            "\r",
            "- ",
            "-\n",
            ": ",
            ":",
            "::",
            "? ",
            "?",
            " # c",
            "#",
        ),
        *(",", "[", "]", "{", "}", "[]", "{}", ", ,", ": ,", ":}", ": # c\n ]", "{a: , b}", "- - "),
        *("&a ", "*a", "!!str ", "!t ", "!", "|\n", ">\n", "|-\n  x\n", "%YAML 1.1\n", "%", "`"),
        *('"', "'", '""', "''", '"a\n b"', '"\\\n x"', '"a":', "'a''b'", "\\x41", "\\", "@", "="),
        *("---", "---\n", "...\n", "--- a\n", "<<: ", "<<: {a: 1}\n", "~", "null", "yes", "0x1"),
        *("1_0", "1:30", "2001-01-01", ".inf", "1e3", "é", "𝄞", "\xa0", "\x85", "\u2028", "\ufeff"),
        *("\x07", "\x00", "\x7f", "\ufffe", "\n# x\n", "\n ", "\n    ", "a:\n", "a: b\n", "a\n  b"),
    ]
)

_WORDS = st.one_of(
    st.sampled_from(["pid", "agents", "devices", "num_robots", "delta", "world", "a b", "x", "1"]),
    st.sampled_from(["", "-", "- a", "?", "a: b", "a # b", "'", '"', "yes", "~", "{", "0x1", "é"]),
    st.integers(-9, 9),
    st.floats(),
    st.booleans(),
    st.none(),
)

_VALUES = st.recursive(
    _WORDS,
    lambda of: st.lists(of, max_size=4) | st.dictionaries(_WORDS, of, max_size=4),
    max_leaves=12,
)


@st.composite
def _written(draw: st.DrawFn) -> str:
    """Values, laid out in many ways."""
    value = draw(st.dictionaries(_WORDS, _VALUES, min_size=1, max_size=5))
    style = draw(st.sampled_from([None, None, None, "'", '"']))
    flow = draw(st.sampled_from([None, False, True]))
    indent, width = draw(st.integers(2, 6)), draw(st.sampled_from([8, 20, 80]))
    return yaml.safe_dump(
        value, default_style=style, default_flow_style=flow, indent=indent, width=width
    )


#: The configurations of the examples, in pieces of a few lines that begin where a line does.
_LINES = [
    line
    for path in FILES
    if path.parent.name != "protocols" and path.name != "expected.yaml"
    for line in path.read_text("utf-8").splitlines(keepends=True)[:40]
]


@st.composite
def _texts(draw: st.DrawFn) -> str:
    """A text that may be good, with a few pieces put in or left out."""
    begin = draw(st.integers(0, len(_LINES) - 1))
    piece = st.just("".join(_LINES[begin : begin + draw(st.integers(1, 15))]))
    text = draw(st.one_of(_written(), piece, st.lists(_ODD, max_size=8).map("".join)))
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(text)))
        text = text[:at] + draw(_ODD) + text[at + draw(st.sampled_from([0, 0, 1, 2])) :]
    return text + draw(st.sampled_from(["\n", "\n", ""]))


def _around(text: str) -> Iterator[str]:
    """A text as it was written by hand, and as files of forms begin."""
    yield from (text, f"# {text}", f"num_robots: 2\nparams: {{a: 1}}\n{text}")


@pytest.mark.slow
@needs_libyaml
@examples(800)
@given(_texts())
def test_generated_texts_are_read_alike(text: str) -> None:
    for one in _around(text):
        event(f"quick: {_is_quick(one)}")


@needs_libyaml
@examples(8_000)
@given(_texts())
@pytest.mark.slow
def test_many_generated_texts_are_read_alike(text: str) -> None:
    for one in _around(text):
        event(f"quick: {_is_quick(one)}")
