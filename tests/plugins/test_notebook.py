"""Notebooks: the magic does what commands do, and results show themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import koord

interactiveshell = pytest.importorskip("IPython.core.interactiveshell")
traitlets = pytest.importorskip("traitlets.config")

COUNTER = """\
local:
  int x = 0
Step:
  pre: x < 9
  eff: x = x + 1
invariant Low: forall i: x@i >= 0
"""
BROKEN = COUNTER + "invariant Small: forall i: x@i < 2\n"
UNKNOWN = """\
local:
  int x = 0
Step:
  eff: x = x + 2
invariant Odd: forall i: x@i != 91
"""


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A notebook's shell in which koord is loaded."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    # Its history has a thread that nobody ends, and robots' planners are not forked beside threads.
    made = interactiveshell.InteractiveShell(
        config=traitlets.Config({"HistoryManager": {"enabled": False}})
    )
    made.run_cell("%load_ext koord")
    yield made
    made.restore_sys_module_state()


def run(shell: Any, cell: str) -> Any:
    """The result of a cell, which must not fail."""
    done = shell.run_cell(cell)
    assert done.error_before_exec is None
    assert done.error_in_exec is None
    return done.result


def html(shell: Any, found: object) -> str:
    """What the notebook shows of a result, in which every tag is closed."""
    shown, _ = shell.display_formatter.format(found)
    text: str = shown["text/html"]

    class Tags(HTMLParser):
        open_: list[str] = []  # noqa: RUF012

        def handle_starttag(self, tag: str, attrs: object) -> None:
            self.open_.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert self.open_.pop() == tag

    tags = Tags()
    tags.open_ = []
    tags.feed(text)
    assert tags.open_ == []
    return text


def words(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text))


def test_a_cell_is_verified(shell: Any) -> None:
    found = run(shell, f"%%koord verify --robots 2 --rounds 4 --jobs 1\n{COUNTER}")
    assert isinstance(found, koord.VerifyReport)
    assert found.holds
    assert found.problem.name == "cell.krd"
    assert found.system.robots == 2
    assert "Low holds in every round" in words(html(shell, found))


@pytest.mark.slow
def test_verification_is_what_is_done_unless_something_else_is_said(shell: Any) -> None:
    assert run(shell, f"%%koord --robots 2 --rounds 4\n{COUNTER}").holds
    assert run(shell, f"%%koord\n{COUNTER}").system.robots == 3


def test_a_violation_is_shown_with_its_run(shell: Any) -> None:
    found = run(shell, f"%%koord --robots 2 --rounds 4 --as broken --name small.krd\n{BROKEN}")
    assert shell.user_ns["broken"] is found
    text = html(shell, found)
    assert '<b style="color: #d0403f">violated</b>' in text
    assert "<details><summary>a run that breaks Small</summary>" in text
    assert "Small is false for i = " in words(text)
    assert "x@1: 1 → 2" in words(text) or "x@0: 1 → 2" in words(text)
    assert "[PROP-INVARIANT]" in words(text)
    small = html(shell, run(shell, "broken.verdict('Small')"))
    assert small.startswith('<iframe title="Small: ')
    assert "Low: holds" in words(html(shell, found.verdict("Low")))


def test_what_is_unknown_or_vacuous_is_shown_as_that(shell: Any) -> None:
    bounds = "--engine induction --robots 2 --rounds 4"
    found = run(shell, f"%%koord verify {bounds}\n{UNKNOWN}")
    text = html(shell, found)
    assert '<b style="color: #b8860b">unknown</b>' in text
    assert found.verdict("Odd").reason in words(text)
    idle = COUNTER + "Never:\n  pre: x < 0\n  eff: x = 7\n"
    text = html(shell, run(shell, f"%%koord verify --robots 2\n{idle}"))
    assert "verdicts say less than they seem to: Never" in words(text)


def test_a_cell_is_checked_run_and_simulated(shell: Any) -> None:
    wrong = COUNTER.replace("x + 1", "y + 1")
    found = run(shell, f"%%koord check\n{wrong}")
    assert [one.code for one in found.errors] == ["K201"]
    assert "K201" in html(shell, found)
    assert run(shell, f"%%koord check\n{COUNTER}").program is not None
    ran = run(shell, f"%%koord run --robots 2 --rounds 3\n{COUNTER}")
    assert (ran.rounds, ran.trace.robots) == (3, 2)
    assert "x@0: 0 → 1" in words(html(shell, ran))
    pytest.importorskip("ompl")
    simulated = run(shell, f"%%koord sim --robots 2 --time 1\n{COUNTER}")
    assert len(simulated.figures.robots) == 2
    assert "<iframe" in html(shell, simulated)


def test_a_program_with_mistakes_is_shown_with_them(shell: Any) -> None:
    wrong = COUNTER.replace("x + 1", "<y>")
    for command in ("verify", "run"):
        found = run(shell, f"%%koord {command}\n{wrong}")
        assert isinstance(found, koord.CheckReport)
        assert found.errors
        assert "<y>" not in html(shell, found)
    found = run(shell, "%%koord verify\ninvariant Low: 1 < 2\n")
    assert found.program is None


def test_a_line_is_about_a_file(shell: Any, tmp_path: Path) -> None:
    (tmp_path / "a.krd").write_text("param int most = 9\n" + COUNTER.replace("9", "most"))
    (tmp_path / "more.krd").write_text("invariant More: forall i: x@i <= 2\n")
    found = run(shell, "%koord verify a.krd --with more.krd --set most=2 --robots 2 --rounds 4")
    assert found.verdict("More").holds
    assert found.program.name == "a.krd"


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("%%koord verify --robots no\n" + COUNTER, "argument --robots"),
        ("%%koord verify --robots 2..3\n" + COUNTER, "a cell is about one number of robots"),
        ("%%koord verify --json\n" + COUNTER, "unrecognized arguments: --json"),
        ("%%koord verify --help\n" + COUNTER, "--help is for the command line"),
        ("%%koord verify --as a-b\n" + COUNTER, "'a-b' is no name of a variable"),
        ("%%koord verify 'open\n" + COUNTER, "No closing quotation"),
        ("%%koord verify --property Lo\n" + COUNTER, "Lo"),
        ("%koord verify missing.krd", "missing.krd: error K901"),
        ("%koord verify", "the following arguments are required: file"),
    ],
)
def test_mistakes_in_the_line_are_told_without_a_traceback(
    shell: Any, cell: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    done = shell.run_cell(cell)
    assert type(done.error_in_exec).__name__ == "UsageError"
    heard = capsys.readouterr()
    assert "UsageError" in heard.err
    assert said in heard.err
    assert "Traceback" not in heard.out + heard.err


def test_nothing_of_a_program_is_markup(shell: Any) -> None:
    found = run(shell, f"%%koord verify --name <b>.krd --robots 2 --rounds 2\n{COUNTER}")
    assert "<b>.krd" not in html(shell, found)
    assert "&lt;b&gt;.krd" in html(shell, found)
