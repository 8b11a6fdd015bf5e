"""``--sarif FILE``: what the standard's schema allows, with places, runs and cures."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator, validators

import koord
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.cli.progress import LiveLine
from koord.syntax.catalogue import of_programs
from tests.cli.test_schema import PROGRAMS

#: Where `.ci/peers` puts a package that has the schema of the standard.
CACHE = Path(os.environ.get("XDG_CACHE_HOME", "") or Path.home() / ".cache")
OFFICIAL = CACHE / "koord/sarif/package/lib/schemas/sarif-2.1.0-rtm.5.json"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in PROGRAMS.items():
        Path(f"{name}.krd").write_text(text, encoding="utf-8")
    return tmp_path


def check_form(log: Any) -> None:
    """What koord says that it writes; and what the standard allows, where its schema is here."""
    Draft202012Validator(koord.schema("sarif")).validate(log)
    if OFFICIAL.is_file():
        standard = json.loads(OFFICIAL.read_text(encoding="utf-8"))
        validators.validator_for(standard)(standard).validate(log)


def written(code: Exit, *words: str) -> Any:
    """The run in the log that a command writes."""
    assert main([*words, "--sarif", "log.sarif"]) == code
    log = json.loads(Path("log.sarif").read_text(encoding="utf-8"))
    check_form(log)
    (run,) = log["runs"]
    rules = run["tool"]["driver"]["rules"]
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
    assert len({rule["id"] for rule in rules}) == len(rules)
    return run


def verified(code: Exit, *words: str) -> Any:
    return written(code, "verify", *words, "--rounds", "4", "--jobs", "1")


def places(locations: list[Any]) -> list[tuple[str, int | None]]:
    """The files and lines of locations; no line where a file as a whole is meant."""
    found = []
    for one in locations:
        place = one["physicalLocation"]
        line = place["region"]["startLine"] if "region" in place else None
        found.append((place["artifactLocation"]["uri"], line))
    return found


def test_the_standard_allows_what_koord_says_that_it_writes() -> None:
    if not OFFICIAL.is_file():
        pytest.skip("`.ci/peers` puts the schema of SARIF where it is looked for")
    standard = json.loads(OFFICIAL.read_text(encoding="utf-8"))
    run = standard["definitions"]["run"]["properties"]
    own = koord.schema("sarif")["$defs"]
    assert set(own["Run"]["properties"]) <= set(run)
    assert set(own["Result"]["properties"]) <= set(standard["definitions"]["result"]["properties"])
    assert not Draft202012Validator(standard).is_valid({"version": "2.1.0"})


def test_every_diagnostic_has_its_place_its_rule_and_its_cure(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are those of ``--json``; the log is of all programs of the catalogue."""
    files = []
    for code, story in of_programs().items():
        files.append(f"{code}.krd")
        Path(files[-1]).write_text(story.bad, encoding="utf-8")
    run = written(Exit.BAD_INPUT, "check", "--json", *files)
    told = json.loads(capsys.readouterr().out)["diagnostics"]
    assert len(run["results"]) == len(told) > len(files) - 1
    cures = 0
    for result, one in zip(run["results"], told, strict=True):
        assert (result["ruleId"], result["level"]) == (one["code"], one["severity"])
        assert result["message"]["text"].startswith(one["message"])
        assert (one["hint"] or "") in result["message"]["text"]
        (place,) = [each["physicalLocation"] for each in result["locations"]]
        assert place["artifactLocation"]["uri"] == one["file"]
        region, span = place["region"], one["span"]
        assert [region[key] for key in ("startLine", "startColumn", "endLine", "endColumn")] == [
            span[key] for key in ("line", "column", "end_line", "end_column")
        ]
        assert len(result.get("relatedLocations", ())) == len(one["notes"])
        if one["edits"]:
            cures += 1
            ((change,),) = [fix["artifactChanges"] for fix in result["fixes"]]
            made = [each["insertedContent"]["text"] for each in change["replacements"]]
            assert made == [edit["text"] for edit in one["edits"]]
        else:
            assert "fixes" not in result
    assert cures > 0
    for rule in run["tool"]["driver"]["rules"]:
        story = koord.explain(rule["id"])
        assert rule["shortDescription"]["text"] == story.title
        assert story.good in rule["help"]["markdown"]


def test_a_violation_is_a_flow_through_the_text(capsys: pytest.CaptureFixture[str]) -> None:
    run = verified(Exit.VIOLATED, "violated.krd", "--robots", "2")
    assert "violated: 2 of 3 claims" in capsys.readouterr().out, "the verdicts are shown as well"
    small, few = run["results"]
    assert (small["ruleId"], small["kind"], small["level"]) == ("PROP-INVARIANT", "fail", "error")
    assert "Small is false for i = " in small["message"]["text"]
    assert "in round 2, after program turns; violated.krd: 2 robots" in small["message"]["text"]
    lines = PROGRAMS["violated"].splitlines()
    at = 1 + next(n for n, line in enumerate(lines) if "Small" in line)
    assert places(small["locations"]) == [("violated.krd", at)]
    assert small["locations"][0]["logicalLocations"][0]["name"] == "Small"
    (flow,) = small["codeFlows"]
    steps = flow["threadFlows"][0]["locations"]
    assert [step["executionOrder"] for step in steps] == list(range(len(steps)))
    said = [step["location"]["message"]["text"] for step in steps]
    assert said[0] == "the start: x@0 = 0, x@1 = 0"
    step = 1 + lines.index("Step:")
    through = places([each["location"] for each in steps])
    assert through[0] == ("violated.krd", None)
    assert set(through[1:-1]) == {("violated.krd", step)}
    assert through[-1] == ("violated.krd", at)
    assert [one["importance"] for one in steps].index("essential") == len(steps) - 1
    assert any("runs Step: x: 0 → 1" in one for one in said)
    assert len(few["codeFlows"][0]["threadFlows"][0]["locations"]) > len(steps)


@pytest.mark.slow
def test_each_way_to_break_a_claim_is_a_flow() -> None:
    leap = "Leap:\n  pre: x < 9\n  eff: x = x + 2\nassume:"
    Path("ways.krd").write_text(PROGRAMS["violated"].replace("assume:", leap), encoding="utf-8")
    run = verified(Exit.VIOLATED, "ways.krd", "--robots", "1", "--max-violations", "2")
    assert [len(one["codeFlows"]) for one in run["results"]] == [2, 2]


def test_a_run_without_end_says_from_where_it_repeats() -> None:
    run = verified(Exit.VIOLATED, "live.krd", "--robots", "1")
    (ten,) = run["results"]
    assert ten["ruleId"] == "PROP-EVENTUALLY"
    assert "in a run without end" in ten["message"]["text"]
    assert "its rounds repeat for ever" in ten["codeFlows"][0]["message"]["text"]


def test_what_holds_is_no_result() -> None:
    run = verified(Exit.OK, "holds.krd", "--robots", "1..2")
    assert run["results"] == []
    assert run["invocations"] == [{"executionSuccessful": True}]


def test_what_is_unknown_is_open_and_what_is_vacuous_a_warning() -> None:
    run = verified(Exit.UNKNOWN, "unknown.krd", "--engine", "induction", "--robots", "2")
    (odd,) = [one for one in run["results"] if one["kind"] == "open"]
    assert odd["level"] == "none"
    assert odd["message"]["text"].startswith("Odd is unknown for unknown.krd")
    run = verified(Exit.VACUOUS, "vacuous.krd")
    assert {(one["ruleId"], one["level"]) for one in run["results"]} == {("VACUOUS", "warning")}
    at = 1 + (PROGRAMS["vacuous"].splitlines().index("Never:"))
    assert ("vacuous.krd", at) in [places(one["locations"])[0] for one in run["results"]]


def test_mistakes_in_a_program_are_results_of_a_verification() -> None:
    run = verified(Exit.BAD_INPUT, "wrong.krd")
    (one,) = run["results"]
    assert one["ruleId"].startswith("K2")


@pytest.mark.slow
def test_an_interrupted_verification_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def press(line: LiveLine, text: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(LiveLine, "show", press)
    run = verified(Exit.INTERRUPTED, "unknown.krd")
    assert run["invocations"] == [{"executionSuccessful": False}]


def test_names_of_files_are_addresses(folder: Path) -> None:
    Path("my drones ü.krd").write_text(PROGRAMS["wrong"], encoding="utf-8")
    run = written(Exit.BAD_INPUT, "check", "my drones ü.krd")
    assert places(run["results"][0]["locations"])[0][0] == "my%20drones%20%C3%BC.krd"
    run = written(Exit.BAD_INPUT, "check", str(folder / "wrong.krd"))
    assert places(run["results"][0]["locations"])[0][0] == (folder / "wrong.krd").as_uri()


@pytest.mark.parametrize("command", ["check", "verify"])
@pytest.mark.parametrize(
    ("file", "why"), [("no/log", "there is no folder"), ("holds.krd", "read by the same command")]
)
def test_where_it_cannot_be_written_is_told_at_once(
    command: str, file: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "holds.krd", "--sarif", file]) == Exit.BAD_INPUT
    assert why in capsys.readouterr().err
    assert Path("holds.krd").read_text() == PROGRAMS["holds"]


def test_the_api_makes_one_log_of_several_reports() -> None:
    checked = koord.check("wrong.krd")
    report = koord.verify("violated.krd", robots=2, rounds=4, jobs=1)
    log: Any = koord.sarif(checked, report)
    check_form(log)
    assert len(log["runs"][0]["results"]) == 3
