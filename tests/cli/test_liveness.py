"""What ``koord verify`` and ``koord replay`` say of runs without end. [LASSO]"""

from __future__ import annotations

import json
from pathlib import Path
from textwrap import dedent

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.cli import main as frame
from koord.cli.exits import Exit
from tests.semantics.endless import GATE, SERVED

TRACES = Path(koord.__file__).parent / "api" / "schemas" / "trace.schema.json"
VERDICTS = Path(koord.__file__).parent / "api" / "schemas" / "verdicts.schema.json"


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("gate.krd").write_text(dedent(GATE + SERVED), encoding="utf-8")
    return "gate.krd"


def test_a_verdict_says_which_fairness_it_rests_on(
    gate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert frame.main(["verify", gate, "--robots", "2"]) == Exit.OK
    out = capsys.readouterr().out
    assert "Served    holds, under fairness" in out
    assert "it rests on fairness to locks" in out


def test_a_lasso_is_shown_kept_and_replayed(gate: str, capsys: pytest.CaptureFixture[str]) -> None:
    with Path(gate).open("a", encoding="utf-8") as file:
        file.write("eventually Third: holder == 2\n")
    words = ["verify", gate, "--robots", "2", "--trace", "t.json"]
    assert frame.main(words) == Exit.VIOLATED
    out = capsys.readouterr().out
    assert "Third     violated: rounds 1 to 4 repeat for ever" in out
    assert "from here on rounds 1 to 4 repeat for ever:" in out
    assert "... and again from round 1 on" in out
    assert "[PROP-EVENTUALLY]" in out
    trace = json.loads(Path("t.json").read_text("utf-8"))
    assert trace["run"]["loop"] == 0
    schema = json.loads(TRACES.read_text("utf-8"))
    Draft202012Validator(schema).validate(trace)
    assert frame.main(["replay", "t.json"]) == Exit.OK
    assert "rounds 1 to 4 repeat for ever" in capsys.readouterr().out
    # A loop that leaves a robot out is not fair.
    trace["run"]["rounds"] = trace["run"]["rounds"][:2]
    trace["run"]["violation"]["round"] = 1
    Path("t.json").write_text(json.dumps(trace), encoding="utf-8")
    assert frame.main(["replay", "t.json"]) == Exit.VIOLATED
    assert "not legal by FAIR-LOCK" in capsys.readouterr().out


def test_a_loop_in_other_tools_forms(gate: str, capsys: pytest.CaptureFixture[str]) -> None:
    with Path(gate).open("a", encoding="utf-8") as file:
        file.write("eventually Third: holder == 2\n")
    words = ["verify", gate, "--robots", "2", "--trace", "t.itf.json", "--json"]
    assert frame.main(words) == Exit.VIOLATED
    said = json.loads(capsys.readouterr().out)
    Draft202012Validator(json.loads(VERDICTS.read_text("utf-8"))).validate(said)
    served, third = said["reports"][0]["claims"][-2:]
    assert (served["kind"], served["fairness"]) == ("liveness", ["locks"])
    assert (third["violated"]["loop"], third["violated"]["round"]) == (1, 4)
    document = json.loads(Path("t.itf.json").read_text("utf-8"))
    first, last = document["states"][document["loop"]], document["states"][-1]
    assert first["holder"] == last["holder"]
    assert first["inside"] == last["inside"]
    assert frame.main(["replay", "t.itf.json"]) == Exit.OK
    document["loop"] = 3
    Path("t.itf.json").write_text(json.dumps(document), encoding="utf-8")
    assert frame.main(["replay", "t.itf.json"]) == Exit.BAD_INPUT


def test_what_never_happens_leads_anywhere(gate: str, capsys: pytest.CaptureFixture[str]) -> None:
    with Path(gate).open("a", encoding="utf-8") as file:
        file.write("eventually Odd: holder == 9 leadsto holder == 10\n")
    assert frame.main(["verify", gate, "--robots", "2"]) == Exit.VACUOUS
    assert "what Odd supposes: can never come true" in capsys.readouterr().out


def test_expectations_that_nothing_meets(gate: str, capsys: pytest.CaptureFixture[str]) -> None:
    with Path(gate).open("a", encoding="utf-8") as file:
        file.write("assume Odd: true leadsto holder == 9\n")
    assert frame.main(["verify", gate, "--robots", "2"]) == Exit.VACUOUS
    assert "no run without end does all that is expected" in capsys.readouterr().out
