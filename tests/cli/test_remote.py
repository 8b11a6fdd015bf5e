"""``koord deploy --ssh`` and ``--systemd`` on the command line, and with a server of OpenSSH."""

from __future__ import annotations

import configparser
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from koord.cli.main import main

LEADER = "specs/examples/leader_elect.krd"
CARS = "specs/examples/three_cars.yaml"


@pytest.mark.parametrize(
    ("words", "story"),
    [
        (("--ssh", "--pid", "0"), "say --pid I for one robot, or --all-local"),
        (("--ssh", "--all-local"), "--ssh for all of them on their own computers"),
        (("--pid", "0", "--identity", "id"), "--identity is for --ssh"),
        (("--all-local", "--logs", "logs"), "--logs is for --ssh"),
        (("--ssh", "--live"), "--live is not for --ssh"),
        (("--ssh", "--restart"), "--restart is for processes on this machine"),
        (("--ssh", "--systemd"), "say --pid I"),
        (("--pid", "0", "--arm", "--systemd"), "--arm needs --yes"),
        (("--ssh", "--arm"), "say --yes"),
    ],
)
def test_flags_that_do_not_go_together(
    words: tuple[str, ...], story: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["deploy", LEADER, CARS, *words]) == 2
    assert story in " ".join(capsys.readouterr().err.split())


def test_robots_without_an_address_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """(P-SSH)"""
    assert main(["deploy", LEADER, CARS, "--ssh"]) == 2
    err = capsys.readouterr().err
    assert err.count("K932") == 3
    assert "robot 2 has no computer: its device has no `ip`" in err


def test_a_unit_runs_the_same_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """(P-UNIT)"""
    program, config = Path(LEADER).resolve(), Path(CARS).resolve()
    folder = tmp_path / "a 50% $folder"
    folder.mkdir()
    monkeypatch.chdir(folder)
    given = ["--pid", "2", "--rounds", "7", "--arm", "--yes", "--trace", "part.jsonl"]
    words = ["deploy", str(program), str(config), *given, "--set", 'a="b c"', "--systemd"]
    assert main(words) == 0
    out = capsys.readouterr().out
    (folder / "koord.service").write_text(out, "utf-8")
    unit = configparser.RawConfigParser()
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(out)
    service = unit["Service"]
    assert service["WorkingDirectory"] == str(folder).replace("%", "%%")
    line = shlex.split(service["ExecStart"].replace("%%", "%").replace("$$", "$"))
    trace = f"--trace={folder}/part.jsonl"
    flags = ["--pid=2", "--rounds=7", "--arm", "--yes", '--set=a="b c"', trace]
    assert line[1:] == ["deploy", str(program), str(config), *flags]
    assert service["KillMode"] == "mixed"
    assert int(service["TimeoutStopSec"]) > 25  # s, that vehicles have to land
    if shutil.which("systemd-analyze"):
        verified = subprocess.run(
            ["systemd-analyze", "verify", "koord.service"], capture_output=True, text=True
        )
        told = [line for line in verified.stderr.splitlines() if "koord.service" in line]
        assert not [line for line in told if "not executable" not in line]
