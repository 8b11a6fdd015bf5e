"""Scripts that others wrote, cut down to what can do no harm.

A script may tell a solver to write files or to switch its answers off; a certificate may come from
anywhere. So only declarations and assertions are passed on, of scripts that ask one question, at
their end: for any other solver they have to mean the same as here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from msgspec import Struct

_DECLARING = frozenset(
    {
        "declare-const",
        "declare-fun",
        "declare-sort",
        "declare-datatype",
        "declare-datatypes",
        "define-fun",
        "define-sort",
    }
)

#: Control characters, and halves of characters.
_NOT_TEXT = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff]")


class NotACommandError(Exception):
    """A script that is anything else than declarations, assertions and one question."""


class Harmless(Struct, frozen=True):
    """The logic that a script names, if it does, and its declarations and assertions."""

    logic: str
    commands: tuple[str, ...]


def harmless(text: str) -> Harmless:
    """What a script declares and asserts. Raises NotACommandError."""
    if _NOT_TEXT.search(text):
        raise NotACommandError("it is not text")
    logic, kept, names, heads = "", [], set[str](), set[str]()
    for command in _commands(text):
        words = command.strip("() \t\r\n").split(None, 2)
        head = words[0] if words else ""
        if "check-sat" in heads and head != "exit":
            raise NotACommandError("something comes after its question")
        if "exit" in heads:
            raise NotACommandError("something comes after its exit")
        if head == "set-logic" and heads <= {"set-info"}:
            logic = command
        elif head in _DECLARING or head == "assert":
            kept.append(command)
            if head in _DECLARING and head != "declare-datatypes":
                name = _name(command[command.index(head) + len(head) :])
                if name in names:
                    raise NotACommandError(f"it declares {name} twice")
                names.add(name)
        elif head == "set-info":
            if words[1:] == [":status", "sat"]:
                raise NotACommandError("it says of itself that it can be satisfied")
        elif head not in ("check-sat", "exit"):
            raise NotACommandError(f"it has a command that is not to be run: {head[:40] or '()'}")
        heads.add(head)
    if "assert" not in heads:
        raise NotACommandError("it asserts nothing")
    if "check-sat" not in heads:
        raise NotACommandError("it asks nothing")
    return Harmless(logic, tuple(kept))


def _name(text: str) -> str:
    """The symbol that a text begins with."""
    text = text.lstrip()
    if text.startswith("|"):
        return text[1 : text.find("|", 1)]
    return text.split(None, 1)[0].rstrip("()") if text else ""


def _commands(text: str) -> Iterator[str]:
    """The parts of a text in outermost parentheses."""
    depth = start = k = 0
    while k < len(text):
        letter = text[k]
        if letter in '"|':
            end = text.find(letter, k + 1)
            if end < 0:
                raise NotACommandError("a quotation in it does not end")
            k = end
        elif letter == ";":
            end = text.find("\n", k)
            k = len(text) if end < 0 else end
        elif letter == "(":
            if depth == 0:
                start = k
            depth += 1
        elif letter == ")":
            depth -= 1
            if depth < 0:
                raise NotACommandError("a parenthesis in it closes nothing")
            if depth == 0:
                yield text[start : k + 1]
        elif depth == 0 and not letter.isspace():
            raise NotACommandError("it has text that is in no command")
        k += 1
    if depth:
        raise NotACommandError("a parenthesis in it is not closed")
