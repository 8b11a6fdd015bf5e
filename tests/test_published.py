"""`python -m tests.published FOLDER` tells what becomes of files, and finds mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from koord.api import migrate as migrating
from koord.syntax.source import Source
from tests.published import documents, expected, programs, runs
from tests.published.__main__ import main
from tests.published.programs import Outcome, judged

PROGRAMS = {
    "good.krd": ("E:\n  eff: stop\n", Outcome.ACCEPTED, ()),
    "old.koord": ("local\n  int n = numBots\nE:\n  eff: n = 1\n", Outcome.WARNED, ("K407",)),
    "calls.krd": ("E:\n  eff: hello()\n", Outcome.MIGRATED, ("K202",)),
    "starts.krd": (
        "using Heater:\n  sensors: float heat\ninit: heat = 3.5\nE:\n  eff: stop\n",
        Outcome.MIGRATED,
        ("K213",),
    ),
    "bad.krd": ("E:\n  eff: n = true + 1\n", Outcome.REJECTED, ("K201", "K229")),
    "src_badtype-0a1b2c.koord": ("local:\n  int n = true\n", Outcome.BAD, ("K204",)),
    "badscope.krd": ("local:\n  int n = true\n", Outcome.REJECTED, ("K204",)),
    "badfile.krd": ("Nothing:\n  eff: stop\n", Outcome.REJECTED, ()),
}

#: A robot goes somewhere, and stops there.
GOES = """\
using Motion:
  sensors:
    pos position
    bool reached
  actuators: pos target
local: int step = 0
Go:
  pre: step == 0
  eff:
    step = 1
    Motion.target = pos(1.0 + pid, 2.0, 1.0)
End:
  pre: step == 1 and Motion.reached
  eff: stop
"""

DOCUMENTS = {
    "fleet.global.yml": (
        "agents: [{pid: 1, on_device: drone0, plist: [2]}, {pid: 2, on_device: drone1}]\n"
        "devices:\n  drone0: {bot_type: QUAD, planner: SimplePlanner}\n"
        "  drone1: {bot_type: QUAD, planner: SimplePlanner}\n",
        Outcome.WARNED,
        ("K938", "K949"),
    ),
    "scene.yml": (
        "- {bot_name: drone0, bot_type: QUAD, init_pos: [0, 0, 30]}\n"
        "- {bot_name: drone1, bot_type: QUAD, init_pos: [3, 0, 30]}\n",
        Outcome.SCENE,
        (),
    ),
    "planes.yaml": (
        "- {bot_name: p, bot_type: PLANE, init_pos: [0, 0, 9]}\n",
        Outcome.SCENE,
        ("K931",),
    ),
    "ci.yml": ("language: java\njdk: openjdk12\n", Outcome.OTHER, ("K953",)),
    "bad.yml": ("devices: {drone: {wings: 4}}\n", Outcome.REJECTED, ("K931",)),
    "zero_agents.global-0a1b2c.yml": ("agents: []\ndevices: []\n", Outcome.BAD, ("K931",)),
    "acas_0_0_0.yml": ("agents: []\ndevices: []\n", Outcome.REJECTED, ("K931",)),
}


def written(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", PROGRAMS)
def test_what_becomes_of_a_program(tmp_path: Path, name: str) -> None:
    text, outcome, codes = PROGRAMS[name]
    found = judged(written(tmp_path, name, text))
    assert (found.outcome, found.codes) == (outcome, codes)
    assert (found.source is not None) == (
        outcome in (Outcome.ACCEPTED, Outcome.WARNED, Outcome.MIGRATED)
    )


def test_programs_of_before_the_grammar_are_known_by_their_digests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "bad.krd", PROGRAMS["bad.krd"][0])
    monkeypatch.setitem(expected.OLDER_PROGRAMS, "664276df", "for this test")
    assert judged(path).outcome is Outcome.OLDER
    path.write_text(PROGRAMS["bad.krd"][0] + "\n", encoding="utf-8")
    assert judged(path).outcome is Outcome.REJECTED


@pytest.mark.parametrize("name", DOCUMENTS)
def test_what_becomes_of_a_document(tmp_path: Path, name: str) -> None:
    text, outcome, codes = DOCUMENTS[name]
    found = documents.judged(written(tmp_path, name, text))
    assert (found.finding.outcome, found.finding.codes) == (outcome, codes)


@pytest.mark.slow
def test_a_program_that_moves_is_simulated_with_the_configurations_of_its_folder(
    tmp_path: Path,
) -> None:
    program = judged(written(tmp_path / "own", "goes.krd", GOES))
    found = [
        documents.judged(written(tmp_path / folder, name, DOCUMENTS[name][0]))
        for folder, name in (
            ("own", "fleet.global.yml"),
            ("own", "scene.yml"),
            ("other", "ci.yml"),
        )
    ]
    done = runs.ran(program, found)
    assert done.trouble == ""
    assert done.runs >= runs.RUNS
    (simulated,) = done.simulations
    assert (simulated.configuration, simulated.scene) == ("fleet.global.yml", "scene.yml")
    assert (simulated.robots, simulated.ending) == (2, "all robots have stopped")
    assert "1 × all robots have stopped" in str(done)
    # without a scene they begin in rows, by the pids of the file
    (alone,) = runs.ran(program, found[:1]).simulations
    assert (alone.scene, alone.ending) == ("", "all robots have stopped")
    # without a configuration, on what suits
    (plain,) = runs.ran(program, ()).simulations
    assert (plain.configuration, plain.standing) == ("", ("above_ground",))


def test_faults_of_programs_are_theirs(tmp_path: Path) -> None:
    text = GOES.replace("step = 1\n", "step = 1 / (pid - pid)\n")
    done = runs.ran(judged(written(tmp_path, "faults.krd", text)), ())
    assert done.trouble == ""
    assert done.faults == done.runs
    assert done.simulations[0].fault == "division by zero of robot 0"


def test_a_folder_is_counted_and_told_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "inner"
    for name, (text, _, _) in {**PROGRAMS, **DOCUMENTS}.items():
        written(folder, name, text)
        written(folder, f"x{name}", text)  # equal files count once
    written(folder, "notes.txt", "E:\n")
    assert main([str(tmp_path), "--json", str(tmp_path / "found.json")]) == 1
    out = capsys.readouterr().out
    assert "\n       2      0  migrated\n" in out
    assert "\n       0      2  a scene\n" in out
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert not found["ok"]
    assert len(found["ran"]) == 4
    outcomes = {one["file"]: one["outcome"] for one in found["documents"]}
    assert outcomes["scene.yml"] == "a scene"


def test_all_is_well_if_files_became_what_they_should(tmp_path: Path) -> None:
    for name in ("good.krd", "src_badtype-0a1b2c.koord"):
        written(tmp_path, name, PROGRAMS[name][0])
    written(tmp_path, "scene.yml", DOCUMENTS["scene.yml"][0])
    assert main([str(tmp_path)]) == 0


def test_mistakes_of_koord_are_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "old.krd", PROGRAMS["old.koord"][0])
    monkeypatch.setattr(programs, "load", lambda source: 1 // 0)
    assert main([str(tmp_path)]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().out
    monkeypatch.undo()
    monkeypatch.setattr(runs, "_ran", lambda finding, documents: 1 // 0)
    assert main([str(tmp_path)]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().out
    monkeypatch.undo()
    monkeypatch.setattr(migrating, "_MOST_PASSES", 0)
    assert judged(path).outcome is Outcome.ACCEPTED  # nothing is brought over


def test_after_ctrl_c_it_tells_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(path: Path) -> documents.Document:
        raise KeyboardInterrupt

    written(tmp_path, "good.krd", PROGRAMS["good.krd"][0])
    written(tmp_path, "scene.yml", DOCUMENTS["scene.yml"][0])
    monkeypatch.setattr(documents, "judged", interrupted)
    assert main([str(tmp_path), "--json", str(tmp_path / "found.json")]) == 130
    assert "\n       1      0  accepted\n" in capsys.readouterr().out
    assert json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["interrupted"]


def test_without_a_folder_nothing_is_told(tmp_path: Path) -> None:
    assert main([]) == 2
    assert main([str(tmp_path / "none")]) == 2
    assert main([str(tmp_path)]) == 2


def test_programs_are_those_that_are_judged(tmp_path: Path) -> None:
    """What becomes of a program is said of the text that runs."""
    finding = judged(written(tmp_path, "old.krd", PROGRAMS["old.koord"][0]))
    assert finding.source == Source(
        str(finding.path), "local:\n  int n = numAgents\nE:\n  eff: n = 1\n"
    )
