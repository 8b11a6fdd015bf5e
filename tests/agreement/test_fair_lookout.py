"""Violations of whole runs that are told before the graph is whole, against those of all of it.
[T-FAIR-CYCLE]
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.syntax.system import System
from koord.verify.engines.explicit import fair_compiled, fair_lookout, fair_search
from koord.verify.engines.explicit.compiled import is_installed
from koord.verify.engines.explicit.fair_answers import FairCycleReport
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from tests.agreement.test_lassos import LIVELY, assert_lassos, with_liveness
from tests.sampling import first
from tests.verify.asking import of_text

#: Who is at work may wait for ever, soon; how much was done makes many configurations.
SLOW = """\
local:
    int at = 0
    int done = 0

Begin:
    pre: at == 0
    eff: at = 1

Work:
    pre: at == 1 and done < 20
    eff: done = done + 1

Wait:
    pre: at == 1
    eff: at = 1

End:
    pre: at == 1
    eff: at = 0

eventually Ends: at == 1 leadsto at == 0
"""

#: Four places are a cycle, each next to the start; behind one of them is a place to stay.
FAR = """\
local:
    int at = 0

First:
    pre: at == 0
    eff: at = 1

Second:
    pre: at == 0
    eff: at = 2

Third:
    pre: at == 0
    eff: at = 3

Fourth:
    pre: at == 0
    eff: at = 4

Round:
    pre: 1 <= at and at <= 4
    eff: at = at % 4 + 1

Leave:
    pre: at == 1
    eff: at = 5

Stay:
    pre: at == 5
    eff: at = 5

eventually Never: at@0 == 6
"""

#: Two places are a cycle, next to the start; in a third one it stays.
NEAR = FAR.replace("at <= 4", "at <= 2").replace("% 4", "% 2").replace("at == 5", "at == 4")
NEAR = NEAR.replace("at = 5", "at = 4")

NEEDS_MACHINE_CODE = pytest.mark.skipif(
    not is_installed(), reason="there is nothing to make machine code with"
)

#: By Python, and by machine code.
BOTH = (False, pytest.param(True, marks=NEEDS_MACHINE_CODE))

HOLDS = "eventually Begins: at == 0 leadsto at == 1\n"


def rounds(found: FairCycleReport) -> dict[str, int]:
    return {name: len(recording.rounds) for name, recording in found.violated.items()}


def compare(of: System, seed: object, compiled_from: int | None) -> str:
    """Compare what is said early, of all claims and of each, with what all of the graph says."""
    limits = Limits(states=300)
    asked = of.program.properties
    whole = lively(of, asked, limits, compiled_from=None, look_from=None)
    if not isinstance(whole.end, Exhausted):
        return "too large, or not finite"
    early = False
    for some in (asked, *((each,) for each in asked)):
        found = lively(of, some, limits, compiled_from=compiled_from, look_from=1)
        assert_lassos(of, found, seed)
        names = {each.name for each in some}
        assert set(found.violated) == set(whole.violated) & names, seed
        assert found.needs == {n: why for n, why in whole.needs.items() if n in names}, seed
        assert found.is_empty is whole.is_empty, seed
        if isinstance(found.end, OutOfBounds):
            early = True
            assert set(found.violated) == names, seed
            assert found.end.states <= whole.end.states, seed
    return "early" if early else "violated" if whole.violated else "holds"


def live(seed: int) -> System:
    random = Random(seed)
    return with_liveness(system(random, LIVELY), random)


@pytest.mark.slow
@pytest.mark.parametrize("start", first(1, [0, 1_000]))
def test_what_is_told_early_is_so(start: int) -> None:
    seeds = range(start, start + 30)
    count = Counter(compare(live(seed), seed, None) for seed in seeds)
    assert count["early"] > 3, count
    assert count["holds"] > 3, count


@pytest.mark.slow
def test_what_is_told_early_is_so_of_many() -> None:
    count = Counter(compare(live(seed), seed, None) for seed in range(5_000, 5_400))
    assert count["early"] > 20, count


@pytest.mark.slow
@NEEDS_MACHINE_CODE
def test_what_machine_code_tells_early_is_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fair_compiled, "_FIRST_BATCH", 1)
    monkeypatch.setattr(fair_compiled, "_MOST_BATCH", 1)
    monkeypatch.setattr(fair_search, "COMPILED_FACTOR", 1)
    count = Counter(compare(live(seed), seed, 0) for seed in range(8_000, 8_100))
    assert count["early"] > 5, count


@pytest.mark.parametrize("machine_code", BOTH)
def test_a_violation_is_told_in_part_of_the_graph(machine_code: bool) -> None:
    of = of_text(SLOW, 2)
    whole = lively(of, of.program.properties, compiled_from=None, look_from=None)
    assert isinstance(whole.end, Exhausted)
    start = 0 if machine_code else None
    found = lively(of, of.program.properties, compiled_from=start, look_from=4)
    assert found.is_compiled is machine_code
    assert isinstance(found.end, OutOfBounds)
    assert found.end.states < whole.end.states
    assert found.end.reason == "every claim is violated"
    assert rounds(found) == rounds(whole)
    assert_lassos(of, found, "early")


@pytest.mark.parametrize("machine_code", BOTH)
def test_what_holds_beside_needs_all_of_the_graph(machine_code: bool) -> None:
    of = of_text(SLOW + HOLDS, 2)
    start = 0 if machine_code else None
    found = lively(of, of.program.properties, compiled_from=start, look_from=1)
    assert isinstance(found.end, Exhausted)
    assert found.violated.keys() == {"Ends"}
    assert found.needs.keys() == {"Begins"}


def test_a_shorter_lasso_is_waited_for() -> None:
    """The start and the four places next to it have a lasso of five rounds, but three will do."""
    of = of_text(FAR, 1)
    for look_from in (None, 1, 5, 6):
        found = lively(of, of.program.properties, compiled_from=None, look_from=look_from)
        assert rounds(found) == {"Never": 3}, look_from


def test_a_shorter_lasso_of_the_same_distance_is_waited_for() -> None:
    """The start and two of the places next to it have a lasso of three rounds; two will do."""
    of = of_text(NEAR, 1)
    for look_from in (None, 1, 3, 4):
        found = lively(of, of.program.properties, compiled_from=None, look_from=look_from)
        assert rounds(found) == {"Never": 2}, look_from


@pytest.mark.slow
def test_lassos_that_are_told_early_are_as_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the graph may grow, no lasso is longer than the shortest of all of it."""
    monkeypatch.setattr(fair_lookout, "_MOST_GROWTH", 1_000)
    count: Counter[bool] = Counter()
    for seed in range(200, 230):
        of = live(seed)
        for each in of.program.properties:
            whole = lively(of, (each,), Limits(states=300), look_from=None)
            if whole.violated and isinstance(whole.end, Exhausted):
                found = lively(of, (each,), Limits(states=300), look_from=1)
                assert rounds(found) == rounds(whole), seed
                count[isinstance(found.end, OutOfBounds)] += 1
    assert count[True] > 3, count
