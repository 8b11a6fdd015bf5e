from __future__ import annotations

import pytest

from koord.cli import main as frame
from koord.cli.exits import Exit
from koord.cli.explain import WIDEST, story
from koord.cli.terminal import Style, cells
from koord.syntax.catalogue import entries


def test_a_code_is_explained_whatever_its_case(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["explain", "k204"]) == Exit.OK
    shown = capsys.readouterr().out
    assert shown.startswith("error K204: ")
    assert "This is refused:\n\n    " in shown
    assert "This is right:\n\n    " in shown


def test_without_a_code_all_are_listed_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["explain"]) == Exit.OK
    codes = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert codes == list(entries())
    assert {"K204", "K901", "K904"} <= set(codes)


def test_a_near_miss_names_its_neighbours(capsys: pytest.CaptureFixture[str]) -> None:
    assert frame.main(["explain", "K2004"]) == Exit.BAD_INPUT
    assert "there is no code 'K2004'; there are K20" in capsys.readouterr().err
    assert frame.main(["explain", "everything"]) == Exit.BAD_INPUT
    assert "`koord explain` lists all codes" in capsys.readouterr().err


@pytest.mark.parametrize("code", entries())
def test_every_story_fits_the_page(code: str) -> None:
    entry = entries()[code]
    assert entry.code == code
    lines = list(story(entry, Style(width=200)))
    assert len(lines) > 2
    prose = [line for line in lines if not line.startswith("    ")]
    assert all(cells(line) <= WIDEST for line in prose)
