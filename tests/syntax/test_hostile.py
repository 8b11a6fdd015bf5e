"""No text makes the parser raise, hang, or recurse without bound."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from koord.syntax import ast
from koord.syntax.parsing.line_forms import MAX_DEPTH
from koord.syntax.parsing.lines import MAX_BRACKETS
from koord.syntax.parsing.parser import MAX_CHARACTERS, Parsed, parse
from koord.syntax.parsing.tokens import words
from koord.syntax.printing.program import print_program
from koord.syntax.source import Source, Span
from tests.sampling import but_slow, examples

#: CPU seconds for one text; the slowest takes a third of it on a slow machine.
PATIENCE_S = 6.0
IN = "E:\n  eff:\n    x = "

LISTING = Path(__file__).parent / "golden" / "task_as_printed.krd"


def parsed(text: str) -> Parsed:
    """The text, read in time; what was read can be printed, and what was told can be shown."""
    start = time.process_time()
    found = parse(Source("t", text))
    assert time.process_time() - start < PATIENCE_S
    print_program(found.program)
    lines = text.count("\n") + 1
    for diagnostic in found.diagnostics:
        (diagnostic.message + (diagnostic.hint or "")).encode("utf-8")
        assert 1 <= diagnostic.span.line <= lines
        assert diagnostic.span.column >= 1
    assert depth(found.program) < 2 * MAX_DEPTH + 300
    return found


def depth(node: object) -> int:
    deepest = 0
    waiting = [(node, 0)]
    while waiting:
        item, level = waiting.pop()
        deepest = max(deepest, level)
        if isinstance(item, tuple):
            waiting += [(child, level) for child in item]
        elif isinstance(item, Struct) and not isinstance(item, Span | ast.Comment):
            waiting += [(getattr(item, name), level + 1) for name in item.__struct_fields__]
    return deepest


def bytes_as(encoding: str, errors: str) -> str:
    return random.Random(1).randbytes(100_000).decode(encoding, errors)


#: Texts, and the code of the first thing that is told of them (None if they are well).
TEXTS: list[tuple[str, Callable[[], str], str | None]] = [
    ("random bytes", lambda: bytes_as("latin-1", "strict"), "K101"),
    ("bytes that are no text", lambda: bytes_as("utf-8", "surrogateescape"), "K101"),
    ("brackets", lambda: f"{IN}{'(' * 10_000}a{')' * 10_000}\n", "K108"),
    ("open brackets", lambda: f"{IN}{'([{' * 10_000}", "K108"),
    ("closing brackets", lambda: ")" * 10_000, "K122"),
    ("brackets of all kinds", lambda: f"{IN}{'(]' * 10_000}", "K121"),
    ("a large file", lambda: "x = 1\n" * 900_000, "K106"),
    ("a line of 100,000 characters", lambda: IN + "[" + "ab, " * 25_000 + "c]\n", None),
    ("a long sum", lambda: IN + " + ".join(["a"] * 25_000), "K109"),
    ("a long name", lambda: IN + "a" * 100_000, None),
    ("a long number", lambda: IN + "9" * 100_000, "K103"),
    ("a great number", lambda: IN + "1e999999999", "K103"),
    ("a long string", lambda: IN + '"' + "a" * 100_000 + '"', None),
    ("a long open string", lambda: IN + '"' + "\\" * 100_001, "K102"),
    ("quotation marks", lambda: '"\n' * 20_000, "K102"),
    ("NULs", lambda: "\0" * 100_000, "K101"),
    ("NULs among words", lambda: "x\0 " * 30_000, "K101"),
    ("lone surrogates", lambda: "\ud800 x" * 30_000, "K101"),
    ("a lone surrogate in a string", lambda: f'{IN}"\ud800"\n', "K101"),
    ("a lone surrogate in a comment", lambda: "# \ud800\n", None),
    (
        "deep blocks",
        lambda: "E:\n eff:\n" + "".join(f"{' ' * i}if x:\n" for i in range(2, 900)),
        "K108",
    ),
    ("deep blocks on a line", lambda: f"E:\n  eff: {'if x: ' * 20_000}stop\n", "K108"),
    ("colons", lambda: ":" * 50_000, "K108"),
    ("lines of colons", lambda: ":\n" * 50_000, "K141"),
    ("minus signs", lambda: f"{IN}{'- ' * 50_000}a", "K109"),
    ("fields", lambda: f"{IN}a{'.b' * 30_000}", "K109"),
    ("indices", lambda: f"{IN}a{'[0]' * 30_000}", "K109"),
    ("implications", lambda: IN + " implies ".join("a" * 10_000), "K109"),
    ("comparisons", lambda: IN + " < ".join("a" * 20_000), "K134"),
    ("quantifiers", lambda: "invariant: " + "forall i: " * 10_000 + "x", "K109"),
    ("conditions", lambda: "E:\n  pre:\n" + "    a\n" * 20_000 + "  eff: stop\n", "K109"),
    ("open types", lambda: "local:\n  " + "Map<" * 20_000, "K130"),
    ("deep types", lambda: f"local:\n  {'List<' * 5_000}int{'>' * 5_000} x\n", "K109"),
    ("arms", lambda: "E:\n  eff:\n    if a: stop\n" + "    elif b: stop\n" * 10_000, None),
    ("lost elses", lambda: "E:\n  eff:\n" + "    else: stop\n" * 10_000, "K116"),
    ("elses on a line", lambda: "E:\n  eff: if x: stop " + "else: if x: stop " * 5_000, "K117"),
    ("semicolons", lambda: ";" * 50_000, "K133"),
    ("calls left open", lambda: "E:\n  eff:\n" + "    x = f(\n" * 20_000, "K120"),
    ("events left open", lambda: "E:\n  eff: x = (\n" * 10_000, "K120"),
    ("steps", lambda: "".join(f"{' ' * (i % 7)}x\n" for i in range(20_000)), "K110"),
    ("tabs", lambda: "\tx = 1\n" * 20_000, "K105"),
    ("keywords", lambda: "if " * 50_000, "K141"),
    ("names", lambda: "a " * 50_000, "K141"),
    ("comments", lambda: "# x\n" * 100_000, None),
    ("blank lines", lambda: "  \n" * 100_000, None),
    ("names in a declaration", lambda: "local:\n  int a" + ", b" * 20_000, "K137"),
    ("joined lines", lambda: "assume:\n" + "  a\n  and b\n" * 10_000, None),
    ("lines that go on", lambda: "invariant:\n" + "  a and\n" * 10_000 + "  b\n", "K109"),
    ("bodies at the level of heads", lambda: "E:\n" + "pre: x\n" * 10_000, "K143"),
]


@pytest.mark.parametrize(
    ("name", "make", "code"), but_slow(["calls left open", "events left open", "steps"], TEXTS)
)
def test_hostile_texts(name: str, make: Callable[[], str], code: str | None) -> None:
    found = parsed(make()).diagnostics
    assert (found[0].code if found else None) == code


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("E:\n  eff:\n" + "    x = 1\n" * (MAX_CHARACTERS // 10 - 2), []),
        ("(" * MAX_CHARACTERS, ["K108"]),
        ("x = 1\n" * (MAX_CHARACTERS // 6), ["K141"]),
    ],
    ids=["statements", "brackets", "strays"],
)
def test_the_largest_files(text: str, codes: list[str]) -> None:
    assert [d.code for d in parsed(text).diagnostics] == codes


def test_as_deep_as_may_be() -> None:
    assert parsed(f"{IN}{'(' * MAX_BRACKETS}a{')' * MAX_BRACKETS}\n").diagnostics == ()
    assert parsed(IN + " + ".join("a" * (MAX_DEPTH - 2))).diagnostics == ()
    deep = f"{IN}{'(' * 90}a{' + b)' * 90}\n"
    assert parsed(deep).diagnostics == ()
    deeper = f"{IN}{'(' * 90}a{(' + b' * 9 + ')') * 90}\n"
    assert [d.code for d in parsed(deeper).diagnostics] == ["K109"]


# --- random texts -------------------------------------------------------------------------------


@examples(300)
@given(st.text(max_size=200))
def test_any_text(text: str) -> None:
    parsed(text)


_PIECES = sorted(
    words(
        """( ) [ ] { } : , . = == < > != ! & | + - * / % @ ' " # // ; -> << ++ -- 1 1.5 1e5 x if
        elif else for in atomic pre eff local allread using def fun enum init invariant assume
        eventually leadsto forall exists and or not implies stop return break int pos Map< List<
        extern fresh requires ensures sensors contract environment agent param urgent true "a" ≤
        é $ \\"""
    )
)
_BREAKS = ["\n", "\n  ", "\n    ", "\n      ", "\t"]
_SOUP = st.lists(st.sampled_from(_BREAKS + _PIECES), max_size=60)


@examples(500)
@given(_SOUP, st.booleans())
def test_any_words(pieces: list[str], spaced: bool) -> None:
    parsed((" " if spaced else "").join(pieces))


@examples(300)
@given(st.data())
def test_damaged_programs(data: st.DataObject) -> None:
    text = LISTING.read_text(encoding="utf-8")
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        to = min(len(text), at + data.draw(st.integers(0, 12)))
        text = text[:at] + data.draw(st.sampled_from(["", *_PIECES])) + text[to:]
    parsed(text)
