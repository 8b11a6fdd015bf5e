"""An *unknown* says what stands in the way: the engine, the variable, and what would change it."""

from __future__ import annotations

from itertools import product

import pytest

from koord.semantics.configurations import System, dealt
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.verify import obstacles
from koord.verify.obstacles import Values, WholeRuns
from koord.verify.portfolio import Choice, verify
from koord.verify.verdicts import Bounds, Outcome, Verdict

#: A sensor and a variable that no search can follow, a list that may be long, and a whole run.
OPEN = """
using Watch:
    sensors:
        float speed
        int[] seen
local:
    float far = 0
    int k = 0
Go:
    pre: k < 3
    eff:
        far = far + Watch.speed * Watch.speed
        k = k + 1
invariant Near: forall i: far@i < 100 or far@i * far@i * far@i > far@i
invariant Short: forall i: len(Watch.seen@i) < 9 or k@i < 4
eventually Gone: far > 100
"""

STARTS = """
allwrite:
    float level
assume: level > 0
Rise:
    pre: level < 10
    eff:
        level = level * level
invariant Low: level * level * level < 1000000
"""

CHOICES = [c for c in Choice if c is not Choice.ABC]


def asked(text: str, choice: Choice, timeout_s: float | None = None) -> tuple[Verdict, ...]:
    program = load(Source("open.krd", text)).program
    assert program is not None
    system: System = dealt(program, 2)
    return verify(system, Bounds(2, timeout_s), choice).verdicts


@pytest.mark.parametrize(
    ("text", "choice"),
    [*product([OPEN, STARTS], [c for c in CHOICES if c is not Choice.AUTO])],
    ids=lambda value: value.value if isinstance(value, Choice) else "",
)
def test_whatever_is_unknown_says_what_stands_in_the_way(text: str, choice: Choice) -> None:
    for verdict in asked(text, choice, 2.0):
        said = obstacles.lines(verdict.obstacles, verdict.claim.name)
        assert bool(said) is (verdict.outcome is Outcome.UNKNOWN), (choice, verdict)
        assert all("what would help: " in line for line in said)


def test_the_search_names_what_it_cannot_follow() -> None:
    found = {v.claim.name: v.obstacles for v in asked(STARTS, Choice.SEARCH)}
    assert [o.names for o in found["Low"] if isinstance(o, Values)] == [("level",)]
    found = {v.claim.name: v.obstacles for v in asked(OPEN, Choice.SEARCH)}
    assert [o.names for o in found["Near"] if isinstance(o, Values)] == [("Watch.speed",)]
    assert [o.names for o in found["Gone"] if isinstance(o, Values)] == [("Watch.speed",)]


def test_engines_that_know_nothing_of_whole_runs_are_told_from_those_that_do() -> None:
    found = {v.claim.name: v.obstacles for v in asked(OPEN, Choice.INDUCTION)}
    assert found["Gone"] == (WholeRuns(),)


@pytest.mark.parametrize("choice", CHOICES)
def test_when_time_is_up_more_of_it_would_help(choice: Choice) -> None:
    left = [v for v in asked(STARTS, choice, 0.0) if v.outcome is Outcome.UNKNOWN]
    assert "Low" in {verdict.claim.name for verdict in left}
    for verdict in left:
        assert any("--timeout" in line for line in obstacles.lines(verdict.obstacles, "Low"))
