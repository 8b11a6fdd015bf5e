"""The lexer: words, numbers, operators, and characters that the language does not have.

One regular expression finds the tokens; each is a :class:`Token` on one line. Words that are
keywords only where their construct is (``at``, ``round``, ``extern``, …) are names here.
"""

from __future__ import annotations

import re
import unicodedata

from msgspec import Struct

from koord.syntax.ast import Comment
from koord.syntax.operators import SPELLINGS
from koord.syntax.parsing.report import ErrorLog
from koord.syntax.source import Source, Span
from koord.syntax.vocabulary import KEYWORDS as KEYWORDS
from koord.syntax.vocabulary import words as words

#: The types of the words that begin a statement with a body, arms of ``if`` included.
LOOPS = words("FOR REPEAT")
BLOCKS = words("IF ATOMIC") | LOOPS
ARMS = words("ELSE ELIF")

_TYPES = {word: word.upper() for word in KEYWORDS}
#: Operators between two operands; ``-``, ``<`` and ``>`` also stand elsewhere.
_TYPES |= dict.fromkeys(SPELLINGS, "OPERATOR")
_TYPES |= {
    "!": "NOT",
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

#: Signs of other languages, and what Koord writes instead.
_FOREIGN = {
    "&": "and",
    "|": "or",
    "∧": "and",
    "∨": "or",
    "¬": "not",
    "∀": "forall",
    "∃": "exists",
    "∈": "in",
    "⇒": "implies",
    "=>": "implies",
    "→": "->",
    ":=": "=",
    "<>": "!=",
    "=<": "<=",
    "===": "==",
    "!==": "!=",
    "−": "-",
    "×": "*",
    "÷": "/",
    "’": "'",
}

_TOKEN = re.compile(
    r"""
      (?P<SPACE>[ \t]+)
    | (?P<NAME>[A-Za-z_][A-Za-z0-9_]*)
    | (?P<COMMENT>(?:\#|//)[^\n]*)
    | (?P<FOREIGN>===|!==|=>|=<|<>|:=|&(?!&)|\|(?!\|)|[∧∨¬∀∃∈⇒→−×÷’])
    | (?P<SIGN><<|->|\+\+|--|[=!<>]=|&&|\|\||[-+*/%<>=!≠≤≥()\[\]{},.:;@'])
    | (?P<NUMBER>[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?(?P<TAIL>[A-Za-z0-9_]*))
    | (?P<NEWLINE>\n[ \t]*)
    | (?P<JOINED>\\[ \t]*\n[ \t]*)
    | (?P<STRING>"[^"\\\n]*(?:\\[^\n][^"\\\n]*)*(?P<QUOTE>["\\]?))
    | (?P<BAD>[^\x20-\x7e\n\t≠≤≥∧∨¬∀∃∈⇒→−×÷’]+|.)
    """,
    re.VERBOSE,
)


class Token(Struct):
    """A word of the text, on one line. ``type`` is the name of its terminal in the grammar."""

    type: str
    text: str
    file: str
    line: int
    column: int
    end_column: int

    @property
    def span(self) -> Span:
        """The span of the token."""
        return Span(self.file, self.line, self.column, self.line, self.end_column)

    def meant(self, text: str) -> Token:
        """A replacement for this token, with another text."""
        kind = _TYPES.get(text, "NAME")
        return Token(kind, text, self.file, self.line, self.column, self.end_column)


class TextLine(Struct):
    """A line of the file: the width of its indentation, and its tokens."""

    indent: int
    tokens: list[Token]


class TokenText(Struct, frozen=True):
    """A file in tokens."""

    lines: list[TextLine]  #: those that are not blank
    comments: tuple[Comment, ...]
    tabs: bool  #: whether tabs stand in the indentation


#: A number has at most so many digits, and lies between 1e-400 and 1e400.
MAX_DIGITS = 400

_TAB = 4


def tokenise(source: Source, report: ErrorLog) -> TokenText:
    """The lines of a text that are not blank, and its comments."""
    file = source.name
    text = source.text
    types = _TYPES
    comments: list[Comment] = []
    position = len(text) - len(text.lstrip(" "))
    tokens: list[Token] = []
    lines = [TextLine(position, tokens)]
    tabs: list[Span] = []
    line = 1
    start = 0  # offset of column 1 of the line
    foreign = -1  # where the last word ends that is not of the language
    if text[position : position + 1] == "\t":
        tabs.append(Span(file, 1, 1, 1, position + 2))
    for match in _TOKEN.finditer(text, position):
        kind = match.lastgroup
        if kind == "SPACE":
            continue
        begin, end = match.span()
        column = begin - start + 1
        if kind == "NAME" or kind == "SIGN":
            word = match.group()
            if begin == foreign and kind == "NAME":
                _join(tokens[-1], word)
                continue
            tokens.append(Token(types.get(word, "NAME"), word, file, line, column, end - start + 1))
        elif kind == "NEWLINE":
            line += 1
            start = begin + 1
            indent = end - start
            if "\t" in match.group() and text[end : end + 1] not in ("\n", ""):
                indent = len(text[start:end].expandtabs(_TAB))
                tabs.append(Span(file, line, 1, line, end - start + 1))
            tokens = []
            lines.append(TextLine(indent, tokens))
        elif kind == "JOINED":  # the line goes on below [OLD-LINE]
            line += 1
            start = text.index("\n", begin) + 1
        elif kind == "COMMENT":
            comments.append(Comment(line, column, match.group().rstrip(), not tokens))
        else:
            token = Token("NAME", match.group(), file, line, column, end - start + 1)
            if kind == "NUMBER":
                tokens.append(_number(token, match.group("TAIL"), report))
            elif kind == "STRING":
                tokens.append(_string(token, match.group("QUOTE"), report))
            elif kind == "FOREIGN":
                tokens.append(_foreign(token, report))
            elif _bad(token, report):
                foreign = end
                if tokens and tokens[-1].type == "NAME" and tokens[-1].end_column == column:
                    _join(tokens[-1], token.text)
                else:
                    tokens.append(token)
    if tabs:
        _refuse_tabs(tabs, report)
    return TokenText([line for line in lines if line.tokens], tuple(comments), bool(tabs))


def _number(token: Token, tail: str, report: ErrorLog) -> Token:
    digits = token.text
    token.type = "INT" if digits.isdigit() else "FLOAT"
    if tail:
        report.error(
            "K103",
            token.span,
            f"`{shown(digits)}` is neither a number nor a name",
            "a name begins with a letter or `_`; a number has digits, `.` and `e` only",
        )
    elif not _is_moderate(digits.lower()):
        message = (
            f"a number has at most {MAX_DIGITS} digits, "
            f"and lies between 1e-{MAX_DIGITS} and 1e{MAX_DIGITS}"
        )
        report.error("K103", token.span, message)
    else:
        return token
    token.type, token.text = "INT", "0"
    return token


def _is_moderate(number: str) -> bool:
    """Return whether a number has few enough digits and a small enough exponent."""
    if len(number) < MAX_DIGITS and "e" not in number:
        return True
    mantissa, _, exponent = number.partition("e")
    if len(mantissa) > 2 * MAX_DIGITS or len(exponent) > 5:
        return False
    whole, _, part = mantissa.partition(".")
    digits = whole + part
    first = len(whole) - 1 - (len(digits) - len(digits.lstrip("0")))
    significant = digits.strip("0")
    size = (first if significant else 0) + int(exponent or 0)  # the exponent of the first digit
    return len(significant) <= MAX_DIGITS and abs(size) < MAX_DIGITS


_ESCAPES = {"n": "\n", "t": "\t", '"': '"', "\\": "\\"}


def _string(token: Token, quote: str, report: ErrorLog) -> Token:
    token.type = "STRING"
    if quote != '"':
        report.damaged.add(token.line)
        report.error(
            "K102",
            token.span,
            "this string has no end on its line",
            'close it with `"`; a line break in a string is written `\\n`',
        )
        token.text = '""'
    for escape in re.finditer(r"\\(.)", token.text):
        if escape.group(1) not in _ESCAPES:
            place = _inside(token, escape.start(), 2)
            message = f"`{shown(escape.group())}` means nothing in a string"
            report.error("K104", place, message, 'known are `\\n`, `\\t`, `\\"` and `\\\\`')
    if not token.text.isprintable():
        for offset, character in enumerate(token.text):
            if _unprintable(character):
                message = f"the character U+{ord(character):04X} cannot stand in a string"
                report.error("K101", _inside(token, offset, 1), message)
                break
    return token


def string_value(text: str) -> str:
    """The string that a token denotes, with escapes resolved."""
    return re.sub(r"\\(.)", lambda match: _ESCAPES.get(match.group(1), match.group()), text[1:-1])


def _inside(token: Token, offset: int, length: int) -> Span:
    column = token.column + offset
    return Span(token.file, token.line, column, token.line, column + length)


def _foreign(token: Token, report: ErrorLog) -> Token:
    meant = _FOREIGN[token.text]
    hint = f"write `{meant}`"
    if token.text == "=>":
        hint = "write `>=` to compare, `implies` to conclude"
    elif token.text in ("&", "|"):
        hint = f"write `{meant}` or `{token.text * 2}`"
    report.error("K133", token.span, f"`{token.text}` is not a sign of the language", hint)
    return token.meant(meant)


def _join(name: Token, rest: str) -> None:
    """Extend a name by letters that names cannot have: there is one error already.

    Beyond a length that no name has its text is cut off, lest a hostile one take long.
    """
    if len(name.text) < MAX_DIGITS:
        name.text += rest[:MAX_DIGITS]
    name.end_column += len(rest)


def _bad(token: Token, report: ErrorLog) -> bool:
    """Report characters that the language does not have; return whether they look like a name."""
    character = token.text[0]
    code = f"U+{ord(character):04X}"
    what = f"`{character}` ({code})" if character.isprintable() else f"the character {code}"
    hint = None
    word = character.isalpha()
    if character in "“”„«»‘`":
        hint = 'strings stand between `"`'
    elif character.isspace():
        hint = "write an ordinary space"
    elif character == "$":
        hint = "leave the `$` out: it belongs to the typesetting of a listing"
    elif character == "\\":
        hint = "leave it out, and put what stands on both lines in `(` `)`"
    elif word:
        hint = "names are made of the letters a to z, digits and `_`"
    report.damaged.add(token.line)
    report.error("K101", token.span, f"{what} is not part of the language", hint)
    return word


def _unprintable(character: str) -> bool:
    return unicodedata.category(character) in ("Cc", "Cs")


def _refuse_tabs(tabs: list[Span], report: ErrorLog) -> None:
    more = len(tabs) - 1
    also = f" (and {more} more line{'s' if more > 1 else ''})" if more else ""
    report.error("K105", tabs[0], f"this line{also} is indented with a tab", "indent with spaces")


def shown(text: str) -> str:
    """A piece of the text as it may stand in a message."""
    text = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text[:24])
    return text if len(text) <= 20 else text[:19] + "…"
