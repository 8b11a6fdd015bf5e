"""A lexer of programs for Pygments, an entry point: ``pygmentize -l koord task.krd``."""

from __future__ import annotations

from typing import Any, ClassVar

from pygments.lexer import RegexLexer, bygroups, words
from pygments.token import (
    Comment,
    Keyword,
    Name,
    Number,
    Operator,
    Punctuation,
    String,
    Whitespace,
)

from koord.syntax import vocabulary


def _words(group: frozenset[str]) -> words:
    """A rule for whole words; the longer ones first."""
    return words(tuple(sorted(group, key=lambda word: (-len(word), word))), r"\b", r"\b")


class KoordLexer(RegexLexer):
    """The lexer of Koord."""

    name = "Koord"
    aliases: ClassVar[list[str]] = ["koord", "krd"]
    filenames: ClassVar[list[str]] = ["*.krd"]
    mimetypes: ClassVar[list[str]] = ["text/x-koord"]

    tokens: ClassVar[dict[str, Any]] = {
        "root": [
            (r"\s+", Whitespace),
            (r"(?:#|//)[^\n]*", Comment.Single),
            (r'"(?:[^"\\\n]|\\.)*"?', String.Double),
            (r"\d+(?:\.\d+(?:[eE][+-]?\d+)?|[eE][+-]?\d+)", Number.Float),
            (r"\d+", Number.Integer),
            (
                r"(def)(\s+)(fun)(\s+)(\w+)",
                bygroups(Keyword.Declaration, Whitespace, Keyword, Whitespace, Name.Function),  # type: ignore[no-untyped-call]
            ),
            (
                r"\b(def|enum|agent|using|contract)(\s+)(\w+)",
                bygroups(Keyword.Declaration, Whitespace, Name.Class),  # type: ignore[no-untyped-call]
            ),
            (
                r"\b(invariant|eventually|assume|urgent)(\s+)([A-Za-z_]\w*)(?=[^\n:]*:)",
                bygroups(Keyword.Declaration, Whitespace, Name.Label),  # type: ignore[no-untyped-call]
            ),
            (_words(vocabulary.OPERATORS), Operator.Word),
            (_words(vocabulary.CONSTANTS), Keyword.Constant),
            (_words(vocabulary.SECTIONS), Keyword.Declaration),
            (_words(vocabulary.STATEMENTS), Keyword),
            (rf"\b({'|'.join(sorted(vocabulary.HEADS))})(?=\s*:)", Keyword.Declaration),
            (r"\bextern(?:\s+fresh)?\b|\bat\s+round\b", Keyword),
            (r"^[A-Za-z_]\w*(?=\s*:)", Name.Label),
            (_words(vocabulary.TYPES | vocabulary.GENERIC_TYPES), Keyword.Type),
            (_words(vocabulary.OWN_NAMES), Name.Builtin.Pseudo),
            (
                rf"(?:{'|'.join(sorted(vocabulary.FUNCTIONS))})\b(?=\s*\()",
                Name.Builtin,
            ),
            (r"[A-Za-z_]\w*(?=\s*\()", Name.Function),
            (r"[A-Za-z_]\w*", Name),
            (words(vocabulary.SIGNS), Operator),
            (r"[()\[\]{},.:;]", Punctuation),
            (r".", Punctuation),
        ]
    }
