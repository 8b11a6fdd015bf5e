"""The API for editors: definitions wherever they are, references; the lexer of Pygments."""

from __future__ import annotations

from pathlib import Path

import pytest
from pygments.lexers import get_lexer_by_name
from pygments.token import Comment, Error, Keyword, Name, Operator, String

import koord
from koord.api.pygments_lexer import KoordLexer

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"
TASK = EXAMPLES / "task.krd"


def at(document: koord.Document, text: str) -> tuple[int, int]:
    return document.source.place(document.source.text.index(text))


def test_a_document_knows_the_program_and_its_diagnostics() -> None:
    document = koord.document(TASK)
    assert document.program is not None
    assert document.diagnostics == ()
    broken = koord.document(koord.Source("a.krd", "Go:\n  eff: x = 1\n"))
    assert broken.program is None
    assert [d.code for d in broken.diagnostics] == ["K201"]
    assert broken.report.errors == broken.diagnostics


def test_a_definition_is_in_the_text_the_library_or_the_specification() -> None:
    document = koord.document(TASK)
    own = document.definition(*at(document, "mine@i"))
    assert own is not None
    assert (own.path, own.span.line) == ("", 34)
    library = document.definition(*at(document, "findPath("))
    assert library is not None
    line = Path(library.path).read_text("utf-8").split("\n")[library.span.line - 1]
    assert line.startswith("def fun findPath(pos start, pos goal) ->")
    rule = document.definition(*at(document, "atomic:"))
    assert rule is not None
    assert Path(rule.path).name == "04-rounds.md"
    assert "[ATOMIC]" in Path(rule.path).read_text("utf-8").split("\n")[rule.span.line - 1]


def test_references_are_those_of_the_symbol_there() -> None:
    document = koord.document(TASK)
    place = at(document, "isOnTask = false")
    every = document.references(*place)
    others = document.references(*place, declaration=False)
    assert len(every) == len(others) + 1
    assert document.references(1, 1) == ()
    assert document.renamable(*place) == every[0]
    assert isinstance(document.renamable(*at(document, "atomic:")), str)


# --- Pygments -------------------------------------------------------------------------------------


def test_the_lexer_is_an_entry_point() -> None:
    assert isinstance(get_lexer_by_name("koord"), KoordLexer)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.krd")), ids=lambda path: path.stem)
def test_the_lexer_reads_every_character(path: Path) -> None:
    text = path.read_text("utf-8")
    tokens = list(KoordLexer(stripnl=False, ensurenl=False).get_tokens(text))
    assert "".join(value for _, value in tokens) == text
    assert not any(kind is Error for kind, _ in tokens)


def test_the_lexer_tells_words_apart() -> None:
    text = 'Go:\n  pre: not done and x\n  eff: stdout << "not" # if\ninvariant Safe: true\n'
    found = {value: kind for kind, value in KoordLexer().get_tokens(text)}
    assert found["Go"] is Name.Label
    assert found["Safe"] is Name.Label
    assert found["not"] is Operator.Word
    assert found["pre"] is Keyword.Declaration
    assert found["true"] is Keyword.Constant
    assert found['"not"'] is String.Double
    assert found["# if"] is Comment.Single
    assert found["x"] is Name
