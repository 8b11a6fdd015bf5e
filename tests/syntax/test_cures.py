"""Cures are right: what a hint says to write is written, and then the mistake is gone."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from koord.syntax.catalogue import of_programs
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.syntax.elaborating import diagnostics

#: Sections above which every case stands.
ABOVE = """\
using Motion
allwrite:
    int total = 0
    Task[] list = []
local:
    float speed = 0
    int counter = 0
    pos aim = pos(0, 0, 0)
def fun half(float x) -> float:
    return x / 2
"""

EVENT = "Go:\n    pre: counter < 3\n    eff:\n        "
CASES = [
    # sections inside of sections
    "local:\n    int x = 0\n    invariant Small: counter <= 3\n",
    "local:\n    int x = 0\n    Step:\n        pre: x < 3\n        eff: x = x + 1\n",
    "local:\n    int x = 0\n    urgent Step:\n        pre: x < 3\n        eff: x = x + 1\n",
    "allwrite:\n    int y = 0\n    local:\n        int x = 0\n",
    "Go:\n    eff: counter = 1\n    invariant Small: counter <= 3\n",
    "Go:\n    eff:\n        counter = 1\n        invariant Small: counter <= 3\n",
    "Go:\n    eff:\n        counter = 1\n    Stay:\n        eff: counter = 2\n",
    "using Rail:\n    sensors:\n        float x\n    Go:\n        eff: counter = 1\n",
    "init:\n    counter = 1\n    assume: total == 0\n",
    "agent Car:\n    local:\n        int x = 0\n        Step:\n            eff: x = x + 1\n",
    # names
    *(f"{word}:\n    eff: counter = 1\n" for word in ("stop", "break", "pass", "return", "in")),
    "local:\n    int stop = 3\n",
    f"{EVENT}counter = countr + 1\n",
    f"{EVENT}speed = distence(aim, aim)\n",
    f"{EVENT}speed = haf(speed)\n",
    f"{EVENT}total = lenght(list)\n",
    f"{EVENT}aim = Motion.pns\n",
    f"{EVENT}list[0].asigned = true\n",
    "local:\n    flot z = 1\n",
    # signs of other languages
    "local:\n    x: int\n",
    "local:\n    x: int = 3\n",
    "local:\n    costs: Map<int, int>\n",
    "Go:\n    pre: counter = 3\n    eff: pass\n",
    f"{EVENT}speed = .5\n",
    f"{EVENT}if counter == 3 mod 2: pass\n",
]


def cured(text: str, found: Diagnostic) -> str | None:
    """The text as the hint says; None if that takes a person."""
    hint, span = found.hint or "", found.span
    lines = text.splitlines()
    line = lines[span.line - 1]
    single = span.line == span.end_line

    def written(new: str) -> str:
        start = span.column - 1
        lines[span.line - 1] = line[:start] + new + line[span.end_column - 1 :]
        return "\n".join(lines) + "\n"

    if by := re.match(r"dedent it by (\d+) spaces?", hint):
        at = span.line - 1
        depth = len(line) - len(line.lstrip())
        last = at + 1
        while last < len(lines) and len(lines[last]) - len(lines[last].lstrip()) > depth:
            last += 1
        moved = [one[int(by[1]) :] for one in lines[at:last]]
        return "\n".join([*lines[:at], *moved, *lines[last:]]) + "\n"
    if meant := re.fullmatch(r"did you mean `([^`…]+)`\?", hint):
        return written(meant[1].removesuffix(":")) if single else None
    if meant := re.match(r"choose another name, such as `(\w+)`", hint):
        return written(meant[1])
    if hint.startswith("leave it out, and put what stands on both lines in"):
        head, sign, rest = re.split(r"(= |: )", line.removesuffix("\\"), maxsplit=1)
        lines[span.line - 1] = f"{head}{sign}({rest}"
        lines[span.line] += ")"
        return "\n".join(lines) + "\n"
    if (typed := re.fullmatch(r"write `(\S.* \w+)( = …)?`", hint)) and found.code == "K115":
        value = line.partition("=")[2]
        indent = line[: len(line) - len(line.lstrip())]
        lines[span.line - 1] = f"{indent}{typed[1]}" + (f" ={value}" if typed[2] else "")
        return "\n".join(lines) + "\n"
    if (sign := re.fullmatch(r"write `([^`…\w]{1,2})`", hint)) and single:
        return written(sign[1])
    if number := re.fullmatch(r"write `([0-9.]+)`", hint):
        start = span.column - 1
        rest = re.sub(r"^[0-9.]+", "", line[start:])
        lines[span.line - 1] = line[:start] + number[1] + rest
        return "\n".join(lines) + "\n"
    return None


def places(found: tuple[Diagnostic, ...]) -> list[tuple[str, int]]:
    return [(one.code, one.span.line) for one in found]


def check(text: str) -> bool:
    """Whether there is a cure that can be written; if so, it has to help."""
    before = diagnostics(text)
    any_cured = False
    for one in before:
        after = cured(text, one)
        if after is None:
            continue
        any_cured = True
        told = diagnostics(after)
        gone = (one.code, one.span.line)
        same = [d for d in told if (d.code, d.span.line) == gone and d.message == one.message]
        assert same == [], (one.hint, after)
        left = [d for d in told if d.severity is one.severity]
        assert len(left) < len([d for d in before if d.severity is one.severity]), (one.hint, after)
        new = {d.code for d in told} - {d.code for d in before}
        assert not new - {"K403", "K401", "K402", "K406"}, (one.hint, after, told)
    return any_cured


@pytest.mark.parametrize("case", CASES)
def test_the_cure_of_a_mistake_helps(case: str) -> None:
    assert check(f"{ABOVE}{case}"), diagnostics(f"{ABOVE}{case}")


def test_so_do_those_of_the_catalogue() -> None:
    tried = [code for code, entry in of_programs().items() if check(entry.bad)]
    assert len(tried) >= 8, tried


# --- names that are suggested ---------------------------------------------------------------------


def suggested(text: str) -> Iterator[tuple[str, str]]:
    for found in diagnostics(text):
        for name in re.findall(r"did you mean `(\w+)`", found.hint or ""):
            yield found.code, name


@pytest.mark.parametrize(
    "text",
    [
        "Go:\n  eff: x = {}(1)\n",
        "Go:\n  eff: x = {}\n",
        "def fun f(int a) -> int:\n  return {}\n",
        "param int n = {}\n",
        "local:\n  int y = {}\n",
        "allwrite:\n  int y = {}\n",
        "invariant: {} > 0\n",
        "Go:\n  eff: x = xs.{}(1)\n",
    ],
)
def test_what_is_suggested_may_stand_there(text: str) -> None:
    """A name that is suggested is none that means nothing, or cannot stand in that place."""
    above = "local:\n  int x = 0\n  int[] xs = []\nallwrite:\n  int score = 0\nparam int most = 3\n"
    misspelt = """sin mins minn xx scor scoer msot mostt pidd numagents Numagents numAgent stoped
        appendd lengt contain chose chooose abss sqr delt assig half push size vector self"""
    for word in misspelt.split():
        for _, name in suggested(above + text.format(word)):
            again = diagnostics(above + text.format(name))
            wrong = {"K201", "K202", "K224", "K226"}
            assert not wrong & {d.code for d in again}, (word, name)


def test_short_names_that_share_little_are_not_suggested() -> None:
    assert list(suggested("local:\n  float x = 0\nGo:\n  eff: x = sun(x) + tin(x) + qs(x)\n")) == []


def test_a_function_of_mathematics_is_to_be_declared() -> None:
    text = "local:\n  float x = 1\nGo:\n  eff: x = {0}\n"
    for call in ("tan(x)", "pow(x, 2)"):
        (found,) = diagnostics(text.format(call))
        declared = re.findall(r"`(def fun [^`]*)`", found.hint or "")
        assert len(declared) == 1
        assert diagnostics(f"{declared[0]}\n{text.format(call)}") == ()


# --- what there is to choose from -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("using Rail:\n  environment:\n    pass\nGo:\n  eff: n = Rail.x\n", "it has no ports"),
        ("Go:\n  eff: n = aim.q\n", "its fields are `x`, `y` and `z`"),
        ("enum Mode: on\nGo:\n  eff: n = Mode.up\n", "its members are `on`"),
    ],
)
def test_there_is_never_nothing_to_choose_from(text: str, hint: str) -> None:
    above = "local:\n  int n = 0\n  pos aim = pos(0, 0, 0)\n"
    assert hint in [found.hint for found in diagnostics(above + text)]


# --- once for each name ---------------------------------------------------------------------------


def test_a_name_that_means_nothing_is_told_once() -> None:
    text = "local:\n  int x = 0\nGo:\n  pre: y < 3\n  eff:\n    x = y + y\n    x = y\n"
    (found,) = diagnostics(text)
    assert found.code == "K201"
    assert found.span.line == 4
    assert found.message == "`y` is not declared; it stands in lines 6, 7 as well"
    (found,) = diagnostics("local:\n  int x = 0\nGo:\n  eff:\n    x = g(x)\n    x = g(1)\n")
    assert (found.code, found.span.line) == ("K202", 5)
    assert found.message.endswith("it stands in line 6 as well")


def test_other_names_and_functions_are_told_of_their_own() -> None:
    text = "local:\n  int x = 0\nGo:\n  eff:\n    x = y + z\n    x = y(1)\n"
    assert [(d.code, d.span.line) for d in diagnostics(text)] == [
        ("K201", 5),
        ("K201", 5),
        ("K202", 6),
    ]


def test_what_is_displaced_is_read_all_the_same() -> None:
    """So that nothing more is told of what it declares."""
    text = "allwrite:\n  int y = 0\n  local:\n    int x = 0\nGo:\n  eff: x = y\n"
    assert [d.code for d in load(Source("a.krd", text)).diagnostics] == ["K141"]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("list.psuh(list[0])", "append"),
        ("list.appned(list[0])", "append"),
        ("list.enqeue(list[0])", "append"),
        ("total = list.lenght()", "length"),
        ("total = list.szie()", "length"),
        ("if total < 1:\n            pass\n        elfi total < 2:\n            pass", "elif"),
        ("fro i = 0, 3:\n            pass", "for"),
        ("atomci:\n            total = 1", "atomic"),
    ],
)
def test_misspelt_operations_and_keywords_are_suggested(wrong: str, right: str) -> None:
    found = [one.hint for one in diagnostics(ABOVE + EVENT + wrong + "\n")]
    assert f"did you mean `{right}`?" in found, found


def test_an_event_inside_of_another_may_have_lost_its_name() -> None:
    text = "local:\n  int x = 0\nA:\n  :\n    pre: x == 0\n    eff: x = 1\n"
    found = load(Source("a.krd", text)).diagnostics
    misplaced = next(d for d in found if d.code == "K141")
    assert (misplaced.span.line, misplaced.span.column) == (4, 3)
    assert misplaced.hint == "dedent it by 2 spaces: it stands beside `A`, not in it"
