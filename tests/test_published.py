"""`python -m tests.published FOLDER` tells what becomes of programs, and finds mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.api import migrate as migrating
from tests import published
from tests.published import Outcome, judged, main

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
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_what_becomes_of_a_program(tmp_path: Path, name: str) -> None:
    text, outcome, codes = PROGRAMS[name]
    (tmp_path / name).write_text(text, encoding="utf-8")
    found = judged(tmp_path / name)
    assert (found.outcome, found.codes) == (outcome, codes)


def test_a_folder_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "inner").mkdir()
    for name, (text, _, _) in PROGRAMS.items():
        (tmp_path / "inner" / name).write_text(text, encoding="utf-8")
        (tmp_path / f"again_{name}").write_text(text, encoding="utf-8")
    (tmp_path / "notes.txt").write_text("E:\n", encoding="utf-8")
    assert main([str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "\n   2  migrated\n   1  rejected\n   0  a mistake of koord\n   5  programs\n" in out


def test_mistakes_of_koord_are_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "old.krd").write_text(PROGRAMS["old.koord"][0], encoding="utf-8")
    monkeypatch.setattr(published, "load", lambda source: 1 // 0)
    assert main([str(tmp_path)]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().out
    monkeypatch.undo()
    monkeypatch.setattr(migrating, "_MOST_PASSES", 0)
    assert judged(tmp_path / "old.krd").outcome is Outcome.ACCEPTED  # nothing is brought over


def test_without_a_folder_nothing_is_told(tmp_path: Path) -> None:
    assert main([]) == 2
    assert main([str(tmp_path / "none")]) == 2
    assert main([str(tmp_path)]) == 2
