"""``koord deploy --ssh`` and ``--systemd`` on the command line, and with a server of OpenSSH."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from koord.cli.main import main
from koord.runtime.configuration.keys import write_key
from tests.cli.openssh import OpenSsh, needs_sshd
from tests.deployed.fleet import free_port

LEADER = "specs/examples/leader_elect.krd"
CARS = "specs/examples/three_cars.yaml"
LEADER_PATH = str(Path(LEADER).resolve())


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
        (("--ssh", "--arm", "--yes", "--attach"), "--attach starts nothing"),
        (("--all-local", "--attach"), "--attach is for --ssh"),
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


# --- with a server of OpenSSH ---------------------------------------------------------------------

TASK = str(Path("specs/examples/task.krd").resolve())

#: Nothing here takes so long.
PATIENCE_S = 120.0


@pytest.fixture
def ssh(tmp_path: Path) -> Iterator[OpenSsh]:
    with OpenSsh(tmp_path) as made:
        yield made


def fleet(folder: Path, more: str = "") -> Path:
    """A configuration of three robots, each on a computer at the loopback."""
    write_key(str(folder / "robots.key"))
    agents = "".join(f"  - {{pid: {pid}, on_device: d{pid}}}\n" for pid in range(3))
    devices = "".join(
        f"  d{pid}: {{ip: 127.0.0.1, port: {free_port()}, {more}}}\n" for pid in range(3)
    )
    network = "network: {transport: unicast, key_file: robots.key}\n"
    config = folder / "fleet.yaml"
    config.write_text(f"delta: 0.1\nagents:\n{agents}devices:\n{devices}{network}", "utf-8")
    return config


def cars(folder: Path) -> Path:
    """The same of cars, in a world with four places."""
    config = fleet(folder, "bot_type: CAR, planner: RRT_CAR")
    with config.open("a", encoding="utf-8") as file:
        file.write("world: {bounds: {low: [-3.5, -4, 0], high: [3.5, 4, 3]}, scattered: 4}\n")
    return config


class Deployment:
    """``koord deploy --ssh`` as a process, and what it says on standard error."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process, self.said = process, ""

    def wait_for(self, pattern: str) -> None:
        """Wait for a line."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.said += line
            if re.search(pattern, line):
                return
        raise AssertionError(self.said)

    def ended(self) -> tuple[int, str]:
        """Wait for its end; return exit code and standard output."""
        out, err = self.process.communicate(timeout=PATIENCE_S)
        self.said += err
        return self.process.returncode, out


@contextmanager
def deployment(ssh: OpenSsh, program: str, config: Path, *words: str) -> Iterator[Deployment]:
    login = ["--ssh", "--ssh-config", str(ssh.config), "--koord", "~/koord"]
    process = subprocess.Popen(
        [sys.executable, "-m", "koord", "deploy", program, str(config), *login, *words],
        cwd=ssh.folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield Deployment(process)
    finally:
        process.kill()
        process.wait(PATIENCE_S)
        for stream in (process.stdout, process.stderr):
            assert stream is not None
            stream.close()


def judged(folder: Path) -> str:
    """What `koord replay` says of the trace."""
    words = [sys.executable, "-m", "koord", "replay", str(folder / "run.json")]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


def until(condition: Callable[[], object]) -> None:
    """Wait for a condition."""
    ends_at = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < ends_at
        time.sleep(0.05)


def told(ssh: OpenSsh) -> list[int]:
    """How much each robot has told, of those that are in their rounds."""
    sizes = [file.stat().st_size for file in ssh.files("part.jsonl")]
    return [size for size in sizes if size > 3000]


@needs_sshd
@pytest.mark.slow
@pytest.mark.waits
def test_simulated_cars_are_started_gathered_and_judged(ssh: OpenSsh) -> None:
    """(P-SSH) (P-SSH-GATHER)"""
    config = cars(ssh.folder)
    words = ("--dry-run", "--rounds", "30", "--trace", "run.json", "--record", "run.mcap")
    with deployment(ssh, TASK, config, *words, "--logs", "logs") as run:
        code, out = run.ended()
    assert code == 0, run.said
    assert "run.json: 30 rounds of 3 robots, every step legal" in out
    assert not Path(f"{ssh.folder}/run.json.parts").exists()
    assert not Path(f"{ssh.folder}/run.mcap.parts").exists()
    assert "legal" in judged(ssh.folder)
    assert sorted(one.name for one in (ssh.folder / "logs").iterdir()) == [
        *("0.log", "1.log", "2.log")
    ]
    again = subprocess.run(
        [sys.executable, "-m", "koord", "merge", "run.mcap", "-o", "again.json"],
        cwd=ssh.folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "again.json: 30 rounds of 3 robots, every step legal" in again.stdout


@needs_sshd
@pytest.mark.slow
@pytest.mark.waits
def test_cut_connections_stop_nobody_and_sigterm_stops_all_safely(ssh: OpenSsh) -> None:
    """(P-SSH-GOES-ON) (P-SSH-STOP)"""
    with deployment(ssh, LEADER_PATH, fleet(ssh.folder), "--trace", "run.json", "--json") as run:
        until(lambda: len(told(ssh)) == 3)
        ssh.cut()
        for _ in range(3):
            run.wait_for("connected again")
        run.process.send_signal(signal.SIGTERM)
        code, out = run.ended()
    assert code == 143, run.said
    printed = json.loads(out)
    assert len(printed["robots"]) == 3
    assert printed["trace"]["refused"] is None
    assert printed["trace"]["missing"] == []
    assert [file.read_text("utf-8").strip() for file in ssh.files("deploy.code")] == ["143"] * 3


@needs_sshd
@pytest.mark.slow
@pytest.mark.waits
def test_robots_whose_people_are_gone_are_reached_all_the_same(ssh: OpenSsh) -> None:
    """(P-SSH-GOES-ON) (P-SSH-ATTACH)"""
    config = cars(ssh.folder)
    with deployment(ssh, TASK, config, "--dry-run", "--trace", "run.json") as run:
        until(lambda: len(told(ssh)) == 3)
        run.process.kill()
        run.process.wait(PATIENCE_S)
    before = told(ssh)
    until(lambda: all(now > then for now, then in zip(told(ssh), before, strict=True)))
    assert main(["order", str(config), "land"]) == 0
    with deployment(ssh, TASK, config, "--attach", "--trace", "run.json") as again:
        again.wait_for("the run ")
        until(lambda: len(told(ssh)) == 3)
        again.process.send_signal(signal.SIGINT)
        code, out = again.ended()
    assert code == 130, again.said
    assert "rounds of 3 robots, every step legal" in out
    assert len(ssh.files("deploy.code")) == 3
