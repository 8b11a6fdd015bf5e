"""``koord sim --processes``: the same run, with programs in several processes."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from koord.api import sim_processes
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.robot import Robot
from tests.sampling import first

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
BOTH = ("", "--processes")


def run(
    name: str, capsys: pytest.CaptureFixture[str], *flags: str, code: Exit = Exit.OK
) -> dict[str, Any]:
    """The figures of a run, without how long it took on the wall."""
    given = [flag for flag in flags if flag]
    found = main(["sim", str(EXAMPLES / f"{name}.krd"), "--json", "--no-html", *given])
    out, err = capsys.readouterr()
    assert found == code, err
    figures: dict[str, Any] = json.loads(out)
    for name in ("wall_s", "late"):
        figures.pop(name, None)
    return figures


def same_run(name: str, time_s: int, capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    """In one process and in several: the same figures, recordings and traces, to the last bit."""
    told, kept = [], []
    for mode in BOTH:
        files = [folder / f"run{mode}{end}" for end in (".html", ".mcap", ".json")]
        page, record, trace = map(str, files)
        flags = ("--time", str(time_s), "--html", page, "--record", record, "--trace", trace)
        told.append(run(name, capsys, *flags, mode))
        kept.append([file.read_bytes() for file in files])
    assert told[0] == told[1]
    assert told[0]["rounds"] == 10 * time_s
    assert told[0]["claims"]
    assert kept[0] == kept[1]


def test_processes_make_the_same_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    same_run("follow_path", 1, capsys, tmp_path)


@pytest.mark.slow
def test_two_in_a_scene_with_a_scanner_make_the_same_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same_run("mapping", 4, capsys, tmp_path)


@pytest.mark.parametrize("name", first(1, ["hvac", "shortest_path_any_graph"]))
def test_what_no_world_answers_is_answered_alike(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    short = ("--robots", "3", "--delta", "0.1", "--time", "2")
    one, several = (run(name, capsys, *short, mode) for mode in BOTH)
    assert one == several


@pytest.mark.parametrize("name", first(1, ["lineform_ends", "leader_elect_early"]))
def test_faults_and_broken_claims_are_the_same(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program = f"broken/{name}"
    one, several = (run(program, capsys, "--time", "3", m, code=Exit.VIOLATED) for m in BOTH)
    assert one == several
    assert one["fault"] or one["broken"]


@pytest.mark.slow
def test_cars_among_processes_make_the_same_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same_run("task", 30, capsys, tmp_path)


@pytest.mark.slow
def test_a_run_of_processes_ends_where_one_in_one_process_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By itself when nothing changes any more, and where a claim is broken."""
    ends = [run("follow_path", capsys, "--time", "30", mode) for mode in BOTH]
    assert ends[0] == ends[1]
    assert ends[0]["ending"] == "stopped"
    low = tmp_path / "low.krd"
    low.write_text("invariant Low: forall i: Motion.psn@i.z <= 0.3\n")
    flags = ("--with", str(low))
    ends = [run("follow_path", capsys, *flags, mode, code=Exit.VIOLATED) for mode in BOTH]
    assert ends[0] == ends[1]
    assert ends[0]["ending"] == "violated"
    assert ends[0]["broken"][0]["claim"] == "invariant Low"


def test_a_process_that_dies_ends_the_run_and_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real, first = Robot.propose, os.getpid()

    def dies(self: Robot, round_: int, *given: Any, **more: Any) -> Any:
        if os.getpid() != first and self.pid == 2 and round_ == 20:
            os._exit(9)
        return real(self, round_, *given, **more)

    monkeypatch.setattr(Robot, "propose", dies)
    monkeypatch.setattr(sim_processes, "cores", lambda: 3)
    program = str(EXAMPLES / "follow_path.krd")
    flags = ["--time", "30", "--no-html", "--processes"]
    assert main(["sim", program, *flags]) == Exit.VIOLATED
    out, _ = capsys.readouterr()
    assert "programs in 3 processes" in out
    assert "the process of 2 robots (2, 3) was ended" in out
    assert "a robot told nothing more" in out
    time_s = float(next(line.split()[1] for line in out.splitlines() if line.startswith("time")))
    assert time_s == 2.0  # up to the round that nobody decided
