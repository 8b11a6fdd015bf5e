"""Scripts that others wrote, cut down to what can do no harm.

A script may tell a solver to write files or to switch its answers off; a certificate may come from
anywhere. So only declarations and assertions are passed on.
"""

from __future__ import annotations

from collections.abc import Iterator

_ALLOWED = frozenset(
    {
        "declare-const",
        "declare-fun",
        "declare-sort",
        "declare-datatype",
        "declare-datatypes",
        "define-fun",
        "define-sort",
        "assert",
    }
)
_IGNORED = frozenset({"set-info", "set-logic", "check-sat", "exit"})


class NotACommandError(Exception):
    """A script with something else in it than declarations and assertions."""


def harmless(text: str) -> str:
    """The declarations and assertions of a script, and one question. Raises NotACommandError."""
    kept = []
    for command in _commands(text):
        head = command[1:].split(None, 1)[0].rstrip(")") if len(command) > 2 else ""
        if head in _ALLOWED:
            kept.append(command)
        elif head not in _IGNORED:
            raise NotACommandError(head[:40])
    return "\n".join([*kept, "(check-sat)"])


def _commands(text: str) -> Iterator[str]:
    """The parts of a text in outermost parentheses."""
    depth = start = k = 0
    while k < len(text):
        letter = text[k]
        if letter in '"|':
            end = text.find(letter, k + 1)
            if end < 0:
                raise NotACommandError("an open quotation")
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
                raise NotACommandError("a stray parenthesis")
            if depth == 0:
                yield text[start : k + 1]
        elif depth == 0 and not letter.isspace():
            raise NotACommandError("text outside of commands")
        k += 1
    if depth:
        raise NotACommandError("an open parenthesis")
