"""Finite structures, and the value of formulas in them.

A formula becomes a Python expression, in which quantifiers are loops over the tuples of relations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import Any, assert_never

from msgspec import Struct

from koord.refinement.protocol_proof.logic import (
    And,
    Atom,
    Equal,
    Exists,
    ForAll,
    Formula,
    Not,
    Or,
    Variable,
    free,
)

#: Of a sort, in a structure; anything that can be compared and be a member of a set.
Element = Any

Tuples = Set[tuple[Element, ...]]


class Structure(Struct, frozen=True):
    """By their names: the elements of each sort, and the tuples of which a relation is true."""

    domains: Mapping[str, Sequence[Element]]
    relations: Mapping[str, Tuples]


class Query:
    """All values of ``wanted`` of which each of the ``parts`` is true, for values of ``given``.

    What is both wanted and given is as it is given.
    """

    def __init__(
        self,
        wanted: Sequence[Variable],
        given: Sequence[Variable],
        parts: Iterable[Formula],
    ) -> None:
        writer = _Writer()
        names = {one: writer.name() for one in given}
        open_ = [one for one in wanted if one not in names]
        clauses, bound = writer.loops(open_, parts, names)
        found = "".join(f"{bound[one]}, " for one in wanted)
        arguments = "".join(f", {name}" for name in names.values())
        text = f"lambda R, D{arguments}: [({found}) {clauses}]"
        self._run: Callable[..., list[tuple[Element, ...]]] = eval(text)

    def __call__(self, structure: Structure, *given: Element) -> list[tuple[Element, ...]]:
        return self._run(structure.relations, structure.domains, *given)


def counterexamples(formula: Formula, constants: Sequence[Variable]) -> Query:
    """The query for values of the free variables of a formula for which it is not true."""
    wanted = [one for one in dict.fromkeys(free(formula)) if one not in constants]
    return Query(wanted, constants, [_negation(formula)])


class _Writer:
    """Writes the expressions of one query."""

    def __init__(self) -> None:
        self._count = 0

    def name(self) -> str:
        self._count += 1
        return f"v{self._count}"

    def expression(self, formula: Formula, names: Mapping[Variable, str]) -> str:
        match formula:
            case Atom(relation=relation, arguments=arguments):
                elements = "".join(f"{names[one]}, " for one in arguments)
                return f"(({elements}) in R[{relation.name!r}])"
            case Equal(left=left, right=right):
                return f"({names[left]} == {names[right]})"
            case Not(body=body):
                return f"(not {self.expression(body, names)})"
            case And(parts=parts):
                return f"({' and '.join(self.expression(one, names) for one in parts)})"
            case Or(parts=parts):
                return f"({' or '.join(self.expression(one, names) for one in parts)})"
            case Exists(variables=variables, body=body):
                clauses, _ = self.loops(variables, [body], names)
                return f"any(True {clauses})"
            case ForAll(variables=variables, body=body):
                clauses, _ = self.loops(variables, [_negation(body)], names)
                return f"(not any(True {clauses}))"
            case _:
                assert_never(formula)

    def loops(
        self, variables: Sequence[Variable], parts: Iterable[Formula], outer: Mapping[Variable, str]
    ) -> tuple[str, dict[Variable, str]]:
        """Loops over the values of variables for which all parts are true: what is known first."""
        names = {one: name for one, name in outer.items() if one not in variables}
        left = [one for part in parts for one in _conjuncts(part)]
        open_ = list(variables)
        clauses = ["for _ in (0,)"]
        while left or open_:
            place = min(range(len(left)), key=lambda n: _cost(left[n], open_), default=None)
            if place is None or _cost(left[place], open_) == _NO_LOOP:
                names[open_[0]] = self.name()
                clauses.append(f"for {names[open_[0]]} in D[{_sort(open_.pop(0))}]")
                continue
            part = left.pop(place)
            if not set(free(part)) & set(open_):
                clauses.append(f"if {self.expression(part, names)}")
            else:
                clauses += self._loop(part, open_, names)
                open_ = [one for one in open_ if one not in names]
        return " ".join(clauses), names

    def _loop(
        self, part: Formula, open_: Sequence[Variable], names: dict[Variable, str]
    ) -> list[str]:
        """A loop over what an atom or an equation leaves open."""
        if isinstance(part, Equal):
            new, old = (part.left, part.right) if part.left in open_ else (part.right, part.left)
            names[new] = self.name()
            return [f"for {names[new]} in ({names[old]},)"]
        assert isinstance(part, Atom)
        places, tests = [], []
        for one in part.arguments:
            places.append(self.name())
            if one in names:
                tests.append(f"if {places[-1]} == {names[one]}")
            else:
                names[one] = places[-1]
        return [f"for {', '.join(places)}, in R[{part.relation.name!r}]", *tests]


#: A part in which no loop is to be found yet.
_NO_LOOP = 1000


def _cost(part: Formula, open_: Sequence[Variable]) -> int:
    """How many variables a part leaves open, if it can be looped over."""
    missing = set(free(part)) & set(open_)
    match part:
        case _ if not missing:
            return -1
        case Equal(left=left, right=right) if len(missing) == 1 and left != right:
            return 0
        case Atom():
            return len(missing)
        case _:
            return _NO_LOOP


def _sort(variable: Variable) -> str:
    return repr(variable.sort.value)


def _conjuncts(formula: Formula) -> list[Formula]:
    match formula:
        case And(parts=parts):
            return [one for part in parts for one in _conjuncts(part)]
        case Not(body=Or() | Not() | ForAll() as body):
            negated = _negation(body)
            return [negated] if isinstance(negated, Exists) else _conjuncts(negated)
        case _:
            return [formula]


def _negation(formula: Formula) -> Formula:
    match formula:
        case Not(body=body):
            return body
        case Or(parts=parts):
            return And(tuple(map(_negation, parts)))
        case ForAll(variables=variables, body=body):
            return Exists(variables, _negation(body))
        case _:
            return Not(formula)
