"""``--html``: pages of verifications, runs, replays and refused runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from koord.cli.main import main
from tests.api.test_story_page import data_of
from tests.loading import EXAMPLES

EARLY = str(EXAMPLES / "broken" / "leader_elect_early.krd")
WHOLE = str(EXAMPLES / "leader_elect.krd")


def shown(path: Path) -> dict[str, Any]:
    return data_of(path.read_text("utf-8"))


def test_verify_shows_all_programs_on_one_page(tmp_path: Path) -> None:
    page = tmp_path / "all.html"
    assert main(["verify", EARLY, WHOLE, "--html", str(page), "--jobs", "1"]) == 1
    data = shown(page)
    reports = data["verifications"]
    assert [one["report"]["outcome"] for one in reports] == ["violated", "holds"]
    assert [one["title"] for one in data["stories"]] == ["Agree"]


def test_run_shows_its_turns(tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    assert main(["run", WHOLE, "--rounds", "4", "--html", str(page)]) == 0
    (story,) = shown(page)["stories"]
    assert story["ending"]["kind"] == "done"
    assert story["moments"][-1]["round"] == 4


def test_replay_shows_what_is_legal_and_what_is_not(tmp_path: Path) -> None:
    trace, page = tmp_path / "t.json", tmp_path / "t.html"
    assert main(["run", WHOLE, "--rounds", "3", "--trace", str(trace)]) == 0
    document = json.loads(trace.read_text())
    document["run"]["rounds"][1]["after"]["store"]["allwrite"]["candidate"] = 7
    trace.write_text(json.dumps(document))
    assert main(["replay", str(trace), "--html", str(page)]) == 1
    (story,) = shown(page)["stories"]
    ending = story["ending"]
    assert ending["kind"] == "refused"
    first = ending["differences"][0]
    assert (first["name"], first["expected"], first["found"]) == ("candidate", "1", "7")
    assert ending["expected_as"] == "by the rules"
    assert story["moments"][-1]["round"] == 2


def test_check_refinement_without_a_refused_run_has_no_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "r.html"
    flags = ["--runs", "1", "--rounds", "2", "--target", "engine", "--save", str(tmp_path)]
    assert main(["check-refinement", WHOLE, *flags, "--html", str(page)]) == 0
    assert not page.exists()
    assert "no run was refused" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["verify", "run"])
def test_a_page_that_cannot_be_written_is_told_before_any_work(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "no" / "such.html"
    assert main([command, WHOLE, "--html", str(page)]) == 2
    assert str(page) in capsys.readouterr().err
