"""What the engines do not cover is said once per variable, and never passes for *holds*."""

from __future__ import annotations

from koord.syntax.system import dealt
from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.loading import program_of

LISTENS = """
using Radio:
    sensors:
        int[] heard
local:
    int last = 0
Hear:
    pre: length(heard) > 0
    eff:
        last = heard[0]
invariant Any: last < 1 or last >= 1
"""

LONG = """
local:
    int[] heard
assume: length(heard) > 100
Hear:
    eff:
        heard[0] = 1
"""


def test_that_no_short_list_will_do_does_not_mean_that_none_does() -> None:
    program = program_of(LONG)
    report = verify(dealt(program, 1), Bounds(rounds=2))
    assert report.outcome is Outcome.UNKNOWN
    assert not any(vacuity.certain for vacuity in report.vacuities)


def test_lists_longer_than_the_capacity_are_told_by_the_names_of_the_program() -> None:
    program = program_of(LISTENS)
    for choice in (Engine.BMC, Engine.INDUCTION):
        report = verify(dealt(program, 2), Bounds(rounds=2), choice)
        assert report.outcome is Outcome.UNKNOWN
        for verdict in report.verdicts:
            assert verdict.reason == (
                "not covered: lists Radio.heard of more than 3 elements; "
                "lists heard of more than 3 elements"
            )


PLANS = """
def fun plan(int a) -> int[]: extern
local:
    int[] path = []
Plan:
    eff: path = plan(1)
invariant Short: length(path) <= 3 or contains(path, 9)
"""


def test_nothing_is_said_of_rounds_in_which_lists_may_be_longer() -> None:
    """A plan of four elements breaks Short in round 1, whatever engine looks at three."""
    program = program_of(PLANS)
    for choice in (None, Engine.BMC, Engine.INDUCTION, Engine.BITS):
        short, _ = verify(dealt(program, 1), Bounds(rounds=2), choice).verdicts
        assert short.outcome is Outcome.UNKNOWN
        assert short.rounds in (None, 0)


def test_lists_that_are_only_measured_may_be_longer() -> None:
    """Where nothing goes over a plan, nothing bounds it. [T-OBSERVE]"""
    program = program_of(PLANS.replace("contains(path, 9)", "path[2] == 9"))
    short, _ = verify(dealt(program, 1), Bounds(rounds=2), Engine.BMC).verdicts
    assert short.outcome is Outcome.VIOLATED
