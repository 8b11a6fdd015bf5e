"""`koord estop`, `koord order` and `koord heartbeat`, to robots in processes of their own."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.configuration.keys import new_key

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0

#: Robots that go to and fro for ever.
PROGRAM = """\
using Motion:
    sensors:
        pos psn
        boolean reached
    actuators:
        pos target
local:
    boolean isSent = false
    boolean isThere = false
Go:
    pre: not isSent
    eff:
        Motion.target = pos(1 + 2 * pid, 1, 0)
        isSent = true
"""

CONFIG = """\
delta: 0.1
agents:
    - {pid: 0, on_device: car, position: [0, 0]}
    - {pid: 1, on_device: car, position: [2, 0]}
devices:
    car: {bot_type: CAR, planner: STRAIGHT, driver: sim}
world:
    bounds: {low: [-4, -4, 0], high: [6, 6, 3]}
"""


def free_port() -> int:
    """The first of some ports that are free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
    return port if port < 60_000 else port - 10_000


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A program, and a configuration with a key; ``other.yaml`` has another key."""
    (tmp_path / "go.krd").write_text(PROGRAM, encoding="utf-8")
    port = free_port()
    for name in ("go", "other"):
        network = f"network: {{transport: unicast, port: {port}, key: {new_key()}}}\n"
        file = tmp_path / f"{name}.yaml"
        file.write_text(CONFIG + network, encoding="utf-8")
        file.chmod(0o600)
    return tmp_path


def environment(folder: Path, machine: str) -> dict[str, str]:
    """The environment of a process on one of several machines, as far as files tell."""
    place = folder / machine
    place.mkdir(exist_ok=True)
    return {**os.environ, "PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": str(place)}


@contextmanager
def robot(folder: Path, *words: str, machine: str) -> Iterator[subprocess.Popen[bytes]]:
    """`koord deploy` as a process."""
    command = [sys.executable, "-m", "koord", "deploy", "go.krd", "go.yaml", "--arm", "--yes"]
    with subprocess.Popen(
        [*command, *words, "--state", f"state-{machine}"],
        cwd=folder,
        env=environment(folder, machine),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def said(folder: Path, *words: str, machine: str = "here") -> tuple[int, dict[int, Any]]:
    """Say something to robots; return the exit code, and what each answered, by pid."""
    done = subprocess.run(
        [sys.executable, "-m", "koord", *words, "--json"],
        cwd=folder,
        env=environment(folder, machine),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    robots = json.loads(done.stdout or "{}").get("robots", [])
    return done.returncode, {one["pid"]: one for one in robots}


def wait_for_states(
    folder: Path, accepts: Callable[[str], bool], *words: str, machine: str = "here"
) -> None:
    """Ask robots how they are until all are as they should be."""
    begun = time.monotonic()
    answers: dict[int, Any] = {}
    while len(answers) < 2 or not all(accepts(one["state"] or "") for one in answers.values()):
        assert time.monotonic() - begun < PATIENCE_S, answers
        ask = ("estop", *words, "--test", "--timeout", "1")
        _, answers = said(folder, *ask, machine=machine)


def is_running(state: str) -> bool:
    return state == "running"


def is_stopped(state: str) -> bool:
    return state.startswith("e-stopped")


def is_standing(state: str) -> bool:
    return state.endswith("at rest")


@pytest.mark.slow
def test_a_fleet_on_several_machines_is_stopped_by_its_key(folder: Path) -> None:
    """(O-KEY) (O-ANSWER)"""
    with ExitStack() as stack:
        robots = [
            stack.enter_context(robot(folder, "--pid", str(pid), machine=f"robot{pid}"))
            for pid in range(2)
        ]
        wait_for_states(folder, is_running, "go.yaml")
        code, answers = said(folder, "estop", "other.yaml", "--timeout", "1")
        assert (code, [one["state"] for one in answers.values()]) == (Exit.VIOLATED, [None, None])
        wait_for_states(folder, is_running, "go.yaml")
        code, answers = said(folder, "estop", "go.yaml", "--robots", "1")
        assert (code, list(answers)) == (Exit.OK, [1])
        code, answers = said(folder, "estop", "go.yaml")
        assert code == Exit.OK
        assert all(is_stopped(one["state"]) for one in answers.values())
        code, answers = said(folder, "order", "go.yaml", "start")
        assert code == Exit.VIOLATED
        assert "reset it first" in answers[0]["why"]
        wait_for_states(folder, is_standing, "go.yaml")
        assert said(folder, "order", "go.yaml", "reset")[0] == Exit.OK
        assert said(folder, "order", "go.yaml", "start")[0] == Exit.OK
        wait_for_states(folder, is_running, "go.yaml")
        # One is gone, the other one has no majority any more, and is stopped all the same.
        robots[0].kill()
        robots[0].wait()
        code, answers = said(folder, "estop", "go.yaml", "--timeout", "1")
        assert code == Exit.VIOLATED
        assert answers[0]["state"] is None
        assert is_stopped(answers[1]["state"])


@pytest.mark.slow
def test_a_fleet_of_this_machine_is_stopped_without_a_word_more(folder: Path) -> None:
    """(O-HERE) And a machine that has nobody says so."""
    code, _ = said(folder, "estop", machine="elsewhere")
    assert code == Exit.BAD_INPUT
    with robot(folder, "--all-local", machine="here") as process:
        wait_for_states(folder, is_running)
        code, answers = said(folder, "estop")
        assert (code, list(answers)) == (Exit.OK, [0, 1])
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == Exit.TERMINATED
    assert list((folder / "here").rglob("*.run")) == []


@pytest.mark.slow
def test_robots_hold_when_their_heartbeat_ends(folder: Path) -> None:
    """(O-ALIVE) It is killed, and begins again."""
    for name in ("go", "other"):
        file = folder / f"{name}.yaml"
        text = file.read_text(encoding="utf-8") + "safety: {heartbeat: 1, hold: 60}\n"
        file.write_text(text, encoding="utf-8")

    @contextmanager
    def beating(name: str) -> Iterator[subprocess.Popen[bytes]]:
        with subprocess.Popen(
            [sys.executable, "-m", "koord", "heartbeat", f"{name}.yaml"],
            cwd=folder,
            env=environment(folder, "people"),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        ) as process:
            try:
                yield process
            finally:
                process.kill()

    with ExitStack() as stack:
        first = stack.enter_context(beating("go"))
        for pid in range(2):
            stack.enter_context(robot(folder, "--pid", str(pid), machine=f"robot{pid}"))
        wait_for_states(folder, is_running, "go.yaml")
        first.kill()
        wait_for_states(folder, lambda state: state == "holding", "go.yaml")
        with beating("other"):
            time.sleep(2.0)  # long enough for them to go on, if they believed it
            wait_for_states(folder, lambda state: state == "holding", "go.yaml")
        with beating("go"):
            wait_for_states(folder, is_running, "go.yaml")


# --- nobody there ---------------------------------------------------------------------------------


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine on which nothing runs."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.mark.usefixtures("alone")
def test_nobody_to_call_is_an_error_with_a_cure(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estop"]) == Exit.BAD_INPUT
    assert "`koord estop CONFIG`" in capsys.readouterr().err
    keyless = folder / "keyless.yaml"
    keyless.write_text(CONFIG, encoding="utf-8")
    assert main(["estop", str(keyless)]) == Exit.BAD_INPUT
    assert "it has no key" in capsys.readouterr().err
    assert main(["estop", str(folder / "none.yaml")]) == Exit.BAD_INPUT
    assert "there is no such file" in capsys.readouterr().err


@pytest.mark.usefixtures("alone")
def test_who_does_not_answer_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """(O-ANSWER)"""
    assert main(["estop", str(folder / "go.yaml"), "--timeout", "0.1"]) == Exit.VIOLATED
    out = capsys.readouterr().out
    assert "    0  did not answer\n    1  did not answer\nNOT done by all: 0, 1\n" in out


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--robots", "2"], "there is no robot 2: there are 0, 1"),
        (["--robots", "x"], "'x' is not a whole number"),
        (["--timeout", "-1"], "--timeout"),
    ],
)
def test_flags_that_do_not_fit_are_refused(
    folder: Path, words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estop", str(folder / "go.yaml"), *words]) == Exit.BAD_INPUT
    assert told in capsys.readouterr().err
