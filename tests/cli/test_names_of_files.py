"""Names of files are shown, and never act: not on a terminal, nor on what is written."""

from __future__ import annotations

import ast
import json
import os
import unicodedata
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.source import visible

#: What a name can have in it, all at once: an escape sequence, a line end, a mark that turns the
#: direction of writing, markup, quotes, a comment of HTML, a byte that is no UTF-8.
EVIL = os.fsdecode(b'a\x1b[31m\nb\xe2\x80\xaec[red]d[bold]\'"""\\N{x}<!--<script>\xff')

PROGRAM = """\
local:
    int x = 0
Go:
    pre: x < 2
    eff: x = x + 1
invariant Small: x <= 1
"""
WRONG = "local:\n    int x = yy\n"
CONFIGURATION = "num_robots: 2\ndevice: {bot_type: IDEAL, planner: STRAIGHT}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    texts = {"p.krd": PROGRAM, "w.krd": WRONG, "c.yaml": CONFIGURATION, "n.yaml": "robots: 3\n"}
    for ending, text in texts.items():
        Path(f"{EVIL}{ending}").write_text(text, encoding="utf-8")
    return tmp_path


def harmless(capsys: pytest.CaptureFixture[str]) -> str:
    """What was printed, if nothing in it acts."""
    out, err = capsys.readouterr()
    for character in out + err:
        assert character == "\n" or unicodedata.category(character) not in (
            "Cc",
            "Cf",
            "Cs",
            "Zl",
            "Zp",
        ), (character, out, err)
    return out + err


P, W, C, N = (f"{EVIL}{ending}" for ending in ("p.krd", "w.krd", "c.yaml", "n.yaml"))
ABSENT = f"{EVIL}absent"

#: Commands whose output names the file.
COMMANDS = [
    ["check", W],
    ["check", W, "--json"],
    ["check", ABSENT],
    ["check", P, "--with", W],
    ["check", P, "--set", f"{EVIL}=3"],
    ["fmt", "--check", W],
    ["fmt", "--diff", W],
    ["fmt", W],
    ["verify", P],
    ["verify", P, "--json"],
    ["verify", P, "--robots", "2..3"],
    ["verify", P, "--robots", EVIL],
    ["verify", P, "--property", EVIL],
    ["verify", P, "--export", "vmt"],
    ["verify", P, "--trace", f"no/{EVIL}.json"],
    ["verify", W],
    ["run", P],
    ["run", P, "--json"],
    ["compile", P],
    ["sim", P, "--rounds", "3", "--no-html"],
    ["sim", P, C, "--rounds", "3", "--no-html"],
    ["sim", P, N],
    ["sim", P, C, "--runs", "1", "--rounds", "2"],
    ["deploy", P, N, "--all-local"],
    ["deploy", P, ABSENT, "--all-local"],
    ["config", "check", C, N],
    ["replay", P],
    ["replay", ABSENT],
    ["recheck", P],
    ["recheck", ABSENT],
    ["check-refinement", P, "--runs", "1", "--target", "engine"],
    ["explain", EVIL],
    ["check", P, f"--{EVIL}"],
    [EVIL],
]


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: " ".join(words)[:12].encode().hex())
def test_no_command_prints_a_name_raw(
    words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) != Exit.INTERNAL, capsys.readouterr().err
    said = harmless(capsys)
    if "--json" in words:
        json.loads(said)
    if words[0] == "compile":
        ast.parse(said)


def test_names_are_shown_as_they_are_where_they_do_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Markup is text: nothing of it is swallowed."""
    for words in (["check", W], ["verify", P], ["sim", P, C, "--rounds", "2", "--no-html"]):
        main(words)
        assert visible(EVIL) in harmless(capsys)
    assert "␛[31m␊" in visible(EVIL)


def test_what_is_kept_can_be_read_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Traces and certificates under such names, and of such programs."""
    trace, certificate = f"{EVIL}t.json", f"{EVIL}cert.json"
    assert main(["verify", P, "--trace", trace, "--certificate", certificate]) == Exit.VIOLATED
    harmless(capsys)
    assert main(["replay", trace]) == Exit.OK
    assert visible(trace) in harmless(capsys)
    assert main(["recheck", certificate]) in (Exit.OK, Exit.BAD_INPUT)
    harmless(capsys)


def test_names_inside_of_traces_and_certificates_are_shown_too(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", P, "--trace", "t.json"]) == Exit.VIOLATED
    capsys.readouterr()
    document = json.loads(Path("t.json").read_text("utf-8"))
    document["program"]["name"] = "\x1b]0;title\x07\u202e.krd"
    Path("t.json").write_text(json.dumps(document), encoding="utf-8")
    for words in (["replay", "t.json"], ["replay", "t.json", "--json"]):
        main(words)
        harmless(capsys)


def test_a_page_of_such_a_program_is_one_page(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", P, C, "--rounds", "2", "--html", "run.html"]) in (Exit.OK, Exit.VIOLATED)
    harmless(capsys)
    page = Path("run.html").read_text("utf-8")
    assert "<!--<script>" not in page
    assert "\x1b" not in page
