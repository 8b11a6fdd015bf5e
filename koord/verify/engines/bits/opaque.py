"""Opaque values: of these only equality and uninterpreted relations are known.

At any moment finitely many of them exist. A *token* is one that came about: what a variable held at
the start of a round, an answer, a function of other tokens. A value that is not known is a *choice*
of tokens under conditions that exclude each other. What is known of tokens are *atoms*: one literal
for each relation and each tuple of tokens that somebody asks about.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple, TypeAlias

from msgspec import Struct, field

from koord.semantics.domain import Constant
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph

#: The relation that every sort has.
EQUALS = "="


class OpaqueChoice(NamedTuple):
    """An opaque value: tokens, each with the condition that it is the one."""

    sort: str
    parts: tuple[tuple[Argument, int], ...]


class OpaqueToken(NamedTuple):
    """An opaque value in the form of an atom's argument.

    ``standing`` ones are held by variables from one round to the next, ``part`` says to which
    formula the others belong. ``function`` and ``arguments`` tell what it was computed from.
    """

    sort: str
    name: str
    part: int
    standing: bool = False
    function: str = ""
    arguments: tuple[Argument, ...] = ()


class Known(NamedTuple):
    """A constant in the form of an atom's argument."""

    value: Constant


Argument: TypeAlias = "int | Known"

#: A relation and what it is asked of.
Atom: TypeAlias = "tuple[str, tuple[Argument, ...]]"


class Opaques(Struct):
    """All tokens and atoms of one system, over one graph."""

    graph: Graph
    part: int = 0  #: to which formula what comes about now belongs
    tokens: list[OpaqueToken] = field(default_factory=list)
    atoms: dict[int, dict[Atom, int]] = field(default_factory=dict)  #: by part
    _terms: dict[tuple[str, int, tuple[Argument, ...]], int] = field(default_factory=dict)

    def fresh(self, sort: str, name: str, *, standing: bool = False) -> OpaqueChoice:
        """A fresh opaque value."""
        self.tokens.append(OpaqueToken(sort, name, self.part, standing))
        return OpaqueChoice(sort, ((len(self.tokens) - 1, TRUE),))

    def term(self, function: str, arguments: tuple[Argument, ...], sort: str) -> int:
        """The token of a function applied to arguments: one for equal arguments.

        For none it gives one for the whole run, of which is known what is known of variables'.
        """
        key = (function, self.part if arguments else 0, arguments)
        if key not in self._terms:
            shown = ",".join(str(a) for a in arguments)
            name, standing = f"{function}({shown})", not arguments
            token = OpaqueToken(sort, name, self.part, standing, function, arguments)
            self.tokens.append(token)
            self._terms[key] = len(self.tokens) - 1
        return self._terms[key]

    def found(self, function: str, arguments: tuple[Argument, ...]) -> int:
        """The token of a function applied to arguments; -1 if it does not exist."""
        return self._terms.get((function, self.part if arguments else 0, arguments), -1)

    def atom(self, relation: str, arguments: tuple[Argument, ...]) -> int:
        """The literal that a relation holds of tokens and constants."""
        if relation == EQUALS:
            if arguments[0] == arguments[1]:
                return TRUE
            arguments = tuple(sorted(arguments, key=str))
        key = (relation, arguments)
        atoms = self.atoms.setdefault(self.part, {})
        if key not in atoms:
            shown = ",".join(self._name(a) for a in arguments)
            atoms[key] = self.graph.input(f"{relation}({shown})")
        return atoms[key]

    def _name(self, argument: Argument) -> str:
        if isinstance(argument, Known):
            return str(argument.value)
        return self.tokens[argument].name

    def is_standing(self, atom: Atom) -> bool:
        """Return whether an atom is about values of variables, and so part of the state."""
        return all(isinstance(a, Known) or self.tokens[a].standing for a in atom[1])

    # --- values ---------------------------------------------------------------------------------

    def chosen(self, condition: int, then: OpaqueChoice, other: OpaqueChoice) -> OpaqueChoice:
        """If-then-else of two opaque values."""
        g = self.graph
        guards: dict[Argument, int] = {}
        for token, guard in then.parts:
            guards[token] = g.both(condition, guard)
        for token, guard in other.parts:
            both = g.both(condition ^ 1, guard)
            guards[token] = g.either(guards[token], both) if token in guards else both
        if set(guards) == {t for t, _ in then.parts} == {t for t, _ in other.parts}:
            # Simpler, and the same.
            a, b = dict(then.parts), dict(other.parts)
            guards = {token: g.choose(condition, a[token], b[token]) for token in guards}
        return OpaqueChoice(then.sort, tuple((t, x) for t, x in guards.items() if x != FALSE))

    def related(self, relation: str, arguments: Sequence[OpaqueChoice | Constant]) -> int:
        """The literal that a relation holds of values, by cases."""
        g = self.graph
        if relation == EQUALS and arguments[0] == arguments[1]:
            return TRUE
        return g.any_of(
            g.both(guard, self.atom(relation, tokens)) for tokens, guard in self.cases(arguments)
        )

    def applied(
        self, function: str, arguments: Sequence[OpaqueChoice | Constant], sort: str
    ) -> OpaqueChoice:
        """Apply a function to values, by cases."""
        g = self.graph
        guards: dict[Argument, int] = {}
        for tokens, guard in self.cases(arguments):
            token = self.term(function, tokens, sort)
            guards[token] = g.either(guards.get(token, FALSE), guard)
        return OpaqueChoice(sort, tuple(guards.items()))

    def cases(
        self, arguments: Sequence[OpaqueChoice | Constant]
    ) -> Iterator[tuple[tuple[Argument, ...], int]]:
        """Yield the combinations of tokens that arguments may be, each with its condition."""
        options: list[tuple[tuple[Argument, int], ...]] = [
            a.parts if isinstance(a, OpaqueChoice) else ((Known(a), TRUE),) for a in arguments
        ]
        for combined in product(*options):
            guard = TRUE
            for _, condition in combined:
                guard = self.graph.both(guard, condition)
            if guard != FALSE:
                yield tuple(argument for argument, _ in combined), guard
