"""Robots that may change places: a few of them stand for all. [SYMMETRY]"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.verify.claims import Claim, claims_of
from koord.verify.effort import Deadline
from koord.verify.engines.induction import proving
from koord.verify.engines.induction.proving import Inductive, prove, representatives
from koord.verify.reduction.abstraction import abstracted
from koord.verify.verdicts import Outcome
from tests.generators.profiles import FINITE
from tests.loading import example_program, program_of
from tests.sampling import first, sampled
from tests.verify.asking import ask

EXAMPLES = Path(__file__).parents[4] / "specs" / "examples"


def example(name: str, robots: int) -> System:
    return dealt(example_program(name), robots)


def named(found: System, name: str) -> Claim:
    return next(claim for claim in claims_of(found) if claim.name == name)


def ranges(e: object) -> list[object]:
    """How far the quantifiers at the top go; None for all robots."""
    found: list[object] = []
    while isinstance(e, core.Quantified):
        high = e.domain.high if isinstance(e.domain, core.IntRange) else None
        found.append(high.value if isinstance(high, core.Const) else None)
        e = e.body
    return found


def test_each_quantifier_names_one_more_robot() -> None:
    found = example("fischer", 5)
    claim = named(found, "Exclusive")
    seen = representatives(found)(claim)
    assert claim.stated is not None
    assert seen.stated is not None
    assert (ranges(claim.stated.condition), ranges(seen.stated.condition)) == ([None, None], [1, 2])


def test_robots_that_are_told_apart_all_count() -> None:
    found = example("lineform", 5)
    assert all(representatives(found)(claim) is claim for claim in claims_of(found))
    mixed = example("cars_and_drones", 4)
    assert all(representatives(mixed)(claim) is claim for claim in claims_of(mixed))


def everybody(system: System) -> Callable[[Claim], Claim]:
    """Nobody stands for anybody."""
    return lambda claim: claim


def proofs(found: System, depth: int) -> Inductive:
    return prove(found, claims_of(found), (), Deadline.after(60), depth=depth)


@pytest.mark.parametrize("name", first(2, ["broken/fischer2_no_deadline", "traffic", "mapping"]))
def test_what_two_robots_break_is_broken_up_to_names(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = example(name, 3)
    some = proofs(found, 1)
    monkeypatch.setattr(proving, "representatives", everybody)
    every = proofs(found, 1)
    assert set(some.proved) == set(every.proved)
    assert some.reasons == every.reasons


@pytest.mark.parametrize("last", sampled(90, [300]))
def test_proofs_of_generated_programs_are_the_same(
    last: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    count: Counter[str] = Counter()
    for seed in range(last):
        found = system(Random(seed), FINITE)
        seen = representatives(found)
        if all(seen(claim) is claim or seen(claim) == claim for claim in claims_of(found)):
            continue
        try:
            some = proofs(found, 1)
            with monkeypatch.context() as patch:
                patch.setattr(proving, "representatives", everybody)
                every = proofs(found, 1)
        except NotFiniteError:
            continue
        assert set(some.proved) == set(every.proved), seed
        count["systems"] += 1
        count["proved"] += sum(claim.stated is not None for claim in some.proved)
        count["not proved"] += sum(claim.stated is not None for claim in some.reasons)
    assert count["systems"] >= last // 15
    assert count["proved"] >= last // 30
    assert count["not proved"] >= last // 30


def test_opaque_values_to_start_with_are_no_obstacle() -> None:
    """They come of functions that the program itself does not have."""
    text = """
    def fun safe(pos p) -> bool: extern
    allwrite:
        pos home = pos(0.0, 0.0, 0.0)
        int visits = 0
    local:
        pos mine = pos(0.0, 0.0, 0.0)
    Visit:
        pre: safe(home)
        eff:
            mine = home
            visits = visits + 1
    invariant Home: forall i: mine@i == home
    invariant Few: visits < 2
    """
    program = program_of(text)
    abstraction = abstracted(program)
    assert abstraction is not None
    found = dealt(abstraction.program, 3)
    claim = named(found, "Home")
    assert representatives(found)(claim) != claim
    assert ask(program, 3).outcome("Few") is Outcome.VIOLATED
