"""Entries of maps that are written in part: every engine sees updates in that. [LOST-UPDATE]"""

from __future__ import annotations

import pytest

from koord.verify.engine_names import Engine
from koord.verify.verdicts import Outcome
from tests.verify.asking import ask, of_text

CLAIM = "no lost update of lockers"


def lockers(key: str) -> str:
    return (
        "def Locker:\n  int owner = -1\n  bool open = false\n"
        "allwrite:\n"
        "  Map<int, Locker> lockers = {0: Locker(-1, false), 1: Locker(-1, false)}\n"
        "local:\n  bool done = false\n"
        "Take:\n  pre: not done and pid == 0\n"
        f"  eff:\n    lockers[{key}].owner = 7\n    done = true\n"
        "Open:\n  pre: not done and pid == 1\n"
        f"  eff:\n    lockers[{key}].open = true\n    done = true\n"
    )


@pytest.mark.parametrize("choice", [Engine.SEARCH, Engine.BMC, Engine.BITS, None])
def test_two_robots_that_write_parts_of_one_entry_lose_an_update(choice: Engine | None) -> None:
    """Neither reads the map, but what each writes is the whole entry as it was before."""
    found = ask(of_text(lockers("0")), choice=choice)[CLAIM]
    assert found.outcome is Outcome.VIOLATED
    assert found.counterexample is not None
    assert found.counterexample.round == 1
    assert "updates what it read before" in found.counterexample.detail


@pytest.mark.parametrize("choice", [Engine.SEARCH, Engine.BMC, Engine.BITS, None])
def test_parts_of_entries_under_different_keys_lose_nothing(choice: Engine | None) -> None:
    assert ask(of_text(lockers("pid")), choice=choice).outcome(CLAIM) is Outcome.HOLDS
