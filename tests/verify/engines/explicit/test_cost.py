"""When a search goes over to machine code: by what Python has cost, which no clock measures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from koord.syntax.system import System, dealt
from koord.verify.engines.explicit import search as searching
from koord.verify.engines.explicit.cost import COMPILED_FROM, FAIR_COMPILED_FROM
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted
from koord.verify.engines.explicit.search import Search, begun
from tests.agreement.test_kernels import properties_of
from tests.loading import program_of
from tests.verify.asking import of_text

pytest.importorskip("llvmlite")

from koord.kernels.terms import NoKernelError

#: Robots that count by themselves: many states, each of which costs next to nothing.
MANY_CHEAP = """\
local:
    int x = 0

Up:
    pre: x < 5
    eff: x = x + 1

invariant Small: forall i: x@i < 9
eventually Done: forall i: x@i == 5
"""


def claiming(robots: int, tasks: int) -> System:
    path = Path(__file__).parents[4] / "benchmarks" / "programs" / "claiming.krd"
    return dealt(program_of(path.read_text("utf-8"), tasks=tasks), robots)


def searched(of: System, compiled_from: int | None, **bounds: Any) -> Search:
    made = begun(of, properties_of(of), Limits(**bounds), compiled_from=compiled_from)
    assert not isinstance(made, NotFinite)
    list(made.violations())
    return made


def test_few_states_that_cost_much_are_left_to_machine_code() -> None:
    """Elements and robots that change places in all ways take Python long for each state."""
    search = searched(claiming(5, 6), COMPILED_FROM)
    assert search.is_compiled
    assert len(search.seen) < 60
    assert search.end == Exhausted(132, 12)


def test_many_states_that_cost_little_are_looked_at_before_machine_code_is_made() -> None:
    search = searched(of_text(MANY_CHEAP, robots=6), COMPILED_FROM)
    assert not search.is_compiled
    assert search.end == Exhausted(462, 5)


def test_where_states_are_limited_machine_code_goes_on() -> None:
    search = searched(of_text(MANY_CHEAP, robots=6), COMPILED_FROM, states=100)
    assert search.is_compiled
    assert search.end == Exhausted(462, 5)


def test_graphs_of_whole_runs_go_over_by_what_they_cost() -> None:
    few, many = (of_text(MANY_CHEAP, robots=n) for n in (2, 4))
    for of, is_compiled in ((few, False), (many, True)):
        [stated] = [p for p in of.program.properties if p.name == "Done"]
        report = lively(of, (stated,), compiled_from=FAIR_COMPILED_FROM)
        assert report.is_compiled is is_compiled
        assert report.needs


@pytest.mark.parametrize("cost", [0, 500, 1_000, 5_000])
def test_where_machine_code_fails_python_goes_on_in_the_middle_of_a_state(
    cost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(self: Search) -> list[Any]:
        raise NoKernelError("no")

    of = of_text(MANY_CHEAP, robots=4)
    plain = searched(of, None)
    monkeypatch.setattr(searching.Search, "_compiled_goals", fails)
    search = searched(of, cost)
    assert search.left is not None
    assert search.end == plain.end
    assert search.seen.keys() == plain.seen.keys()
