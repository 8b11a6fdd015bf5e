"""What a few robots break does not hold of every number of them, and that is told. [T-EVERY-N]"""

from __future__ import annotations

from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import protocol_text
from tests.verify.engines.every_n.asking import system_of


def verdict_of(text: str, name: str) -> Verdict:
    report = verify(system_of(text), Bounds(3), Engine.EVERY_N)
    return next(v for v in report.verdicts if v.claim.name == name)


FEW = """\
local:
    int x = 0

Step:
    pre: x < 2
    eff: x = x + pid

invariant Small: forall i: x@i < {most}
"""


def test_the_fewest_robots_that_break_a_claim_are_told() -> None:
    """A robot with the number 2 is there where three are, and with 3 where there are four."""
    two, three = (verdict_of(FEW.format(most=most), "Small") for most in (2, 3))
    assert two.outcome is three.outcome is Outcome.UNKNOWN
    assert "2 robots break it, as `--robots 2` shows" in two.reason
    assert "4 robots break it, as `--robots 4` shows" in three.reason
    assert two.obstacles == ()


def test_what_no_few_robots_break_stays_open() -> None:
    verdict = verdict_of(FEW.format(most=9), "Small")
    assert verdict.outcome is Outcome.UNKNOWN
    assert "break" not in verdict.reason


def test_a_program_for_two_robots_faults_with_others() -> None:
    """Of what is open without being broken it is told of how many robots the text is."""
    report = verify(system_of(protocol_text("peterson")), Bounds(3), Engine.EVERY_N)
    exclusive, no_fault = (v.reason for v in report.verdicts)
    assert "the text states 2" in exclusive
    assert "one robot breaks it, as `--robots 1` shows" in no_fault
