"""Pieces of functions are found by what they mean, and not by how they are laid out."""

from __future__ import annotations

import ast
from textwrap import dedent

import pytest

from tests.mutants.patterns import definitions, replace

TEXT = dedent(
    """
    def total(xs):
        found = sum(  # of all
            xs,
        )
        if found:
            found += 1
            return found
        match xs:
            case [x] if x > 0:
                return x
        return found

    class Shelf:
        def total(self):
            def inner():
                return len(self.books)
            return inner()
    """
)


@pytest.mark.parametrize(
    ("place", "old", "new", "wanted"),
    [
        ("total", "sum(xs)", "max(xs)", "found = max(xs)"),
        (
            "total",
            "found += 1\nreturn found",
            "return found",
            "    if found:\n        return found",
        ),
        ("total", "found += 1", "pass", "        pass\n        return found"),
        ("total", "case [x] if x > 0:", "case [x]:", "case [x]:\n            return x"),
        ("Shelf.total.inner", "len(self.books)", "0", "return 0"),
    ],
)
def test_a_piece_is_replaced_where_it_stands(place: str, old: str, new: str, wanted: str) -> None:
    tree = ast.parse(TEXT)
    (scope,) = definitions(tree, place.split("."))
    assert replace(scope, old, new) == 1
    assert wanted in ast.unparse(tree)


def test_pieces_are_counted() -> None:
    (scope,) = definitions(ast.parse(TEXT), ["total"])
    assert replace(scope, "return found", "return 0") == 2
    assert replace(scope, "sum(ys)", "0") == 0
    assert definitions(scope, ["Shelf"]) == []
