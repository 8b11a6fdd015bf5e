"""``koord check-refinement --target guardian``: its proof and exploration, as they are shown."""

from __future__ import annotations

import json

import pytest

import koord
from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.refinement.guardian_proof import proving
from koord.refinement.protocol_proof.steps import Answer, Step
from koord.runtime.exploration import guardian
from koord.runtime.exploration.claims import BrokenInvariant, InvariantViolation
from koord.runtime.exploration.guardian import GuardianExplored

COMMAND = ("check-refinement", "--target", "guardian")

STEPS = (
    Step("tick", "G-TICK", "S-WISH", Answer.PROVED, 0.5),
    Step("tick", "G-TICK", "S-LIMIT", Answer.PROVED, 0.5),
    Step("arm", "G-ARM", "S-LIMIT", Answer.PROVED, 0.1),
)
REFUTED = Step("start", "G-START", "S-CLEAR", Answer.REFUTED, 0.1, ("mode = armed", "now = 0"))
UNKNOWN = Step("start", "G-START", "S-CLEAR", Answer.UNKNOWN, 60.0)
VIOLATION = InvariantViolation(BrokenInvariant("S-FINAL", "stopped → running"), ("arm", "start"))


def finds(
    monkeypatch: pytest.MonkeyPatch, *steps: Step, violation: InvariantViolation | None = None
) -> None:
    """Let the proof have these steps, and the exploration find this."""
    explored = GuardianExplored(7, 8, 9, violation is None, violation)
    monkeypatch.setattr(proving, "steps", lambda: iter(steps))
    monkeypatch.setattr(guardian, "VEHICLES", {"a car": guardian.VEHICLES["a car"]})
    monkeypatch.setattr(guardian, "explore_guardian", lambda limits: explored)


def test_what_is_proved_and_explored_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finds(monkeypatch, *STEPS)
    assert frame.main([*COMMAND]) == Exit.OK
    assert capsys.readouterr().out.splitlines() == [
        "tick (G-TICK): 2 invariants kept",
        "arm (G-ARM): 1 invariant kept",
        "a car: 7 states, 8 transitions, all of them",
        "proved for all limits, times and facts: S-WISH, S-LIMIT",
    ]


@pytest.mark.parametrize(
    ("step", "code"), [(REFUTED, Exit.VIOLATED), (UNKNOWN, Exit.UNKNOWN)], ids=str
)
def test_what_is_not_proved_is_told(
    step: Step, code: Exit, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finds(monkeypatch, *STEPS, step)
    assert frame.main([*COMMAND]) == code
    out = capsys.readouterr().out
    assert f"not proved ({step.answer.value}): start: S-CLEAR" in out
    assert all(f"  {fact}" in out for fact in step.counterexample)
    assert "proved for all" not in out


def test_a_violation_is_told_with_its_story(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finds(monkeypatch, *STEPS, violation=VIOLATION)
    assert frame.main([*COMMAND]) == Exit.VIOLATED
    out = capsys.readouterr().out
    assert "a car: 7 states, 8 transitions, to depth 9" in out
    assert "  arm\n  start\nbroken: S-FINAL: stopped → running\n" in out


def test_the_check_as_data(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finds(monkeypatch, *STEPS, REFUTED)
    assert frame.main([*COMMAND, "--json"]) == Exit.VIOLATED
    data = json.loads(capsys.readouterr().out)
    assert (data["format"], data["proved"]) == ("koord-guardian-check", False)
    assert data["invariants"] == ["S-WISH", "S-LIMIT"]
    assert data["steps"][-1]["counterexample"] == ["mode = armed", "now = 0"]
    assert data["explored"] == [{"what": "a car", "states": 7, "transitions": 8, "complete": True}]


def test_a_cancelled_check_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    finds(monkeypatch, *STEPS)
    stop = koord.Cancellation()
    stop.cancel()
    checked = koord.check_guardian(cancellation=stop)
    assert checked.interrupted
    assert not checked.ok
    assert checked.invariants == ()


def test_the_guardian_is_of_no_program(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main([*COMMAND, "specs/examples/task.krd"]) == Exit.BAD_INPUT
    assert "--target guardian is of no program" in capsys.readouterr().err
    assert frame.main([*COMMAND, "--for-every-number"]) == Exit.BAD_INPUT
