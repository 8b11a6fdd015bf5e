"""The programs of specs/examples with mistakes in them: what breaks is reported as violated.

That something breaks is confirmed first, by the search where an instance is finite, and by random
runs of the reference elsewhere. Neither knows the engines that work with formulas and bits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from koord.sampling.monitors import Monitor
from koord.sampling.policies import AtRandom, Play
from koord.sampling.running import new_run
from koord.syntax import core
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System, dealt
from koord.traces.trace import Numbers, ViolationKind
from koord.verify.claims import claims_of
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import GoalKind
from koord.verify.engines.explicit.search import survey
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report
from tests.generators.mutating import Mutant, mutants
from tests.loading import example_program
from tests.sampling import sampled
from tests.verify.asking import name_of

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: So far a search and runs look.
ROUNDS = 8

#: Random runs of a program that is not finite.
RUNS = 10

#: So often a search or a run may be asked whether to go on: no clock decides what is confirmed.
PATIENCE = 4_000


@dataclass(frozen=True)
class Example:
    """A small instance of a program, and of how many of its mutants a violation is confirmed."""

    name: str
    robots: int
    delta_s: Fraction
    broken: int
    step: int  #: each so many-th mutant is tried in every run of the tests; 0: none

    def program(self) -> core.Program:
        return example_program(self.name)


TENTH = Fraction(1, 10)

SEARCHED = [
    Example("allstop", 3, TENTH, 6, 9),
    Example("fischer", 2, Fraction(1), 28, 12),
    Example("follow_points", 2, TENTH, 29, 30),
    Example("leader_elect", 3, TENTH, 12, 9),
    Example("shortest_path", 3, TENTH, 35, 60),
    Example("sum_of_ids", 3, TENTH, 37, 20),
]

RUN = [
    Example("delivery", 2, TENTH, 33, 0),
    Example("hvac", 1, Fraction(40), 9, 9),
    Example("lineform_1d", 3, Fraction(10), 20, 9),
    Example("mapping", 2, TENTH, 27, 0),
    Example("task", 2, TENTH, 22, 0),
    Example("traffic", 2, Fraction(3), 18, 24),
    Example("waypoints", 2, Fraction(50), 24, 0),
]


def patient(system: System) -> System:
    """The system with a budget that ends after so many questions."""
    left = PATIENCE

    def is_over() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    return replace(system, budget=Budget(is_over))


def searched(system: System) -> dict[str, int]:
    """The round in which each claim breaks, by the search; empty if nothing is sure to break."""
    stated = [claim.stated for claim in claims_of(system) if claim.stated is not None]
    limits = Limits(states=3_000, rounds=ROUNDS)
    try:
        found = survey(patient(system), stated, limits, subjects=frozenset(GoalKind))
    except OutOfBudgetError:
        return {}
    assert not isinstance(found.end, NotFinite)
    return {name_of(v.claim): v.rounds for v in found.violated}


def ran(system: System) -> dict[str, int]:
    """A claim that breaks in a random run, and when; empty if none does."""
    for seed in range(RUNS):
        rng = Random(seed)
        run = new_run(patient(system), Numbers.EXACT, rng)
        play = Play(run, AtRandom(rng), ROUNDS, Monitor(run.d, run.system, run.inputs))
        try:
            for _ in play.steps():
                pass
        except (KoordError, OutOfBudgetError):
            return {}
        if play.violation is not None:
            is_contract = play.violation.kind is ViolationKind.CONTRACT
            name = f"contract {play.violation.name}" if is_contract else play.violation.name
            return {name: play.violation.round + 1}
        if run.configuration.fault is not None:
            return {"no fault": run.round + 1}
    return {}


def verified(system: System, broken: dict[str, int]) -> Report:
    """What the portfolio says, stopped as soon as it has called all that is broken violated."""
    reported: set[str] = set()

    def listen(text: str) -> None:
        _, _, names = text.partition("; violated: ")
        reported.update(names.split(", "))

    return verify(
        system,
        Bounds(max(broken.values()), 120.0),
        progress=listen,
        interrupted=lambda: broken.keys() <= reported,
    )


def compare(example: Example, tried: Iterable[Mutant], *, by_search: bool) -> Counter[str]:
    count: Counter[str] = Counter()
    for mutant in tried:
        count["tried"] += 1
        system = dealt(mutant.program, example.robots, example.delta_s)
        broken = searched(system) if by_search else ran(system)
        if not broken:
            continue
        count["broken"] += 1
        said = {verdict.claim.name: verdict for verdict in verified(system, broken).verdicts}
        for name, round_ in broken.items():
            verdict, where = said[name], (str(mutant), name, round_)
            assert verdict.outcome is Outcome.VIOLATED, (*where, verdict)
            assert verdict.counterexample is not None
            # A run is seldom a shortest one; the search says which round is the first.
            assert verdict.counterexample.round <= round_, where
            assert not by_search or verdict.counterexample.round == round_, where
    return count


def every_so_many(example: Example) -> list[Mutant]:
    return list(mutants(example.program()))[:: example.step]


@pytest.mark.parametrize("examples", sampled(SEARCHED[1::4], [SEARCHED]))
def test_what_a_search_finds_in_some_mutated_programs_is_reported(examples: list[Example]) -> None:
    count: Counter[str] = Counter()
    for example in examples:
        count += compare(example, every_so_many(example), by_search=True)
    assert count["broken"] >= len(examples), count


@pytest.mark.parametrize("examples", sampled(RUN[1:3], [[e for e in RUN if e.step]]))
def test_what_runs_find_in_some_mutated_programs_is_reported(examples: list[Example]) -> None:
    count: Counter[str] = Counter()
    for example in examples:
        count += compare(example, every_so_many(example), by_search=False)
    assert count["broken"] >= min(5, len(examples) // 2), count


@pytest.mark.slow
@pytest.mark.parametrize("example", [*SEARCHED, *RUN], ids=lambda e: e.name)
def test_what_breaks_in_any_mutated_program_is_reported(example: Example) -> None:
    """In 300 programs, 147 of them searched."""
    count = compare(example, mutants(example.program()), by_search=example in SEARCHED)
    assert count["broken"] >= example.broken, count


def test_mutants_differ_from_their_program_and_from_each_other() -> None:
    program = SEARCHED[1].program()
    made = [mutant.program for mutant in mutants(program)]
    assert len(made) >= 40
    assert program not in made
    assert all(a != b for i, a in enumerate(made) for b in made[:i])


def test_what_is_proved_does_not_hide_a_violation() -> None:
    """Clear paths are proved here; what functions may answer then first leads to no run."""
    task = next(example for example in RUN if example.name == "task")
    program = task.program()
    wrong = [m for m in mutants(program) if str(m) == "pid + 1 (task.krd:58:41)"]
    assert compare(task, wrong, by_search=False)["broken"] == 1
