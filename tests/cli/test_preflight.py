"""`koord deploy --arm` and `--preflight`: what people see and are asked before anything moves."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from koord.api.preflight import Check, Finding, Preflight
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.cli.preflight import Question, table
from koord.cli.terminal import PLAIN
from tests.cli.test_dry_run import CONFIG, ERRAND

ROOT = Path(__file__).parents[2]

GOOD = Check("pose", Finding.GOOD, "there")
BAD = Check("pose", Finding.BAD, "3 s old", "look at the cameras")
OPEN = Check("others", Finding.PENDING, "not heard of: 1")


@pytest.fixture
def run(tmp_path: Path) -> list[str]:
    """A program and a configuration with a driver."""
    program, configuration = tmp_path / "errand.krd", tmp_path / "errand.yaml"
    program.write_text(ERRAND, encoding="utf-8")
    configuration.write_text(CONFIG.replace("CAR,", "CAR, driver: sim,"), encoding="utf-8")
    return ["deploy", str(program), str(configuration), "--all-local"]


def test_without_a_terminal_the_answer_has_to_be_given_in_advance(
    run: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-PREFLIGHT)"""
    assert main([*run, "--arm"]) == Exit.BAD_INPUT
    assert "say --yes" in capsys.readouterr().err
    assert main([*run, "--yes"]) == Exit.BAD_INPUT
    assert "--yes answers the question of --arm" in capsys.readouterr().err


def test_it_looks_moves_nothing_and_ends(
    run: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-PREFLIGHT)"""
    assert main([*run, "--preflight"]) == Exit.OK
    out = capsys.readouterr().out
    assert "position  0       good      0.00 m from (0.00, 0.00, 0.00)" in out
    assert "dead man" in out
    assert "koord estop CONFIG --test" in out


@pytest.mark.slow
def test_what_was_answered_in_advance_arms_and_drives(
    run: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-PREFLIGHT) (P-ARM)"""
    assert main([*run, "--arm", "--yes"]) == Exit.OK
    assert "all robots have stopped" in capsys.readouterr().out


@pytest.mark.slow
def test_what_is_bad_is_refused_whatever_was_answered(
    run: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-PREFLIGHT) It asks for a heartbeat, and nobody is there."""
    configuration = Path(run[2])
    text = configuration.read_text(encoding="utf-8")
    configuration.write_text(text + "safety: {heartbeat: 1}\n", encoding="utf-8")
    assert main([*run, "--arm", "--yes"]) == Exit.BAD_INPUT
    said = capsys.readouterr()
    assert "not armed: robot 0: heartbeat" in said.err
    assert "koord heartbeat CONFIG" in said.out


@pytest.mark.slow
@pytest.mark.parametrize(("typed", "code"), [("y", Exit.OK), ("n", Exit.BAD_INPUT)])
def test_people_are_asked_on_a_terminal(run: list[str], typed: str, code: Exit) -> None:
    """(P-PREFLIGHT) The table of the run does not cover the question."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "koord", *run, "--arm"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TERM": "xterm"}
    with subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment
    ) as process:
        os.close(theirs)
        shown, is_answered = b"", False
        while True:
            try:
                shown += os.read(ours, 4096)
            except OSError:  # the other end is closed
                break
            if b"[y/N]" in shown and not is_answered:
                is_answered = True
                os.write(ours, f"{typed}\n".encode())
        os.close(ours)
        assert process.wait(60) == code, shown
    assert (b"all robots have stopped" in shown) is (typed == "y")


# --- the question ---------------------------------------------------------------------------------


@pytest.fixture
def typing(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """What is written here is typed."""
    read, write = os.pipe()
    with os.fdopen(read, encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        yield write
        os.close(write)


@pytest.mark.parametrize(
    ("typed", "answer"), [("y", True), ("yes", True), ("", False), ("n", False)]
)
def test_the_answer_is_waited_for(
    typing: int, typed: str, answer: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    question, good = Question(answer=None), Preflight({0: (GOOD,)}, 1)
    assert question.ask(Preflight({0: (OPEN,)}, 1)) is None
    assert capsys.readouterr().out == ""
    assert question.ask(good) is None
    assert capsys.readouterr().out.endswith("arm these robots? [y/N] ")
    assert question.ask(good) is None
    assert capsys.readouterr().out == "", "it is asked once"
    os.write(typing, f"{typed}\n".encode())
    assert question.ask(good) is answer


def test_nobody_is_asked_about_what_is_bad_until_it_is_mended(
    typing: int, capsys: pytest.CaptureFixture[str]
) -> None:
    question = Question(answer=None)
    os.write(typing, b"y\n")
    assert question.ask(Preflight({0: (GOOD,), 1: (BAD,)}, 2)) is None
    said = capsys.readouterr().out
    assert "not armed: robot 1: pose: 3 s old" in said
    assert "arm these robots?" not in said
    good = Preflight({0: (GOOD,), 1: (GOOD,)}, 2)
    assert question.ask(good) is None, "what was typed before is no answer"
    os.write(typing, b"y\n")
    assert question.ask(good) is True


def test_robots_with_the_same_stand_in_one_row() -> None:
    checks = {0: (GOOD, OPEN), 1: (GOOD,), 2: (BAD,)}
    assert table(Preflight(checks, 3), PLAIN) == [
        "check   robots  found",
        "pose    0, 1    good      there",
        "pose    2       bad       3 s old; look at the cameras",
        "others  0       pending   not heard of: 1",
    ]
