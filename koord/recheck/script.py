"""Terms as text of SMT-LIB 2, with shared parts named once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from koord.recheck.terms import Term

#: A part that is used less often, or is smaller, is written out where it is used.
_SMALL = 2


@dataclass(slots=True)
class Script:
    """Writes terms. What it has named stays named, so a term is written once."""

    _names: dict[int, str] = field(default_factory=dict)
    _free: dict[int, frozenset[str]] = field(default_factory=dict)

    def text(self, term: Term) -> tuple[list[str], str]:
        """Definitions that are needed first, and the term in their words."""
        definitions: list[str] = []
        written: dict[int, str] = {}
        for node in _inside_out(term, self._names):
            if id(node) in self._names or id(node) in written:
                continue
            body = self._body(node, written)
            if node.args and not self._is_open(node) and node is not term and len(body) > 24:
                name = f"t{len(self._names)}"
                definitions.append(f"(define-fun {name} () {node.sort} {body})")
                self._names[id(node)] = name
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

    def _is_open(self, node: Term) -> bool:
        """Whether a variable is free in it: then it has no name outside of its quantifier."""
        return bool(self._free_in(node))

    def _free_in(self, node: Term) -> frozenset[str]:
        known = self._free.get(id(node))
        if known is None:
            known = frozenset[str]().union(*(self._free_in(a) for a in node.args))
            if node.head.startswith("|?"):
                known |= {node.head}
            known -= {b.head for b in node.binders}
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
