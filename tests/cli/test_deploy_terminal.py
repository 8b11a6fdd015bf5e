"""``koord deploy`` on a terminal: the live table, and what Ctrl-C does the first time and again."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from mcap.reader import make_reader

from koord.api.deployed import FleetHeard
from koord.cli.deployed import Lines, table
from koord.cli.exits import Exit
from koord.runtime.deploy.status import RobotReport
from koord.runtime.deploy.supervision import EndCause, ProcessEnd, ProcessReport, ProcessState
from koord.runtime.protocol.events import Reason
from tests.deployed.fleet import free_port

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Nothing here takes long; who waits longer than this waits for ever.
PATIENCE_S = 60.0

#: Colours and movements of the cursor.
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Screen:
    """A command on a terminal, and all that it has written so far."""

    def __init__(self, process: subprocess.Popen[bytes], terminal: int) -> None:
        self.process = process
        self.text = ""
        self._terminal = terminal

    def read_until(self, pattern: str | None) -> str:
        """Wait for a text to appear, or for the end."""
        while pattern is None or not re.search(pattern, self.text):
            ready, _, _ = select.select([self._terminal], [], [], PATIENCE_S)
            assert ready, self.text
            try:
                said = os.read(self._terminal, 4096)
            except OSError:  # nobody has the other end any more
                said = b""
            if not said:
                assert pattern is None, self.text
                break
            self.text += _ESCAPES.sub("", said.decode(errors="replace"))
            assert len(self.text) < 300_000, self.text[-2_000:]
        return self.text

    def press_ctrl_c(self) -> None:
        os.write(self._terminal, b"\x03")

    def hang_up(self) -> None:
        """Close the terminal, if that has not been done."""
        if self._terminal >= 0:
            os.close(self._terminal)
            self._terminal = -1

    @property
    def code(self) -> int:
        return self.process.wait(PATIENCE_S)


@contextmanager
def deployed(folder: Path, *words: str, columns: int = 80) -> Iterator[Screen]:
    config = folder / "c.yaml"
    config.write_text("num_robots: 3\ndelta: 0.05\n", encoding="utf-8")
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    # The tests may run under nohup, and so would the command.
    heard = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL)"
    start = f"{heard}; from koord.cli.main import entry; entry()"
    command = [sys.executable, "-c", start, "deploy", str(EXAMPLES / "leader_elect.krd")]
    process = subprocess.Popen(
        [*command, str(config), "--all-local", *words],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    os.close(theirs)
    screen = Screen(process, ours)
    try:
        yield screen
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        process.wait()
        screen.hang_up()


def test_the_first_ctrl_c_stops_safely_with_a_summary(tmp_path: Path) -> None:
    with deployed(tmp_path) as screen:
        screen.read_until(r"robot +round +lag +ran +skipped +late +dropped +coordinator")
        screen.read_until(r"round [2-9]")
        screen.press_ctrl_c()
        text = screen.read_until(None)
        assert screen.code == Exit.INTERRUPTED
    summary = text[text.rindex("rounds of 3 robots") - 8 :]
    assert "datagrams sent" in summary
    assert "koord: interrupted" not in text


def test_the_second_ctrl_c_stops_at_once(tmp_path: Path) -> None:
    """The robots are stopped meanwhile, so that no first one could be enough."""
    with deployed(tmp_path) as screen:
        screen.read_until(r"round [2-9]")
        listed = subprocess.run(
            ["ps", "-o", "pid=", "--ppid", str(screen.process.pid)],
            capture_output=True,
            check=True,
            text=True,
        )
        robots = [int(pid) for pid in listed.stdout.split()]
        assert len(robots) >= 3
        for robot in robots:
            os.kill(robot, 19)
        screen.press_ctrl_c()
        screen.read_until("stopping")
        screen.press_ctrl_c()
        text = screen.read_until(None)
        assert screen.code == Exit.INTERRUPTED
    assert "rounds of 3 robots" not in text
    assert "koord: interrupted" in text


def test_a_terminal_that_hangs_up_ends_the_run_in_good_order(tmp_path: Path) -> None:
    record = tmp_path / "run.mcap"
    with deployed(tmp_path, "--record", str(record)) as screen:
        screen.read_until(r"round [2-9]")
        screen.hang_up()
        assert screen.code == Exit.HUNG_UP
    with record.open("rb") as file:
        told = [json.loads(one.data) for _, _, one in make_reader(file).iter_messages()]
    assert {one["pid"] for one in told if "pid" in one} == {0, 1, 2}


def test_a_run_that_ends_leaves_its_summary_alone(tmp_path: Path) -> None:
    with deployed(tmp_path, "--rounds", "8", columns=120) as screen:
        text = screen.read_until(None)
        assert screen.code == Exit.OK
    assert re.search(r"8 rounds of 3 robots: .*\s+.*\s+epoch 0; dropped: .*\s*$", text)


# --- the table ------------------------------------------------------------------------------------


def status(pid: int, round_: int, **said: object) -> RobotReport:
    plain: dict[str, object] = {
        "behind": 0,
        "coordinator": 0,
        "epoch": 0,
        "holding": None,
        "waiting_for": (),
        "ran": 0,
        "skipped": 0,
        "late": 0,
        "overdue": 0,
        "longest_s": 0.1,
        "took_s": 10.0,
        "sent": 0,
        "received": 0,
        "drops": (),
        "is_over": False,
        "all_stopped": False,
        "is_mute": False,
        "is_voter": True,
    }
    return RobotReport(pid=pid, round=round_, **{**plain, **said})  # type: ignore[arg-type]


def column(statuses: list[RobotReport], name: str, rows: int = 24) -> list[str]:
    made = table(FleetHeard.of({one.pid: one for one in statuses}, 200), rows)
    (found,) = [c for c in made.columns if c.header == name]
    return [str(cell) for cell in found.cells]


def test_lag_is_what_a_robot_lacks_and_not_how_long_ago_it_spoke() -> None:
    statuses = [status(0, 100), status(1, 98), status(2, 98, behind=4), status(3, 60)]
    assert column(statuses, "lag") == ["0", "0", "4", "40"]


@pytest.mark.parametrize("rows", [1, 3])
def test_what_does_not_fit_is_counted_and_trouble_comes_first(rows: int) -> None:
    statuses = [status(pid, 10) for pid in range(9)]
    statuses[7] = status(7, 10, trouble="the store differs")
    shown = column(statuses, "robot", rows)
    assert len(shown) == rows + 1
    assert "7" in shown
    assert shown[-1] == "…"
    assert column(statuses, "", rows)[-1] == f"and {9 - rows} more"


# --- without a terminal ---------------------------------------------------------------------------


def test_without_a_terminal_what_lasts_is_said_once_and_so_is_its_end() -> None:
    said: list[str] = []
    lines = Lines(said.append)

    def hear(at: float, *statuses: RobotReport) -> None:
        lines.hear(FleetHeard.of({one.pid: one for one in statuses}, None), at)

    holding = status(1, 4, holding=Reason.UNDECIDED)
    hear(0.0, status(0, 4), holding)
    hear(0.5, status(0, 5), status(1, 5))
    hear(1.0, status(0, 5), holding)
    assert said == []
    hear(1.9, status(0, 5), holding)
    hear(2.1, status(0, 5), holding)
    hear(2.4, status(0, 5, is_mute=True), holding)
    hear(9.0, status(0, 5, is_mute=True), status(1, 7))
    assert said == [
        "robot 1: holds: the round is not decided",
        "robot 0: came back without its journal: runs no events",
        "robot 1: goes on, in round 7",
    ]
    hear(10.0, status(0, 8, is_over=True), status(1, 8, is_over=True))
    assert len(said) == 3


def test_robots_whose_processes_end_have_a_line_and_do_not_go_on() -> None:
    said: list[str] = []
    lines = Lines(said.append)
    end = ProcessEnd(1, EndCause.KILLED, 4, signal=9)
    running = ProcessReport()
    back = ProcessReport(restarts=1, end=end)
    lost = ProcessReport(ProcessState.LOST, end=end)
    holding = status(1, 4, holding=Reason.UNDECIDED)
    for at, process in ((0.0, running), (1.0, running), (2.0, back), (3.0, back), (4.0, lost)):
        lines.hear(FleetHeard.of({1: holding}, None, {1: process}), at)
    assert said == [
        "robot 1: holds: the round is not decided",
        "robot 1: its process was killed (signal 9) in round 4; restarted once",
        "robot 1: its process was killed (signal 9) in round 4",
    ]


def test_what_many_robots_do_is_said_in_one_line() -> None:
    said: list[str] = []
    lines = Lines(said.append)
    many = {pid: status(pid, 4, holding=Reason.UNDECIDED) for pid in (0, 1, 2, 5, 8, 9)}
    for at in (0.0, 9.0):
        lines.hear(FleetHeard.of(many, None), at)
    noticed = {3: status(3, 4, notes=("robot 2 runs something else",))}
    lines.hear(FleetHeard.of({pid: status(pid, 5) for pid in many} | noticed, None), 9.5)
    assert said == [
        "robots 0–2, 5, 8, 9: holds: the round is not decided",
        "robot 3: robot 2 runs something else",
        "robots 0–2, 5, 8, 9: goes on, in round 5",
    ]


def test_why_a_robot_waits_is_said_without_a_terminal(tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(
        "agents: [{pid: 0, on_device: a}, {pid: 1, on_device: b}]\n"
        f"devices: {{a: {{ip: 127.0.0.1, port: {free_port()}}}, "
        f"b: {{ip: 127.0.0.1, port: {free_port()}}}}}\n"
        "delta: 0.05\nnetwork: {transport: unicast, key: sixteen letters ok}\n",
        encoding="utf-8",
    )
    config.chmod(0o600)  # else it is told that everybody may read the key
    words = ["deploy", str(EXAMPLES / "sum_of_ids.krd"), str(config), "--pid", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "koord", *words, "--state", str(tmp_path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process.stderr as stream:
        said = stream.readline()
        process.kill()
    process.wait()
    assert said.startswith("robot 1: holds: ")
