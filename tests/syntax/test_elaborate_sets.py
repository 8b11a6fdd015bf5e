"""Sets as the front end knows them: types, literals, what is done to them, what is not."""

from __future__ import annotations

import pytest

from koord.syntax import core
from koord.syntax.types import INT, PRESENT, ListType, SetType
from tests.syntax.elaborating import codes, effect, only

ABOVE = """
allwrite:
  Set<int> seen = {1, 2}
  Set<pos> spots = {}
  Map<int, bool> marks = {}
local:
  int n = 0
"""

NUMBERS = SetType(INT, PRESENT)


def test_an_element_is_added_by_writing_its_entry() -> None:
    """[S-ADD]"""
    (added,) = effect("seen.add(n + 1)", ABOVE)
    assert isinstance(added, core.Assign)
    assert isinstance(added.place.steps[-1], core.KeyStep)
    assert added.value == core.Const(0, PRESENT)


def test_adding_reads_nothing_so_that_no_update_can_be_lost() -> None:
    added = f"{ABOVE}\nGo:\n  eff:\n    spots.add(pos(1.0, 2.0, 3.0))\n"
    assert "K401" not in codes(added)
    assert "K401" in codes(added.replace("add", "remove"))


def test_loops_and_quantifiers_go_through_the_elements() -> None:
    (loop,) = effect("for i in seen: n = i", ABOVE)
    assert isinstance(loop, core.ForEach)
    assert loop.key is None
    assert isinstance(loop.sequence, core.Builtin)
    assert (loop.sequence.op, loop.sequence.type) == (core.ListOp.KEYS, ListType(INT))
    (listed,) = effect("n = length(keys(marks))", ABOVE)
    assert isinstance(listed, core.Assign)


@pytest.mark.parametrize(
    ("statement", "code", "said"),
    [
        ("n = seen[1]", "K229", "no elements by number or key"),
        ("seen[1] = 2", "K229", "no elements by number or key"),
        ("marks.add(1)", "K229", "changes sets"),
        ("seen.append(1)", "K229", "changes lists and queues"),
        ("seen.add(true)", "K204", "what is added"),
        ("seen = {true}", "K204", "an element of this"),
        ("n = length(keys(n))", "K229", "a map or a set"),
        ("seen = marks", "K204", "Set<int>"),
    ],
)
def test_what_sets_do_not_do_is_told(statement: str, code: str, said: str) -> None:
    found = only(f"{ABOVE}\nGo:\n  eff:\n    {statement}\n")
    assert found.code == code
    assert said in found.message + (found.hint or "")


def test_elements_are_comparable() -> None:
    found = only("allwrite:\n  Set<int[]> bags = {}\nGo:\n  eff:\n    pass\n")
    assert (found.code, found.message) == ("K203", "`int[]` cannot be an element of a set")
