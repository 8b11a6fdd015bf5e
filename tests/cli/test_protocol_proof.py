"""``koord check-refinement --target protocol --for-every-number``: the proof, as it is shown."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

import koord
from koord.api import protocol_check
from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.refinement.protocol_proof.proving import Prover
from koord.refinement.protocol_proof.steps import Answer, Step
from koord.runtime.exploration.world import ExplorationBounds

COMMAND = ("check-refinement", "--target", "protocol", "--for-every-number")

STEPS = (
    Step("vote", "R-VOTE", "a vote promises", Answer.PROVED, 0.5),
    Step("", "", "I-AGREE", Answer.PROVED, 0.7),
)
REFUTED = Step("decide", "R-DECIDE", "one history", Answer.REFUTED, 0.1, ("earlier: (e, f)",))
UNKNOWN = Step("decide", "R-DECIDE", "one history", Answer.UNKNOWN, 60.0)


def proves(monkeypatch: pytest.MonkeyPatch, *steps: Step) -> None:
    """Let the proof have these steps, and one small exploration."""

    def made(prover: Prover) -> Iterator[Step]:
        return iter(steps)

    bounds = ExplorationBounds(rounds=1, epoch=0, crashes=0)
    monkeypatch.setattr(Prover, "steps", made)
    monkeypatch.setattr(protocol_check, "_HELD_AGAINST_MODEL", {"a round": bounds})


def test_a_proof_names_actions_and_invariants(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    proves(monkeypatch, *STEPS)
    assert frame.main([*COMMAND]) == Exit.OK
    vote, claims, machine, proved = capsys.readouterr().out.splitlines()
    assert vote == "vote (R-VOTE): 1 statement proved"
    assert claims == "claims: 1 statement proved"
    assert machine.startswith("the machine does what the model does, a round: ")
    assert proved == ("proved for every number of robots, rounds and epochs: I-AGREE, in 1.2 s")


@pytest.mark.parametrize(
    ("step", "code"), [(REFUTED, Exit.VIOLATED), (UNKNOWN, Exit.UNKNOWN)], ids=str
)
def test_what_is_not_proved_is_told(
    step: Step, code: Exit, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    proves(monkeypatch, *STEPS, step)
    assert frame.main([*COMMAND]) == code
    out = capsys.readouterr().out
    assert f"not proved ({step.answer.value}): decide: one history" in out
    assert all(f"  {fact}" in out for fact in step.counterexample)
    assert "proved for every number" not in out


def test_the_proof_as_data(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    proves(monkeypatch, *STEPS)
    assert frame.main([*COMMAND, "--json"]) == Exit.OK
    data = json.loads(capsys.readouterr().out)
    assert (data["format"], data["proved"]) == ("koord-protocol-proof", True)
    assert data["invariants"] == ["I-AGREE"]
    assert [one["statement"] for one in data["steps"]] == ["a vote promises", "I-AGREE"]


def test_a_cancelled_proof_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    proves(monkeypatch, *STEPS)
    stop = koord.Cancellation()
    stop.cancel()
    proof = koord.prove_protocol(cancellation=stop)
    assert proof.interrupted
    assert not proof.ok


def test_the_flag_is_of_the_protocol(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["check-refinement", "--for-every-number"]) == Exit.BAD_INPUT
    assert "--for-every-number needs --target protocol" in capsys.readouterr().err
