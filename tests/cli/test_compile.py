"""``koord compile``: to a file, to standard output, and what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.runtime.compile.loading import loaded

TEXT = "param int most = 3\nlocal:\n  int n = 0\nUp:\n  pre: n < most\n  eff: n = n + 1\n"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "app.krd").write_text(TEXT, "utf-8")
    return "app.krd"


def koord(*arguments: str) -> int:
    return frame.main(list(arguments))


def test_a_program_becomes_python(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert koord("compile", file) == Exit.OK
    text = capsys.readouterr().out
    assert text.startswith('"""app.krd, compiled')
    (robot,) = loaded(text)
    assert robot.__name__ == "App"
    assert [event.name for event in robot.EVENTS] == ["Up"]


def test_it_goes_into_a_file(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert koord("compile", file, "-o", "app.py", "--set", "most=5") == Exit.OK
    assert capsys.readouterr().out == ""
    text = Path("app.py").read_text("utf-8")
    assert "# param most = 5" in text
    assert "self.n < 5" in text


def test_a_program_with_errors_is_not_compiled(
    file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(file).write_text("local:\n  int n = true\n", "utf-8")
    assert koord("compile", file, "-o", "app.py") == Exit.BAD_INPUT
    assert "K204" in capsys.readouterr().err
    assert not Path("app.py").exists()


def test_a_file_that_cannot_be_written_is_told_first(
    file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert koord("compile", file, "-o", "nowhere/app.py") == Exit.BAD_INPUT
    assert "K903" in capsys.readouterr().err


def test_a_file_of_properties_is_no_program(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(file).write_text("invariant: true\n", "utf-8")
    assert koord("compile", file) == Exit.BAD_INPUT
    assert "K904" in capsys.readouterr().err
