"""``koord sim --runs``: many runs, and what is told of them."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from koord.cli.campaigns import mean_and_reach
from koord.cli.exits import Exit
from koord.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
TASK = [str(EXAMPLES / "task.krd"), str(EXAMPLES / "task_mixed.yaml"), "--time", "1"]
PATH = [str(EXAMPLES / "follow_path.krd"), "--time", "1"]


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


def test_a_sweep_has_a_line_for_each_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", *PATH, "--sweep", "height=1,1.5"]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == ["height", "1", "1.5"]
    assert main(["sim", *TASK, "--sweep", "robots=2..3", "--json"]) == Exit.OK
    runs = json.loads(capsys.readouterr().out)["runs"]
    assert [run["robots"] for run in runs] == [2, 3]


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


def test_intervals_are_those_of_students_t() -> None:
    mean, reach = mean_and_reach([1.0, 2.0, 3.0, 4.0, 5.0])
    assert mean == 3.0
    assert reach == pytest.approx(2.776 * 1.5811 / 5**0.5, rel=1e-3)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--sweep", "robots"], "no sweep"),
        (["--sweep", "robots=3..2"], "1000 values"),
        (["--sweep", "robots=0.5"], "no number of robots"),
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
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        for flags in ([], ["--cluster", cluster.scheduler_address]):
            assert main(["sim", *TASK, "--runs", "2", "--json", *flags]) == Exit.OK
            runs = json.loads(capsys.readouterr().out)["runs"]
            found.append(sorted((run["seed"], run["digest"]) for run in runs))
        flags = ["--sweep", "hight=1,2", "--cluster", cluster.scheduler_address]
        assert main(["sim", *PATH, *flags]) == Exit.BAD_INPUT
    assert found[0] == found[1]
    assert "no `param` named `hight`" in capsys.readouterr().err
