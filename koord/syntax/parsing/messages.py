"""Messages about lines with syntax errors, with likely corrections."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from msgspec import Struct

from koord.syntax.parsing.line_forms import UnexpectedError
from koord.syntax.parsing.line_kinds import LineKind
from koord.syntax.parsing.tokens import KEYWORDS, Token, shown, words
from koord.syntax.source import Span

_WORDS = {word.upper() for word in KEYWORDS}
_ENDS = frozenset(["$END"])
_VALUE = frozenset(["NAME", "INT", "LPAR"])
#: Terminals that a value begins with, and those that go on with one: too many to list.
_BEGINS_VALUE = _VALUE | words("FLOAT STRING TRUE FALSE MINUS NOT LSQB LBRACE FORALL EXISTS")
_GOES_ON = words("OPERATOR MINUS LESS GREATER DOT LSQB LPAR PRIME AT")
_SIGNS = {
    "RPAR": "`)`",
    "RSQB": "`]`",
    "RBRACE": "`}`",
    "COLON": "`:`",
    "ASSIGN": "`=`",
    "COMMA": "`,`",
    "IN": "`in`",
    "ARROW": "`->`",
    "LEADSTO": "`leadsto`",
    "OUTPUT": "`<<`",
    "$END": "the end of the line",
}
#: Words of other languages for what Koord has.
_OTHER_WORDS = {"mod": "%", "is": "==", "iff": "==", "xor": "!="}


class Complaint(Struct, frozen=True):
    """A mistake in a line; ``repaired`` are the tokens that were most likely meant."""

    code: str
    token: Token
    message: str
    hint: str | None = None
    repaired: list[Token] | None = None
    #: The last token of what is wrong, if it is not only ``token``.
    last: Token | None = None

    @property
    def span(self) -> Span:
        """The span of the mistake."""
        return self.token.span.to(self.last.span) if self.last else self.token.span


class Mistake(Struct, frozen=True):
    """A line with a syntax error: its tokens, the position, and the terminals expected there."""

    form: LineKind
    tokens: list[Token]
    position: int
    expected: frozenset[str]
    end: Token  #: stands for the place behind the line

    @property
    def token(self) -> Token:
        """The token that is not allowed where it stands."""
        return self.at(self.position)

    def at(self, position: int) -> Token:
        """The token at a position; ``end`` outside of the line."""
        return self.tokens[position] if 0 <= position < len(self.tokens) else self.end

    def replaced(self, *tokens: Token, count: int = 1) -> list[Token]:
        """The line with ``tokens`` in place of ``count`` ones at the position."""
        return [*self.tokens[: self.position], *tokens, *self.tokens[self.position + count :]]

    @property
    def wants_value(self) -> bool:
        """True if an expression could begin here."""
        return self.expected >= _VALUE

    @property
    def could_end(self) -> bool:
        """True if the line up to here is complete."""
        return self.expected >= _ENDS


#: What a line cannot end with, though another could follow.
_OPERATORS = frozenset(
    ("+", "-", "*", "/", "%", "==", "!=", "<", "<=", ">", ">=", "and", "or", "implies", "not")
)


def explain(form: LineKind, tokens: list[Token], error: UnexpectedError, end: Token) -> Complaint:
    """Explain the syntax error in a line."""
    mistake = Mistake(form, tokens, error.position, error.expected, end)
    for rule in _RULES:
        complaint = rule(mistake)
        if complaint:
            return complaint
    return _general(mistake)


def _general(m: Mistake) -> Complaint:
    expected = " or ".join(_in_words(m.expected)) or "something else"
    if m.position < len(m.tokens):
        found = f"found `{shown(m.token.text)}`"
    else:
        found = "the line ends" if m.end.type != "COLON" else "found `:`"
    message = f"{expected} is expected here, but {found}"
    return Complaint("K130", m.token, message, _unfinished(m))


def _unfinished(m: Mistake) -> str | None:
    """A hint on how a line continues that ends with an operator."""
    last = m.tokens[-1].text if m.tokens else ""
    if m.position < len(m.tokens) or last not in _OPERATORS:
        return None
    return f"write what stands behind `{last}`; an expression goes on below if it is in brackets"


def _in_words(expected: frozenset[str]) -> Iterator[str]:
    names = []
    rest = expected
    if expected >= _VALUE:
        names.append("a value")
        rest = rest - _BEGINS_VALUE
    if "NAME" in rest:
        names.append("a name")
    goes_on = rest >= frozenset(["OPERATOR", "MINUS"])
    if goes_on:
        rest = rest - _GOES_ON
    names.extend(word for sign, word in _SIGNS.items() if sign in rest)
    if goes_on:
        names.append("an operator")
    if len(names) > 2:
        yield ", ".join(names[:-1])
        yield names[-1]
    else:
        yield from names


# --- mistakes that are known by sight -----------------------------------------------------------


def _assign_for_equal(m: Mistake) -> Complaint | None:
    if m.token.type != "ASSIGN" or "OPERATOR" not in m.expected:
        return None
    before = [token.type for token in m.tokens[: m.position]]
    brackets = sum(before.count(kind) for kind in ("LPAR", "LSQB", "LBRACE"))
    closed = sum(before.count(kind) for kind in ("RPAR", "RSQB", "RBRACE"))
    if m.form is LineKind.STATEMENT and brackets == closed:
        message = "a statement assigns once"
        return Complaint("K132", m.token, message, "write `==` to compare, or two statements")
    return Complaint(
        "K132", m.token, "`=` assigns; `==` compares", "write `==`", m.replaced(m.token.meant("=="))
    )


def _equal_for_assign(m: Mistake) -> Complaint | None:
    if m.token.text != "==" or "ASSIGN" not in m.expected:
        return None
    return Complaint(
        "K132",
        m.token,
        "`==` compares; `=` assigns",
        "write `=`",
        m.replaced(m.token.meant("=")),
    )


def _augmented(m: Mistake) -> Complaint | None:
    sign, equal = m.token, m.at(m.position + 1)
    if (
        m.form is not LineKind.STATEMENT
        or "ASSIGN" not in m.expected
        or sign.type not in ("OPERATOR", "MINUS")
        or equal.type != "ASSIGN"
        or (equal.line, equal.column) != (sign.line, sign.end_column)
    ):
        return None
    target = m.tokens[: m.position]
    value = m.tokens[m.position + 2 :]
    text = shown("".join(token.text for token in target))
    return Complaint(
        "K133",
        sign,
        f"`{sign.text}=` is not a sign of the language",
        f"write `{text} = {text} {sign.text} …`",
        [*target, equal, *target, sign, sign.meant("("), *value, sign.meant(")")],
    )


def _keyword_as_name(m: Mistake) -> Complaint | None:
    token = m.token
    if token.text not in KEYWORDS or "NAME" not in m.expected:
        return None
    if m.wants_value and token.type in ("OPERATOR", "IN", "LEADSTO"):
        return None
    return Complaint(
        "K131",
        token,
        f"`{token.text}` is a keyword and cannot be used as a name",
        f"choose another name, such as `{token.text.lower()}_`",
        m.replaced(Token("NAME", *_rest(token))),
    )


def _rest(token: Token) -> tuple[str, str, int, int, int]:
    return token.text, token.file, token.line, token.column, token.end_column


def _other_word(m: Mistake) -> Complaint | None:
    token = m.token
    if token.type != "NAME":
        return None
    lower = token.text.lower()
    meant = _OTHER_WORDS.get(token.text, lower if lower in KEYWORDS else "")
    repaired = token.meant(meant)
    if not meant or repaired.type not in m.expected:
        return None
    return Complaint(
        "K133",
        token,
        f"`{token.text}` is not an operator of the language",
        f"write `{meant}`",
        m.replaced(repaired),
    )


def _arrow(m: Mistake) -> Complaint | None:
    if m.token.type != "ARROW" or "OPERATOR" not in m.expected:
        return None
    return Complaint(
        "K133",
        m.token,
        "`->` stands before the type of a function's answer only",
        "write `implies`",
        m.replaced(m.token.meant("implies")),
    )


def _point_of_number(m: Mistake) -> Complaint | None:
    if m.token.type == "DOT" and m.wants_value and m.at(m.position + 1).type == "INT":
        digits = m.at(m.position + 1)
        number = Token("FLOAT", f"0.{digits.text}", *_rest(digits)[1:])
        hint = f"write `0.{shown(digits.text)}`"
        message = "a number begins with a digit"
        return Complaint("K103", m.token, message, hint, m.replaced(number, count=2))
    before = m.at(m.position - 2)
    if m.token.type == "DOT" and m.at(m.position - 1).type == "DOT" and before.type == "INT":
        hint = "a range is written `0, n`, in `for i = 0, n:` and `forall k in 0, n:`"
        return Complaint("K133", m.token, "`..` is not a sign of the language", hint)
    if m.at(m.position - 1).type == "DOT" and before.type == "INT" and m.token.type != "NAME":
        number = Token("FLOAT", f"{before.text}.0", *_rest(before)[1:])
        tokens = [*m.tokens[: m.position - 2], number, *m.tokens[m.position :]]
        point = m.at(m.position - 1)
        hint = f"write `{shown(before.text)}.0`"
        return Complaint("K103", point, "a number ends with a digit", hint, tokens)
    return None


def _quote(m: Mistake) -> Complaint | None:
    if m.token.type == "PRIME" and m.wants_value:
        message = "`'` means the value after a step and stands behind a name"
        return Complaint("K130", m.token, message, 'strings stand between `"`')
    return None


def _no_index(m: Mistake) -> Complaint | None:
    if m.token.type == "RSQB" and m.at(m.position - 1).type == "LSQB" and m.wants_value:
        return Complaint("K130", m.token, "an index is missing between `[` and `]`")
    return None


# --- mistakes in certain forms of line ----------------------------------------------------------


def _several_names(m: Mistake) -> Complaint | None:
    if m.form is not LineKind.DECLARATION or m.token.type != "COMMA" or not m.could_end:
        return None
    return Complaint(
        "K137",
        m.token,
        "a declaration has one name",
        "declare each on a line of its own",
        m.tokens[: m.position],
    )


def _no_type(m: Mistake) -> Complaint | None:
    if m.form not in (LineKind.DECLARATION, LineKind.SIGNATURE):
        return None
    before = m.at(m.position - 1)
    if before.type != "NAME" or "NAME" not in m.expected or m.wants_value:
        return None
    name = shown(before.text)
    if m.token.type in ("ASSIGN", "COMMA", "RPAR"):
        return Complaint("K139", before, f"the type of `{name}` is missing", f"write `int {name}`")
    if m.position == len(m.tokens):
        message = "a declaration has a type and a name"
        return Complaint("K139", before, message, "write `int x`, for example")
    return None


def _loop(m: Mistake) -> Complaint | None:
    if m.form is not LineKind.LOOP:
        return None
    token = m.token
    kinds = [t.type for t in m.tokens]
    form = "`for i = 0, n:`, `for x in list:` or `for k, v in list:`"
    if token.type == "COMMA" and kinds[2:3] == ["IN"]:
        repaired = [*m.tokens[:2], m.tokens[2].meant("="), *m.tokens[3:]]
        hint = "write `=` in place of `in`"
        message = "a loop over a range is written `for i = 0, n:`"
        return Complaint("K139", m.tokens[2], message, hint, repaired)
    if m.position == 2 and kinds[2:3] == ["NAME"]:
        message = "the variable of a loop has no type"
        hint = f"leave `{shown(m.tokens[1].text)}` out"
        return Complaint("K139", m.tokens[1], message, hint, [m.tokens[0], *m.tokens[2:]])
    if kinds[2:3] == ["ASSIGN"] and "COMMA" in m.expected:
        if m.position == len(m.tokens):
            message = "the upper bound of this loop is missing"
            return Complaint("K139", token, message, f"a loop is written {form}")
        if token.text in ("to", "until", "upto"):
            comma = token.meant(",")
            message = f"`,` stands between the bounds of a loop, not `{token.text}`"
            return Complaint("K139", token, message, "write `,`", m.replaced(comma))
    if m.position < 3:
        return Complaint("K139", token, "a loop is not written like this", f"write {form}")
    return None


def _value_as_statement(m: Mistake) -> Complaint | None:
    if m.form is not LineKind.STATEMENT or "ASSIGN" not in m.expected:
        return None
    if m.token.type not in ("OPERATOR", "MINUS", "LESS", "GREATER"):
        return None
    message = "this is a value, not a statement"
    hint = "assign it with `=`, or call something"
    return Complaint("K136", m.tokens[0], message, hint, last=m.tokens[-1])


def _two_in_one(m: Mistake) -> Complaint | None:
    if not m.could_end or m.position >= len(m.tokens):
        return None
    token = m.token
    text = shown(token.text)
    if token.type == "ASSIGN" and m.form is LineKind.STATEMENT:
        return None
    repaired = m.tokens[: m.position]
    if m.form in (LineKind.STATEMENT, LineKind.DECLARATION) and (
        token.type in _WORDS or token.type == "NAME"
    ):
        message = f"the line should end before `{text}`"
        hint = "one statement per line; or an operator is missing here"
        return Complaint("K135", token, message, hint, repaired)
    return None


def _no_operator(m: Mistake) -> Complaint | None:
    if m.token.type not in _BEGINS_VALUE or "OPERATOR" not in m.expected:
        return None
    missing = "`,` or an operator" if "COMMA" in m.expected else "an operator"
    message = f"{missing} is missing before `{shown(m.token.text)}`"
    repaired = m.tokens[: m.position] if m.could_end else None
    return Complaint("K130", m.token, message, None, repaired)


def _nothing(m: Mistake) -> Complaint | None:
    if m.tokens:
        return None
    what = {
        LineKind.EXPRESSION: "a value",
        LineKind.GOAL: "a property",
        LineKind.DECLARATION: "a declaration, such as `int x`,",
        LineKind.SIGNATURE: "the name of a function",
        LineKind.MEMBERS: "a name",
        LineKind.STATEMENT: "a statement",
        LineKind.LOOP: "a loop",
    }[m.form]
    return Complaint("K130", m.end, f"{what} is expected here")


_RULES: tuple[Callable[[Mistake], Complaint | None], ...] = (
    _nothing,
    _assign_for_equal,
    _equal_for_assign,
    _augmented,
    _several_names,
    _loop,
    _keyword_as_name,
    _other_word,
    _arrow,
    _point_of_number,
    _quote,
    _no_index,
    _no_type,
    _value_as_statement,
    _two_in_one,
    _no_operator,
)
