"""First-order logic with sorts: the terms in which the protocol is modelled for every number.

A formula is data. It is put to Z3 (``proving``), and evaluated on finite structures
(``structures``): what is proved and what is tested are the same terms.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import assert_never

from msgspec import Struct


class Sort(Enum):
    """The sorts of the model."""

    LIFE = "life"  #: an incarnation of a robot
    EPOCH = "epoch"
    HISTORY = "history"  #: an entry with all those before it
    QUORUM = "quorum"  #: a set of lives


class Variable(Struct, frozen=True):
    """A variable; a constant, where nothing binds it."""

    name: str
    sort: Sort


class Relation(Struct, frozen=True):
    """A relation symbol; calling it makes an atom."""

    name: str
    sorts: tuple[Sort, ...]

    def __call__(self, *arguments: Variable) -> Atom:
        assert tuple(one.sort for one in arguments) == self.sorts, (self, arguments)
        return Atom(self, arguments)


class Atom(Struct, frozen=True):
    relation: Relation
    arguments: tuple[Variable, ...]


class Equal(Struct, frozen=True):
    left: Variable
    right: Variable


class Not(Struct, frozen=True):
    body: Formula


class And(Struct, frozen=True):
    parts: tuple[Formula, ...]


class Or(Struct, frozen=True):
    parts: tuple[Formula, ...]


class ForAll(Struct, frozen=True):
    variables: tuple[Variable, ...]
    body: Formula


class Exists(Struct, frozen=True):
    variables: tuple[Variable, ...]
    body: Formula


Formula = Atom | Equal | Not | And | Or | ForAll | Exists


def both(*parts: Formula) -> And:
    return And(parts)


def either(*parts: Formula) -> Or:
    return Or(parts)


def implies(*parts: Formula) -> Or:
    """The last part follows from the others."""
    *premises, conclusion = parts
    return Or((*(Not(one) for one in premises), conclusion))


def free(formula: Formula) -> Iterator[Variable]:
    """The variables that nothing in the formula binds; some more than once."""
    match formula:
        case Atom(arguments=arguments):
            yield from arguments
        case Equal(left=left, right=right):
            yield from (left, right)
        case Not(body=body):
            yield from free(body)
        case And(parts=parts) | Or(parts=parts):
            for part in parts:
                yield from free(part)
        case ForAll(variables=bound, body=body) | Exists(variables=bound, body=body):
            yield from (one for one in free(body) if one not in bound)
        case _:
            assert_never(formula)


def relations(formula: Formula) -> Iterator[Relation]:
    """The relations that a formula speaks of; some more than once."""
    match formula:
        case Atom(relation=relation):
            yield relation
        case Equal():
            return
        case Not(body=body) | ForAll(body=body) | Exists(body=body):
            yield from relations(body)
        case And(parts=parts) | Or(parts=parts):
            for part in parts:
                yield from relations(part)
        case _:
            assert_never(formula)


class Effect(Struct, frozen=True):
    """``relation`` becomes true of those ``variables`` of which ``where`` is; nothing ends."""

    relation: Relation
    variables: tuple[Variable, ...]
    where: Formula


class Action(Struct, frozen=True):
    """A kind of step: with any parameters of which the guard holds, all effects at once.

    ``rule`` is the id in specs/protocol. The first effect is one fact, by which a step is told.
    """

    name: str
    rule: str
    parameters: tuple[Variable, ...]
    guard: tuple[Formula, ...]
    effects: tuple[Effect, ...]


def becomes(atom: Atom) -> Effect:
    """The effect that one fact becomes true."""
    arguments = atom.arguments
    places = tuple(Variable(f"{n}.", one.sort) for n, one in enumerate(arguments))
    where = And(tuple(map(Equal, places, arguments)))
    return Effect(atom.relation, places, where)


class Statement(Struct, frozen=True):
    """A formula with a name; its free variables are meant universally."""

    name: str
    formula: Formula


def statement(name: str, *parts: Formula) -> Statement:
    """A statement: the last part follows from the others."""
    return Statement(name, implies(*parts))
