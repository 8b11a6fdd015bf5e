"""``koord sim --processes``: the same run, over UDP."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"


def digests(name: str, time_s: int, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The hashes of a run in one process, and with one for each robot."""
    found = []
    for flags in (["--no-html"], ["--processes"]):
        program = str(EXAMPLES / f"{name}.krd")
        code = main(["sim", program, "--time", str(time_s), "--json", *flags])
        out, err = capsys.readouterr()
        assert code == Exit.OK, err
        run = json.loads(out)
        assert run["rounds"] == 10 * time_s
        found.append(run["digest"])
    return found


def test_processes_make_the_same_run(capsys: pytest.CaptureFixture[str]) -> None:
    one, several = digests("follow_path", 3, capsys)
    assert one == several


@pytest.mark.slow
def test_cars_among_processes_make_the_same_run(capsys: pytest.CaptureFixture[str]) -> None:
    one, several = digests("task", 8, capsys)
    assert one == several


def test_processes_leave_no_recording(capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--processes", "--record", "run.mcap"]
    assert main(["sim", str(EXAMPLES / "follow_path.krd"), *flags]) == Exit.BAD_INPUT
    assert "the same run" in capsys.readouterr().err
