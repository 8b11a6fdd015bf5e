"""Every engine against the explicit search, on generated finite programs.

They share the semantics' turns. All else is different: the search lists states, bounded model
checking and induction have words of Z3 for whole rounds, bits have a circuit, a SAT solver and IC3,
and the engine for every number of robots looks at one robot of a crowd.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from random import Random

import pytest

from koord.api.verdicts import trace_of
from koord.refinement.compiled_replay import rerun
from koord.refinement.generating.programs import system
from koord.refinement.running import ready
from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System
from koord.traces.codec import decode, encode
from koord.traces.replay import replay
from koord.traces.trace import Numbers, traced
from koord.verify.claims import Claim, ClaimKind, claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import SPARING
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind, Violated
from koord.verify.engines.explicit.search import survey
from koord.verify.verdicts import Counterexample, Outcome, Verdict
from tests.generators.large import large
from tests.generators.profiles import FINITE, SYMMETRIC
from tests.generators.staged import staged
from tests.sampling import first, sampled
from tests.semantics.driving import NO_TEXT
from tests.verify.asking import ask, bounded, inductive, name_of, of_text
from tests.verify.engines.bits.asking import on_bits


@dataclass(frozen=True)
class Family:
    """Generated programs of one sort, and how many rounds of them are looked at."""

    make: Callable[[Random], System]
    rounds: int


FAMILIES = {
    "finite": Family(partial(system, profile=FINITE), 2),
    "symmetric": Family(partial(system, profile=SYMMETRIC), 2),
    "staged": Family(staged, 5),
    "large": Family(large, 3),
}


@dataclass(frozen=True)
class Searched:
    """What the search saw of a system: the first round in which each claim breaks."""

    seed: int
    system: System
    violated: tuple[Violated, ...]
    first: dict[str, int]
    depth: int | None  #: through which round it saw everything; None: not even the start
    every: bool  #: whether that is all there is


def searched(seed: int, of: System) -> Searched | None:
    """None if it is not finite."""
    limits = Limits(states=1_000, rounds=12)
    found = survey(of, of.program.properties, limits, subjects=frozenset(GoalKind))
    if isinstance(found.end, NotFinite):
        return None
    first = {name_of(v.claim): v.rounds for v in found.violated}
    assert set(first) <= {claim.name for claim in claims_of(of)}, seed
    return Searched(
        seed, of, found.violated, first, found.end.depth, isinstance(found.end, Exhausted)
    )


# --- each engine ----------------------------------------------------------------------------------


def compiled_agrees(case: Searched) -> Counter[str]:
    """The compiled program does the same in every run that breaks something."""
    made = ready(case.system.program)
    for violated in case.violated:
        run = traced(NO_TEXT, case.system, Numbers.EXACT, violated.recording)
        assert rerun(run, made) is None, (case.seed, violated.claim)
    return Counter({"compiled: counterexamples": len(case.violated)})


def bmc_agrees(case: Searched, rounds: int) -> Counter[str]:
    """It finds exactly what is there, each claim in the first round that breaks it."""
    if not case.every:
        if case.depth is None:
            return Counter(["search: too many ways to start"])
        rounds = min(rounds, case.depth)
    try:
        checked = bounded(case.system, rounds=rounds)
    except NotFiniteError:
        return Counter(["bmc: a loop without a bound"])
    assert checked.bounded.reason == "", case.seed
    assert not checked.bounded.unreplayed, case.seed
    claims = {claim.name: claim for claim in claims_of(case.system)}
    for name, found in checked.violated.items():
        assert_is_read(case, claims[name], found)
    assert checked.rounds == {name: n for name, n in case.first.items() if n <= rounds}, case.seed
    return Counter(["bmc"])


def bits_agree(case: Searched, rounds: int) -> Counter[str]:
    """What bits say is so; what they leave open is counted."""
    ledger = on_bits(case.system, rounds)
    count = Counter(["bits"])
    for claim in ledger.claims:
        verdict = ledger.verdict(claim)
        assert_so(case, verdict)
        count[f"bits: {verdict.outcome.value}"] += 1
        proved = verdict.outcome is Outcome.HOLDS and verdict.rounds is None
        count["bits: proved"] += proved and verdict.engine is Engine.BITS
        count["bits: proved, and all runs seen"] += proved and case.every
    return count


def induction_agrees(case: Searched, depths: Iterable[int]) -> Counter[str]:
    """What it proves breaks nowhere."""
    count = Counter(["induction"])
    for depth in depths:
        try:
            proved, _ = inductive(case.system, depth=depth)
        except NotFiniteError:
            return Counter(["induction: a loop without a bound"])
        assert not proved & set(case.first), (case.seed, depth)
        count["induction: proved"] += len(proved)
        count["induction: proved, and all runs seen"] += len(proved) if case.every else 0
    return count


def every_n_agrees(case: Searched) -> Counter[str]:
    """What is proved for every number of robots breaks for none."""
    claims = claims_of(case.system)
    effort = Effort.of_seconds(SPARING.seconds)
    proved = {c.name for c in prove(case.system, claims, Deadline(), effort, SPARING).proved}
    assert not proved & set(case.first), case.seed
    return Counter({"every N": 1, "every N: proved": len(proved)})


def spacer_agrees(case: Searched, rounds: int) -> Counter[str]:
    """What Spacer says is so; what breaks in the rounds that were seen it finds, or gives up."""
    count = Counter(["spacer"])
    for verdict in ask(case.system, rounds=rounds, choice=Engine.SPACER):
        if verdict.claim.kind is ClaimKind.LIVENESS:
            continue
        assert_so(case, verdict)
        count[f"spacer: {verdict.outcome.value}"] += 1
    return count


def portfolio_agrees(case: Searched, rounds: int) -> Counter[str]:
    """So does what is said at last, and nothing that breaks in these rounds is left open."""
    count = Counter(["portfolio"])
    for verdict in ask(case.system, rounds=rounds):
        if verdict.claim.kind is ClaimKind.LIVENESS:
            continue
        assert_so(case, verdict)
        count[f"portfolio: {verdict.outcome.value}"] += 1
        if case.first.get(verdict.claim.name, rounds + 1) <= rounds:
            assert verdict.outcome is Outcome.VIOLATED, (case.seed, verdict)
    return count


def assert_so(case: Searched, verdict: Verdict) -> None:
    """What a verdict says is what the search saw, as far as it looked."""
    breaks, where = case.first.get(verdict.claim.name), (case.seed, verdict)
    if verdict.outcome is Outcome.VIOLATED:
        assert verdict.counterexample is not None
        assert_is_read(case, verdict.claim, verdict.counterexample)
        if case.every or (case.depth is not None and verdict.counterexample.round <= case.depth):
            assert breaks == verdict.counterexample.round, where
    elif verdict.outcome is Outcome.HOLDS and verdict.rounds is None:
        assert breaks is None, where
    else:
        assert breaks is None or verdict.rounds is None or breaks > verdict.rounds, where


def assert_is_read(case: Searched, claim: Claim, found: Counterexample) -> None:
    """What is kept of a counterexample is legal when it is read, and breaks that. [REPLAY]"""
    kept = encode(trace_of(NO_TEXT, case.system, claim, found))
    read = decode(kept, "kept.json", lambda sources: case.system.program)
    assert replay(read).refused is None, (case.seed, claim)
    ends = read.violation is not None, read.configurations[-1].fault is not None
    assert ends == (claim.kind is not ClaimKind.FAULT, claim.kind is ClaimKind.FAULT), case.seed


# --- all of them ----------------------------------------------------------------------------------


def compare(family: Family, seed: int) -> Counter[str]:
    """What came of one program. Cheap engines are asked about each, dear ones about some."""
    of = family.make(Random(seed))
    case = searched(seed, of)
    if case is None:
        return Counter(["not finite"])
    count = Counter(["systems"])
    count["violated"] += bool(case.first)
    count["violated late"] += any(n > 2 for n in case.first.values())
    count["exhausted"] += case.every
    count += compiled_agrees(case)
    count += bmc_agrees(case, family.rounds)
    count += bits_agree(case, family.rounds)
    if seed % 2 == 0:
        count += induction_agrees(case, (1, 2, 3) if seed % 20 == 0 else (1,))
    if seed % 20 == 1:
        count += every_n_agrees(case)
    if seed % 10 == 3:
        count += spacer_agrees(case, family.rounds)
    if seed % 25 == 2:
        count += portfolio_agrees(case, family.rounds)
    return count


def many(family: Family, seeds: range) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in seeds:
        count += compare(family, seed)
    print(dict(count))  # shown with -s, and where an assertion fails
    return count


#: 1,150 programs, of which more than 1,000 are finite, as the counts below ensure; 18 of them
#: are looked at by default.
SOME = [
    *sampled(
        ("finite", range(7_006, 7_012)),
        (("finite", range(7_000 + 50 * n, 7_050 + 50 * n)) for n in range(6)),
    ),
    *sampled(
        ("symmetric", range(3_000, 3_006)),
        (("symmetric", range(3_000 + 50 * n, 3_050 + 50 * n)) for n in range(4)),
    ),
    *sampled(("staged", range(6)), (("staged", range(50 * n, 50 * n + 50)) for n in range(13))),
]


@pytest.mark.parametrize(("name", "seeds"), first(1, SOME))
def test_all_engines_agree_with_the_search(name: str, seeds: range) -> None:
    count, programs = many(FAMILIES[name], seeds), len(seeds)
    assert count["systems"] >= 0.88 * programs, count
    assert count["bmc"] >= 0.8 * programs, count
    assert count["violated"] >= 0.3 * programs, count
    assert count["compiled: counterexamples"] >= count["violated"], count
    others = count.total() - count["compiled: counterexamples"]
    assert count["bits: unknown"] <= others // 40, count
    assert count["bits: proved, and all runs seen"] >= 0.3 * programs, count
    assert count["induction: proved, and all runs seen"] >= programs // 10, count
    assert name != "staged" or count["violated late"] >= programs // 10, count


def test_choices_lead_back_to_none_that_they_are_of() -> None:
    """The graph finds a choice to be a number that others are chosen from: comparing it ends."""
    assert compare(FAMILIES["finite"], 51_784)["systems"] == 1


def test_what_no_round_with_it_can_end_is_looked_at() -> None:
    """An event breaks a promise about an actuator, which nothing mends: invariants see it."""
    assert compare(FAMILIES["symmetric"], 51_791)["violated"] == 1


def test_a_start_that_was_not_looked_at_whole_is_no_round() -> None:
    assert compare(FAMILIES["symmetric"], 50_136)["search: too many ways to start"] == 1


@pytest.mark.parametrize("seeds", sampled(range(26, 30), [range(20, 40), range(40, 60)]))
def test_all_engines_agree_with_the_search_where_numbers_are_large(seeds: range) -> None:
    count = many(FAMILIES["large"], seeds)
    assert count["systems"] >= 0.85 * len(seeds), count
    assert count["violated"] >= 0.4 * len(seeds), count


#: What is read is any member of an enumeration, what is chosen any number between two.
RANGES = """
enum Mode: {members}
param int low = {low}
param int high = {high}
using Dial:
  sensors:
    Mode mode
    int level = low
  environment:
    level = choose(low, high)
local:
  int n = low
  bool first = false
Look:
  eff:
    n = Dial.level
    first = Dial.mode == a
invariant Member: {one_of_them}
invariant Within: low <= n and n <= high
invariant Below: n < high
invariant Above at round: low < Dial.level
"""


@pytest.mark.parametrize(("low", "high"), [(0, 1), (0, 2), (-1, 4), (3, 5), (-6, -2)])
def test_bits_agree_at_the_ends_of_ranges(low: int, high: int) -> None:
    """Of as many values as take a number of bits, and of fewer."""
    modes = "abcdef"[: high - low + 1]
    one_of_them = " or ".join(f"Dial.mode == {mode}" for mode in modes)
    text = RANGES.format(members=", ".join(modes), low=low, high=high, one_of_them=one_of_them)
    case = searched(0, of_text(text, robots=1))
    assert case is not None
    assert case.every
    assert case.first.keys() == {"Below", "Above"}
    ledger = on_bits(case.system, 2)
    for claim in ledger.claims:
        breaks = Outcome.VIOLATED if claim.name in case.first else Outcome.HOLDS
        assert ledger.verdict(claim).outcome is breaks, claim.name
        assert_so(case, ledger.verdict(claim))


#: 10,000 more.
MANY = [
    *(("finite", range(50_000 + 100 * n, 50_100 + 100 * n)) for n in range(35)),
    *(("symmetric", range(50_000 + 100 * n, 50_100 + 100 * n)) for n in range(25)),
    *(("staged", range(50_000 + 100 * n, 50_100 + 100 * n)) for n in range(45)),
    *(("large", range(50_000 + 100 * n, 50_100 + 100 * n)) for n in range(10)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seeds"), MANY)
def test_all_engines_agree_with_the_search_on_many(name: str, seeds: range) -> None:
    count = many(FAMILIES[name], seeds)
    assert count["systems"] >= 80, count
