"""Lines that stand where they do not belong."""

from __future__ import annotations

from koord.syntax.lines import Part
from koord.syntax.parser_lines import type_end
from koord.syntax.parser_reader import Reader
from koord.syntax.tokens import shown

_PIECES_OF_MODULES = frozenset(["sensors", "actuators", "environment", "contract"])
_STATEMENTS = frozenset("IF FOR ATOMIC BREAK RETURN STOP TRYSTOP PASS ELSE ELIF".split())
#: What other languages call the sections.
_OTHER_SECTIONS = {
    "event": "an event is written `NAME:`, with `pre:` and `eff:` below",
    "record": "a record is written `def NAME:`",
    "struct": "a record is written `def NAME:`",
    "class": "a record is written `def NAME:`",
    "type": "a record is written `def NAME:`, an enumeration `enum NAME: a, b`",
    "fun": "a function is written `def fun f(int a) -> int:`",
    "function": "a function is written `def fun f(int a) -> int:`",
    "const": "a constant is written `param int n = 4`",
    "import": "a module is written `using NAME:`",
    "module": "a module is written `using NAME:`",
    "property": "a property is written `invariant NAME: …`",
    "assert": "a property is written `invariant NAME: …`",
}


class Strays:
    """Complains once about lines in a row that do not belong where they are."""

    __slots__ = ("_reader", "_told")

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._told = False

    def add(self, part: Part, message: str, hint: str | None) -> None:
        """A line that does not belong here."""
        if not self._told:
            self._reader.complain(part, "K141", part.span, message, hint)
        self._told = True

    def over(self) -> None:
        """A line that does."""
        self._told = False

    def once(self, part: Part, seen: set[str]) -> None:
        """Complain about a second block of one kind."""
        word = part.tokens[0].text
        if part.first in seen:
            message = f"there is a `{word}:` here already"
            self._reader.complain(part, "K142", part.tokens[0].span, message, "make one of both")
        seen.add(part.first)


def stray_section(part: Part) -> tuple[str, str | None]:
    """What to say about a line that is no section, with its cure."""
    word = shown(part.tokens[0].text) if part.tokens else ":"
    expected = "a section or an event is expected here"
    if part.first in ("PRE", "EFF"):
        return f"`{word}:` stands outside of an event", "indent it below the name of its event"
    if word in _PIECES_OF_MODULES:
        return f"`{word}` stands outside of a module", "indent it below `using NAME:`"
    if word in ("requires", "ensures"):
        return f"`{word}:` stands outside of a contract", "indent it below `contract NAME:`"
    if word in _OTHER_SECTIONS and len(part.tokens) > 1:
        return expected, _OTHER_SECTIONS[word]
    end = type_end(part.tokens, 0)
    if end is not None and end < len(part.tokens) and part.tokens[end].type == "NAME":
        return (
            "a declaration stands outside of a section",
            "indent it below `local:`, `allread:` or `allwrite:`",
        )
    if part.first in _STATEMENTS or any(t.type in ("ASSIGN", "LPAR") for t in part.tokens):
        return (
            "a statement stands outside of an event",
            "indent it below the `eff:` of an event, or below `init:`",
        )
    return expected, "such as `local:`, `init:`, `invariant NAME:` or `Event:`"
