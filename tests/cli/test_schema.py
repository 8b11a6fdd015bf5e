"""What ``koord schema`` prints describes what the commands print, whatever comes of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.api import refinement
from koord.api.documents import DOCUMENTS
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.cli.progress import LiveLine
from koord.refinement import running
from koord.runtime.compile import compiled
from tests.refinement.part_files import lines_of, part_files, write_lines
from tests.sampling import first

COUNTER = """
local:
  int x
Step:
  pre: x < 9
  eff: x = x + 1
assume: forall i: x@i == 0
"""

# No inductive step of a few rounds knows that numbers are even, which is seen at once.
EVEN = """
local:
  int x = 0
Step:
  eff: x = x + 2
"""

PROGRAMS = {
    "holds": COUNTER + "invariant Low: forall i: x@i >= 0\n",
    "violated": COUNTER + "invariant Small: forall i: x@i < 2\ninvariant Few: forall i: x@i < 3\n",
    "vacuous": COUNTER + "Never:\n  pre: x < 0\n  eff: x = 7\ninvariant Low: forall i: x@i >= 0\n",
    "unknown": EVEN + "invariant Odd: forall i: x@i != 91\n",
    "live": COUNTER + "eventually Nine: forall i: x@i == 9\neventually Ten: exists i: x@i == 10\n",
    "wrong": COUNTER + "invariant Low: y > 0\n",
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in PROGRAMS.items():
        Path(f"{name}.krd").write_text(text, encoding="utf-8")


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    capsys.readouterr()
    main(list(words))
    return json.loads(capsys.readouterr().out)


def valid(capsys: pytest.CaptureFixture[str], document: str, told: object) -> None:
    schema = printed(capsys, "schema", document)
    Draft202012Validator(schema).validate(told)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_each_is_a_schema(capsys: pytest.CaptureFixture[str], document: str) -> None:
    schema = printed(capsys, "schema", document)
    Draft202012Validator.check_schema(schema)
    assert not Draft202012Validator(schema).is_valid({"surely": "nothing of koord"})


def test_that_of_configurations_needs_no_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "schema") == printed(capsys, "schema", "configuration")


def test_others_are_refused_with_those_that_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "verdict"]) == Exit.BAD_INPUT
    assert "'configuration', 'verdicts', 'diagnostics'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "outcomes"),
    first(
        1,
        [
            (["violated.krd", "--max-violations", "3"], Exit.VIOLATED, ["violated"]),
            (["vacuous.krd"], Exit.VACUOUS, ["holds"]),
            (["unknown.krd", "--engine", "induction", "--robots", "2"], Exit.UNKNOWN, ["unknown"]),
            (["live.krd"], Exit.VIOLATED, ["violated"]),
            (["holds.krd", "--robots", "1..2"], Exit.OK, ["holds"] * 2),
            (["holds.krd"], Exit.OK, ["holds"]),
            (["violated.krd", "--trace", "t.json"], Exit.VIOLATED, ["violated"]),
            (["holds.krd", "--robots", "any"], Exit.OK, ["holds"]),
            (["holds.krd", "--rests-on"], Exit.OK, ["holds"]),
            (["violated.krd", "--instants"], Exit.VIOLATED, ["violated"]),
        ],
    ),
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, list) else value.name,
)
def test_verdicts_are_as_described(
    capsys: pytest.CaptureFixture[str], words: list[str], code: Exit, outcomes: list[str]
) -> None:
    told = ["--rounds", "4", "--jobs", "1", "--json"]
    assert main(["verify", *words, *told]) == code
    found = json.loads(capsys.readouterr().out)
    assert [report["outcome"] for report in found["reports"]] == outcomes
    valid(capsys, "verdicts", found)


def test_verdicts_of_a_run_that_was_interrupted_are_as_described(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def press(line: LiveLine, text: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(LiveLine, "show", press)
    words = ["verify", "unknown.krd", "--rounds", "4", "--json"]
    assert main(words) == Exit.INTERRUPTED
    found = json.loads(capsys.readouterr().out)
    assert found["reports"][0]["interrupted"] is True
    valid(capsys, "verdicts", found)


def test_diagnostics_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["check", "wrong.krd"], ["verify", "wrong.krd"], ["recheck", "wrong.krd"]):
        assert main([*words, "--json"]) == Exit.BAD_INPUT
        found = json.loads(capsys.readouterr().out)
        assert found["errors"] == 1
        valid(capsys, "diagnostics", found)


def test_traces_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    valid(capsys, "trace", printed(capsys, "run", "holds.krd", "--rounds", "2", "--json"))


def test_verdicts_on_traces_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    trace = printed(capsys, "run", "holds.krd", "--rounds", "2", "--json")
    Path("t.json").write_text(json.dumps(trace), encoding="utf-8")
    for words in ([], ["--compiled"]):
        found = printed(capsys, "replay", "t.json", "--json", *words)
        assert found["legal"] is True
        assert (found["compiled"] is None) == (not words)
        valid(capsys, "replay", found)
    trace["run"]["rounds"][-1]["after"]["robots"][0]["locals"]["x"] = 7
    Path("t.json").write_text(json.dumps(trace), encoding="utf-8")
    found = printed(capsys, "replay", "t.json", "--json")
    assert found["refused"]["differences"][0]["recorded"] == "7"
    valid(capsys, "replay", found)


def test_verdicts_on_deployed_runs_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    schema = printed(capsys, "schema", "merged")
    files = part_files(Path("parts"), PROGRAMS["violated"].replace("@i < 2", "@i < 5"))
    merge = ("merge", *map(str, files), "-o", "run.json", "--json")
    found = printed(capsys, *merge)
    assert found["broken"]["name"] == "Few"
    Draft202012Validator(schema).validate(found)
    for field, change in (("parts", []), ("rounds", -1), ("broken", {"name": "Few"})):
        assert not Draft202012Validator(schema).is_valid(found | {field: change})
    lines = lines_of(files[1])
    stood = next(one for one in lines if (one["told"], one.get("round")) == ("stood", 5))
    stood["robot"]["locals"]["x"] = 77
    write_lines(files[1], lines)
    found = printed(capsys, *merge)
    assert found["refused"]["rule"] == "ENV-TRANS"
    Draft202012Validator(schema).validate(found)


@pytest.mark.slow
def test_certificates_and_verdicts_on_them_are_as_described(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("cvc5")
    assert main(["verify", "holds.krd", "--certificate", "c.json"]) == Exit.OK
    document = json.loads(Path("c.json").read_text(encoding="utf-8"))
    valid(capsys, "certificate", document)
    found = printed(capsys, "recheck", "c.json", "--json")
    assert found["verdict"] == "confirmed"
    valid(capsys, "recheck", found)
    document["invariant"] = []
    Path("c.json").write_text(json.dumps(document), encoding="utf-8")
    found = printed(capsys, "recheck", "c.json", "--json")
    assert found["verdict"] == "refuted"
    valid(capsys, "recheck", found)


def test_findings_on_drivers_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    only = ("--only", "options", "--only", "stale", "--only", "opens")
    for driver in ("sim", "tests.testing.faulty:Faulty"):
        words = ["conform", "--driver", driver, "--virtual-time", *only, "--json"]
        found = printed(capsys, *words)
        assert found["ok"] is (driver == "sim")
        valid(capsys, "conformance", found)


def test_simulated_runs_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("ompl")
    faulty = "local:\n  int x = 2\n  int y\nStep:\n  eff:\n    x = x - 1\n    y = 6 / x\n"
    Path("faulty.krd").write_text(faulty)
    schema = printed(capsys, "schema", "simulated")
    task = str(Path(__file__).parents[2] / "specs" / "examples" / "task.krd")
    for program, ending in (("holds", "limit"), ("violated", "violated"), ("faulty", "fault")):
        words = ("sim", f"{program}.krd", "--rounds", "3", "--no-html", "--json")
        found = printed(capsys, *words)
        assert found["ending"] == ending
        Draft202012Validator(schema).validate(found)
    found = printed(capsys, "sim", task, "--rounds", "2", "--no-html", "--json")
    assert found["tasks"]
    Draft202012Validator(schema).validate(found)
    for field, change in (("ending", "over"), ("robots", [{}]), ("rounds", -1)):
        assert not Draft202012Validator(schema).is_valid(found | {field: change})


def test_deployed_runs_are_as_described(capsys: pytest.CaptureFixture[str]) -> None:
    schema = printed(capsys, "schema", "deployed")
    two = koord.read_configuration(koord.Source("two.yaml", "num_robots: 2\ndelta: 0.05\n"))
    run = koord.deploy("violated.krd", two, rounds=4, as_fast_as_possible=True, trace="run.json")
    found = json.loads(run.to_json())
    assert {one["claim"] for one in found["broken"]} == {"invariant Small", "invariant Few"}
    assert found["trace"]["format"] == "koord-merged"
    assert found["robots"][0]["process"]["state"] == "over"
    Draft202012Validator(schema).validate(found)
    for field, change in (("robots", [{}]), ("trace", {}), ("stuck", 1)):
        assert not Draft202012Validator(schema).is_valid(found | {field: change})


def test_findings_on_compiled_programs_are_as_described(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    schema = printed(capsys, "schema", "refinement")
    check = ("check-refinement", "--target", "engine", "--runs", "2", "--json")
    found = printed(capsys, *check, "holds.krd")
    assert found["targets"][0]["runs"] == 2
    Draft202012Validator(schema).validate(found)
    assert not Draft202012Validator(schema).is_valid(found | {"format": "koord-protocol-check"})
    pytest.importorskip("ompl")
    words = ("check-refinement", "holds.krd", "--target", "simulator", "--runs", "1", "--json")
    (one,) = found = printed(capsys, *words)
    assert one["refused"] is None
    Draft202012Validator(schema).validate(found)
    monkeypatch.setattr(refinement, "TRIES", 0)
    monkeypatch.setattr(running, "compiled", lambda one: compiled(one).replace("+ 1", "+ 2"))
    found = printed(capsys, *check, "holds.krd")
    assert found["failure"]["rule"] is not None
    Draft202012Validator(schema).validate(found)


@pytest.mark.slow
@pytest.mark.parametrize("what", [("guardian",), ("protocol",), ("protocol", "--for-every-number")])
def test_findings_on_protocol_and_guardian_are_as_described(
    capsys: pytest.CaptureFixture[str], what: tuple[str, ...]
) -> None:
    found = printed(capsys, "check-refinement", "--json", "--runs", "1", "--target", *what)
    valid(capsys, "refinement", found)
