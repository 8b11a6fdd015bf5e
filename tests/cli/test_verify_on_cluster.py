"""``koord verify --cluster``: the verdicts of one process, whatever becomes of the workers."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from koord.api import courier
from koord.api.courier import Cluster
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.verify.helpers import Helpers
from koord.verify.processes import can_fork
from tests.clusters import ROOT, WITHOUT_KOORD, local_cluster, worker_of_this_process

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")

EXAMPLES = ROOT / "specs" / "examples"

#: One claim that holds, one that is violated, and one about whole runs.
TEXT = """
local:
    int steps = 0
Step:
    pre: steps < 3
    eff: steps = steps + 1
invariant Few: steps <= 3
invariant Fewer: steps <= 2
eventually Done: forall i: steps@i >= 3
"""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with local_cluster() as (found, _):
        yield found


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "steps.krd"
    path.write_text(TEXT, encoding="utf-8")
    return str(path)


#: What depends on the machine, and on who has looked at it.
_TIMES = {"seconds", "spans"}


def reports(words: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, list[Any]]:
    """The exit code of a verification, and what it tells, but for times."""

    def timeless(value: Any) -> Any:
        match value:
            case dict():
                return {key: timeless(each) for key, each in value.items() if key not in _TIMES}
            case list():
                return [timeless(each) for each in value]
            case _:
                return value

    code = main(["verify", *words, "--json"])
    return code, timeless(json.loads(capsys.readouterr().out))


@pytest.mark.slow
def test_numbers_of_robots_have_the_same_verdicts_there(
    program: str, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [program, "--robots", "1..2", "--rounds", "5"]
    alone = reports(words, capsys)
    assert alone[0] == Exit.VIOLATED
    assert reports([*words, "--cluster", address], capsys) == alone


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["leader_elect.krd", "--robots", "2..4"],
        ["task.krd", "--robots", "2..3"],
        ["broken/leader_elect_early.krd", "--robots", "2..3"],
        ["broken/crossing.krd", "broken/hvac_may_sleep.krd", "--rounds", "6"],
        ["leader_elect.krd", "--robots", "2", "--engine", "bits", "--property-timeout", "100"],
        ["protocols/peterson.krd", "--robots", "2", "--engine", "bits"],
    ],
    ids=" ".join,
)
def test_examples_have_the_same_verdicts_there(
    words: list[str], address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(EXAMPLES / word) if word.endswith(".krd") else word for word in words]
    assert reports([*words, "--cluster", address], capsys) == reports(words, capsys)


@pytest.mark.slow
def test_somebody_who_is_no_scheduler_is_told(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", program, "--cluster", "nonsense"]) == Exit.BAD_INPUT
    err = capsys.readouterr().err
    assert "K935" in err
    assert "missing port number" in err
    assert "dask scheduler" in err


@pytest.mark.slow
def test_a_worker_without_koord_is_told(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    with local_cluster(first=WITHOUT_KOORD) as (address, _):
        assert main(["verify", program, "--cluster", address]) == Exit.BAD_INPUT
    err = capsys.readouterr().err
    assert "K947" in err
    assert "koord is not installed there" in err
    assert address.rpartition(":")[0] in err, "which worker it is"


@pytest.mark.slow
def test_a_worker_with_another_version_is_told(
    program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "koord", tmp_path / "koord", ignore=shutil.ignore_patterns("*.pyc"))
    file = tmp_path / "koord" / "verify" / "claims.py"
    file.write_text(file.read_text("utf-8") + "\n# Another version.\n", "utf-8")
    with local_cluster(folder=tmp_path) as (address, _):
        words = ["verify", program, "--robots", "1..2", "--cluster", address]
        assert main(words) == Exit.BAD_INPUT
    out, err = capsys.readouterr()
    assert "K947" in err
    assert "a worker of the cluster has koord" in err
    assert "holds" not in out


@pytest.mark.slow
def test_a_cluster_without_workers_is_told(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def reached(*_: object) -> Iterator[Cluster]:
        cluster = Cluster(Helpers("/nowhere", b"", ""), workers=0)
        yield cluster
        cluster.died = 2

    monkeypatch.setattr(courier, "cluster_at", reached)
    assert main(["verify", program, "--property", "Few", "--cluster", "tcp://x:1"]) == Exit.OK
    first, *_, last = capsys.readouterr().err.splitlines()
    assert "no workers yet" in first
    assert "2 workers of the cluster ended at a question" in last


@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGKILL, marks=pytest.mark.slow),
    ],
)
def test_no_question_outlives_who_asked_it(
    number: signal.Signals, program: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, ended, given_up = threading.Event(), threading.Event(), threading.Event()

    def wait(line: object, tell: object, is_unwanted: Callable[[], bool]) -> bytes:
        begun.set()
        while not (is_unwanted() or given_up.wait(0.01)):
            pass
        ended.set()
        return b""

    monkeypatch.setattr(courier, "_said_at_last", wait)
    with worker_of_this_process() as address:
        command = [sys.executable, "-m", "koord", "verify", program, "--robots", "1..2"]
        asking = subprocess.Popen(
            [*command, "--cluster", address],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            assert begun.wait(60)
            asking.send_signal(number)
            out, _ = asking.communicate(timeout=60)
            assert ended.wait(30), "the question goes on"
        finally:
            given_up.set()
            asking.kill()
            asking.communicate()
    codes = {signal.SIGINT: Exit.INTERRUPTED, signal.SIGTERM: Exit.TERMINATED}
    assert asking.returncode == codes.get(number, -number)
    assert "Traceback" not in out
