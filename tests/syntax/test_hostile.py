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
from tests.sampling import examples, first

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


def bytes_as(count: int, encoding: str, errors: str) -> str:
    return random.Random(1).randbytes(count).decode(encoding, errors)


#: Texts, and the code of the first thing that is told of them (None if they are well).
#: They grow with ``k``, which stands for a thousand.
TEXTS: list[tuple[str, Callable[[int], str], str | None]] = [
    ("random bytes", lambda k: bytes_as(100 * k, "latin-1", "strict"), "K101"),
    ("bytes that are no text", lambda k: bytes_as(100 * k, "utf-8", "surrogateescape"), "K101"),
    ("brackets", lambda k: f"{IN}{'(' * (10 * k)}a{')' * (10 * k)}\n", "K108"),
    ("open brackets", lambda k: f"{IN}{'([{' * (10 * k)}", "K108"),
    ("closing brackets", lambda k: ")" * (10 * k), "K122"),
    ("brackets of all kinds", lambda k: f"{IN}{'(]' * (10 * k)}", "K121"),
    ("a large file", lambda k: "x = 1\n" * 900_000, "K106"),
    ("a long line", lambda k: IN + "[" + "ab, " * (25 * k) + "c]\n", None),
    ("a long sum", lambda k: IN + " + ".join(["a"] * (25 * k)), "K109"),
    ("a long name", lambda k: IN + "a" * (100 * k), None),
    ("a long number", lambda k: IN + "9" * (100 * k), "K103"),
    ("a great number", lambda k: IN + "1e999999999", "K103"),
    ("a long string", lambda k: IN + '"' + "a" * (100 * k) + '"', None),
    ("a long open string", lambda k: IN + '"' + "\\" * (100 * k + 1), "K102"),
    ("quotation marks", lambda k: '"\n' * (20 * k), "K102"),
    ("NULs", lambda k: "\0" * (100 * k), "K101"),
    ("NULs among words", lambda k: "x\0 " * (30 * k), "K101"),
    ("lone surrogates", lambda k: "\ud800 x" * (30 * k), "K101"),
    ("a lone surrogate in a string", lambda k: f'{IN}"\ud800"\n', "K101"),
    ("a lone surrogate in a comment", lambda k: "# \ud800\n", None),
    (
        "deep blocks",
        lambda k: "E:\n eff:\n" + "".join(f"{' ' * i}if x:\n" for i in range(2, 900)),
        "K108",
    ),
    ("deep blocks on a line", lambda k: f"E:\n  eff: {'if x: ' * (20 * k)}stop\n", "K108"),
    ("colons", lambda k: ":" * (50 * k), "K108"),
    ("lines of colons", lambda k: ":\n" * (50 * k), "K141"),
    ("minus signs", lambda k: f"{IN}{'- ' * (50 * k)}a", "K109"),
    ("fields", lambda k: f"{IN}a{'.b' * (30 * k)}", "K109"),
    ("indices", lambda k: f"{IN}a{'[0]' * (30 * k)}", "K109"),
    ("implications", lambda k: IN + " implies ".join("a" * (10 * k)), "K109"),
    ("comparisons", lambda k: IN + " < ".join("a" * (20 * k)), "K134"),
    ("quantifiers", lambda k: "invariant: " + "forall i: " * (10 * k) + "x", "K109"),
    ("conditions", lambda k: "E:\n  pre:\n" + "    a\n" * (20 * k) + "  eff: stop\n", "K109"),
    ("open types", lambda k: "local:\n  " + "Map<" * (20 * k), "K130"),
    ("deep types", lambda k: f"local:\n  {'List<' * (5 * k)}int{'>' * (5 * k)} x\n", "K109"),
    ("arms", lambda k: "E:\n  eff:\n    if a: stop\n" + "    elif b: stop\n" * (10 * k), None),
    ("lost elses", lambda k: "E:\n  eff:\n" + "    else: stop\n" * (10 * k), "K116"),
    ("elses on a line", lambda k: "E:\n  eff: if x: stop " + "else: if x: stop " * (5 * k), "K117"),
    ("semicolons", lambda k: ";" * (50 * k), "K133"),
    ("calls left open", lambda k: "E:\n  eff:\n" + "    x = f(\n" * (20 * k), "K120"),
    ("events left open", lambda k: "E:\n  eff: x = (\n" * (10 * k), "K120"),
    ("steps", lambda k: "".join(f"{' ' * (i % 7)}x\n" for i in range(20 * k)), "K110"),
    ("tabs", lambda k: "\tx = 1\n" * (20 * k), "K105"),
    ("keywords", lambda k: "if " * (50 * k), "K141"),
    ("names", lambda k: "a " * (50 * k), "K141"),
    ("comments", lambda k: "# x\n" * (100 * k), None),
    ("blank lines", lambda k: "  \n" * (100 * k), None),
    ("names in a declaration", lambda k: "local:\n  int a" + ", b" * (20 * k), "K137"),
    ("joined lines", lambda k: "assume:\n" + "  a\n  and b\n" * (10 * k), None),
    ("lines that go on", lambda k: "invariant:\n" + "  a and\n" * (10 * k) + "  b\n", "K109"),
    ("bodies at the level of heads", lambda k: "E:\n" + "pre: x\n" * (10 * k), "K143"),
]


@pytest.mark.parametrize("k", first(1, [50, 1000]))
@pytest.mark.parametrize(("name", "make", "code"), TEXTS)
def test_hostile_texts(name: str, make: Callable[[int], str], code: str | None, k: int) -> None:
    found = parsed(make(k)).diagnostics
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
