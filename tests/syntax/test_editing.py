"""What editors ask about a text: names, completions, cures, folds, with and without mistakes."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from koord.syntax.catalogue import of_programs
from koord.syntax.diagnostics import Severity
from koord.syntax.editing.completion import Completion, completions
from koord.syntax.editing.cures import cures
from koord.syntax.editing.folding import folds
from koord.syntax.editing.highlighting import TokenKind, TokenModifier, semantic_tokens
from koord.syntax.editing.hover import hover
from koord.syntax.editing.inlays import inlays
from koord.syntax.editing.lines import code_of, ends_in_text
from koord.syntax.editing.model import SemanticModel
from koord.syntax.editing.renaming import renamed
from koord.syntax.editing.signatures import signature_help
from koord.syntax.editing.symbols import SymbolKind
from koord.syntax.edits import edited
from koord.syntax.elaboration.library import LIBRARY
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.sampling import first

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"
TASK = (EXAMPLES / "task.krd").read_text("utf-8")


def model(text: str) -> SemanticModel:
    return SemanticModel(Source("app.krd", text))


def marked(text: str) -> tuple[SemanticModel, int, int]:
    """A text without its mark ``|``, and the place of the mark."""
    at = text.index("|")
    made = model(text[:at] + text[at + 1 :])
    return (made, *made.source.place(at))


def in_task(old: str, new: str) -> str:
    assert old in TASK
    return TASK.replace(old, new, 1)


def completed(text: str) -> dict[str, Completion]:
    return {item.label: item for item in completions(*marked(text)).items}


def references(text: str) -> list[tuple[int, int]]:
    found, line, column = marked(text)
    here = found.at(line, column)
    assert here is not None
    return [(each.span.line, each.span.column) for each in found.occurrences_of(here.symbol)]


# --- names ----------------------------------------------------------------------------------------


def test_a_name_is_found_wherever_it_stands() -> None:
    text = in_task("    int mine", "    int m|ine")
    made, _, _ = marked(text)
    lines = made.source.text.split("\n")
    places = references(text)
    assert len(places) == 8
    assert all(lines[line - 1][column - 1 :].startswith("mine") for line, column in places)


def test_the_same_name_of_two_quantifiers_is_two_symbols() -> None:
    text = (
        "local:\n  int x = 0\ninvariant: forall |i: x@i >= 0\ninvariant: forall i, j: x@i >= 0\n"
        "Go:\n  eff: x = 1\n"
    )
    assert references(text) == [(3, 19), (3, 24)]


def test_fields_ports_members_events_and_modules_are_named() -> None:
    text = """\
using Motion:
  sensors:
    pos psn
enum Mode: idle, busy
def Job:
  pos at
local:
  Mode mode = idle
  Job job = Job(at = pos(0, 0, 0))
Go:
  pre: mode == Mode.idle
  eff:
    mode = busy
    job.at = Motion.psn
invariant Ran: forall i: ran(Go)@i implies mode@i == busy
"""
    kinds = {
        (each.symbol.name, each.symbol.kind): sum(
            1 for other in model(text).occurrences_of(each.symbol)
        )
        for each in model(text).occurrences
    }
    assert kinds["mode", SymbolKind.LOCAL] == 4
    assert kinds["busy", SymbolKind.MEMBER] == 3
    assert kinds["idle", SymbolKind.MEMBER] == 3
    assert kinds["Mode", SymbolKind.ENUM] == 3
    assert kinds["at", SymbolKind.FIELD] == 3
    assert kinds["Job", SymbolKind.RECORD] == 3
    assert kinds["psn", SymbolKind.SENSOR] == 2
    assert kinds["Motion", SymbolKind.MODULE] == 2
    assert kinds["Go", SymbolKind.EVENT] == 2


def test_a_call_leads_to_the_overload_that_it_means() -> None:
    made = model(TASK)
    at = TASK.index("pathIsClear(route")
    found = made.at(*made.source.place(at))
    assert found is not None
    assert found.symbol.name_span is not None
    assert found.symbol.name_span.file == LIBRARY
    assert found.symbol.code.startswith("def fun pathIsClear(pos[][] routes")
    assert "robot `me`" in found.symbol.story


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.krd")), ids=lambda path: path.stem)
def test_names_of_examples_stand_where_they_are_said_to(path: Path) -> None:
    """Each is written there; of those with a declaration in the text it is among them."""
    made = model(path.read_text("utf-8"))
    assert made.occurrences
    aliases = {"position", "done", "target", "loc", "assignId", "assignedTo", "taskId", "id"}
    before = (0, 0)
    for each in made.occurrences:
        span, symbol = each.span, each.symbol
        written = made.source.line_text(span.line)[span.column - 1 : span.end_column - 1]
        alike = {"psn", "reached", "Point", "boolean", *aliases}
        assert written == symbol.name or written in alike, (written, symbol)
        assert before <= (span.line, span.column)
        before = (span.line, span.end_column)
        if symbol.name_span is not None and symbol.name_span.file == "app.krd":
            assert any(other.is_declaration for other in made.occurrences_of(symbol)), symbol


def test_names_are_known_on_the_lines_that_can_be_read() -> None:
    text = in_task("mine = i\n", "mine = = i\n").replace("pre: isOnTask", "pre: isOn|Task")
    found, line, column = marked(text)
    here = found.at(line, column)
    assert here is not None
    assert here.symbol.kind is SymbolKind.LOCAL


# --- hover ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("else: atomic:", "else: at|omic:", ["Lock class 0", "`list`", "`ATOMIC`"]),
        ("    Task[tasks] list", "    Task[tasks] li|st", ["allwrite", "lock class 0"]),
        ("Motion.reached", "Motion.rea|ched", ["boolean reached", "sensor of `Motion`"]),
        ("[Motion.psn]\n    Motion", "[Motion.p|sn]\n    Motion", ["contract OnRoute", "ensures"]),
        ("findPath(Motion", "find|Path(Motion", ["extern fresh", "from the library", "result[0]"]),
        ("forall i, j: i != j", "forall i, |j: i != j", ["int j"]),
        ("leadsto ran(Complete)", "leads|to ran(Complete)", ["`PROP-LEADS-TO`"]),
        ("mine = i\n", "mi|ne = = i\n", ["local int mine", "the number of the robot's task"]),
    ],
)
def test_a_place_is_told_about(old: str, new: str, told: list[str]) -> None:
    found = hover(*marked(in_task(old, new)))
    assert found is not None
    assert [piece for piece in told if piece not in found.markdown] == []


@pytest.mark.parametrize(
    ("line", "code", "is_text"),
    [
        ("x = 1 # y", "x = 1 ", True),
        ("x = 1 // y", "x = 1 ", True),
        ('"a # b" << x', "        << x", False),
        (r'"a \" # b" << x', "           << x", False),
        ('x << "a # b', "x <<       ", True),
        ('"" << "/', "   <<   ", True),
        ("x / y", "x / y", False),
        ("", "", False),
    ],
)
def test_strings_and_comments_are_no_code(line: str, code: str, is_text: bool) -> None:
    assert (code_of(line), ends_in_text(line)) == (code, is_text)


def test_a_name_behind_a_string_with_a_comment_sign_is_told_about() -> None:
    text = 'local:\n    int x = 0\nGo:\n    eff: stdout << "a # b // c" << |x\n'
    found = hover(*marked(text))
    assert found is not None
    assert "local int x = 0" in found.markdown


def test_nothing_is_told_about_comments() -> None:
    assert hover(*marked("# if a|tomic\nlocal:\n  int x = 0\n")) is None


# --- completions ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "offered", "lacking"),
    [
        ("mine = i\n", "mine = |\n", "i mine tasks pid length findPath", "pre append x"),
        ("mine = i\n", "|\n", "mine route Motion if for append stop", "int length"),
        ("mine = i\n", "if li|\n", "list", ""),
        ("route, testRoute, pid):", "ro|", "route testRoute", ""),
        ("if pathIsClear(route, testRoute, pid):", "if list[i].|", "loc assigned id", "route if"),
        ("Motion.reached", "Motion.|", "psn position path yaw", "mine"),
        ("Motion.reached", "not Motion.re| and isOnTask", "reached", "mine"),
        ("    int mine", "    Li|\n    int mine", "int List Task pos", "mine"),
        ("    int mine", "    Map<int, |\n    int mine", "int List Task", "mine"),
        ("ran(Complete)", "ran(|", "Assign Complete", "mine"),
        ("i != j and isOnTask@i", "forall k: |", "i j k isOnTask forall list", "append"),
        ("init:", "inv|\ninit:", "invariant local event using", "mine"),
        ("    pre: not isOnTask", "    |", "pre eff", ""),
        ("    sensors:", "    |", "sensors actuators contract environment", "pre"),
        ("requires: true", "requires: |", "psn path forall", "mine"),
    ],
)
def test_what_could_stand_there_is_offered(old: str, new: str, offered: str, lacking: str) -> None:
    found = completed(in_task(old, new))
    assert [name for name in offered.split() if name not in found] == []
    assert [name for name in lacking.split() if name in found] == []


def test_what_has_the_type_that_is_wanted_comes_first() -> None:
    items = completions(*marked(in_task("mine = i\n", "mine = |\n"))).items
    first = [item.label for item in items[:5]]
    assert sorted(first) == ["i", "mine", "numAgents", "pid", "tasks"]


def test_a_completion_replaces_the_word() -> None:
    found = completions(*marked(in_task("mine = i\n", "mine = ta|sk\n")))
    assert found.span.end_column - found.span.column == len("task")


@pytest.mark.parametrize("text", ["# lo|", 'Go:\n  eff: stdout << "a|', "Go:\n  eff: x = 12|"])
def test_nothing_is_offered_in_comments_strings_and_numbers(text: str) -> None:
    assert completed(text) == {}


def test_what_is_offered_means_something() -> None:
    """Each name that is offered for a value is declared there: none is told to be unknown."""
    text = in_task("mine = i\n", "mine = |\n")
    for label, item in completed(text).items():
        if item.is_snippet or item.kind in (SymbolKind.MODULE, SymbolKind.RECORD):
            continue
        told = {d.code for d in model(text.replace("|", label)).diagnostics}
        assert not told & {"K201", "K202", "K203", "K205", "K206"}, label


# --- signatures -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "argument", "label"),
    [
        (
            "def fun f(int a, pos b) -> int:\n  return a\nGo:\n  eff: x = f(1, |",
            1,
            "f(int a, pos b)",
        ),
        ("Go:\n  eff: x = distance(pos(1, 2, 3), |)", 1, "distance(pos a, pos b) -> float"),
        ("Go:\n  eff: x = distance(pos(1, |", 1, "pos(x, y, z)"),
        ("Go:\n  eff: list.append(|", 1, "x.append(v)"),
        ("def Job:\n  int n\n  pos p\nGo:\n  eff: x = Job(n = 1, |", 1, "Job(int n, pos p)"),
    ],
)
def test_a_call_is_shown_with_its_arguments(text: str, argument: int, label: str) -> None:
    found = signature_help(*marked(text))
    assert found is not None
    assert found.argument == argument
    assert label in found.forms[0].label


def test_outside_of_calls_there_is_none() -> None:
    for text in ("Go:\n  eff: x = (1 + |", "Go:\n  eff: x = f(1)|", "# f(|", 'x = "f(|'):
        assert signature_help(*marked(text)) is None


# --- renaming -------------------------------------------------------------------------------------


def test_a_renaming_changes_all_places_and_nothing_else() -> None:
    found, line, column = marked(in_task("    int mine", "    int m|ine"))
    done = renamed(found, line, column, "own")
    text = edited(found.source, done.edits)
    assert text == TASK.replace("mine", "own")
    assert not [d for d in model(text).diagnostics if d.severity is Severity.ERROR]


@pytest.mark.parametrize(
    ("old", "new", "name", "why"),
    [
        ("    int mine", "    int m|ine", "list", "is taken"),
        ("    int mine", "    int m|ine", "if", "word of the language"),
        ("    int mine", "    int m|ine", "2x", "is no name"),
        ("pos psn", "pos p|sn", "place", "drivers"),
        ("findPath(", "find|Path(", "way", "the library"),
        ("else: atomic", "else: ato|mic", "way", "no name here"),
        ("forall i: route[i]", "forall |i: route[i]", "route", ""),
    ],
)
def test_a_renaming_that_would_change_the_meaning_is_refused(
    old: str, new: str, name: str, why: str
) -> None:
    found, line, column = marked(in_task(old, new))
    done = renamed(found, line, column, name)
    assert done.edits == ()
    assert why in done.refused
    assert done.refused


def test_a_name_that_is_caught_by_another_is_refused() -> None:
    """The inner `k` would be read where the outer `i` is meant, without any error."""
    text = (
        "local:\n  int x = 0\nGo:\n  eff: x = 1\n"
        "invariant: forall |i: exists k in 0, 3: x@i + k >= 0\n"
    )
    found, line, column = marked(text)
    assert "something else" in renamed(found, line, column, "k").refused


# --- cures ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "cured"),
    [
        ("Go:\n  eff: mne = 1\nlocal:\n  int mine = 0\n", "eff: mine = 1"),
        ("Go:\n  eff: Motion.target = pos(0, 0, 0)\n", "using Motion\nGo:"),
        ("local:\n  flot z = 1\nGo:\n  eff: z = z + 1\n", "  float z = 1"),
        ("local:\n  int x = 0\nGo:\n  pre: x = 1\n  eff: x = 1\n", "pre: x == 1"),
        ("local:\n  int x = 0\nGo:\n  pre: x > 0 ∧ x < 2\n  eff: x = 1\n", "> 0 and x"),
        ("local:\n  int x = 0\nGo:\n  eff: x = 1 +\n", ""),
    ],
)
def test_a_hint_becomes_an_edit(text: str, cured: str) -> None:
    made = model(text)
    found = [cure for one in made.diagnostics for cure in cures(made, one)]
    assert bool(found) == bool(cured)
    if cured:
        assert cured in edited(made.source, found[0].edits)


def test_cures_of_the_catalogue_help() -> None:
    """Whatever is offered leaves fewer mistakes, and no other ones."""
    offered = 0
    for story in of_programs().values():
        made = model(story.bad)
        for one in made.diagnostics:
            for cure in cures(made, one):
                offered += 1
                after = load(Source("app.krd", edited(made.source, cure.edits))).diagnostics
                told = [d for d in after if d.code == one.code]
                before = [d for d in made.diagnostics if d.code == one.code]
                assert len(told) < len(before), (story.code, cure)
    assert offered >= 15


# --- highlighting, folds, inlays ------------------------------------------------------------------


def test_tokens_say_what_names_mean() -> None:
    made = model(TASK)
    tokens = {
        made.source.line_text(t.span.line)[t.span.column - 1 : t.span.end_column - 1]: t
        for t in semantic_tokens(made)
    }
    assert tokens["list"].kind is TokenKind.VARIABLE
    assert TokenModifier.SHARED in tokens["list"].modifiers
    assert TokenModifier.SHARED not in tokens["mine"].modifiers
    assert TokenModifier.READONLY in tokens["tasks"].modifiers
    assert tokens["findPath"].kind is TokenKind.FUNCTION
    assert TokenModifier.DEFAULT_LIBRARY in tokens["findPath"].modifiers
    assert tokens["Complete"].kind is TokenKind.EVENT
    assert tokens["Motion"].kind is TokenKind.NAMESPACE


def test_blocks_fold_with_and_without_mistakes() -> None:
    text = "# a\n# b\nlocal:\n  int x =\n\nGo:\n  eff:\n    x = = 1\n    x = 2\n"
    assert [(f.first, f.last, f.is_comment) for f in folds(Source("a.krd", text))] == [
        (1, 2, True),
        (3, 4, False),
        (6, 9, False),
        (7, 9, False),
    ]


def test_types_and_locks_are_shown_between_words() -> None:
    text = (
        "allwrite:\n  Task[] list = []\ndef fun half(float x):\n  return x / 2\n"
        "local:\n  float y = 0\n"
        "Go:\n  eff:\n    atomic:\n      for t in list:\n        y = half(y)\n        list = []\n"
    )
    shown = [(hint.line, hint.text) for hint in inlays(model(text))]
    assert shown == [(3, " -> float"), (9, " locks list"), (10, ": Task")]


# --- whatever the text ----------------------------------------------------------------------------

_PIECES = (
    *("\n", "  ", "    ", ":", "(", ")", "[", ".", ",", "=", "==", "@", "'", '"', "#", "∧", "🤖"),
    *(
        "if ",
        "else:",
        "for ",
        "atomic:",
        "forall i: ",
        "Motion.",
        "list[",
        "def fun f(",
        "invariant ",
    ),
    *("agent A:\n", "\t", "\u2028", "\r", "0", "1e9", "local:", "eff:", "koord__hole__"),
)


def mutated(text: str, rng: random.Random) -> str:
    """A text after a few edits at random places."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(text) + 1)
        upto = min(len(text), at + rng.choice((0, 0, 1, 3, 20)))
        text = text[:at] + rng.choice(_PIECES) * rng.choice((0, 1, 1, 2)) + text[upto:]
    return text


def asked(text: str, rng: random.Random) -> Iterator[object]:
    """Everything that an editor asks, at a random place."""
    made = model(text)
    line = rng.randint(1, text.count("\n") + 2)
    column = rng.randint(1, len(made.source.line_text(line)) + 2)
    yield made.occurrences
    yield hover(made, line, column)
    yield completions(made, line, column)
    yield signature_help(made, line, column)
    yield renamed(made, line, column, rng.choice(("zz", "mine", "i", "if", "")))
    yield list(semantic_tokens(made))
    yield folds(made.source)
    yield inlays(made)
    for one in made.diagnostics[:2]:
        yield cures(made, one)


@pytest.mark.parametrize("seed", first(13, range(40)))
def test_no_text_is_too_much(seed: int) -> None:
    rng = random.Random(seed)
    paths = sorted(EXAMPLES.glob("*.krd"))
    text = rng.choice(paths).read_text("utf-8")
    for _ in range(2):
        text = mutated(text, rng)
        for _ in asked(text, rng):
            pass


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 120))
def test_nor_are_many(seed: int) -> None:
    rng = random.Random(seed)
    for path in sorted(EXAMPLES.glob("*.krd")):
        text = path.read_text("utf-8")
        for _ in range(3):
            text = mutated(text, rng)
            for _ in asked(text, rng):
                pass
