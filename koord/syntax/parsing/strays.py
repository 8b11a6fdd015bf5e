"""Misplaced lines: messages and recovery."""

from __future__ import annotations

from collections.abc import Iterable

from koord.syntax.parsing.line_forms import type_end
from koord.syntax.parsing.lines import LinePart
from koord.syntax.parsing.reader import LineReader
from koord.syntax.parsing.tokens import ARMS, BLOCKS, shown, words

_OF_MODULES = frozenset(["sensors", "actuators", "environment", "contract"])
#: Words that begin a piece of a module or of a contract.
PIECES = _OF_MODULES | frozenset(["requires", "ensures"])
#: First words of statements that have a body.
OPENING = BLOCKS | ARMS
_STATEMENTS = OPENING | words("BREAK RETURN STOP TRYSTOP PASS")
_SECTIONS = ("local", "allread", "allwrite", "init", "assume", "invariant", "eventually", "using")
#: The pieces of an event, and what they are called elsewhere.
_OF_EVENTS = {
    "pre": words("precondition preconditions guard when if"),
    "eff": words("effect effects action do then"),
}
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


def _closest(word: str, known: Iterable[str]) -> str | None:
    """The word that was probably meant by one that differs in a letter or two."""
    from difflib import get_close_matches  # seldom needed

    found = get_close_matches(word.lower()[:30], known, n=1, cutoff=0.8)
    return found[0] if found else None


def misspelt_section(part: LinePart) -> tuple[str, str] | None:
    """The message for a line that begins like a section, except for a letter or two."""
    word = part.tokens[0].text if part.tokens else ""
    found = _closest(word, _SECTIONS)
    if found is None or not part.colon:
        return None
    return f"`{shown(word)}` is not a section", f"did you mean `{found}`?"


class Strays:
    """A report of misplaced lines: once for several in a row."""

    __slots__ = ("_reader", "_repeated", "_told")

    def __init__(self, reader: LineReader) -> None:
        self._reader = reader
        self._told = False
        self._repeated = False

    def add(self, part: LinePart, message: str, hint: str | None, *, lost: bool = True) -> None:
        """Add a misplaced line; ``lost`` if no node is made of it."""
        if not self._told:
            self._reader.complain(part, "K141", part.span, message, hint)
        self._told = True
        if lost:
            self._reader.lose(part, body=True)

    def over(self) -> None:
        """End a row of misplaced lines."""
        self._told = False

    def once(self, part: LinePart, seen: set[str]) -> None:
        """Report a second block of one kind."""
        word = part.tokens[0].text
        if part.first in seen and not self._repeated:
            message = f"there is a `{word}:` here already"
            self._reader.complain(part, "K142", part.tokens[0].span, message, "make one of both")
            self._repeated = True
        seen.add(part.first)


def stray_section(part: LinePart) -> tuple[str, str | None]:
    """The message for a line that is no section, and its cure."""
    misspelt = misspelt_section(part)
    if misspelt:
        return misspelt
    word = shown(part.tokens[0].text) if part.tokens else ":"
    expected = "a section or an event is expected here"
    if part.first in ("PRE", "EFF"):
        return f"`{word}:` stands outside of an event", "indent it below the name of its event"
    if word in _OF_MODULES:
        return f"`{word}` stands outside of a module", "indent it below `using NAME:`"
    if word in ("requires", "ensures"):
        return f"`{word}:` stands outside of a contract", "indent it below `contract NAME:`"
    if word in _OTHER_SECTIONS and len(part.tokens) > 1:
        return expected, _OTHER_SECTIONS[word]
    if part.first in ("FORALL", "EXISTS"):
        return expected, "a property is written `invariant NAME: …`"
    if _is_declaration(part):
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


def stray_piece(part: LinePart) -> tuple[str, str]:
    """The message for a line of an event that is neither guard nor effect, and its cure."""
    if part.first in ("ELSE", "ELIF"):
        word = part.tokens[0].text
        return f"this `{word}` stands outside of `eff:`", "indent it deeper than the `eff:`"
    word = part.tokens[0].text if part.colon and part.tokens else ""
    for piece, others in _OF_EVENTS.items():
        if word.lower() in others or _closest(word, [piece]):
            return f"`{shown(word)}` is no part of an event", f"did you mean `{piece}:`?"
    return "`pre:` or `eff:` is expected here", "the statements of an event stand below its `eff:`"


def stray_port(part: LinePart) -> tuple[str, str]:
    """The message for a line that is no piece of a module, and its cure."""
    word = part.tokens[0].text if part.colon and part.tokens else ""
    found = _closest(word, sorted(_OF_MODULES))
    if found:
        return f"`{shown(word)}` is no piece of a module", f"did you mean `{found}`?"
    pieces = "one of `sensors:`, `actuators:`, `environment:`, `contract NAME:`"
    return "a piece of a module is expected here", pieces


def adopted(reader: LineReader, parts: list[LinePart]) -> list[LinePart]:
    """Indent the parts that stand at the level of their head."""
    kept: list[LinePart] = []
    adopting: LinePart | None = None
    for part in parts:
        head = kept[-1] if kept else None
        if not (head and head.colon and _fits(head, part) and (head is adopting or not head.body)):
            kept.append(part)
            continue
        if head is not adopting:
            word = shown(" ".join(token.text for token in head.tokens))
            message = f"this belongs to `{word}` and stands at its level"
            reader.complain(part, "K113", part.span, message, "indent it deeper")
            adopting = head
        head.body.append(part)
    return kept


def _fits(head: LinePart, part: LinePart) -> bool:
    """Return whether a part is likely to be in the body of ``head``."""
    match head.first:
        case "NAME" | "URGENT":
            return part.first in ("PRE", "EFF")
        case "LOCAL" | "ALLREAD" | "ALLWRITE":
            return not part.colon and _is_declaration(part)
        case "USING":
            return bool(part.colon and part.tokens and part.tokens[0].text in _OF_MODULES)
        case _:
            return False


def _is_declaration(part: LinePart) -> bool:
    end = type_end(part.tokens, 0)
    return end is not None and end < len(part.tokens) and part.tokens[end].type == "NAME"
