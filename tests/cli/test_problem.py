"""Every value that is not the text's is shown wherever a verdict or a run is, and kept with it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from koord.cli.main import main

PROGRAM = """\
param int k = 2
param float speed
param int[] spots = [1, 2]
enum Mode: slow, quick
param Mode mode = slow

local:
    int n = 0

Step:
    pre: n < k and speed > 0.0 and spots[0] > 0 and mode == quick
    eff: n = n + 1

invariant Small: n <= 2
"""

SET = ["--set", "k=1", "--set", "speed=0.5", "--set", "mode=quick", "--set", "spots=[1, 2]"]

#: What is not as in the text; the value of ``spots`` is.
VALUES = (
    "k = 1 (2 in the text), speed = 0.5 (no value in the text), mode = quick (slow in the text)"
)

Koord = Callable[..., str]


@pytest.fixture
def koord(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Koord:
    """What a command prints, with the values set."""
    monkeypatch.chdir(tmp_path)
    Path("k.krd").write_text(PROGRAM, encoding="utf-8")
    Path("more.krd").write_text("invariant More: n < 7\n", encoding="utf-8")

    def ran(*words: str) -> str:
        main(list(words))
        return capsys.readouterr().out

    return ran


VERIFY = ["verify", "k.krd", *SET, "--delta", "1/3", "--rounds", "3", "--engine", "search"]
ABOUT = f"k.krd: 2 robots, δ = 1/3 s, {VALUES}"


def test_a_verdict(koord: Koord) -> None:
    assert koord(*VERIFY, "--robots", "2").startswith(f"{ABOUT}\n")


def test_robots_and_delta_that_the_text_states(koord: Koord) -> None:
    stated = "param int numAgents = 2\nparam float delta = 40\n"
    Path("k.krd").write_text(stated + PROGRAM, encoding="utf-8")
    flags = ["--engine", "search", "--rounds", "3"]
    assert koord("verify", "k.krd", *SET, *flags).startswith(f"k.krd: 2 robots, δ = 40 s, {VALUES}")
    said = koord("verify", "k.krd", *SET, *flags, "--robots", "1", "--delta", "1")
    about = f"1 robot (2 robots in the text), δ = 1 s (40 s in the text), {VALUES}"
    assert said.startswith(f"k.krd: {about}\n")
    assert koord("run", "k.krd", *SET, "--robots", "1", "--delta", "1").startswith(
        f"k.krd: {about},"
    )


def test_files_of_properties_are_named(koord: Koord) -> None:
    said = koord(*VERIFY, "--robots", "2", "--with", "more.krd")
    assert said.startswith("k.krd with more.krd: 2 robots, δ = 1/3 s, k = 1")


def test_a_verdict_as_json(koord: Koord) -> None:
    (report,) = json.loads(koord(*VERIFY, "--robots", "2", "--json"))["reports"]
    assert report["problem"] == {
        "robots": 2,
        "kinds": None,
        "delta": "1/3",
        "in_text": {"robots": None, "kinds": None, "delta": None},
        "params": {
            "k": {"value": 1, "in_text": 2},
            "speed": {"value": {"fraction": "1/2"}, "in_text": None},
            "spots": {"value": [1, 2], "in_text": [1, 2]},
            "mode": {"value": "quick", "in_text": "slow"},
        },
        "tasks": None,
        "properties": [],
    }


def test_a_sweep(koord: Koord) -> None:
    said = koord(*VERIFY, "--robots", "1..2", "--jobs", "1", "--plot", "times.svg")
    assert said.startswith(f"k.krd: δ = 1/3 s, {VALUES}\n")
    picture = Path("times.svg").read_text("utf-8")
    assert all(part in picture for part in ("k = 1", "speed = 0.5", "mode = quick"))


def test_invariants_that_are_saved(koord: Koord) -> None:
    flags = ["--engine", "bits", "--save-invariants", "found.krd"]
    koord("verify", "k.krd", *SET, "--robots", "2", *flags)
    assert (
        Path("found.krd")
        .read_text("utf-8")
        .startswith(f"# Found for k.krd: 2 robots, δ = 0.1 s, {VALUES}:\n")
    )


@pytest.mark.parametrize("form", ["smt2", "vmt", "aiger", "tla"])
def test_a_problem_for_other_tools(koord: Koord, form: str) -> None:
    assert f"{ABOUT}, by koord" in koord(
        *VERIFY, "--robots", "2", "--export", form, "--property", "Small"
    )


def test_a_run_and_its_trace(koord: Koord) -> None:
    flags = ["--robots", "2", "--delta", "1/3", "--rounds", "2"]
    assert koord("run", "k.krd", *SET, *flags, "--trace", "t.json").startswith(f"{ABOUT}, policy")
    assert f"\n  a run of {ABOUT}\n" in koord("replay", "t.json")
    found = json.loads(koord("replay", "t.json", "--json"))
    assert found["problem"]["params"]["k"] == {"value": 1, "in_text": 2}


def test_another_text_is_what_a_replay_compares_with(koord: Koord) -> None:
    koord("run", "k.krd", *SET, "--rounds", "2", "--trace", "t.json")
    Path("other.krd").write_text(PROGRAM.replace("k = 2", "k = 1"), encoding="utf-8")
    said = koord("replay", "t.json", "--program", "other.krd")
    assert "a run of other.krd: 3 robots, δ = 0.1 s, speed = 0.5 (no value" in said


def test_compiled_runs_that_are_judged(koord: Koord) -> None:
    flags = ["--target", "engine", "--runs", "2", "--rounds", "2"]
    assert koord("check-refinement", "k.krd", *SET, *flags).startswith(
        f"k.krd: δ = 0.1 s, {VALUES}\n"
    )


def test_compiled_programs(koord: Koord) -> None:
    said = koord("compile", "k.krd", *SET)
    assert "# param k = 1 (2 in the text)\n" in said
    assert "# param spots = [1, 2]\n" in said


def test_names_do_not_steer_the_terminal(koord: Koord) -> None:
    name = "k\x1b[2J.krd"
    Path(name).write_text(PROGRAM, encoding="utf-8")
    said = koord("verify", name, *SET, "--engine", "search")
    assert "\x1b" not in said
    assert said.startswith("k␛[2J.krd: ")
