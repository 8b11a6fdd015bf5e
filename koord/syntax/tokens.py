"""From text to tokens: words, numbers, operators, and what is no part of the language.

One regular expression finds the tokens; each is a :class:`Token` on one line. Words that are
keywords only where their construct is (``at``, ``round``, ``extern``, …) are names here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from koord.syntax.ast import Comment
from koord.syntax.report import Report
from koord.syntax.source import Source, Span

#: Words that no program may use as names.
KEYWORDS = frozenset(
    "agent allread allwrite and assume atomic break def eff elif else enum eventually exists false "
    "False for forall if implies in init invariant leadsto local not or param pass pre return stop "
    "true True trystop urgent using".split()
)

#: Operators between two operands. ``-``, ``<`` and ``>`` have types of their own, since they also
#: stand elsewhere.
OPERATORS = frozenset(
    ["+", "*", "/", "%", "==", "!=", "≠", "<=", "≤", ">=", "≥", "&&", "||", "and", "or", "implies"]
)

_TYPES = {word: word.upper() for word in KEYWORDS}
_TYPES |= dict.fromkeys(OPERATORS, "OPERATOR")
_TYPES |= {"&": "OPERATOR", "|": "OPERATOR", "!": "NOT"}
_TYPES |= {
    "-": "MINUS",
    "<": "LESS",
    ">": "GREATER",
    "=": "ASSIGN",
    "<<": "OUTPUT",
    "->": "ARROW",
    "++": "INCREMENT",
    "--": "DECREMENT",
    "(": "LPAR",
    ")": "RPAR",
    "[": "LSQB",
    "]": "RSQB",
    "{": "LBRACE",
    "}": "RBRACE",
    ",": "COMMA",
    ".": "DOT",
    ":": "COLON",
    ";": "SEMICOLON",
    "@": "AT",
    "'": "PRIME",
}

_TOKEN = re.compile(
    r"""
      (?P<SPACE>[ \t]+)
    | (?P<NAME>[A-Za-z_][A-Za-z0-9_]*)
    | (?P<COMMENT>(?:\#|//)[^\n]*)
    | (?P<SIGN><<|->|\+\+|--|[=!<>]=|&&|\|\||[-+*/%<>=!≠≤≥()\[\]{},.:;@'&|])
    | (?P<NUMBER>[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?(?P<TAIL>[A-Za-z0-9_]*))
    | (?P<NEWLINE>\n[ \t]*)
    | (?P<STRING>"(?:[^"\\\n]|\\[^\n])*(?P<QUOTE>"?))
    | (?P<BAD>[^\x20-\x7e\n\t≠≤≥]+|.)
    """,
    re.VERBOSE,
)


@dataclass(slots=True)
class Token:
    """A word of the text, on one line. ``type`` is the name of its terminal in the grammar."""

    type: str
    text: str
    file: str
    line: int
    column: int
    end_column: int

    @property
    def span(self) -> Span:
        """Where the token stands."""
        return Span(self.file, self.line, self.column, self.line, self.end_column)


@dataclass(slots=True)
class TextLine:
    """A line of the file: the columns of its indentation, and its tokens."""

    indent: int
    tokens: list[Token]


#: A number has at most so many digits, and an exponent of at most so much.
MAX_DIGITS = 400

_TAB = 4


def tokenise(source: Source, report: Report) -> tuple[list[TextLine], tuple[Comment, ...]]:
    """The lines of a text that are not blank, and its comments."""
    lines: list[TextLine] = []
    comments: list[Comment] = []
    file = source.name
    text = source.text
    tokens: list[Token] = []
    lines.append(TextLine(0, tokens))
    add = tokens.append
    types = _TYPES
    line = 1
    start = 0  # offset of column 1 of the line
    tab: Span | None = None
    tabs = 0
    position = len(text) - len(text.lstrip(" "))
    lines[0].indent = position
    for match in _TOKEN.finditer(text, position):
        kind = match.lastgroup
        if kind == "SPACE":
            continue
        begin, end = match.span()
        column = begin - start + 1
        if kind == "NAME" or kind == "SIGN":
            word = match.group()
            add(Token(types.get(word, "NAME"), word, file, line, column, end - start + 1))
        elif kind == "NEWLINE":
            line += 1
            start = begin + 1
            indent = end - start
            if "\t" in match.group():
                indent = len(text[start:end].expandtabs(_TAB))
                tabs += 1
                tab = tab or Span(file, line, 1, line, end - start + 1)
            tokens = []
            add = tokens.append
            lines.append(TextLine(indent, tokens))
        elif kind == "COMMENT":
            comments.append(Comment(line, column, match.group().rstrip(), not tokens))
        else:
            token = Token("NAME", match.group(), file, line, column, end - start + 1)
            if kind == "NUMBER":
                _number(token, match, report)
            elif kind == "STRING":
                _string(token, match, report)
            else:
                _bad(token, report)
                continue
            add(token)
    if tab:
        _tabs(tab, tabs, report)
    return [line for line in lines if line.tokens], tuple(comments)


def _number(token: Token, match: re.Match[str], report: Report) -> None:
    digits = token.text
    token.type = "INT" if digits.isdigit() else "FLOAT"
    if match.group("TAIL"):
        report.error(
            "K103",
            token.span,
            f"`{_shown(digits)}` is neither a number nor a name",
            "a name begins with a letter or `_`",
        )
        token.type, token.text = "INT", "0"
    elif len(digits) > MAX_DIGITS or ("e" in digits.lower() and _exponent(digits) > MAX_DIGITS):
        report.error("K103", token.span, f"a number has at most {MAX_DIGITS} digits")
        token.type, token.text = "INT", "0"


def _exponent(digits: str) -> int:
    return abs(int(digits.lower().partition("e")[2]))


_ESCAPES = {"n": "\n", "t": "\t", '"': '"', "\\": "\\"}


def _string(token: Token, match: re.Match[str], report: Report) -> None:
    token.type = "STRING"
    if not match.group("QUOTE"):
        report.error(
            "K102",
            token.span,
            "this string has no end on its line",
            'close it with `"`; a line break in a string is written `\\n`',
        )
        token.text += '"'
    for escape in re.finditer(r"\\(.)", token.text[:-1]):
        if escape.group(1) not in _ESCAPES:
            column = token.column + escape.start()
            report.error(
                "K104",
                Span(token.file, token.line, column, token.line, column + 2),
                f"`{_shown(escape.group())}` means nothing in a string",
                'known are `\\n`, `\\t`, `\\"` and `\\\\`',
            )


def string_value(text: str) -> str:
    """The text that a string token means."""
    return re.sub(r"\\(.)", lambda match: _ESCAPES.get(match.group(1), match.group()), text[1:-1])


def _bad(token: Token, report: Report) -> None:
    character = token.text[0]
    shown = f"`{character}`" if character.isprintable() else "this character"
    hint = None
    if character in "“”„«»‘’`":
        hint = 'strings stand between `"`'
    elif character.isalpha():
        hint = "names are made of the letters a to z, digits and `_`"
    report.error(
        "K101", token.span, f"{shown} (U+{ord(character):04X}) is not part of the language", hint
    )


def _tabs(tab: Span, count: int, report: Report) -> None:
    more = f" (so do {count - 1} more lines)" if count > 1 else ""
    report.error("K105", tab, f"this line is indented with a tab{more}", "indent with spaces")


def _shown(text: str) -> str:
    return text if len(text) <= 20 else text[:19] + "…"
