from __future__ import annotations

import io
import os
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from koord.cli import main as frame
from koord.cli.exits import Exit

NEAT = "local:\n    int x = 0\n\ngo:\n    pre: x < 3\n    eff: x = x + 1\n"
UNTIDY = "local:\n  int   x=0\ngo:\n  pre: (x<3)\n  eff:   x=x+1   # count\n"
BROKEN = "local:\n  int x = = 0\n"


@pytest.fixture
def untidy(tmp_path: Path) -> Path:
    path = tmp_path / "untidy.krd"
    path.write_text(UNTIDY, encoding="utf-8")
    path.chmod(0o640)
    return path


def feed(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(text.encode())))


def test_a_file_is_laid_out_in_place(
    capsysbinary: pytest.CaptureFixture[bytes], untidy: Path
) -> None:
    assert frame.main(["fmt", str(untidy)]) == Exit.OK
    assert capsysbinary.readouterr().out == f"{untidy}: laid out\n".encode()
    first = untidy.read_text(encoding="utf-8")
    assert first != UNTIDY
    assert "# count" in first
    assert stat.S_IMODE(untidy.stat().st_mode) == 0o640
    before = untidy.stat().st_mtime_ns
    assert frame.main(["fmt", str(untidy)]) == Exit.OK
    assert untidy.stat().st_mtime_ns == before
    assert capsysbinary.readouterr().out == b""
    assert os.listdir(untidy.parent) == ["untidy.krd"]


def test_check_changes_nothing(capsys: pytest.CaptureFixture[str], untidy: Path) -> None:
    assert frame.main(["fmt", "--check", str(untidy)]) == Exit.VIOLATED
    assert capsys.readouterr().out == f"{untidy}: would be laid out anew\n"
    assert untidy.read_text(encoding="utf-8") == UNTIDY
    frame.main(["fmt", str(untidy)])
    assert frame.main(["fmt", "--check", str(untidy)]) == Exit.OK


def test_diff(capsys: pytest.CaptureFixture[str], untidy: Path) -> None:
    assert frame.main(["fmt", "--diff", str(untidy)]) == Exit.OK
    shown = capsys.readouterr().out
    assert shown.startswith(f"--- {untidy}\n+++ {untidy} (laid out)\n@@ ")
    assert "\n-  int   x=0\n" in shown
    assert untidy.read_text(encoding="utf-8") == UNTIDY
    assert frame.main(["fmt", "--diff", "--check", str(untidy)]) == Exit.VIOLATED
    assert capsys.readouterr().out == shown


def test_a_diff_tells_of_a_last_line_without_its_end(
    capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    feed(monkeypatch, UNTIDY.rstrip("\n"))
    frame.main(["fmt", "--diff", "-"])
    assert b"\\ No newline at end of file" in capsysbinary.readouterr().out


def test_standard_input_goes_to_standard_output(
    capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, untidy: Path
) -> None:
    frame.main(["fmt", str(untidy)])
    capsysbinary.readouterr()
    feed(monkeypatch, UNTIDY)
    assert frame.main(["fmt", "-"]) == Exit.OK
    assert capsysbinary.readouterr().out == untidy.read_bytes()
    feed(monkeypatch, UNTIDY)
    assert frame.main(["fmt", "--check", "-"]) == Exit.VIOLATED
    assert capsysbinary.readouterr().out == b"<stdin>: would be laid out anew\n"


def test_line_ends_and_byte_order_marks_are_put_right(
    capsys: pytest.CaptureFixture[str], untidy: Path
) -> None:
    frame.main(["fmt", str(untidy)])
    neat = untidy.read_bytes()
    untidy.write_bytes(b"\xef\xbb\xbf" + neat.replace(b"\n", b"\r\n"))
    capsys.readouterr()
    assert frame.main(["fmt", "--diff", "--check", str(untidy)]) == Exit.VIOLATED
    assert "only line ends or a byte-order mark would change" in capsys.readouterr().out
    assert frame.main(["fmt", str(untidy)]) == Exit.OK
    assert untidy.read_bytes() == neat


def test_a_file_with_errors_is_left_alone_and_hides_no_other(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, untidy: Path
) -> None:
    broken = tmp_path / "broken.krd"
    broken.write_text(BROKEN, encoding="utf-8")
    assert frame.main(["fmt", str(broken), f"{tmp_path}/none.krd", str(untidy)]) == Exit.BAD_INPUT
    streams = capsys.readouterr()
    assert streams.out == f"{untidy}: laid out\n"
    assert f"{broken}:2:11: error K1" in streams.err
    assert "none.krd: error K901" in streams.err
    assert broken.read_text(encoding="utf-8") == BROKEN
    assert untidy.read_text(encoding="utf-8") != UNTIDY


def test_standard_input_with_errors_yields_nothing(
    capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    feed(monkeypatch, BROKEN)
    assert frame.main(["fmt", "-"]) == Exit.BAD_INPUT
    streams = capsysbinary.readouterr()
    assert streams.out == b""
    assert b"<stdin>:2:11: error K1" in streams.err


def test_letters_outside_of_ascii_stay(
    capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    feed(monkeypatch, NEAT + "# größer ≤ 日本\n")
    assert frame.main(["fmt", "-"]) == Exit.OK
    assert "# größer ≤ 日本".encode() in capsysbinary.readouterr().out
