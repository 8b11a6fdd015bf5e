"""Different ways to break a claim are different in what is run: not later, nor by other robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from itertools import permutations
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from koord.refinement.generating.palette import Profile
from koord.refinement.generating.programs import system
from koord.semantics.recordings import Recording
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bmc import engine
from koord.verify.engines.bmc.engine import is_variant, others
from koord.verify.ledger import Ledger
from koord.verify.reduction.problems import plain_problem
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.each_claim_turn import on_slice
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Verdict
from tests.generators.profiles import FINITE, SYMMETRIC
from tests.verify.asking import of_text

#: Of these the same way was shown again, with robots that wait for each other.
STAGGERED = (
    "leader_elect_early",
    pytest.param("waypoints_early", marks=pytest.mark.slow),
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
    for verdict in verify(of, Bounds(rounds, 30.0, violations=most), Engine.BMC).verdicts:
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


#: What one claim is about makes rounds hard to solve, and says nothing of the other claim.
BESIDE = """\
using Dice:
    sensors:
        int a = 3
        int b = 2
    contract Powers:
        ensures: a' * a' * a' >= b' * b' + a * a * b
local:
    int x = 0
    int seen = 3
Up:
    pre: x < 9
    eff: x = x + 1
Jump:
    pre: x < 9
    eff: x = x + 2
Look:
    eff: seen = Dice.a
invariant Small: forall i: x@i < 5
invariant Seen: forall i: seen@i >= 3
"""


@pytest.fixture(scope="module")
def beside() -> tuple[System, Verdict]:
    system = of_text(BESIDE)
    (small,) = verify(system, Bounds(4), Engine.SEARCH, names=["Small"]).verdicts
    return system, small


def test_ways_cost_no_more_for_what_a_claim_does_not_depend_on(
    beside: tuple[System, Verdict], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "_SECONDS", 0.01)
    report = verify(beside[0], Bounds(4, violations=40), Engine.SEARCH, names=["Small"])
    (small,) = report.verdicts
    assert small.ways is not None
    assert small.ways.complete, small.ways.reason
    assert len(small.others) == 7


def test_what_a_slice_leaves_out_makes_no_other_way(beside: tuple[System, Verdict]) -> None:
    """Whoever shows a run may not know that an event is not needed."""
    system, small = beside
    assert small.counterexample is not None
    recording = small.counterexample.recording
    first, *rest = recording.rounds
    robot = first.events.index(None)
    looking = replace(
        first, events=tuple(2 if i == robot else e for i, e in enumerate(first.events))
    )
    shown = replace(small.counterexample, recording=replace(recording, rounds=(looking, *rest)))
    ledger = Ledger(plain_problem(system), Bounds(3), Deadline(), claims_of(system))
    counts = {
        len(others(*on_slice(Slices(system), ledger, small.claim), each, 40)[0])
        for each in (shown, small.counterexample)
    }
    assert len(counts) == 1
