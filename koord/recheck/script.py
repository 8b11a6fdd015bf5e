"""Terms as text of SMT-LIB 2, with shared parts named once."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from koord.recheck.terms import Term

#: A part that is used less often, or is smaller, is written out where it is used.
_SMALL = 2


class Script(Struct):
    """Writes terms. What it has named stays named, so a term is written once.

    A part in which variables of quantifiers are free is named as a function of these.
    """

    _names: dict[int, str] = field(default_factory=dict)
    _free: dict[int, dict[str, str]] = field(default_factory=dict)
    _count: int = 0

    def text(self, term: Term) -> tuple[list[str], str]:
        """Definitions that are needed first, and the term in their words."""
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
        """The variables that are free in a term whose parts were asked about before, with sorts."""
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
    """Every part before what it is part of."""
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
