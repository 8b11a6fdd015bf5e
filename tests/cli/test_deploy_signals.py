"""``koord deploy`` that is told to end, or whose processes are: robots stop safely, all is kept."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from koord.cli.exits import Exit
from tests.sampling import first

SUM = str(Path(__file__).parents[2] / "specs" / "examples" / "sum_of_ids.krd")

#: Runs the command line. Robots write down whether they hold; what the live table would show of a
#: run goes to standard error.
DRIVER = """
import os, signal, sys
from pathlib import Path
import koord.cli.deploy as deploy
import koord.runtime.deploy.job as job
from koord.cli.deployed import story
from koord.cli.main import main

class Noted(job.IdealHost):
    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        if name == "holding":
            Path(f"holds-{self.pid}").write_text(str(value))

class Told(deploy.Board):
    def show(self, heard):
        said = "stopping" if self.is_stopping else f"round {heard.round}"
        robots = sorted(heard.statuses.items())
        stories = [f"{pid} {story(one, heard.processes.get(pid))}" for pid, one in robots]
        print("; ".join([said, *stories]), file=sys.stderr, flush=True)

job.IdealHost, deploy.Board = Noted, Told
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
sys.exit(main(sys.argv[1:]))
"""

#: What is told of a run that is under way.
UNDER_WAY = r"round ([3-9]|\d\d)"
#: The same, of a run of three robots that all take part.
TOGETHER = rf"{UNDER_WAY}; 0 ; 1 ; 2 $"

#: Nothing here takes long; who waits longer than this waits for ever.
PATIENCE_S = 60.0


@dataclass
class Command:
    """A command that runs, with its folder and what it has said of itself."""

    process: subprocess.Popen[str]
    folder: Path
    said: str = ""

    def wait_for(self, pattern: str) -> None:
        """Wait until standard error has a line with this pattern."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.said += line
            if re.search(pattern, line):
                return
        raise AssertionError(self.said)

    @property
    def robots(self) -> list[int]:
        """The ids of the robots' processes, in the order of their start."""
        words = ["ps", "-o", "pid=", "--ppid", str(self.process.pid)]
        listed = subprocess.run(words, capture_output=True, check=True, text=True)
        return sorted(int(pid) for pid in listed.stdout.split())

    def ended(self) -> tuple[int, str]:
        """Wait for the end of all processes; return the exit code and standard output."""
        out, err = self.process.communicate(timeout=PATIENCE_S)
        self.said += err
        return self.process.returncode, out

    def holds(self) -> list[str]:
        """What each robot last wrote down: whether it holds."""
        return [path.read_text("utf-8") for path in sorted(self.folder.glob("holds-*"))]

    def recorded(self, topic: str = "/status") -> list[dict[str, Any]]:
        """The messages on a topic and those below it."""
        with (self.folder / "run.mcap").open("rb") as file:
            said = make_reader(file).iter_messages()
            return [json.loads(one.data) for _, at, one in said if at.topic.startswith(topic)]

    def rounds(self, pid: int) -> list[int]:
        """The rounds that a robot has acted on, by the recording."""
        return [one["round"] for one in self.recorded(f"/robots/{pid}")]


@contextmanager
def command(folder: Path, robots: int, *words: str) -> Iterator[Command]:
    (folder / "driver.py").write_text(DRIVER, "utf-8")
    key = "network: {key: sixteen letters ok, transport: unicast}"
    (folder / "c.yaml").write_text(f"num_robots: {robots}\ndelta: 0.05\n{key}\n", "utf-8")
    process = subprocess.Popen(
        [sys.executable, "driver.py", "deploy", SUM, "c.yaml", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield Command(process, folder)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


ALL = ("--all-local", "--record", "run.mcap", "--state", "noted")
ONE = ("--pid", "0", "--record", "run.mcap", "--state", "noted")
CODES = {
    signal.SIGTERM: Exit.TERMINATED,
    signal.SIGHUP: Exit.HUNG_UP,
    signal.SIGINT: Exit.INTERRUPTED,
}


@pytest.mark.parametrize(
    ("number", "words", "robots"),
    [
        (signal.SIGTERM, ALL, 3),
        (signal.SIGHUP, ONE, 1),
        pytest.param(signal.SIGHUP, ALL, 3, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, ONE, 1, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, ONE, 1, marks=pytest.mark.slow),
    ],
)
def test_a_run_that_is_asked_to_end_stops_safely_and_keeps_all(
    number: signal.Signals, words: tuple[str, ...], robots: int, tmp_path: Path
) -> None:
    """The first process alone is asked."""
    with command(tmp_path, robots, *words, "--json") as run:
        run.wait_for(UNDER_WAY)
        os.kill(run.process.pid, number)
        code, out = run.ended()
        assert code == CODES[number], run.said
        assert run.holds() == ["True"] * robots
        told = json.loads(out)["robots"]
        assert [one["pid"] for one in told] == list(range(robots))
        assert [max(run.rounds(pid)) for pid in range(robots)] == [one["round"] - 1 for one in told]
        assert len(list((tmp_path / "noted").iterdir())) == robots


@pytest.mark.parametrize("number", first(1, [signal.SIGKILL, signal.SIGTERM]))
def test_the_same_command_goes_on(number: signal.Signals, tmp_path: Path) -> None:
    """Nobody acts on a round a second time."""
    words = (*ALL, "--rounds", "25")
    with command(tmp_path, 3, *words) as run:
        run.wait_for(UNDER_WAY)
        os.kill(run.process.pid, number)
        run.ended()
        # What the first process had not heard when it was killed nobody has recorded.
        before = [max(run.rounds(pid), default=-2) for pid in range(3)]
    with command(tmp_path, 3, *words) as run:
        code, out = run.ended()
        assert code == Exit.OK, out
        assert all(min(run.rounds(pid)) > before[pid] for pid in range(3))
        assert [max(run.rounds(pid)) for pid in range(3)] == [24] * 3
    assert list((tmp_path / "noted").iterdir()) == []


@pytest.mark.parametrize("number", first(1, [signal.SIGTERM, signal.SIGHUP]))
def test_all_processes_may_be_asked_to_end_together(number: signal.Signals, tmp_path: Path) -> None:
    """As a terminal does that hangs up, and who ends a service."""
    with command(tmp_path, 3, *ALL) as run:
        run.wait_for(UNDER_WAY)
        os.killpg(run.process.pid, number)
        code, out = run.ended()
        assert code == CODES[number], run.said
        assert run.holds() == ["True"] * 3
        assert "rounds of 3 robots" in out
        assert "its process" not in out


def test_a_second_signal_stops_at_once(tmp_path: Path) -> None:
    """The robots are stopped meanwhile, so that no first one could be enough."""
    with command(tmp_path, 3, *ALL) as run:
        run.wait_for(UNDER_WAY)
        for robot in run.robots:
            os.kill(robot, signal.SIGSTOP)
        os.kill(run.process.pid, signal.SIGTERM)
        run.wait_for("stopping")
        os.kill(run.process.pid, signal.SIGTERM)
        code, out = run.ended()
        assert code == Exit.TERMINATED
        assert "koord: interrupted" in run.said
        assert "rounds of 3 robots" not in out
        assert run.recorded()


def test_robots_whose_first_process_is_killed_stop_safely_by_themselves(tmp_path: Path) -> None:
    with command(tmp_path, 3, *ALL) as run:
        run.wait_for(UNDER_WAY)
        os.kill(run.process.pid, signal.SIGKILL)
        code, _ = run.ended()  # the pipes have their end when the last process has
        assert code == -signal.SIGKILL
        assert run.holds() == ["True"] * 3
        assert len(list((tmp_path / "noted").iterdir())) == 3


# --- robots whose processes are killed ------------------------------------------------------------


def test_a_run_that_has_lost_its_majority_ends_with_a_summary(tmp_path: Path) -> None:
    with command(tmp_path, 3, *ALL, "--json") as run:
        run.wait_for(UNDER_WAY)
        for robot in run.robots[-2:]:
            os.kill(robot, signal.SIGKILL)
        run.wait_for(r"1 its process was killed \(signal 9\)")
        code, out = run.ended()
        assert code == Exit.UNKNOWN
        told = json.loads(out)
        assert told["stuck"].startswith("no round can be decided any more without robots 1 and 2:")
        ends = [one["process"]["end"] for one in told["robots"]]
        assert ends[0] is None
        assert [one["signal"] for one in ends[1:]] == [signal.SIGKILL] * 2
        lost = [one for one in run.recorded() if one["process"]["state"] == "lost"]
        assert {one["pid"] for one in lost} == {1, 2}
        assert run.holds()[0] == "True"


def test_a_robot_that_is_killed_is_restarted_and_told_of(tmp_path: Path) -> None:
    with command(tmp_path, 3, *ALL, "--rounds", "40", "--restart") as run:
        run.wait_for(TOGETHER)
        os.kill(run.robots[-1], signal.SIGKILL)
        run.wait_for("2 .*restarted once")
        code, out = run.ended()
        assert code == Exit.OK, out
        assert out.startswith(f"{SUM}: 3 robots, δ = 0.05 s\n40 rounds of 3 robots: ")
        assert re.search(r"robot 2: its process was killed .* in round \d+; restarted once\n", out)
        back = [one for one in run.recorded() if one["process"]["restarts"] == 1]
        assert {one["pid"] for one in back} == {2}
