"""``koord sim --runs``: many runs, and what is told of them."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from jsonschema import validate
from msgspec.structs import replace

from koord.api.campaign_figures import mean_and_reach
from koord.api.campaign_pictures import finished, told
from koord.api.campaign_runs import Row
from koord.api.documents import schema
from koord.cli.exits import Exit
from koord.cli.main import main
from tests.api.test_campaign_figures import PLAIN
from tests.api.test_splitting import COIN, ONE
from tests.clusters import worker_of_this_process

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
TASK = [str(EXAMPLES / "task.krd"), str(EXAMPLES / "task_mixed.yaml"), "--time", "0.5"]
#: Columns of what was measured, which differ from run to run.
MEASURED = ("wall_s", "cpu_s", "memory_mib", "threads")

PATH = [str(EXAMPLES / "follow_path.krd"), "--time", "0.5"]


def test_each_run_has_a_seed_of_its_own_and_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "runs.csv"
    assert main(["sim", *TASK, "--runs", "3", "--seed", "5", "--csv", str(table)]) == Exit.OK
    out, _ = capsys.readouterr()
    values = "δ = 0.1 s, tasks = 6 (4 in the text), 6 tasks of the world"
    assert f"task.krd: 3 runs, {values}, means with 95 % intervals" in out
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["seed"] for row in rows] == ["5", "6", "7"]
    assert {row["values"] for row in rows} == {values}
    assert len({row["digest"] for row in rows}) == 3
    assert main(["sim", *TASK, "--seed", "6", "--json", "--no-html"]) == Exit.OK
    assert json.loads(capsys.readouterr().out)["digest"] == rows[1]["digest"]


def test_a_line_says_what_its_run_needed(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    assert main(["sim", *PATH, "--runs", "2", "--csv", str(path), "--no-html"]) == Exit.OK
    for one in lines(path):
        assert float(one["cpu_s"]) > 0.0
        assert float(one["memory_mib"]) > 10.0
        assert int(one["threads"]) >= 1


def test_a_sweep_has_a_line_for_each_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", *PATH, "--sweep", "height=1,1.5"]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == ["height", "1", "1.5"]
    assert main(["sim", *TASK, "--sweep", "robots=2..3", "--json"]) == Exit.OK
    told = json.loads(capsys.readouterr().out)
    validate(told, schema("campaign"))
    assert [run["robots"] for run in told["runs"]] == [2, 3]


@pytest.mark.slow
def test_several_processes_do_what_one_does(capsys: pytest.CaptureFixture[str]) -> None:
    found = []
    for jobs in ("1", "2"):
        assert main(["sim", *TASK, "--runs", "3", "--jobs", jobs, "--json"]) == Exit.OK
        runs = json.loads(capsys.readouterr().out)["runs"]
        found.append(sorted((run["seed"], run["digest"]) for run in runs))
    assert found[0] == found[1]
    assert main(["sim", *PATH, "--sweep", "hight=1,2", "--jobs", "2"]) == Exit.BAD_INPUT
    assert "no `param` named `hight`" in capsys.readouterr().err


def test_what_is_broken_in_a_run_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "count.krd"
    program.write_text(
        "param int most = 3\nlocal:\n    int n = 0\nCount:\n    eff: n = n + 1\n\n"
        "invariant Few: n <= most\n",
        encoding="utf-8",
    )
    files = [str(program), "--time", "1", "--robots", "2"]
    assert main(["sim", *files, "--sweep", "most=9,30"]) == Exit.VIOLATED
    out, _ = capsys.readouterr()
    assert out.count("broken: ") == 1
    assert "2 robots, seed 0: 2 claims broken" in out


def test_a_campaign_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    picture = tmp_path / "runs.svg"
    arguments = ["sim", *PATH, "--runs", "2", "--sweep", "height=1,2", "--plot", str(picture)]
    assert main(arguments) == Exit.OK
    first = picture.read_bytes()
    assert b"<svg" in first
    assert b"height" in first


def test_runs_of_one_value_are_drawn_as_they_are_distributed(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    picture = tmp_path / "runs.svg"
    assert main(["sim", *PATH, "--runs", "3", "--plot", str(picture)]) == Exit.OK
    first = picture.read_text("utf-8")
    for words in ("done: 3 of 3 runs", "how they ended", "distance of all robots"):
        assert f"<!-- {words}" in first


def test_the_schema_of_a_campaign_has_all_that_is_told_of_a_run() -> None:
    run = schema("campaign")["$defs"]["CampaignRun"]
    assert list(run["properties"]) == list(Row.__struct_fields__)
    assert set(run["required"]) == set(Row.__struct_fields__)


def test_endings_are_told_in_words() -> None:
    ended = replace(PLAIN, broken=0, stuck=0, ending="limit")
    assert told(ended) == "the time was up"
    assert told(replace(ended, stuck=1)) == "the time was up, some stuck"
    assert told(replace(ended, broken=2)) == "a claim was broken"


def test_the_share_of_runs_that_are_done_counts_all_runs() -> None:
    done = replace(PLAIN, tasks=2, tasks_done=2, ending="stopped")
    rows = [replace(done, seed=k, tasks_s=time_s) for k, time_s in enumerate((4.0, 2.0, 3.0))]
    rows.append(replace(done, seed=3, tasks_done=1, tasks_s=None))
    assert finished(rows) == [(0.0, 0.0), (2.0, 0.25), (3.0, 0.5), (4.0, 0.75)]


def test_intervals_are_those_of_students_t() -> None:
    mean, reach = mean_and_reach([1.0, 2.0, 3.0, 4.0, 5.0])
    assert mean == 3.0
    assert reach == pytest.approx(2.776 * 1.5811 / 5**0.5, rel=1e-3)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--sweep", "robots"], "no sweep"),
        (["--sweep", "robots=3..2"], "1000 values"),
        (["--sweep", "robots=0.5"], "robots must be from 1 to 10000"),
        (["--runs", "0"], "runs must be from 1 to"),
        (["--csv", "runs.csv"], "--runs K"),
        (["--runs", "2", "--trace", "t.json"], "of one run"),
        (["--sweep", "hight=1,2"], "no `param` named `hight`"),
    ],
)
def test_flags_that_do_not_go_together(
    flags: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", *PATH, *flags]) == Exit.BAD_INPUT
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_cluster_does_what_one_process_does(capsys: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed")
    found = []
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as cluster:
        for flags in ([], ["--cluster", cluster.scheduler_address]):
            assert main(["sim", *TASK, "--runs", "2", "--json", *flags]) == Exit.OK
            runs = json.loads(capsys.readouterr().out)["runs"]
            found.append(sorted((run["seed"], run["digest"]) for run in runs))
        flags = ["--sweep", "hight=1,2", "--cluster", cluster.scheduler_address]
        assert main(["sim", *PATH, *flags]) == Exit.BAD_INPUT
    assert found[0] == found[1]
    assert "no `param` named `hight`" in capsys.readouterr().err


# --- campaigns that are ended ---------------------------------------------------------------------

#: Runs the command line, and ends itself by a signal once so many runs are in the file.
ENDED = """
import os, signal, sys
from koord.api.campaign_runs import RunFile
from koord.cli.main import main

def adding(self, row, add=RunFile.add):
    add(self, row)
    adding.left -= 1
    if adding.left == 0:
        os.kill(os.getpid(), int(sys.argv[2]))

if __name__ == "__main__":
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    adding.left = int(sys.argv[1])
    RunFile.add = adding
    sys.exit(main(sys.argv[3:]))
"""


def ended(folder: Path, after: int, number: int, *words: str) -> int:
    """The exit code of a command that was ended so; when it is known no worker is left."""
    driver = folder / "driver.py"
    driver.write_text(ENDED, "utf-8")
    command = [sys.executable, str(driver), str(after), str(int(number)), *words]
    # Workers inherit the pipe: its end is reached when the last of them has ended.
    done = subprocess.run(command, stdout=subprocess.PIPE, timeout=120, check=False)
    return done.returncode


def lines(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def without_times(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [{name: cell for name, cell in row.items() if name not in MEASURED} for row in rows]


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGKILL, -signal.SIGKILL),
        # These are heard as by other commands: tests/cli/test_killed.py has both.
        pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, 129, marks=pytest.mark.slow),
    ],
)
def test_a_campaign_that_was_ended_goes_on(
    number: int, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, whole = tmp_path / "runs.csv", tmp_path / "whole.csv"
    words = ["sim", *PATH[:1], "--time", "0.2", "--runs", "4", "--csv"]
    assert ended(tmp_path, 2, number, *words, str(table)) == code
    before = lines(table)
    assert [row["seed"] for row in before] == ["0", "1"]
    assert main([*words, str(table)]) == Exit.BAD_INPUT
    assert "K937" in capsys.readouterr().err
    assert main([*words, str(table), "--resume"]) == Exit.OK
    assert "2 of 4 runs are there already" in capsys.readouterr().out
    assert main([*words, str(whole)]) == Exit.OK
    assert lines(table)[:2] == before
    assert without_times(lines(table)) == without_times(lines(whole))


def test_no_worker_outlives_its_campaign(tmp_path: Path) -> None:
    table = tmp_path / "runs.csv"
    words = ["sim", *PATH[:1], "--time", "2", "--runs", "6", "--jobs", "2", "--csv", str(table)]
    assert ended(tmp_path, 1, signal.SIGKILL, *words) == -signal.SIGKILL
    assert len(lines(table)) == 1


@pytest.mark.parametrize("more", [["--seed", "7"], ["--set", "height=1"], ["--rounds", "3"]])
def test_a_file_of_another_campaign_is_refused(
    more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "runs.csv"
    words = ["sim", *PATH[:1], "--time", "0.5", "--csv", str(table)]
    assert main([*words, "--runs", "1"]) == Exit.OK
    kept = table.read_bytes()
    assert main([*words, "--runs", "2", "--resume", *more]) == Exit.BAD_INPUT
    assert "are not of this campaign" in capsys.readouterr().err
    assert table.read_bytes() == kept


def test_a_line_that_was_cut_off_is_made_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "runs.csv"
    words = ["sim", *PATH[:1], "--time", "0.5", "--csv", str(table), "--runs", "2"]
    assert main(words) == Exit.OK
    whole = lines(table)
    table.write_bytes(table.read_bytes()[:-7])
    assert main([*words, "--resume"]) == Exit.OK
    assert "1 of 2 runs are there already" in capsys.readouterr().out
    assert without_times(lines(table)) == without_times(whole)


def test_no_run_on_a_cluster_outlives_who_asked_for_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    begun, ended_, given_up = threading.Event(), threading.Event(), threading.Event()

    def endless(simulation: object, limit_s: float) -> Iterator[None]:
        begun.set()
        try:
            while not given_up.wait(0.01):
                yield
        finally:
            ended_.set()

    # The worker is a thread of this process.
    monkeypatch.setattr("koord.api.campaign_runs.run", endless)
    with worker_of_this_process() as address:
        command = [sys.executable, "-m", "koord", "sim", *PATH, "--runs", "2"]
        asking = subprocess.Popen([*command, "--cluster", address])
        try:
            assert begun.wait(60)
            asking.kill()
            assert asking.wait(60) == -signal.SIGKILL
            assert ended_.wait(30), "the run goes on"
        finally:
            given_up.set()
            asking.kill()
            asking.wait()


# --- campaigns that end when their intervals are narrow -------------------------------------------

UNTIL = ["sim", *TASK[:1], "--robots", "1", "--time", "0.5", "--until", "distance=0.1"]


def test_a_campaign_ends_when_its_interval_is_narrow(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "runs.csv"
    assert main([*UNTIL, "--csv", str(table), "--json"]) == Exit.OK
    document = json.loads(capsys.readouterr().out)
    validate(document, schema("campaign"))
    assert 20 <= len(document["runs"]) < 100
    assert document["until"] == {"metric": "distance", "reach": 0.1}
    (interval,) = document["intervals"].values()
    assert interval["high"] - interval["low"] <= 0.2
    assert [row["seed"] for row in lines(table)] == [str(run["seed"]) for run in document["runs"]]
    assert main([*UNTIL, "--csv", str(table), "--resume"]) == Exit.OK
    out = capsys.readouterr().out
    assert f"{len(document['runs'])} of at most 1000 runs are there already" in out
    assert "broken %" in out


@pytest.mark.slow
def test_rows_and_end_do_not_hang_on_the_number_of_jobs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = []
    for jobs in ("1", "2", "3"):
        table = tmp_path / f"{jobs}.csv"
        assert main([*UNTIL, "--sweep", "robots=2..3", "--jobs", jobs, "--csv", str(table)]) == 0
        found.append(without_times(lines(table)))
    assert found[0] == found[1] == found[2]


@pytest.mark.slow
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_what_ctrl_c_leaves_are_whole_rows(jobs: str, tmp_path: Path) -> None:
    table = tmp_path / "runs.csv"
    words = ["sim", *PATH[:1], "--time", "2", "--runs", "100", "--jobs", jobs, "--csv", str(table)]
    assert ended(tmp_path, 3, signal.SIGINT, *words) == Exit.INTERRUPTED
    assert table.read_bytes().endswith(b"\n")
    assert 3 <= len(lines(table)) < 100
    assert all(None not in row.values() for row in lines(table))


@pytest.mark.slow
def test_splitting_tells_a_rate_with_its_interval(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, config = tmp_path / "coin.krd", tmp_path / "coin.yaml"
    program.write_text(COIN.text)
    config.write_text(ONE.text)
    few = ["sim", str(program), "--time", "5", "--splitting", "Below", "--particles", "4"]
    few += ["--runs", "3", "--set", "start=1"]
    assert main([*few, "--set", "goal=3"]) == Exit.VIOLATED
    told = capsys.readouterr().out
    assert "coin.krd: invariant Below, 3 repetitions of splitting with 4 particles" in told
    assert "95 % interval" in told
    assert "the interval may be too narrow" in told
    assert main([*few, "--set", "goal=3", "--json"]) == Exit.VIOLATED
    found = json.loads(capsys.readouterr().out)
    validate(found, schema("splitting"))
    assert found["low"] <= found["rate"] <= found["high"]
    assert len(found["repetitions"]) == 3
    assert main([*few, "--set", "goal=90", "--level", "x"]) == Exit.OK
    told = capsys.readouterr().out
    assert "no violation was found: at most 0.26 of runs break it (95 %)" in told


def test_what_says_nothing_to_splitting_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (
        ["--splitting", "separation", "--csv", "runs.csv"],
        ["--splitting", "separation", "--trace", "run.json"],
        ["--splitting", "separation", "--runs", "1"],
        ["--splitting", "separation", "--particles", "1"],
        ["--level", "x"],
        ["--runs", "3", "--particles", "7"],
        ["--runs", "3", "--html", "run.html"],
    ):
        assert main(["sim", *PATH, *words]) == Exit.BAD_INPUT
        assert words[-2].removeprefix("--") in capsys.readouterr().err
