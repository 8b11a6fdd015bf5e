"""Orders of writes: all stores in which they may end, with little work. [T-COMMIT]"""

from __future__ import annotations

import pytest

from koord.syntax.system import System, dealt
from koord.verify.engines.explicit.commits import Commits, Shared
from koord.verify.engines.explicit.initial_states import openings
from koord.verify.engines.explicit.states import State, StateStore
from tests.loading import program_of

#: All robots write the same, but for some of them.
WRITERS = """
allwrite:
    int[3] owner
    int last = -1
init:
    for i = 0, 3:
        owner[i] = -1
    if pid < {others}:
        owner[pid] = pid
        last = pid % 2
"""


class Counting(Commits):
    """Counts the writes that are put into stores."""

    puts = 0

    def _commit(self, shared: Shared, write: int) -> Shared:
        self.puts += 1
        return super()._commit(shared, write)


def stores(system: System, *, every_order: bool = False) -> tuple[set[State], Counting]:
    vault = StateStore(system, tracks_ran=False)
    commits = Counting(vault, every_order=every_order)
    return {found.state for found in openings(system, vault, commits)}, commits


@pytest.mark.parametrize("others", [0, 1, 2, 3])
def test_writers_of_the_same_end_in_the_same_stores(others: int) -> None:
    system = dealt(program_of(WRITERS.format(others=others)), 5)
    found, _ = stores(system)
    assert len(found) == len(stores(system, every_order=True)[0]) > others


def test_writers_of_the_same_are_put_in_one_order() -> None:
    found, commits = stores(dealt(program_of(WRITERS.format(others=0)), 12))
    assert len(found) == 1
    assert commits.puts == 12
