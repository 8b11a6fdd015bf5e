"""What fails beside the verdicts costs its own part: they are told, and the failure is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from koord.api import certify, cones, pictures
from koord.cli import counterexamples, verdicts, verified
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.refinement import compiled_replay
from koord.verify import instants, proof_core

PROGRAM = """
local:
  int x = 0
Step:
  pre: x < 3
  eff: x = x + 1
invariant Low: forall i: x@i >= 0
invariant Small: forall i: x@i < 2
"""


def fail(*words: object, **named: object) -> Any:
    raise AssertionError("made to fail")


PARTS = {
    "rests on": (proof_core, "proof_core", ["--rests-on"], "what the proofs rest on"),
    "premises": (verdicts, "core_lines", ["--rests-on"], "what the proofs rest on"),
    "story": (counterexamples, "lines", [], "the story of Small"),
    "rerun": (compiled_replay, "rerun", [], "the story of Small"),
    "slices": (verdicts, "cone_lines", ["--explain"], "what claims do not depend on"),
    "certificate": (certify, "certify", ["--certificate", "c"], "the certificate"),
    "trace": (verified, "_keep", ["--trace", "t.json"], "the trace"),
    "invariants": (verified, "_save", ["--save-invariants", "i"], "the file of invariants"),
}

IN_JSON = {
    "rests on": PARTS["rests on"],
    "rerun": (compiled_replay, "rerun", [], "the compiled program's run of Small"),
    "slices": (cones, "cones_of", [], "what claims do not depend on"),
    "certificate": PARTS["certificate"],
}

ASKED = ["verify", "p.krd", "--robots", "1", "--rounds", "3", "--jobs", "1", "--engine", "bmc"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.krd").write_text(PROGRAM, encoding="utf-8")


@pytest.mark.parametrize("part", PARTS)
def test_verdicts_are_told_whatever_fails_beside_them(
    part: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    where, name, flags, who = PARTS[part]
    monkeypatch.setattr(where, name, fail)
    assert main([*ASKED, *flags]) == Exit.VIOLATED
    printed = capsys.readouterr()
    assert "violated: 1 of 3 claims" in printed.out
    assert f"{who} failed: AssertionError: made to fail" in printed.err


@pytest.mark.parametrize("part", IN_JSON)
def test_documents_have_the_verdicts_and_what_failed(
    part: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    where, name, flags, who = IN_JSON[part]
    monkeypatch.setattr(where, name, fail)
    assert main([*ASKED, *flags, "--json"]) == Exit.VIOLATED
    (report,) = json.loads(capsys.readouterr().out)["reports"]
    assert report["outcome"] == "violated"
    assert [failure["who"] for failure in report["failures"]] == [who]
    claims = {claim["name"]: claim for claim in report["claims"]}
    if part == "rerun":
        assert "could not be compared" in json.dumps(claims["Small"])


def test_a_plot_that_fails_costs_no_verdict(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(pictures, "draw_sweep", fail)
    words = ["verify", "p.krd", "--robots", "1..2", "--rounds", "2", "--plot", "p.svg"]
    assert main([*words, "--jobs", "1", "--engine", "bmc"]) == Exit.VIOLATED
    assert "the plot failed: AssertionError: made to fail" in capsys.readouterr().err


def test_shadows_that_fail_leave_what_is_between_rounds_unknown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        "using Dial:\n  sensors:\n    int level = 0\ninvariant Read: forall i: Dial.level@i >= 0\n"
    )
    Path("p.krd").write_text(PROGRAM + text, encoding="utf-8")
    monkeypatch.setattr(instants, "_shadowed", fail)
    assert main([*ASKED, "--instants"]) == Exit.VIOLATED
    assert main([*ASKED, "--instants", "--json"]) == Exit.VIOLATED
    printed = capsys.readouterr().out
    assert "failed: what is asked between rounds: AssertionError: made to fail" in printed
    (report,) = json.loads(printed[printed.index("\n{") :])["reports"]
    claims = {claim["name"]: claim for claim in report["claims"]}
    assert claims["Small"]["outcome"] == "violated"
    assert claims["Read between rounds"]["outcome"] == "unknown"
    assert [failure["who"] for failure in report["failures"]] == ["what is asked between rounds"]
