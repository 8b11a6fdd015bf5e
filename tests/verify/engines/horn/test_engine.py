"""What Spacer says of programs: proofs without lemmas, late violations, what it cannot follow."""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from pathlib import Path

import pytest
import z3
from msgspec.structs import replace

from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.horn.clauses import Clauses, Reached, Safe
from koord.verify.engines.horn.engine import _first
from koord.verify.ledger import Ledger, Reach, VerificationProblem
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from tests.verify.asking import bounded, judged, of_text

EXAMPLES = Path(__file__).parents[4] / "specs" / "examples"


def asked(system: System, rounds: int = 3, *names: str) -> dict[str, Verdict]:
    report: Report = verify(system, Bounds(rounds, 60), Engine.SPACER, names=names)
    return {verdict.claim.name: verdict for verdict in report.verdicts}


def outcomes(text: str, robots: int = 2) -> dict[str, Outcome]:
    return {name: verdict.outcome for name, verdict in asked(of_text(text, robots)).items()}


def test_timing_excludes_without_any_lemma() -> None:
    text = (EXAMPLES / "fischer.krd").read_text(encoding="utf-8")
    alone = "\n".join(
        line
        for line in text.splitlines()
        if not line.startswith("invariant") or "Exclusive" in line
    )
    found = asked(of_text(alone))
    assert {v.outcome for v in found.values()} == {Outcome.HOLDS}
    assert found["Exclusive"].engine is Engine.SPACER
    assert found["Exclusive"].rounds is None


@pytest.mark.slow
def test_what_breaks_late_is_found_whatever_the_bound() -> None:
    text = (EXAMPLES / "broken" / "sats_report_for_ever.krd").read_text(encoding="utf-8")
    verdict = asked(of_text(text, 2, Fraction(50)), 4, "Separation")["Separation"]
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.round == 11


COUNTER = """
allwrite:
  int x = 0
Up:
  pre: x < 7
  eff: atomic: x = x + 1
Jump:
  pre: x == 5
  eff: atomic: x = 40
"""


def test_each_claim_breaks_in_its_first_round() -> None:
    text = COUNTER + "invariant Low: x < 3\ninvariant High: x <= 41\ninvariant Mid: x < 30\n"
    found = asked(of_text(text))
    assert {name: v.outcome for name, v in found.items()} == {
        "Low": Outcome.VIOLATED,
        "High": Outcome.HOLDS,
        "Mid": Outcome.VIOLATED,
        "no fault": Outcome.HOLDS,
    }
    shown = {n: v.counterexample.round for n, v in found.items() if v.counterexample is not None}
    assert shown == {"Low": 3, "Mid": 6}


def test_what_is_false_at_the_start() -> None:
    verdict = asked(of_text(COUNTER + "invariant Late: x > 0\n"))["Late"]
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.round == 0


def test_what_is_false_at_the_start_alone() -> None:
    """Nobody may skip, so that every moment of every round is behind it."""
    text = COUNTER.replace("Up:", "urgent Up:").replace("x < 7", "x < 2")
    text = text.replace("Jump:", "urgent Stay:").replace("x == 5", "x >= 2").replace("40", "2")
    verdict = asked(of_text(text + "invariant Late: x > 0\n", 1))["Late"]
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.round == 0


def test_faults_are_found() -> None:
    text = COUNTER.replace("int x = 0", "int x = 0\n  int[5] of = [1, 1, 1, 1, 1]")
    text = text.replace("x = 40", "x = of[x]") + "invariant Low: x < 30\n"
    assert outcomes(text) == {"Low": Outcome.HOLDS, "no fault": Outcome.VIOLATED}


def test_what_never_changes_is_the_same_in_all_rounds() -> None:
    """What a variable starts with, and what a function without arguments answers."""
    text = """
def fun limit() -> int: extern
  ensures: 1 <= result and result <= 5
allwrite:
  int first
  int x = 0
  int seen = 0
  int cap = 0
Up:
  pre: x < limit()
  eff: atomic:
    x = x + 1
    seen = first
    cap = limit()
assume: 3 <= first and first <= 4
invariant Low: x <= 5
invariant Seen: seen == 0 or seen == first
invariant Three: seen != 2
invariant Cap: cap == 0 or cap == limit()
"""
    assert set(outcomes(text).values()) == {Outcome.HOLDS}


@pytest.mark.parametrize(
    ("declaration", "claim", "reason"),
    [
        (
            "allwrite:\n  int[] many = []\nAdd:\n  eff: many.append(1)\n",
            "length(many) < 99",
            "elements",
        ),
        (
            "allwrite:\n  Map<int, int> many = {}\nAdd:\n  eff: many[pid] = 1\n",
            "length(many) < 99",
            "elements",
        ),
        (
            "def fun f(int k) -> int: extern\nallwrite:\n  int y = 0\nAsk:\n  eff: y = f(y)\n",
            "y < 99",
            "functions like f",
        ),
    ],
)
def test_what_it_cannot_follow_it_says(declaration: str, claim: str, reason: str) -> None:
    verdict = asked(of_text(f"{declaration}invariant Some: {claim}\n"))["Some"]
    assert verdict.outcome is Outcome.UNKNOWN
    assert reason in verdict.reason


def test_no_invariant_is_taken_on_trust(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Clauses, "solved", lambda *_: Safe(True))
    assert outcomes(COUNTER + "invariant Low: x < 3\n")["Low"] is Outcome.UNKNOWN


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (b"max. resource limit exceeded", "Spacer gave up"),
        (b"no such relation", "Spacer cannot be asked: no such relation"),
    ],
)
def test_it_says_why_it_stopped(said: bytes, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise z3.Z3Exception(said)

    monkeypatch.setattr(z3.Fixedpoint, "query", stop)
    verdict = asked(of_text(COUNTER + "invariant High: x <= 41\n"))["High"]
    assert verdict.outcome is Outcome.UNKNOWN
    assert reason in verdict.reason
    assert "b'" not in verdict.reason


def test_no_run_is_taken_on_trust(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Clauses, "solved", lambda *_: Reached(((), ())))
    verdict = asked(of_text(COUNTER + "invariant High: x <= 41\n"))["High"]
    assert verdict.outcome is Outcome.UNKNOWN
    assert "replay" in verdict.reason


@pytest.mark.slow
def test_it_is_asked_before_rounds_are_unrolled_for_long() -> None:
    text = (EXAMPLES / "broken" / "sats_report_for_ever.krd").read_text(encoding="utf-8")
    report = verify(of_text(text, 2, Fraction(50)), Bounds(4, 600))
    engines = {v.claim.name: v.engine for v in report.verdicts}
    assert engines["Separation"] is Engine.SPACER
    assert engines["Runway"] is Engine.SPACER


def test_a_violation_is_shown_with_the_fewest_rounds() -> None:
    """Where Spacer came upon a longer run, the rounds before are looked at."""
    system = of_text(
        "local:\n    int x = 0\n\nGrow:\n    eff: x = x + 1\n\ninvariant Few: x < 3\n", 1
    )
    subject = VerificationProblem(system, partial(judged, system), system)
    claim, *_ = claims = claims_of(system)
    ledger = Ledger(subject, Bounds(9), Deadline(), claims)
    first = bounded(system, rounds=5).violated["Few"]
    assert first.round == 3
    later = replace(first, round=5)
    found = _first(ledger, claim, later)
    assert (found.counterexample.round, found.fewest) == (3, True)
    found = _first(ledger, claim, first)
    assert found.counterexample is first
    assert found.fewest
    ledger.leave([claim], Reach(Engine.BMC, 4, "", 0.0))  # somebody has looked there
    found = _first(ledger, claim, later)
    assert found.counterexample is later
    assert found.fewest


def test_nobody_says_that_rounds_are_the_fewest_that_could_not_be_looked_at() -> None:
    system = of_text(
        "local:\n    int x = 0\n\nGrow:\n    eff: x = x + 1\n\ninvariant Few: x < 3\n", 1
    )
    claim, *_ = claims = claims_of(system)
    later = replace(bounded(system, rounds=5).violated["Few"], round=5)
    subject = VerificationProblem(system, partial(judged, system), system)
    ledger = Ledger(subject, Bounds(9), Deadline.after(0), claims)
    found = _first(ledger, claim, later)
    assert found.counterexample is later
    assert not found.fewest
