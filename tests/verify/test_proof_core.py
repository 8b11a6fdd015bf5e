"""What proofs rest on: each premise that is needed, and none that is not."""

from __future__ import annotations

import pytest

from koord.syntax.analysis.premises import Premise, PremiseKind, premises, without
from koord.syntax.system import System, dealt
from koord.verify.engine_names import Engine
from koord.verify.proof_core import ProofCore, proof_core
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.loading import program_of
from tests.sampling import first

ROVER = """
    def fun faster(int a) -> int: extern
        ensures:
            result > a
            result < a + 100

    using Rover:
        sensors:
            int speed
            int heat
        actuators:
            int wish
        contract Slow:
            ensures:
                speed' <= 10
                heat' >= 0

    local:
        int n = 0
        int seen = 0

    init:
        n = faster(n)

    Look:
        pre: true
        eff:
            seen = Rover.speed

    assume: Rover.speed == 0
    assume: Rover.heat == 0
    invariant Seen: forall i: seen@i <= 10
    invariant Above: forall i: n@i > 0
"""


def system(text: str = ROVER, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def found(of: System, choice: Engine | None = None) -> ProofCore:
    report = verify(of, Bounds(5), choice)
    assert report.outcome is Outcome.HOLDS
    return proof_core(of, report.verdicts, Bounds(5))


def names(of: tuple[Premise, ...]) -> list[tuple[str, str, int]]:
    return [(p.kind.value, p.name, p.promise) for p in of]


def test_all_premises_are_told() -> None:
    assert names(premises(system().program)) == [
        ("assumption", "assume_1", 1),
        ("assumption", "assume_2", 1),
        ("contract", "Rover.Slow", 1),
        ("contract", "Rover.Slow", 2),
        ("summary", "faster", 1),
        ("summary", "faster", 2),
    ]


@pytest.mark.parametrize("choice", first(1, [Engine.INDUCTION, None]))
def test_what_is_needed_stays_and_the_rest_goes(choice: Engine | None) -> None:
    told = found(system(), choice)
    assert set(told.claims) == {"Seen", "Above", "no fault"}
    assert names(told.needed) == [
        ("assumption", "assume_1", 1),
        ("contract", "Rover.Slow", 1),
        ("summary", "faster", 1),
    ]
    assert names(told.spare) == [
        ("assumption", "assume_2", 1),
        ("contract", "Rover.Slow", 2),
        ("summary", "faster", 2),
    ]
    assert not told.untried


@pytest.mark.slow
def test_without_what_is_spare_all_is_still_proved_and_without_what_is_needed_it_is_not() -> None:
    of = system(robots=1)
    told = found(of)
    lean = System(without(of.program, told.spare), of.kinds, of.delta_s)
    assert verify(lean, Bounds(5)).outcome is Outcome.HOLDS
    for premise in told.needed:
        less = System(without(of.program, [*told.spare, premise]), of.kinds, of.delta_s)
        assert verify(less, Bounds(5)).outcome is not Outcome.HOLDS


def test_a_model_is_no_premise() -> None:
    contract = ROVER[ROVER.index("        contract Slow") : ROVER.index("    local:")]
    model = """        environment:
            speed = 3
            heat = heat + 1

"""
    text = ROVER.replace(contract, model)
    kinds = {p.kind for p in premises(system(text).program)}
    assert kinds == {PremiseKind.ASSUMPTION, PremiseKind.SUMMARY}


def test_what_holds_for_some_rounds_rests_on_nothing_that_is_told() -> None:
    of = system()
    report = verify(of, Bounds(2), Engine.BMC)
    told = proof_core(of, report.verdicts, Bounds(2))
    assert (told.claims, told.needed, told.spare) == ((), (), ())
    assert len(told.untried) == 6


def test_out_of_time_says_what_was_not_tried() -> None:
    of = system()
    report = verify(of, Bounds(5))
    told = proof_core(of, report.verdicts, Bounds(5, timeout_s=0.0))
    assert (told.needed, told.spare) == ((), ())
    assert len(told.untried) == 6
