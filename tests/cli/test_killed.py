"""What is recorded of a run that is killed: all up to the last second, and it can be read."""

from __future__ import annotations

import base64
import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader

from koord.cli.exits import Exit
from koord.cli.main import main
from tests.sim.unpacking import unpacked

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Runs the command line, and ends itself by a signal when something was called so many times.
ENDED = """
import os, sys
import koord.cli.growing as growing
from koord.runtime.records import RecordFile
from koord.semantics.traces.parts import PartTrace
from koord.sim.viewing import PartPage
from koord.cli.main import main

def counted(holder, name, most, number):
    do = getattr(holder, name)
    left = [most]
    def done(*arguments):
        do(*arguments)
        left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), number)
    setattr(holder, name, done)

if __name__ == "__main__":
    growing.PERIOD_S = 0.0
    what, most, number = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    holders = {"page": (PartPage, "grow"), "record": (RecordFile, "flush")}
    holders["trace"] = (PartTrace, "grow")
    holder, name = holders[what]
    counted(holder, name, most, number)
    sys.exit(main(sys.argv[4:]))
"""


def ended(folder: Path, what: str, most: int, number: int, *words: str) -> int:
    driver = folder / "driver.py"
    driver.write_text(ENDED, "utf-8")
    command = [sys.executable, str(driver), what, str(most), str(int(number)), *words]
    # Processes of robots inherit the pipe: its end is reached when the last of them has ended.
    run = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, timeout=120, check=False)
    return run.returncode


def messages(path: Path) -> list[Message]:
    """The messages of an MCAP file that may be cut off anywhere."""
    found = []
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Message):
                    found.append(record)
        except EndOfFile:
            pass
    return found


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


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_who_is_asked_to_end_keeps_all_of_it(number: int, code: int, tmp_path: Path) -> None:
    words = ["sim", str(EXAMPLES / "follow_path.krd"), "--record", "run.mcap", "--trace", "t.json"]
    assert ended(tmp_path, "page", 5, number, *words) == code
    names = ["driver.py", "run.html", "run.mcap", "t.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_a_deployed_run_that_is_killed_is_there_up_to_then(tmp_path: Path) -> None:
    words = ["deploy", str(EXAMPLES / "leader_elect.krd"), str(EXAMPLES / "three_cars.yaml")]
    words += ["--all-local", "--record", "run.mcap"]
    assert ended(tmp_path, "record", 8, signal.SIGKILL, *words) == -signal.SIGKILL
    told = [json.loads(message.data) for message in messages(tmp_path / "run.mcap")]
    assert any("event" in one for one in told)


def test_a_deployed_run_that_is_asked_to_end_ends_safely(tmp_path: Path) -> None:
    words = ["deploy", str(EXAMPLES / "leader_elect.krd"), str(EXAMPLES / "three_cars.yaml")]
    words += ["--all-local", "--record", "run.mcap"]
    assert ended(tmp_path, "record", 8, signal.SIGTERM, *words) == Exit.TERMINATED
    from mcap.reader import make_reader

    with (tmp_path / "run.mcap").open("rb") as file:
        assert list(make_reader(file).iter_messages())
