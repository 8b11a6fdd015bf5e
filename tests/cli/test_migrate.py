"""`koord migrate`: what it shows, what it writes, how it ends."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from koord.cli import main as frame
from koord.cli.exits import Exit

OLD = "local\n  int n = numBots  # all\nE:\n  pre (n < 3);\n  eff: n = 3\n"
NOW = "local:\n  int n = numAgents  # all\nE:\n  pre: (n < 3)\n  eff: n = 3\n"


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "old.krd"
    path.write_text(OLD, encoding="utf-8")
    return path


@pytest.mark.parametrize("flags", [(), ("--diff",)])
def test_the_difference_is_shown_and_explained(
    capsys: pytest.CaptureFixture[str], old: Path, flags: tuple[str, ...]
) -> None:
    assert frame.main(["migrate", *flags, str(old)]) == Exit.OK
    out = capsys.readouterr().out
    assert out.startswith(f"--- {old}\n+++ {old} (today)\n@@ ")
    assert "\n-  int n = numBots  # all\n" in out
    assert "\n+  int n = numAgents  # all\n" in out
    assert f"\n{old}:2:11: `numBots` is the old name of `numAgents`: write `numAgents`\n" in out
    assert out.endswith(f"{old}: 3 old forms to be brought over\n")
    assert old.read_text(encoding="utf-8") == OLD


def test_files_are_changed_and_then_stay(capsys: pytest.CaptureFixture[str], old: Path) -> None:
    assert frame.main(["migrate", "--write", str(old)]) == Exit.OK
    out = capsys.readouterr().out
    assert "---" not in out
    assert out.endswith(f"{old}: 3 old forms brought over\n")
    assert old.read_text(encoding="utf-8") == NOW
    before = old.stat().st_mtime_ns
    assert frame.main(["migrate", "--write", str(old)]) == Exit.OK
    assert capsys.readouterr().out == f"{old}: nothing to bring over\n"
    assert old.stat().st_mtime_ns == before


def test_standard_input_is_written_to_standard_output(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(OLD.encode())))
    assert frame.main(["migrate", "--write", "-"]) == Exit.OK
    streams = capsys.readouterr()
    assert streams.out == NOW
    assert "<stdin>: 3 old forms brought over\n" in streams.err


def test_line_ends_stay_as_they_are(old: Path) -> None:
    old.write_bytes(OLD.replace("\n", "\r\n").encode())
    assert frame.main(["migrate", "--write", str(old)]) == Exit.OK
    assert old.read_bytes() == NOW.replace("\n", "\r\n").encode()


def test_stubs_are_written_if_they_are_asked_for(
    capsys: pytest.CaptureFixture[str], old: Path
) -> None:
    old.write_text("E:\n  eff: hello()\n", encoding="utf-8")
    assert frame.main(["migrate", str(old)]) == Exit.BAD_INPUT
    assert "`koord migrate --stub` writes that" in capsys.readouterr().err
    assert frame.main(["migrate", "--stub", "--write", str(old)]) == Exit.OK
    assert "def fun hello() -> bool: extern fresh\n" in old.read_text(encoding="utf-8")


def test_what_is_left_is_told_with_its_line(capsys: pytest.CaptureFixture[str], old: Path) -> None:
    old.write_text(OLD.replace("n = 3", "n = tsak"), encoding="utf-8")
    assert frame.main(["migrate", "--write", str(old)]) == Exit.BAD_INPUT
    assert f"{old}:5:12: error K201" in capsys.readouterr().err
    assert old.read_text(encoding="utf-8") == NOW.replace("n = 3", "n = tsak")


def test_a_file_that_cannot_be_read_leaves_the_others_as_they_are(
    capsys: pytest.CaptureFixture[str], old: Path
) -> None:
    missing = str(old.parent / "none.krd")
    assert frame.main(["migrate", "--write", str(old), missing]) == Exit.BAD_INPUT
    assert "K901" in capsys.readouterr().err
    assert old.read_text(encoding="utf-8") == OLD


def test_the_document_has_every_file(capsys: pytest.CaptureFixture[str], old: Path) -> None:
    assert frame.main(["migrate", "--json", str(old), str(old)]) == Exit.OK
    document = json.loads(capsys.readouterr().out)
    assert document["version"] == 1
    assert [file["text"] for file in document["files"]] == [NOW, NOW]
    assert [step["code"] for step in document["files"][0]["steps"]] == ["K407"] * 3
