"""Where machine code is left: what does not fit, what is too much, and what Python says otherwise.
[SYMMETRY]

In each case the result is that of the road of Python.
"""

from __future__ import annotations

from typing import Any

import pytest

from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.system import System
from koord.verify.engines.explicit import limits
from koord.verify.engines.explicit import search as searching
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind, OutOfBounds
from koord.verify.engines.explicit.search import Search, begun
from tests.agreement.test_kernels import CLAIMING, NAMED, SENSED, properties_of, read
from tests.agreement.test_search import EVERYTHING

pytest.importorskip("llvmlite")

from koord.kernels import combinations, exploration, rounds, terms, turn_code
from koord.kernels.exploration import Exploration
from koord.kernels.layout import Layout
from koord.machine import code
from koord.verify.engines.explicit.second_look import DisagreementError, SecondLook

COUNTING = (
    "local:\n    int x = 0\n\nUp:\n    pre: x < 3\n    eff: x = x + 1\n\ninvariant Small: x < 2\n"
)


def searched(of: System, compiled_from: int | None = 0, **bounds: Any) -> tuple[Search, set[Any]]:
    search = begun(
        of,
        properties_of(of),
        Limits(**bounds),
        subjects=EVERYTHING - {GoalKind.CONTRACT},
        compiled_from=compiled_from,
    )
    assert not isinstance(search, NotFinite)
    return search, {(v.claim.subject, v.claim.name, v.rounds) for v in search.violations()}


def agrees(of: System) -> Search:
    """A search on machine code with the same result as that of Python."""
    plain, expected = searched(of, None)
    search, found = searched(of)
    assert (found, search.end) == (expected, plain.end)
    return search


def test_without_machine_code_there_is_the_road_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "is_installed", lambda: False)
    search, found = searched(read(CLAIMING, 2))
    assert not found
    assert not search.is_compiled
    assert isinstance(search.end, Exhausted)


def test_what_does_not_fit_is_left_to_python() -> None:
    """Cells have as many bits as the starts need; what grows beyond is no result."""
    text = "local:\n    int x = 0\n\nGrow:\n    pre: x < 300\n    eff: x = x + 100\n"
    search, found = searched(read(text, 1))
    assert not found
    assert not search.is_compiled
    assert search.end == Exhausted(4, 3)


def test_what_does_not_fit_is_no_result_though_nobody_looks_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SecondLook, "due", lambda self, first, end: iter(()))
    test_what_does_not_fit_is_left_to_python()


@pytest.mark.parametrize(
    ("module", "name", "why"),
    [
        (terms, "_MOST_TERMS", "terms"),
        (code, "_MOST_TEXT", "too much to compile"),
        (combinations, "_MOST_SUCCESSORS", "successors"),
        (combinations, "_MOST_MOVES", "moves"),
        (rounds, "_MOST_ROBOTS", "robots"),
    ],
)
def test_what_is_too_much_is_left_to_python(
    module: Any, name: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, name, 1)
    search = agrees(read(CLAIMING, 2))
    assert not search.is_compiled
    assert why in str(search.left)


@pytest.mark.parametrize(
    ("text", "robots"),
    [(CLAIMING, 2), (SENSED, 2), (NAMED, 3)],
    ids=["claiming", "sensed", "named"],
)
def test_tables_grow(text: str, robots: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in the middle of a state, which is then looked at once more."""
    monkeypatch.setattr(exploration, "_FIRST_ENTRIES", 4)
    assert agrees(read(text, robots)).is_compiled


def test_machine_code_comes_back_after_some_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exploration, "_WORK", 1)
    assert agrees(read(CLAIMING, 2)).is_compiled


def test_more_memory_than_permitted_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told of tables before they have it."""
    monkeypatch.setattr(limits, "resident_mb", lambda: 0.0)
    monkeypatch.setattr(exploration, "_FIRST_ENTRIES", 64)
    search = begun(read(CLAIMING, 3), (), Limits(memory_mb=1), symmetry=False, compiled_from=0)
    assert not isinstance(search, NotFinite)
    assert not list(search.violations())
    assert isinstance(search.end, OutOfBounds)
    assert search.end.reason == "more than 1 MB of memory"


def test_without_memory_for_any_table_there_is_the_road_of_python() -> None:
    search, _ = searched(read(CLAIMING, 2), memory_mb=1)
    assert not search.is_compiled


def test_machine_code_may_see_more_states() -> None:
    search, _ = searched(read(CLAIMING, 3), states=25)
    assert isinstance(search.end, OutOfBounds)
    assert search.end.reason == "more than 800 states"


# --- second looks ---------------------------------------------------------------------------------


def test_eight_robots_that_may_change_places_are_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What stands for a state is told with its renaming, however many robots there are."""
    looked: list[int] = []
    look = SecondLook.look

    def counted(self: SecondLook, state: Any) -> None:
        look(self, state)
        looked.append(self.looked)

    monkeypatch.setattr(SecondLook, "look", counted)
    search = agrees(read(COUNTING, 8))
    assert search.is_compiled
    assert looked[-1] > 30


def test_a_state_that_machine_code_misses_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Exploration, "lookup", lambda self, numbers: -1)
    search = agrees(read(CLAIMING, 2))
    assert isinstance(search.left, DisagreementError)


@pytest.mark.parametrize("names", [(0, 0, 0), (1, 0, 2)])
def test_a_state_taken_for_another_is_noticed(
    names: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    canonical = Exploration.canonical
    monkeypatch.setattr(Exploration, "canonical", lambda self, n: (canonical(self, n)[0], names))
    search = agrees(read(NAMED, 3))
    assert isinstance(search.left, DisagreementError)


def test_two_robots_with_one_new_number_are_noticed() -> None:
    of = read(COUNTING, 2)
    symmetry = symmetry_of(of, properties_of(of))
    assert isinstance(symmetry, Symmetry)
    layout = Layout(of, symmetry, frozenset(), tracks_ran=False)
    search, _ = searched(of, None)

    class Told:
        work = 0

        def canonical(self, numbers: list[int]) -> tuple[list[int], tuple[int, ...]]:
            return list(numbers), (0, 0)

    told: Any = Told()
    look = SecondLook(told, layout, frozenset(), lambda state: state, search.joints)
    with pytest.raises(DisagreementError):
        look.standing_for([0, 0])


def test_a_violation_that_machine_code_misses_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here it takes every statement to hold."""
    monkeypatch.setattr(
        rounds, "statement_code", lambda m, name, holds, cells: STATEMENT(m, name, True, cells)
    )
    search = agrees(read(COUNTING, 2))
    assert isinstance(search.left, DisagreementError)


STATEMENT = turn_code.statement_code
