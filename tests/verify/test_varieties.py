"""Different ways to break a claim are different in what is run: not later, nor by other robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from itertools import permutations
from pathlib import Path
from random import Random

import pytest

from koord.refinement.generating.profiles import FINITE, SYMMETRIC, Profile
from koord.refinement.generating.programs import system
from koord.semantics.configurations import System, dealt
from koord.semantics.traces.recording import Recording
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.verify.portfolio import Choice, verify
from koord.verify.varieties import is_variant
from koord.verify.verdicts import Bounds

#: Of these the same way was shown again, with robots that wait for each other.
STAGGERED = (
    "leader_elect_early",
    "waypoints_early",
    pytest.param("mapping_race", marks=pytest.mark.slow),
    pytest.param("sats2_out_of_turn", marks=pytest.mark.slow),
)
BROKEN = sorted(Path("specs/examples/broken").glob("*.krd"))


def of_file(path: Path) -> System:
    program = load(Source(path.name, path.read_text(encoding="utf-8"))).program
    assert program is not None
    return dealt(program, 2, Fraction(1, 10))


def events_of(recording: Recording, robot: int) -> list[int]:
    events = [round_.events[robot] for round_ in recording.rounds]
    return [event for event in events if event is not None]


def is_subsequence(few: Sequence[int], many: Sequence[int]) -> bool:
    return not few or (
        bool(many) and is_subsequence(few[1:] if few[0] == many[0] else few, many[1:])
    )


Events = Sequence[Sequence[int]]


def needs_no_more(kinds: Sequence[int], one: Events, other: Events) -> bool:
    """Whether all that happens in one run happens in another, for some way to name the robots."""
    return any(
        all(
            kinds[i] == kinds[names[i]] and is_subsequence(one[i], other[names[i]])
            for i in range(len(kinds))
        )
        for names in permutations(range(len(kinds)))
    )


def test_runs_are_variants_if_some_naming_of_the_robots_makes_them_so() -> None:
    count = Counter[bool]()
    for seed in range(400):
        random = Random(seed)
        kinds = [random.randrange(2) for _ in range(random.randint(1, 4))]
        one, other = (
            [random.choices(range(3), k=random.randint(0, most)) for _ in kinds] for most in (3, 2)
        )
        said = is_variant(kinds, dict(enumerate(one)), dict(enumerate(other)))
        assert said is needs_no_more(kinds, other, one), seed
        count[said] += 1
    assert min(count.values()) > 80, count


def ways(of: System, rounds: int = 5, most: int = 4) -> int:
    """How many further ways there are; each is another one than all the rest."""
    found = 0
    for verdict in verify(of, Bounds(rounds, 30.0, violations=most), Choice.BMC).verdicts:
        if verdict.counterexample is None:
            continue
        assert verdict.ways is not None
        assert "failed" not in verdict.ways.reason
        runs = [c.recording for c in (verdict.counterexample, *verdict.others)]
        for one, other in permutations(runs, 2):
            events = [[events_of(run, i) for i in range(of.robots)] for run in (one, other)]
            assert not needs_no_more(of.kinds, *events), verdict.claim.name
        found += len(verdict.others)
    return found


@pytest.mark.parametrize("name", STAGGERED)
def test_robots_that_wait_for_each_other_make_no_other_way(name: str) -> None:
    ways(of_file(Path("specs/examples/broken") / f"{name}.krd"))


@pytest.mark.slow
@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_ways_of_examples_differ(path: Path) -> None:
    ways(of_file(path), rounds=8)


@pytest.mark.parametrize(
    ("profile", "seeds", "least"),
    [
        (FINITE, (2, 17, 22), 1),
        pytest.param(FINITE, range(1_000, 1_100), 5, marks=pytest.mark.slow),
        pytest.param(SYMMETRIC, range(1_000, 1_050), 0, marks=pytest.mark.slow),
    ],
)
def test_ways_of_generated_programs_differ(
    profile: Profile, seeds: Sequence[int], least: int
) -> None:
    found = sum(ways(system(Random(seed), profile), rounds=3) for seed in seeds)
    assert found >= least
