"""The search against the plain one, and with its reductions against without. [T-ONE-WINNER]
[T-PREFIX] [T-COMMIT] [T-FAULT]

The plain search takes every order of robots, one turn at a time, by the sequential rules.
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from msgspec.structs import replace

from koord.refinement.generating.palette import Profile
from koord.refinement.generating.programs import system
from koord.semantics.domain import EXACT
from koord.semantics.properties import holds_in
from koord.semantics.recordings import RecordedInputs, execute
from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.system import System
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import OUT_OF_TIME, Limits
from koord.verify.engines.explicit.property_checks import (
    Exhausted,
    GoalKind,
    OutOfBounds,
    SearchReport,
    Violated,
)
from koord.verify.engines.explicit.search import Search, begun, survey
from tests.generators.profiles import FINITE, SYMMETRIC
from tests.generators.staged import staged
from tests.sampling import blocks
from tests.semantics.plain_search import PlainSearch, TooMuchError

ROUNDS = 3

#: Turns that the plain search may take on one system.
STEPS = 2_500

EVERYTHING = frozenset(GoalKind)

Said = dict[tuple[str, str], int]


def said(found: SearchReport) -> Said:
    """The rounds of a shortest violation of each claim."""
    return {(v.claim.subject.value, v.claim.name): v.rounds for v in found.violated}


def searched(
    of: System, *, symmetry: bool = True, order_reduction: bool = True, states: int = 2_000
) -> SearchReport | None:
    """What the search finds, or None if the system is too large or not finite."""
    found = survey(
        of,
        of.program.properties,
        Limits(states=states, rounds=ROUNDS),
        subjects=EVERYTHING,
        symmetry=symmetry,
        order_reduction=order_reduction,
    )
    if isinstance(found.end, NotFinite):
        return None
    if isinstance(found.end, OutOfBounds) and "rounds" not in found.end.reason:
        return None
    return found


# --- against the plain search ---------------------------------------------------------------------


def compare_with_plain(seed: int, of: System) -> str:
    found = searched(of, symmetry=False, states=300)
    if found is None:
        return "too large, or not finite"
    try:
        plain = PlainSearch(of, of.program.properties, limit=STEPS).run(ROUNDS)
    except TooMuchError:
        return "too large"
    without = {key: n for key, n in said(found).items() if key[0] != GoalKind.LOST_UPDATE.value}
    assert without == plain.violated, seed
    assert not isinstance(found.end, NotFinite)
    assert found.end.states == plain.states, seed
    assert isinstance(found.end, Exhausted) is plain.is_exhausted, seed
    return "violated" if without else "holds"


@pytest.mark.parametrize("seeds", blocks(12, of=60, count=6))
def test_as_the_plain_search(seeds: range) -> None:
    """Verdicts, shortest runs, and how many states there are."""
    count = Counter(compare_with_plain(seed, system(Random(seed), FINITE)) for seed in seeds)
    assert count["violated"] >= len(seeds) // 2
    assert count["holds"] >= len(seeds) // 12


@pytest.mark.parametrize("seeds", blocks(8, of=40, count=3))
def test_as_the_plain_search_late(seeds: range) -> None:
    """The same of programs in which something happens in each round."""
    count = Counter(compare_with_plain(seed, staged(Random(seed))) for seed in seeds)
    assert count["violated"] >= len(seeds) // 5
    assert count["holds"] >= len(seeds) // 20


def test_as_the_plain_search_where_what_is_unset_is_read() -> None:
    """The turn goes on to its end: it copies an unset queue, and asks how long the copy is."""
    assert compare_with_plain(11_054, system(Random(11_054), FINITE)) == "violated"


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4))
def test_as_the_plain_search_on_many(block: int) -> None:
    seeds = range(10_000 + block * 500, 10_500 + block * 500)
    count = Counter(compare_with_plain(seed, system(Random(seed), FINITE)) for seed in seeds)
    assert count["violated"] + count["holds"] > 250


# --- with reductions and without ------------------------------------------------------------------


def shows(of: System, violated: Violated) -> bool:
    """Whether a recording replays, and ends in what it is to show."""
    last = list(execute(EXACT, of, violated.recording))[-1]
    claim, configuration = violated.claim, last.configuration
    match claim.subject:
        case GoalKind.FAULT:
            return configuration.fault is not None
        case GoalKind.CONTRACT:
            return any(contract.name == claim.name for _, contract in last.stepped.promises)
        case GoalKind.LOST_UPDATE:
            return configuration.fault is None
        case GoalKind.PROPERTY:
            p = next(p for p in of.program.properties if p.name == claim.name)
            inputs = RecordedInputs()
            holds, _ = holds_in(EXACT, of, configuration, p.condition, p.bound, inputs)
            return configuration.fault is None and holds is not True


def compare_reductions(seed: int, of: System) -> str:
    plain = searched(of, symmetry=False, order_reduction=False, states=1_000)
    if plain is None:
        return "too large, or not finite"
    settings = ((True, True), (True, False), (False, True))
    for symmetry, order_reduction in settings:
        found = searched(of, symmetry=symmetry, order_reduction=order_reduction)
        assert found is not None, seed
        assert said(found) == said(plain), (seed, symmetry, order_reduction)
        assert all(shows(of, v) for v in found.violated), (seed, symmetry, order_reduction)
    is_symmetric = isinstance(symmetry_of(of, of.program.properties), Symmetry)
    return "symmetric" if is_symmetric else "as it is"


@pytest.mark.parametrize("seeds", blocks(10, of=60, count=4, start=1_000))
def test_reductions_change_no_verdict(seeds: range) -> None:
    count = Counter(compare_reductions(seed, system(Random(seed), FINITE)) for seed in seeds)
    assert count["symmetric"] >= len(seeds) // 6
    assert count["as it is"] >= len(seeds) // 3


@pytest.mark.parametrize("seeds", blocks(8, of=40, count=3))
def test_reductions_change_no_verdict_late(seeds: range) -> None:
    """The same of programs in which something happens in each round."""
    count = Counter(compare_reductions(seed, staged(Random(seed))) for seed in seeds)
    assert count["symmetric"] >= len(seeds) // 10
    assert count["as it is"] >= len(seeds) // 5


@pytest.mark.parametrize("seeds", blocks(10, of=60, count=4))
def test_symmetry_changes_no_verdict(seeds: range) -> None:
    count = Counter(compare_reductions(seed, system(Random(seed), SYMMETRIC)) for seed in seeds)
    assert count["symmetric"] >= 7 * len(seeds) // 12


@pytest.mark.slow
@pytest.mark.parametrize("profile", [FINITE, SYMMETRIC], ids=["finite", "symmetric"])
@pytest.mark.parametrize("block", range(4))
def test_reductions_change_no_verdict_on_many(profile: Profile, block: int) -> None:
    for seed in range(20_000 + block * 500, 20_500 + block * 500):
        compare_reductions(seed, system(Random(seed), profile))


# --- resumed --------------------------------------------------------------------------------------


def resumed(of: System, random: Random) -> tuple[Search, list[Violated], int]:
    """A search that goes on and on where limits ended it, what it finds, and how often it went on.

    It is cut off anywhere, but further and further on: who looks at a configuration again needs as
    much as that takes.
    """
    limits = Limits(states=random.randint(0, 5), rounds=ROUNDS)
    search = begun(of, of.program.properties, limits, subjects=EVERYTHING)
    assert isinstance(search, Search)
    found: list[Violated] = []
    times, steps = 0, 1
    while True:
        # Nobody is asked for more within the first hundred steps.
        search._budget._left = steps % 100
        search.resume(of.budget.rationed(steps // 100 * 100), limits)
        found += search.violations()
        end = search.end
        if not isinstance(end, OutOfBounds) or "rounds" in end.reason or end.states > 2_000:
            return search, found, times
        if end.reason == OUT_OF_TIME:
            steps += random.randint(0, 20)
        else:
            limits = replace(limits, states=limits.states + random.randint(1, 50))
        times += 1


def compare_resumed(seed: int, of: System) -> str:
    whole = searched(of)
    if whole is None:
        return "too large, or not finite"
    search, found, times = resumed(of, Random(seed))
    assert said(SearchReport(tuple(found), search.end)) == said(whole), seed
    assert search.end == whole.end, seed
    assert len({v.claim for v in found}) == len(found), seed
    for violated in found:
        assert shows(of, violated), (seed, violated)
    return "resumed" if times > 3 else "hardly resumed"


@pytest.mark.parametrize("seeds", blocks(10, of=60, count=4, start=2_000))
def test_who_goes_on_where_limits_ended_it_says_the_same(seeds: range) -> None:
    outcomes = Counter(compare_resumed(seed, system(Random(seed), FINITE)) for seed in seeds)
    outcomes += Counter(compare_resumed(seed, system(Random(seed), SYMMETRIC)) for seed in seeds)
    assert outcomes["resumed"] > len(seeds) // 2, outcomes
