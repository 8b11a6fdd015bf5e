from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from jsonschema import Draft202012Validator

from koord.cli import main as frame
from koord.cli.exits import Exit

ROOT = Path(__file__).resolve().parents[2]

GOOD = "local:\n  int x = 0\ngo:\n  pre: x < 3\n  eff: x = x + 1\n"
BAD = "local:\n  int x = 0\ngo:\n  pre: x < 3\n  eff:\n    x = tsak\n    y = 1\n"
SCHEMA = ROOT / "koord" / "api" / "schemas" / "diagnostics.schema.json"


@pytest.fixture
def good(tmp_path: Path) -> str:
    path = tmp_path / "good.krd"
    path.write_text(GOOD, encoding="utf-8")
    return str(path)


@pytest.fixture
def bad(tmp_path: Path) -> str:
    path = tmp_path / "bad.krd"
    path.write_text(BAD, encoding="utf-8")
    return str(path)


def test_a_good_program(capsys: pytest.CaptureFixture[str], good: str) -> None:
    assert frame.main(["check", good]) == Exit.OK
    streams = capsys.readouterr()
    assert streams.out == "1 file checked: no errors\n"
    assert streams.err == ""


def test_every_error_is_shown_with_its_line(
    capsys: pytest.CaptureFixture[str], good: str, bad: str
) -> None:
    assert frame.main(["check", good, bad]) == Exit.BAD_INPUT
    streams = capsys.readouterr()
    assert f"{bad}:6:9: error K2" in streams.out
    assert "\n  6 |     x = tsak\n    |         ^^^^\n" in streams.out
    assert f"{bad}:7:5: error K2" in streams.out
    assert streams.out.endswith("\n2 errors\n")
    assert streams.err == ""


def test_a_file_that_cannot_be_read_does_not_hide_the_others(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bad: str
) -> None:
    assert frame.main(["check", f"{tmp_path}/none.krd", str(tmp_path), bad]) == Exit.BAD_INPUT
    out = capsys.readouterr().out
    assert f"{tmp_path}/none.krd: error K901: cannot be read: there is no such file\n" in out
    assert f"{tmp_path}: error K901: cannot be read: it is a folder" in out
    assert out.endswith("\n4 errors\n")


def test_json(capsys: pytest.CaptureFixture[str], good: str, bad: str) -> None:
    validator = Draft202012Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert frame.main(["check", "--json", bad]) == Exit.BAD_INPUT
    shown = json.loads(capsys.readouterr().out)
    validator.validate(shown)
    assert [entry["span"]["line"] for entry in shown["diagnostics"]] == [6, 7]
    assert frame.main(["check", "--json", good]) == Exit.OK
    shown = json.loads(capsys.readouterr().out)
    validator.validate(shown)
    assert shown["diagnostics"] == []
    assert frame.main(["check", "--json", good, "--with", "/none"]) == Exit.BAD_INPUT
    validator.validate(json.loads(capsys.readouterr().out))


def test_warnings_count_only_with_strict(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "empty.krd"
    path.write_text("# nothing yet\n", encoding="utf-8")
    assert frame.main(["check", str(path)]) == Exit.OK
    out = capsys.readouterr().out
    assert "warning K4" in out
    assert out.endswith("\n1 warning\n")
    assert frame.main(["check", "--strict", str(path)]) == Exit.BAD_INPUT
    assert capsys.readouterr().out.endswith("\n1 error\n")


def test_standard_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(BAD.encode())))
    assert frame.main(["check", "-"]) == Exit.BAD_INPUT
    assert "<stdin>:6:9: error K2" in capsys.readouterr().out


def test_params_are_set(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "param.krd"
    path.write_text(f"param int most = 3\n{GOOD.replace('x < 3', 'x < most')}", encoding="utf-8")
    assert frame.main(["check", "--set", "most=7", str(path)]) == Exit.OK
    capsys.readouterr()
    for wrong in ("mots=7", "most=0.5", "most=[1]"):
        assert frame.main(["check", "--set", wrong, str(path)]) == Exit.BAD_INPUT
        assert "most" in capsys.readouterr().out


def test_further_properties(capsys: pytest.CaptureFixture[str], tmp_path: Path, good: str) -> None:
    properties = tmp_path / "props.krd"
    properties.write_text("invariant Small: x <= 3\ninvariant Odd: z\n", encoding="utf-8")
    assert frame.main(["check", good, "--with", str(properties)]) == Exit.BAD_INPUT
    out = capsys.readouterr().out
    assert f"{properties}:2:16: error K2" in out
    assert "  2 | invariant Odd: z\n    |                ^\n" in out
    assert out.endswith("\n1 error\n")


def test_the_same_mistake_in_shared_properties_is_told_once(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, good: str
) -> None:
    properties = tmp_path / "props.krd"
    properties.write_text("invariant Odd: z\n", encoding="utf-8")
    assert frame.main(["check", good, good, "--with", str(properties)]) == Exit.BAD_INPUT
    assert capsys.readouterr().out.endswith("\n1 error\n")
