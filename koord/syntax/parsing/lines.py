"""Logical lines: the lines of a file joined inside brackets, and cut at colons.

A line goes on while a bracket is open. It is cut at the colons that open blocks into *parts*:
``else: atomic:`` is a part ``else`` whose body is a part ``atomic``.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from koord.syntax.diagnostics import Note
from koord.syntax.parsing.report import ErrorLog
from koord.syntax.parsing.tokens import KEYWORDS, LOOPS, TextLine, Token, words
from koord.syntax.source import Span

#: Brackets may stand inside each other so deep.
MAX_BRACKETS = 100

_CLOSER = {"LPAR": ("RPAR", ")"), "LSQB": ("RSQB", "]"), "LBRACE": ("RBRACE", "}")}
_CLOSING = frozenset(kind for kind, _ in _CLOSER.values())
_SPECIAL = frozenset(_CLOSER) | _CLOSING
_SPECIAL |= frozenset(["COLON", "SEMICOLON", "FORALL", "EXISTS", "ELSE", "ELIF"])

#: Keywords that begin a statement or a section: none of them stands inside brackets.
_OUTSIDE = frozenset(word.upper() for word in KEYWORDS) - words(
    "AND EXISTS FALSE FORALL IMPLIES IN LEADSTO NOT OR TRUE"
)

#: A deeper-indented line that begins with one of these goes on with the one before it …
GOES_ON = words("OPERATOR LESS GREATER OUTPUT DOT IN LEADSTO")
#: … and one that ends with one of these goes on below.
UNFINISHED = GOES_ON | words("MINUS NOT COMMA ASSIGN COLON FORALL EXISTS")


class LinePart(Struct):
    """A part of a line, up to a colon that opens a block, or up to the end of the line."""

    tokens: list[Token]
    colon: Token | None = None
    body: list[LinePart] = field(default_factory=list)
    #: Something is so wrong in it that nothing more is to be said.
    broken: bool = False
    #: The code of what was told of it: only the same is told again.
    told: str | None = None
    #: Whether ``forall`` or ``exists`` stands in it.
    quantified: bool = False
    #: The first token behind a line break outside of brackets.
    joint: Token | None = None
    #: The ``;`` behind a guard, as in the old ``pre (c);``.
    semicolon: Token | None = None

    @property
    def first(self) -> str:
        """The type of the first token; empty if there is none."""
        return self.tokens[0].type if self.tokens else ""

    @property
    def start(self) -> Token:
        """The token that the part begins with: its colon, if nothing stands before that."""
        return self.tokens[0] if self.tokens else self.end

    @property
    def end(self) -> Token:
        """The token that ends the part: its colon, or a token for the place behind it."""
        if self.colon:
            return self.colon
        last = self.tokens[-1]
        column = last.end_column
        return Token("END", "", last.file, last.line, column, column + 1)

    @property
    def span(self) -> Span:
        """The span from the first token to the last, or the colon if there is nothing else."""
        if self.tokens:
            return self.tokens[0].span.to(self.tokens[-1].span)
        return self.end.span


class Line(Struct):
    """A logical line."""

    indent: int
    #: The parts that belong to the block of the line: one, unless a line break is missing.
    roots: list[LinePart] = field(default_factory=list)
    #: From a root to the last part, each the body of the one before.
    chain: list[LinePart] = field(default_factory=list)
    #: Brackets that are open so far.
    brackets: list[Token] = field(default_factory=list)
    #: Where tokens go; None if a part is to be begun.
    sink: list[Token] | None = None
    #: Colons that quantifiers still wait for.
    quantifiers: int = 0

    def begin(self) -> list[Token]:
        """Begin a part behind a colon, or at the start of the line."""
        part = LinePart([])
        (self.chain[-1].body if self.chain else self.roots).append(part)
        self.chain.append(part)
        self.sink = part.tokens
        self.quantifiers = 0
        return part.tokens

    def sibling(self, level: int) -> list[Token]:
        """Begin a part beside ``chain[level]``, as on a line of its own."""
        del self.chain[level:]
        return self.begin()


def language_lines(lines: list[TextLine], report: ErrorLog) -> Iterator[Line]:
    """The lines of the language, each with its parts."""
    cutter = _Cutter(lines, report)
    while cutter.at < len(lines):
        line = cutter.next()
        if line.roots:
            yield line


class _Cutter:
    __slots__ = ("at", "lines", "report", "strict_until")

    def __init__(self, lines: list[TextLine], report: ErrorLog) -> None:
        self.lines = lines
        self.report = report
        self.at = 0
        #: Up to this line an open bracket also ends where the indentation goes back: a bracket
        #: somewhere before it is never closed.
        self.strict_until = 0

    def next(self) -> Line:
        start = self.at
        line = self._gather(start)
        if line.brackets and self.at > self.strict_until:
            self.strict_until = self.at
            line = self._gather(start)
        if line.brackets:
            self._close(line)
        return line

    def _gather(self, start: int) -> Line:
        """Read the line that begins at ``start``; ``at`` is then the first one not taken."""
        lines = self.lines
        line = Line(lines[start].indent)
        self._scan(line, lines[start].tokens)
        self.at = start + 1
        while self.at < len(lines) and self._goes_on(line, lines[self.at]):
            self._scan(line, lines[self.at].tokens)
            self.at += 1
        return line

    def _goes_on(self, line: Line, following: TextLine) -> bool:
        first = following.tokens[0]
        if first.type in _OUTSIDE:
            return False
        if line.brackets:
            return self.at >= self.strict_until or not _is_over(line, following)
        if line.sink and following.indent > line.indent:
            # line.sink is empty or None behind the colon of a block
            last = line.sink[-1].type
            if last in UNFINISHED or first.type in GOES_ON:
                part = line.chain[-1]
                part.joint = part.joint or first
                return True
        return False

    def _scan(self, line: Line, tokens: list[Token]) -> None:
        sink = line.sink
        for token in tokens:
            if token.type in _SPECIAL:
                if token.type == "SEMICOLON" and token is tokens[-1] and _is_guard(line):
                    line.chain[0].semicolon = token
                    continue
                self._special(line, token)
                sink = line.sink
                continue
            if sink is None:
                sink = line.begin()
            sink.append(token)

    def _special(self, line: Line, token: Token) -> None:
        kind = token.type
        if kind == "SEMICOLON" and not line.brackets:
            self._semicolon(line, token)
            return
        if kind in _CLOSING and not self._closes(line, token):
            return
        sink = line.begin() if line.sink is None else line.sink
        if kind in _CLOSER:
            if len(line.brackets) == MAX_BRACKETS:
                sink = self._too_deep(line, token)
            line.brackets.append(token)
        elif kind == "FORALL" or kind == "EXISTS":
            line.chain[-1].quantified = True
            line.quantifiers += not line.brackets
        elif line.brackets or kind in _CLOSING:
            pass
        elif kind == "COLON":
            if not line.quantifiers:
                line.chain[-1].colon = token
                line.sink = None
                return
            line.quantifiers -= 1
        elif sink and kind != "SEMICOLON":
            sink = self._else(line, token)
        sink.append(token)

    # --- mistakes

    def _too_deep(self, line: Line, token: Token) -> list[Token]:
        part = line.chain[-1]
        if not part.broken:
            self.report.error(
                "K108",
                token.span,
                f"brackets stand inside each other more than {MAX_BRACKETS} deep",
                "give a piece of the expression a name of its own",
            )
        part.broken = True
        line.sink = []  # what stands deeper is not kept
        return line.sink

    def _closes(self, line: Line, token: Token) -> bool:
        """Take a closing bracket; False if it closes nothing."""
        brackets = line.brackets
        if not brackets:
            message = f"`{token.text}` closes nothing"
            self.report.error("K122", token.span, message, "leave it out")
            return False
        part = line.chain[-1]
        opening = brackets.pop()
        kind, text = _CLOSER[opening.type]
        if kind == token.type or part.broken:
            return True
        if any(_CLOSER[bracket.type][0] == token.type for bracket in brackets):
            self._unclosed(opening, f"before this `{token.text}`", token)
            assert line.sink is not None
            line.sink.append(Token(kind, text, token.file, token.line, token.column, token.column))
            while _CLOSER[(opening := brackets.pop()).type][0] != token.type:
                closer = _CLOSER[opening.type]
                line.sink.append(Token(*closer, token.file, token.line, token.column, token.column))
            return True
        self.report.error(
            "K121",
            token.span,
            f"`{token.text}` cannot close `{opening.text}`",
            f"write `{text}` here",
            (Note(opening.span, f"`{opening.text}` opens here"),),
        )
        token.type = kind
        return True

    def _close(self, line: Line) -> None:
        """Close the brackets of a line that nothing closes, and report it."""
        part = line.chain[-1]
        tokens = part.tokens
        opening = line.brackets[-1]
        if not part.broken:
            self._unclosed(opening, "on its line or below", None)
        part.broken = True
        if _ends_head(part):
            part.colon = tokens.pop()
            line.sink = None
        last = tokens[-1] if tokens else opening
        for bracket in reversed(line.brackets):
            kind, text = _CLOSER[bracket.type]
            column = last.end_column
            tokens.append(Token(kind, text, last.file, last.line, column, column))

    def _unclosed(self, opening: Token, where: str, closing: Token | None) -> None:
        closer = _CLOSER[opening.type][1]
        notes = (Note(closing.span, f"`{closing.text}` stands here"),) if closing else ()
        self.report.error(
            "K120",
            opening.span,
            f"`{opening.text}` is not closed {where}",
            f"write the `{closer}` that belongs to it",
            notes,
        )

    def _semicolon(self, line: Line, token: Token) -> None:
        self.report.error(
            "K133", token.span, "`;` is not part of the language", "one statement per line, no `;`"
        )
        if line.sink is not None:
            line.sink = None
            line.chain.pop()

    def _else(self, line: Line, token: Token) -> list[Token]:
        """Begin the ``else`` of an ``if`` on the same line."""
        for level in range(len(line.chain) - 1, -1, -1):
            if line.chain[level].first in ("IF", "ELIF"):
                self.report.error(
                    "K117",
                    token.span,
                    f"`{token.text}` stands on the line of its `if`",
                    f"begin a new line before `{token.text}`",
                )
                return line.sibling(level)
        assert line.sink is not None
        return line.sink


def _is_guard(line: Line) -> bool:
    """Return whether a line so far is a whole guard on one line. [OLD-COLON]"""
    return not line.brackets and bool(line.chain) and line.chain[0].first == "PRE"


def _is_over(line: Line, following: TextLine) -> bool:
    """Return whether a statement with an open bracket most likely ends before the next line."""
    part = line.chain[-1]
    falls_back = following.indent < part.tokens[0].column
    return _ends_head(part) or (falls_back and following.tokens[0].type not in _CLOSING)


def _ends_head(part: LinePart) -> bool:
    """Return whether the last token is likely to be the colon behind the head of a block."""
    return part.first in words("IF ELIF DEF") | LOOPS and part.tokens[-1].type == "COLON"
