"""One question of SMT-LIB can be satisfied exactly where a bounded search finds a violation."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
import z3

from koord.refinement.generating.palette import GENERAL
from koord.refinement.generating.programs import system
from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.export.smtlib import script
from koord.verify.reduction.abstraction import abstracted
from tests.sampling import sampled
from tests.verify.asking import bounded, of_text


def answer(of: System, rounds: int, name: str) -> z3.CheckSatResult:
    claims = [claim for claim in claims_of(of) if claim.name == name]
    solver = z3.Solver()
    solver.set("timeout", 20_000)
    solver.from_string(script(of, claims, rounds).text)
    return solver.check()


def compared(seeds: range, rounds: int) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in seeds:
        of = system(Random(seed), GENERAL)
        if abstracted(of.program) is not None or script(of, claims_of(of), rounds).limits:
            count["loose"] += 1
            continue
        found = bounded(of, rounds=rounds)
        for claim in claims_of(of):
            said = answer(of, rounds, claim.name)
            if said == z3.unknown or found.bounded.reason or claim in found.bounded.unreplayed:
                count["open"] += 1
                continue
            assert (said == z3.sat) == (claim.name in found.rounds), (seed, claim.name)
            count[str(said)] += 1
    return count


@pytest.mark.parametrize("last", sampled(12, [40]))
def test_it_says_what_bounded_search_says(last: int) -> None:
    count = compared(range(last), 2)
    assert min(count["sat"], count["unsat"]) >= last // 2, count


COUNTER = """
local:
  float x = 1.0
  int left = 2
Halve:
  pre: left > 0
  eff:
    x = x / 2.0
    left = left - 1
Fall:
  pre: left == 0
  eff: x = 1.0 / (x - x)
invariant Fine: forall i: x@i >= 0.25
invariant Large: forall i: x@i >= 0.5
"""


@pytest.mark.parametrize(
    ("name", "rounds", "expected"),
    [
        ("Fine", 6, z3.unsat),
        ("Large", 1, z3.unsat),
        ("Large", 2, z3.sat),
        ("Large", 6, z3.sat),
        ("no fault", 2, z3.unsat),
        # Nothing follows a fault: what is required of later rounds must not hide it.
        ("no fault", 3, z3.sat),
        ("no fault", 6, z3.sat),
    ],
)
def test_it_asks_of_every_round_up_to_the_bound(
    name: str, rounds: int, expected: z3.CheckSatResult
) -> None:
    assert answer(of_text(COUNTER, 1), rounds, name) == expected
