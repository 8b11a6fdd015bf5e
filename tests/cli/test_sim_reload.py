"""``koord sim --live --reload``: what a terminal says of edits. They are data here, not files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from koord.api import edits
from koord.api.fitting import FitRequest
from koord.cli.exits import Exit
from koord.cli.main import main

COUNTING = """\
allwrite:
    int total = 0

Count:
    pre: total < 1000
    eff:
        atomic:
            total = total + 1
"""

EDITED = COUNTING.replace("int total = 0", "float total = 0.0").replace("+ 1", "+ 1.0")


class Saved(edits.ListedEdits):
    """Saves files before given rounds."""

    texts: Sequence[tuple[int, str]] = ()
    watched: Sequence[str] = ()

    def __init__(self, request: FitRequest, paths: Sequence[str]) -> None:
        super().__init__(request, self.texts)
        type(self).watched = paths

    def __enter__(self) -> Saved:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing was opened."""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(edits, "FileEdits", Saved)
    path = tmp_path / "counting.krd"
    path.write_text(COUNTING, "utf-8")
    return path


def edited(file: Path, *texts: tuple[int, str], flags: Sequence[str] = ()) -> int:
    Saved.texts = texts
    quick = ("--pace", "10000", "--rounds", "9", "--robots", "1", "--no-html")
    return main(["sim", str(file), "--live", "--reload", *quick, *flags])


def test_a_terminal_says_what_is_not_kept(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert edited(file, (4, EDITED)) == Exit.OK
    err = capsys.readouterr().err
    assert "before round 5: the program has changed; total is of another type" in err
    assert Saved.watched == [str(file)]


def test_it_asks_before_values_are_dropped(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert edited(file, (4, EDITED), (6, EDITED), flags=["--ask"]) == Exit.OK
    err = capsys.readouterr().err
    assert "error K959: the edited program would drop what is in `total`" in err
    assert "before round 5: the edited program is refused; the one before goes on" in err
    assert "before round 7: the program has changed; total is of another type" in err


def test_it_shows_mistakes_where_they_are(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert edited(file, (4, COUNTING.replace("total + 1", "totla + 1"))) == Exit.OK
    err = capsys.readouterr().err
    assert "counting.krd:8:21: error K2" in err
    assert "            total = totla + 1\n" in err
    assert "before round 5: the edited program is refused; the one before goes on" in err


def test_a_claim_that_does_not_hold_there_ends_the_run(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    claimed = COUNTING + "\ninvariant Few: total < 3\n"
    assert edited(file, (6, claimed)) == Exit.VIOLATED
    assert "broken: invariant Few, after 0.60 s" in capsys.readouterr().out
    assert edited(file, (6, claimed), (7, COUNTING), flags=["--keep-going"]) == Exit.VIOLATED
    assert "done" not in capsys.readouterr().out


def test_standard_input_is_refused(
    file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["sim", "-", "--live", "--reload"]) == Exit.BAD_INPUT
    assert "--reload needs files; standard input cannot change" in capsys.readouterr().err
