"""``koord completion`` prints scripts by which shells complete commands, flags and files."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from koord.cli.completion import SHELLS, whole_parser
from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, main

shtab = pytest.importorskip("shtab")


def script(capsys: pytest.CaptureFixture[str], shell: str) -> str:
    capsys.readouterr()
    assert main(["completion", shell]) == Exit.OK
    return capsys.readouterr().out


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_know_all_commands_and_are_read_by_their_shell(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = script(capsys, shell)
    assert [one.name for one in COMMANDS if one.name not in made] == []
    assert "max-violations" in made
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} here to read it")
    file = tmp_path / "script"
    file.write_text(made, encoding="utf-8")
    ran = subprocess.run([shell, "-n", str(file)], capture_output=True, text=True, timeout=60)
    assert (ran.returncode, ran.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("koord ver", ["verify"]),
        ("koord verify --eng", ["--engine"]),
        ("koord verify --engine b", ["bits", "bmc"]),
        ("koord schema verd", ["verdicts"]),
        ("koord config ch", ["check"]),
        ("koord check a_", ["a_program.krd"]),
        ("koord completion ", ["bash", "fish", "zsh"]),
    ],
)
def test_bash_completes(
    words: str, completed: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if shutil.which("bash") is None:
        pytest.skip("there is no bash here")
    (tmp_path / "a_program.krd").write_text("")
    (tmp_path / "script").write_text(script(capsys, "bash"), encoding="utf-8")
    typed = words.split(" ")
    asking = f"""
        source ./script
        words=$(complete -p koord)  # complete … -F FUNCTION koord
        function=${{words#*-F }}
        COMP_WORDS=({" ".join(typed[:-1])} "{typed[-1]}")
        COMP_CWORD={len(typed) - 1}
        ${{function% *}}
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    ran = subprocess.run(
        ["bash", "-c", asking], capture_output=True, text=True, cwd=tmp_path, timeout=60
    )
    assert ran.stderr == ""
    assert sorted(ran.stdout.split()) == completed


def test_the_parser_of_all_commands_reads_what_each_reads() -> None:
    read = whole_parser().parse_args(["verify", "a.krd", "--robots", "2..3", "--json"])
    assert read.command == "verify"
    assert read.json is True


def test_without_the_library_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == Exit.BAD_INPUT
    assert "pip install 'koord[completion]'" in capsys.readouterr().err


def test_other_shells_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "csh"]) == Exit.BAD_INPUT
    assert "'bash', 'zsh', 'fish'" in capsys.readouterr().err
