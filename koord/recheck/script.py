"""Scripts of SMT-LIB 2: printing of terms, and sanitising of foreign scripts."""

from __future__ import annotations

import re
from collections.abc import Iterator

from msgspec import Struct, field

from koord.recheck.terms import Term


class Script(Struct):
    """A printer of terms, with shared subterms named once. Names persist.

    A part in which variables of quantifiers are free is named as a function of these.
    """

    _names: dict[int, str] = field(default_factory=dict)
    _free: dict[int, dict[str, str]] = field(default_factory=dict)
    _count: int = 0

    def text(self, term: Term) -> tuple[list[str], str]:
        """The definitions needed, and the text of the term."""
        definitions: list[str] = []
        written: dict[int, str] = {}
        for node in _inside_out(term, self._names):
            if id(node) in self._names or id(node) in written:
                continue
            body, free = self._body(node, written), self._free_in(node)
            if node.args and node is not term and len(body) > 24:
                name = f"t{self._count}"
                self._count += 1
                variables = " ".join(f"({head} {sort})" for head, sort in free.items())
                definitions.append(f"(define-fun {name} ({variables}) {node.sort} {body})")
                self._names[id(node)] = f"({name} {' '.join(free)})" if free else name
            else:
                written[id(node)] = body
        return definitions, self._names.get(id(term)) or written[id(term)]

    def _body(self, node: Term, written: dict[int, str]) -> str:
        if not node.args:
            return node.head
        args = " ".join(self._names.get(id(a)) or written[id(a)] for a in node.args)
        if node.binders:
            bound = " ".join(f"({b.head} {b.sort})" for b in node.binders)
            return f"(forall ({bound}) {args})"
        return f"({node.head} {args})"

    def _free_in(self, node: Term) -> dict[str, str]:
        """The free variables of a term, with sorts; its parts were visited before."""
        known = self._free.get(id(node))
        if known is None:
            known = {head: sort for a in node.args for head, sort in self._free[id(a)].items()}
            if node.head.startswith("|?"):
                known[node.head] = node.sort
            for b in node.binders:
                known.pop(b.head, None)
            self._free[id(node)] = known
        return known


def _inside_out(term: Term, known: dict[int, str]) -> Iterator[Term]:
    """Yield every subterm before the terms that contain it."""
    done: set[int] = set()
    pending: list[tuple[Term, bool]] = [(term, False)]
    while pending:
        node, ready = pending.pop()
        if ready:
            yield node
        elif id(node) not in done and id(node) not in known:
            done.add(id(node))
            pending.append((node, True))
            pending += [(a, False) for a in node.args]


# --- scripts that others wrote --------------------------------------------------------------------

# A script may tell a solver to write files or to switch its answers off; a certificate may come
# from anywhere. So only declarations and assertions are passed on, of scripts that ask one
# question, at their end: for any other solver they have to mean the same as here.

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
    """Raised for a script with commands beyond declarations, assertions and one query."""


class SanitisedScript(Struct, frozen=True):
    """A sanitised script: its logic, if it names one, and its declarations and assertions."""

    logic: str
    commands: tuple[str, ...]


def harmless(text: str) -> SanitisedScript:
    """Sanitise a script. Raises NotACommandError."""
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
    return SanitisedScript(logic, tuple(kept))


def _name(text: str) -> str:
    """The symbol that a text begins with."""
    text = text.lstrip()
    if text.startswith("|"):
        return text[1 : text.find("|", 1)]
    return text.split(None, 1)[0].rstrip("()") if text else ""


def _commands(text: str) -> Iterator[str]:
    """The top-level parenthesised parts of a text."""
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
