"""Formulas have the value that their definition gives them, however their loops are written."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from random import Random
from typing import assert_never

import pytest

from koord.refinement.protocol_proof.logic import (
    And,
    Atom,
    Equal,
    Exists,
    ForAll,
    Formula,
    Not,
    Or,
    Relation,
    Sort,
    Variable,
    free,
)
from koord.refinement.protocol_proof.structures import Query, Structure, counterexamples

VARIABLES = [Variable(name, sort) for sort in (Sort.LIFE, Sort.EPOCH) for name in "xyz"]
RELATIONS = [
    Relation("one", (Sort.LIFE,)),
    Relation("two", (Sort.LIFE, Sort.EPOCH)),
    Relation("three", (Sort.EPOCH, Sort.LIFE, Sort.EPOCH)),
]


def value(formula: Formula, at: Structure, of: Mapping[Variable, int]) -> bool:
    """The value of a formula, by the definition."""
    match formula:
        case Atom(relation=relation, arguments=arguments):
            return tuple(of[one] for one in arguments) in at.relations[relation.name]
        case Equal(left=left, right=right):
            return of[left] == of[right]
        case Not(body=body):
            return not value(body, at, of)
        case And(parts=parts):
            return all(value(one, at, of) for one in parts)
        case Or(parts=parts):
            return any(value(one, at, of) for one in parts)
        case ForAll(variables=variables, body=body):
            return all(value(body, at, {**of, **one}) for one in values(variables, at))
        case Exists(variables=variables, body=body):
            return any(value(body, at, {**of, **one}) for one in values(variables, at))
        case _:
            assert_never(formula)


def values(variables: tuple[Variable, ...], at: Structure) -> list[dict[Variable, int]]:
    domains = [at.domains[one.sort.value] for one in variables]
    return [dict(zip(variables, found, strict=True)) for found in product(*domains)]


def structure(random: Random) -> Structure:
    domains = {Sort.LIFE.value: (0, 1), Sort.EPOCH.value: (0, 1, 2)}
    relations = {
        one.name: {
            found
            for found in product(*(domains[sort.value] for sort in one.sorts))
            if random.random() < 0.4
        }
        for one in RELATIONS
    }
    return Structure(domains, relations)


def formula(random: Random, depth: int) -> Formula:
    kind = random.randrange(8) if depth else random.randrange(2)
    if kind == 0:
        relation = random.choice(RELATIONS)
        return relation(*(random.choice(of_sort(sort)) for sort in relation.sorts))
    if kind == 1:
        left = random.choice(VARIABLES)
        return Equal(left, random.choice(of_sort(left.sort)))
    if kind == 2:
        return Not(formula(random, depth - 1))
    if kind in (3, 4):
        parts = tuple(formula(random, depth - 1) for _ in range(random.randrange(1, 4)))
        return And(parts) if kind == 3 else Or(parts)
    bound = tuple(random.sample(VARIABLES, random.randrange(1, 3)))
    body = formula(random, depth - 1)
    return ForAll(bound, body) if kind < 6 else Exists(bound, body)


def of_sort(sort: Sort) -> list[Variable]:
    return [one for one in VARIABLES if one.sort is sort]


@pytest.mark.parametrize("seed", range(4))
def test_a_query_finds_what_the_definition_does(seed: int) -> None:
    random = Random(seed)
    for _ in range(150):
        made, at = formula(random, 4), structure(random)
        wanted = tuple(dict.fromkeys(free(made)))
        expected = {tuple(one.values()) for one in values(wanted, at) if value(made, at, one)}
        assert {*Query(wanted, (), [made])(at)} == expected
        others = {tuple(one.values()) for one in values(wanted, at)} - expected
        assert {*counterexamples(made, ())(at)} == others


def test_what_is_given_is_not_looked_for() -> None:
    x, y = VARIABLES[0], VARIABLES[3]
    at = Structure(
        {Sort.LIFE.value: (0, 1), Sort.EPOCH.value: (5, 6)}, {"two": {(0, 5), (1, 5), (1, 6)}}
    )
    assert {*Query((x, y), (x,), [RELATIONS[1](x, y)])(at, 1)} == {(1, 5), (1, 6)}
