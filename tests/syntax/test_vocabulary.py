"""The list of words is that of the grammar, the types and the library, and of what highlights."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from koord.syntax import vocabulary
from koord.syntax.editing.words import WORDS
from koord.syntax.elaboration.calls import BUILTINS, CHANGES
from koord.syntax.elaboration.resolve_types import GENERIC, PREDEFINED
from koord.syntax.elaboration.symbols import RESERVED
from koord.syntax.parsing.report import ErrorLog
from koord.syntax.parsing.tokens import tokenise
from koord.syntax.source import Source
from tests.syntax.elaborating import errors

ROOT = Path(__file__).resolve().parents[2]
GRAMMAR = (ROOT / "koord/syntax/parsing/grammar.lark").read_text("utf-8")
READERS = [
    (ROOT / "koord/syntax/parsing" / name).read_text("utf-8")
    for name in ("sections.py", "parser.py", "blocks.py", "strays.py", "reader.py")
]

#: Terminals of the grammar that are no words.
NO_WORDS = vocabulary.words(
    """NAME TYPENAME INT FLOAT STRING OPERATOR MINUS LESS GREATER LPAR RPAR LSQB RSQB LBRACE RBRACE
    COMMA DOT COLON AT PRIME ASSIGN OUTPUT ARROW INCREMENT DECREMENT"""
)


def test_the_words_of_the_grammar_are_keywords() -> None:
    declared = set(re.findall(r"[A-Z]+", " ".join(re.findall(r"%declare (.+)", GRAMMAR))))
    assert declared >= NO_WORDS
    assert {word.lower() for word in declared - NO_WORDS} <= vocabulary.KEYWORDS


def test_what_reads_sections_knows_the_other_keywords() -> None:
    """A word is in the grammar of lines or in what reads sections and blocks."""
    known = {word.lower() for text in (GRAMMAR, *READERS) for word in re.findall(r"\w+", text)}
    operators = {"and", "implies", "or"}  # the lexer knows them
    assert {
        word.lower() for word in vocabulary.KEYWORDS | vocabulary.CONTEXTUAL
    } <= known | operators


def test_groups_have_no_word_in_common() -> None:
    groups = (
        vocabulary.SECTIONS,
        vocabulary.STATEMENTS,
        vocabulary.OPERATORS,
        vocabulary.CONSTANTS,
        vocabulary.CONTEXTUAL,
        vocabulary.OWN_NAMES,
    )
    assert sum(map(len, groups)) == len(frozenset().union(*groups))


def test_types_and_names_are_those_of_the_language() -> None:
    assert set(PREDEFINED) == vocabulary.TYPES
    assert set(GENERIC) == vocabulary.GENERIC_TYPES
    assert RESERVED <= vocabulary.OWN_NAMES
    assert {*BUILTINS, *CHANGES, "choose", "ran", "pos"} == vocabulary.FUNCTIONS


def test_signs_are_those_of_the_lexer() -> None:
    text = " ".join(vocabulary.SIGNS)
    report = ErrorLog()
    (line,) = tokenise(Source("a.krd", text), report).lines
    assert [token.text for token in line.tokens] == list(vocabulary.SIGNS)
    assert report.diagnostics == []


@pytest.mark.parametrize("word", sorted(vocabulary.KEYWORDS))
def test_no_program_uses_a_keyword_as_a_name(word: str) -> None:
    assert errors(f"local:\n  int {word} = 0\nGo:\n  eff: pass\n")


@pytest.mark.parametrize("word", sorted(vocabulary.CONTEXTUAL))
def test_programs_use_words_of_constructs_as_names(word: str) -> None:
    assert errors(f"local:\n  int {word} = 0\nGo:\n  eff: {word} = {word} + 1\n") == []


def test_every_word_is_explained_by_a_rule_that_there_is() -> None:
    known = vocabulary.KEYWORDS | vocabulary.OWN_NAMES | vocabulary.FUNCTIONS
    assert known - {"True", "False"} <= set(WORDS)
    text = (ROOT / "specs/semantics/README.md").read_text("utf-8")
    stated = set(re.findall(r"^\| ([A-Z0-9-]+) \|", text, re.MULTILINE))
    assert {word.rule for word in WORDS.values() if word.rule} <= stated
