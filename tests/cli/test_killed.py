"""What is recorded of a run that is killed: all up to the last second, and it can be read."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from mcap.reader import SeekingReader, make_reader
from mcap.records import Message

from koord.cli.exits import Exit
from koord.cli.main import main
from tests.sim.unpacking import unpacked

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Runs the command line, and ends itself by a signal when something was called so many times.
ENDED = """
import os, signal, sys
import koord.api.growing as growing
import koord.cli.run as run
from koord.cli.progress import LiveLine
from koord.cli.tables import Rounds
from koord.runtime.records import RecordFile
from koord.traces.unfinished import GrowingTrace
from koord.sim.viewing import PartPage
from koord.cli.main import main

def counted(holder, name, most, number):
    do = getattr(holder, name)
    left, pid = [most], os.getpid()
    def done(*arguments):
        do(*arguments)
        left[0] -= 1
        if left[0] == 0:
            os.kill(pid, number)
    setattr(holder, name, done)

if __name__ == "__main__":
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    growing.PERIOD_S = run._PERIOD_S = 0.0
    what, most, number = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    holders = {"page": (PartPage, "grow"), "record": (RecordFile, "flush")}
    if what in ("bag", "rrd"):
        from koord.sim.files.rerun import PartRrd
        from koord.sim.files.rosbag import PartBag
        holders |= {"bag": (PartBag, "grow"), "rrd": (PartRrd, "grow")}
    holders |= {"line": (LiveLine, "show"), "table": (Rounds, "show_round")}
    holders["trace"] = (GrowingTrace, "grow")
    holder, name = holders[what]
    counted(holder, name, most, number)
    sys.exit(main(sys.argv[4:]))
"""


#: One claim holds at once; of the other nobody finds out for a while.
HARD = """
allwrite:
  int total = 0
local:
  int x = 1
Step:
  eff:
    atomic:
      x = x * x + total
      total = total + x
invariant Odd: total != 92
invariant Low: total >= 0
"""


def ended(folder: Path, what: str, most: int, number: int, *words: str) -> int:
    return run_until(folder, what, most, number, *words).returncode


def run_until(
    folder: Path, what: str, most: int, number: int, *words: str
) -> subprocess.CompletedProcess[bytes]:
    driver = folder / "driver.py"
    driver.write_text(ENDED, "utf-8")
    command = [sys.executable, str(driver), what, str(most), str(int(number)), *words]
    # Processes of robots inherit the pipe: its end is reached when the last of them has ended.
    return subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, timeout=120, check=False)


def messages(path: Path) -> list[Message]:
    """The messages of an MCAP file, which is whole: it has an index, and an end."""
    with path.open("rb") as file:
        read = make_reader(file)
        assert isinstance(read, SeekingReader)
        return [message for _, _, message in read.iter_messages()]


def test_a_simulated_run_that_is_killed_is_there_up_to_then(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sim", str(EXAMPLES / "follow_path.krd"), "--record", "run.mcap", "--trace", "t.json"]
    assert ended(tmp_path, "trace", 6, signal.SIGKILL, *words) == -signal.SIGKILL
    names = ["driver.py", "run.part.html", "run.part.mcap", "t.part.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert main(["replay", str(tmp_path / "t.part.json")]) == Exit.OK
    said = capsys.readouterr().out
    assert ": legal: 26 steps, 5 rounds" in said
    assert "  the file is cut off: what the run did after 5 rounds is not known\n" in said
    text = (tmp_path / "run.part.html").read_text("utf-8")
    found = re.findall(r'class="pack">([^<]*)</script>', text)
    packs = [base64.b64decode(one) for one in found]
    header = unpacked(packs[0]).document["header"]
    documents = [unpacked(one, header).document for one in packs]
    assert [number for one in documents for number, *_ in one["rounds"]] == [-1, 0, 1, 2, 3, 4]
    told = [json.loads(message.data) for message in messages(tmp_path / "run.part.mcap")]
    assert max(one["round"] for one in told if "ran" in one) == 4


@dataclass(frozen=True)
class Asked:
    """A command that is asked to end when something was called so often, and what it leaves."""

    what: str
    most: int
    number: int
    words: tuple[str, ...]
    left: tuple[str, ...] = ()
    said: str = ""


LEADER, CARS = str(EXAMPLES / "leader_elect.krd"), str(EXAMPLES / "three_cars.yaml")
PATH = str(EXAMPLES / "follow_path.krd")
ASKED = (
    Asked(
        "line",
        4,
        signal.SIGTERM,
        ("verify", "hard.krd", "--rounds", "400", "--jobs", "2"),
        said="Low holds for every N",
    ),
    Asked(
        "table",
        9,
        signal.SIGHUP,
        ("run", LEADER, "--policy", "random", "--rounds", "90", "--trace", "t.json"),
        ("t.json",),
        "interrupted after",
    ),
    Asked("line", 3, signal.SIGTERM, ("check-refinement", LEADER), said="engine: "),
    Asked(
        "page",
        5,
        signal.SIGHUP,
        ("sim", PATH, "--record", "run.mcap", "--trace", "t.json"),
        ("run.html", "run.mcap", "t.json"),
        "interrupted",
    ),
    Asked(
        "record",
        8,
        signal.SIGTERM,
        ("deploy", LEADER, CARS, "--all-local", "--record", "run.mcap"),
        ("run.mcap",),
        "rounds of 3 robots",
    ),
)


#: Who are asked by default; the others hear signals in the same way.
OFTEN = ("verify", "run")


@pytest.mark.parametrize(
    "asked",
    [
        pytest.param(one, id=one.words[0], marks=() if one.words[0] in OFTEN else pytest.mark.slow)
        for one in ASKED
    ],
)
def test_who_is_asked_to_end_tells_and_keeps_what_there_is(asked: Asked, tmp_path: Path) -> None:
    (tmp_path / "hard.krd").write_text(HARD, "utf-8")
    ended_ = run_until(tmp_path, asked.what, asked.most, asked.number, *asked.words)
    codes = {signal.SIGTERM: Exit.TERMINATED, signal.SIGHUP: Exit.HUNG_UP}
    assert ended_.returncode == codes[signal.Signals(asked.number)]
    assert asked.said in re.sub(" +", " ", ended_.stdout.decode())
    names = sorted(["driver.py", "hard.krd", *asked.left])
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    if asked.words[0] == "deploy":
        with (tmp_path / "run.mcap").open("rb") as file:
            assert list(make_reader(file).iter_messages())


def test_a_run_that_is_killed_is_there_up_to_then(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", LEADER, "--policy", "random", "--rounds", "90", "--trace", "t.json"]
    assert ended(tmp_path, "trace", 8, signal.SIGKILL, *words) == -signal.SIGKILL
    assert main(["replay", str(tmp_path / "t.part.json"), "--json"]) == Exit.OK
    told = json.loads(capsys.readouterr().out)
    assert (told["legal"], told["rounds"], told["cut_off"]) == (True, 7, True)


def test_a_deployed_run_that_is_killed_is_there_up_to_then(tmp_path: Path) -> None:
    words = ["deploy", str(EXAMPLES / "leader_elect.krd"), str(EXAMPLES / "three_cars.yaml")]
    words += ["--all-local", "--record", "run.mcap"]
    assert ended(tmp_path, "record", 8, signal.SIGKILL, *words) == -signal.SIGKILL
    told = [json.loads(message.data) for message in messages(tmp_path / "run.mcap")]
    assert any("event" in one for one in told)


def test_a_bag_of_a_run_that_is_killed_is_whole(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    words = ["sim", PATH, "--no-html", "--record", "run.rosbag2"]
    assert ended(tmp_path, "bag", 6, signal.SIGKILL, *words) == -signal.SIGKILL
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["driver.py", "run.part.rosbag2"]
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([tmp_path / "run.part.rosbag2"], default_typestore=store) as reader:
        times = [time_ns for one, time_ns, _ in reader.messages() if one.topic == "/tf"]
        assert reader.message_count == sum(1 for _ in reader.messages())
    assert max(times) == round(0.5e9)  # five rounds


@pytest.mark.slow
def test_a_recording_for_rerun_of_a_run_that_is_killed_is_there(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    words = ["sim", PATH, "--no-html", "--record", "run.rrd"]
    assert ended(tmp_path, "rrd", 6, signal.SIGKILL, *words) == -signal.SIGKILL
    tool = shutil.which("rerun", path=Path(sys.executable).parent)
    assert tool is not None
    told = subprocess.run(
        [tool, "rrd", "print", "-vvv", str(tmp_path / "run.part.rrd")],
        capture_output=True,
        text=True,
        env={**os.environ, "HOME": str(tmp_path)},
        check=True,
    )
    times = {float(one) for one in re.findall(r"PT([0-9.]+)S", told.stdout)}
    assert max(times) == 0.5, told.stdout[:4000]


@pytest.mark.slow
def test_a_run_that_is_watched_and_killed_is_there_up_to_then(tmp_path: Path) -> None:
    words = ["sim", PATH, "--live", "--pace", "10", "--no-html", "--record", "run.mcap"]
    assert ended(tmp_path, "record", 6, signal.SIGKILL, *words) == -signal.SIGKILL
    told = [json.loads(message.data) for message in messages(tmp_path / "run.part.mcap")]
    assert max(one["round"] for one in told if "ran" in one) == 4
