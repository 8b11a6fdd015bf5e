"""Claims as methods: they say what the reference says, and with slack no more."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from random import Random
from typing import Any

import pytest

from koord.refinement.translation import Translation
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.naming import PythonNames
from koord.runtime.compile.watching import WatchedKind, watched
from koord.runtime.engine import AtRandom, RoundEngine
from koord.runtime.robot import Host, Robot
from koord.runtime.watch import Watch
from koord.semantics.domain import DOUBLES
from koord.semantics.properties import holds_in
from koord.semantics.recordings import RecordedInputs
from koord.syntax import core
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt

HEAD = """\
using Motion:
    sensors:
        float psn
    actuators:
        float target

allread:
    float[] told = 0.0

local:
    int count = 0
    float far = 1.0

def fun near(float a, float b) -> bool:
    bool close = abs(a - b) <= 1.0
    if a > 90.0: return false
    return close

def fun all_small(float[] values) -> bool:
    for v in values:
        if v > 3.0:
            return false
    return true

Step:
    pre: count < 6
    eff:
        count = count + 1
        told[pid] = told[pid] + Motion.psn
        far = far * 1.5
"""

CLAIMS = {
    "All": "forall i: told[i] <= 4.0",
    "Pairs": "forall i, j: i != j implies told[i] <= told[j] + 2.0",
    "Own": "far <= 5.0 or count == 6",
    "Called": "forall i: near(told[i], 1.0)",
    "Loop": "all_small(told)",
    "Same": "forall i, j: told[i] == told[j]",
    "Some": "exists i: told[i] >= 1.0 or count@i == 0",
    "Ran": "forall i: ran(Step)@i implies count@i > 2",
    "Index": "told[count@0] >= 0.0",
    "Negated": "forall i: not told[i] > 3.5",
}


class Noise:
    """A host whose sensors read anything between -1 and 1."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)

    def start(self, robot: int | None, name: str) -> Any:
        return 0.0

    def read(self, robot: Robot) -> dict[str, Any]:
        return {"Motion_psn": self.rng.uniform(-1, 2)}

    def ask(self, *question: Any) -> Any:
        raise AssertionError(question)

    def choose(self, *question: Any) -> Any:
        raise AssertionError(question)


def program(claims: Sequence[str]) -> core.Program:
    text = HEAD + "\n" + "".join(f"invariant {name}: {CLAIMS[name]}\n" for name in claims)
    found = load(Source("claims.krd", text))
    assert found.program is not None, found.diagnostics
    return found.program


def looks(of: core.Program, seed: int, slack: str) -> list[tuple[bool, bool, str]]:
    """Of each claim after each round: whether the watch finds that it holds, and the reference."""
    system: System = dealt(of, 3)
    host: Host = Noise(seed)
    fleet = RoundEngine(loaded(compiled(of)), system.kinds, 0.1, host)
    claims = watched(of, Fraction(slack))
    (made,) = loaded(claims.text)
    assert issubclass(made, Watch)
    watch = made(system.kinds, 0.1, host)
    observer = Translation(system, PythonNames(of))
    schedule = AtRandom(Random(seed))
    fleet.begin()
    found = []
    for _ in range(8):
        fleet.program_turns(schedule)
        fleet.environment_turn()
        watch.look(fleet.robots, fleet.store.values)
        configuration = observer.configuration(fleet)
        for claim in claims.claims:
            assert claim.sort is WatchedKind.INVARIANT
            robots = [range(3)] * len(claim.agents)
            seen = all(watch.holds(claim.method, *several) for several in _tuples(robots))
            stated = next(p for p in of.properties if p.name == claim.name)
            holds, _ = holds_in(
                DOUBLES, system, configuration, stated.condition, stated.bound, RecordedInputs()
            )
            found.append((seen, holds is True, claim.name))
    return found


def _tuples(ranges: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    found: list[tuple[int, ...]] = [()]
    for one in ranges:
        found = [(*before, robot) for before in found for robot in one]
    return found


@pytest.mark.parametrize("seed", range(5))
def test_what_is_watched_is_what_the_reference_says(seed: int) -> None:
    found = looks(program(list(CLAIMS)), seed, "0")
    for seen, holds, name in found:
        assert seen == holds, name
    assert len({holds for _, holds, _ in found}) == 2


def test_with_slack_a_claim_says_no_more() -> None:
    of, gained = program(list(CLAIMS)), set()
    for seed in range(6):
        for seen, holds, name in looks(of, seed, "1/4"):
            assert seen or not holds, name
            if seen and not holds:
                gained.add(name)
    assert {"All", "Pairs", "Called", "Loop"} <= gained
    assert not gained & {"Ran"}


@pytest.mark.parametrize(
    ("claim", "value", "holds"),
    [
        ("told[0] <= 1.0", 1.2, True),
        ("told[0] <= 1.0", 1.3, False),
        ("not told[0] > 1.0", 1.2, True),
        ("told[0] > 1.0 implies false", 1.2, True),
        ("told[0] > 1.0 implies false", 1.3, False),
        ("told[0] == 1.0", 0.8, True),
        ("told[0] == 1.0 implies false", 1.1, True),
        ("told[0] == 1.0 implies false", 1.0, False),
        ("told[0] != 1.0", 1.0, False),
        ("not told[0] != 1.0", 1.2, True),
        ("near(told[0], 0.0)", 1.2, True),
        ("near(told[0], 0.0) implies false", 0.8, True),
        ("near(told[0], 0.0) implies false", 0.7, False),
        ("near(told[0], 90.2)", 90.2, True),
        ("all_small(told)", 3.2, True),
        ("all_small(told)", 3.3, False),
    ],
)
def test_comparisons_are_loosened_by_what_they_count_for(
    claim: str, value: float, holds: bool
) -> None:
    found = load(Source("claims.krd", f"{HEAD}\ninvariant Claim: {claim}\n")).program
    assert found is not None
    claims = watched(found, Fraction(1, 4))
    (made,) = loaded(claims.text)
    assert issubclass(made, Watch)
    watch = made((0,), 0.1, Noise(0))
    watch.look((), {"told": (value,)})
    assert watch.holds(claims.claims[0].method) is holds
