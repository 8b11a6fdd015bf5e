"""What a few robots break is violated, by a run of that many. [T-EVERY-N]"""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

import koord
from koord.verify.engine_names import Engine
from koord.verify.reduction.problems import plain_problem
from koord.verify.strategy.confirmation import confirmed
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


def test_a_run_of_the_fewest_robots_that_break_a_claim_is_told() -> None:
    """A robot with the number 1 counts up to 2; only one with the number 3 passes by that."""
    for most, robots in ((2, 2), (3, 4)):
        system = system_of(FEW.format(most=most))
        verdict = verdict_of(FEW.format(most=most), "Small")
        assert verdict.outcome is Outcome.VIOLATED
        assert (verdict.robots, verdict.reason, verdict.obstacles) == (robots, "", ())
        broken = verdict.broken_system(system)
        assert broken.robots == robots
        shown = verdict.counterexample
        assert shown is not None
        judged = plain_problem(broken).judge(shown.recording, verdict.claim, shown.phase)
        assert judged == shown


def test_a_run_from_another_machine_is_replayed_with_as_many_robots() -> None:
    system = system_of(FEW.format(most=3))
    report = verify(system, Bounds(3), Engine.EVERY_N)
    assert confirmed(system, report) == report
    fewer = [replace(v, robots=3 if v.robots else None) for v in report.verdicts]
    looked_at = confirmed(system, replace(report, verdicts=tuple(fewer)))
    assert Outcome.VIOLATED not in {v.outcome for v in looked_at.verdicts}


def test_a_run_that_was_kept_is_replayed_with_as_many_robots(tmp_path: Path) -> None:
    program = koord.load(koord.Source("few.krd", FEW.format(most=3)))
    asked = [
        koord.verify(program, robots="any", cache=koord.Cache(tmp_path)).verdict("Small")
        for _ in range(2)
    ]
    assert [verdict.kept for verdict in asked] == [False, True]
    for verdict in asked:
        assert verdict.counterexample is not None
        assert koord.replay(verdict.counterexample).legal
        assert verdict.counterexample.robots == 4
        form = verdict.to_dict()["violated"]
        assert isinstance(form, dict)
        assert form["robots"] == 4


def test_what_no_few_robots_break_stays_open() -> None:
    verdict = verdict_of(FEW.format(most=9), "Small")
    assert verdict.outcome is Outcome.UNKNOWN
    assert "break" not in verdict.reason


@pytest.mark.slow
def test_a_program_for_two_robots_faults_with_others() -> None:
    """Of what is open without being broken it is told of how many robots the text is."""
    report = verify(system_of(protocol_text("peterson")), Bounds(3), Engine.EVERY_N)
    exclusive, no_fault = report.verdicts
    assert "the text states 2" in exclusive.reason
    assert (no_fault.outcome, no_fault.robots) == (Outcome.VIOLATED, 1)
