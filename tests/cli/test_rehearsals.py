"""``koord sim --schedule``: counterexamples, played in the world."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from tests.sampling import but_slow

BROKEN = Path(__file__).parents[2] / "specs" / "examples" / "broken"


@pytest.mark.parametrize(
    ("name", "robots", "claims"),
    but_slow(
        ["task_no_lock", "delivery_no_lock", "waypoints_early", "cars_and_drones_low"],
        [
            ("task_no_lock", 2, {"Exclusive"}),
            ("delivery_no_lock", 2, {"Once"}),
            ("lineform_1d_overshoot", 3, {"Fence"}),
            ("waypoints_early", 2, {"InOrder"}),
            ("cars_and_drones_low", 2, {"Aloft"}),
        ],
    ),
)
def test_what_a_counterexample_breaks_is_broken_in_the_world(
    name: str,
    robots: int,
    claims: set[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    program, trace = str(BROKEN / f"{name}.krd"), str(tmp_path / "trace.json")
    bounds = ["--robots", str(robots), "--rounds", "5"]
    assert main(["verify", program, *bounds, "--trace", trace]) == Exit.VIOLATED
    violated = json.loads(Path(trace).read_text("utf-8"))["run"]["violation"]["name"]
    capsys.readouterr()
    flags = ["--schedule", trace, "--json", "--no-html"]
    assert main(["sim", program, *flags]) == Exit.VIOLATED
    run = json.loads(capsys.readouterr().out)
    assert run["ending"] == "played"
    broken = {one["claim"].split()[-1] for one in run["broken"]}
    assert violated in broken
    assert claims <= broken


def test_a_simulated_run_is_played_as_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    examples = BROKEN.parent
    files = [str(examples / "task.krd"), str(examples / "task_mixed.yaml")]
    trace = str(tmp_path / "trace.json")
    flags = ["--time", "1.5", "--json", "--no-html"]
    assert main(["sim", *files, *flags, "--trace", trace]) == Exit.OK
    first = json.loads(capsys.readouterr().out)
    assert main(["sim", files[0], "--schedule", trace, "--json", "--no-html"]) == Exit.OK
    again = json.loads(capsys.readouterr().out)
    assert (again["rounds"], again["broken"]) == (first["rounds"], [])
    for was, is_now in zip(first["robots"], again["robots"], strict=True):
        assert (is_now["events"], is_now["skips"]) == (was["events"], was["skips"])
        assert is_now["distance_m"] == pytest.approx(was["distance_m"], abs=0.5)  # of noisy fixes


def test_a_schedule_leaves_nothing_to_configure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = str(BROKEN / "task_no_lock.krd")
    assert main(["sim", program, "--schedule", "t.json", "--robots", "3"]) == Exit.BAD_INPUT
    assert "as it is recorded" in capsys.readouterr().err
    bad = tmp_path / "bad.json"
    bad.write_text("{}", encoding="utf-8")
    assert main(["sim", program, "--schedule", str(bad), "--no-html"]) == Exit.BAD_INPUT
