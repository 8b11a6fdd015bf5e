"""Simulated runs are runs of the semantics, and their answers meet the summaries."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from koord.api.fitting import Fitted, fit, fit_request
from koord.api.sim_setup import simulation
from koord.api.sim_trace import Tracing
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.refinement.judging import Judged
from koord.runtime.motion.clearance import Clearance
from koord.runtime.motion.library import Library
from koord.sim.running import Simulation, run
from koord.traces.codec import encode
from koord.traces.unfinished import GrowingTrace
from tests.sampling import but_slow, first

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"


def job(name: str, configuration: str | None = None, seed: int = 0) -> Fitted:
    config = None if configuration is None else str(EXAMPLES / f"{configuration}.yaml")
    return fit(fit_request(str(EXAMPLES / f"{name}.krd"), config, None, None, seed, None))


def judged(of: Fitted, time_s: float) -> tuple[Judged, Simulation]:
    tracing = Tracing(of)
    made = simulation(of, Simulation, tracing=tracing.hear)
    tracing.heard(made.begin(), made)
    for decision in run(made, time_s):
        tracing.heard(decision, made)
    return tracing.judged(tracing.ran(made)), made


@pytest.mark.parametrize(
    ("name", "configuration"),
    first(
        2,
        but_slow(
            ["delivery", "shapeform"],
            [
                ("task", "task_mixed"),
                ("delivery", None),
                ("cars_and_drones", None),
                ("mapping", None),
                ("lineform", None),
                ("shapeform", "shapeform_9"),
                ("follow_points", None),
                ("follow_path", None),
                ("waypoints", None),
            ],
        ),
    ),
)
def test_a_simulated_run_is_one_of_the_semantics(name: str, configuration: str | None) -> None:
    found, made = judged(job(name, configuration), 1.5)
    assert found.refused is None
    # INIT, a turn of each robot and one of the environment in each round.
    assert found.steps == 1 + made.engine.round * (len(made.scene.robots) + 1)


def test_a_library_that_contradicts_its_summary_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    real = Library.find_path
    monkeypatch.setattr(Library, "find_path", lambda *given: real(*given)[:-1])
    found, _ = judged(job("task", "task_mixed"), 1.0)
    assert found.refused is not None
    assert found.refused.rule == "EXTERNAL"


def test_vehicles_that_leave_their_paths_are_refused() -> None:
    of = job("task", "task_mixed")
    tracing = Tracing(of)
    made = simulation(of, Simulation, tracing=tracing.hear)
    tracing.heard(made.begin(), made)
    original = made.fleet.sensed

    def elsewhere() -> Any:
        seen = original()
        return structs.replace(seen, position=seen.position + np.array([1.0, 0.0, 0.0]))

    made.fleet.sensed = elsewhere  # type: ignore[method-assign]
    for decision in run(made, 1.0):
        tracing.heard(decision, made)
    found = tracing.judged(tracing.ran(made))
    assert found.refused is not None
    assert found.refused.rule == "ENV-CONTRACT"


def test_a_trace_is_written_and_replays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "trace.json")
    files = [str(EXAMPLES / "task.krd"), str(EXAMPLES / "task_mixed.yaml")]
    assert main(["sim", *files, "--time", "1", "--trace", path, "--no-html"]) == Exit.OK
    assert main(["replay", path]) == Exit.OK
    assert "legal: 51 steps, 10 rounds" in capsys.readouterr().out


def test_a_trace_says_what_slack_its_vehicles_need(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """[REPLAY] [ENV-CONTRACT]: what was clean for the simulator is legal for the judge."""
    path, program = tmp_path / "trace.json", str(EXAMPLES / "follow_path.krd")
    flags = ["--time", "4", "--no-html"]
    assert main(["sim", program, *flags, "--trace", str(path)]) == Exit.OK
    capsys.readouterr()
    assert main(["replay", str(path)]) == Exit.OK
    assert "with a slack of 0.2" in capsys.readouterr().out
    assert main(["replay", str(path), "--slack", "0"]) == Exit.VIOLATED
    assert "ENV-CONTRACT" in capsys.readouterr().out
    assert main(["sim", program, "--schedule", str(path), "--no-html"]) == Exit.OK
    capsys.readouterr()
    # A vehicle that is further off than that is no vehicle that keeps its contract.
    document = json.loads(path.read_text("utf-8"))
    last = document["run"]["rounds"][-1]
    reading, port = last["readings"][0], "Motion.psn"
    assert (reading["robot"], reading["port"]) == (0, port)
    reading["value"]["x"] += 2.0
    last["after"]["robots"][0]["ports"][port]["x"] += 2.0
    path.write_text(json.dumps(document), "utf-8")
    assert main(["replay", str(path)]) == Exit.VIOLATED
    assert "ENV-CONTRACT" in capsys.readouterr().out


# --- summaries ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", first(1, ["task", "mapping", "delivery"]))
def test_all_answers_meet_their_summaries(name: str) -> None:
    made = simulation(job(name), Simulation, check_summaries=True)
    made.begin()
    for _ in run(made, 3.0):
        pass
    assert made.broken == []
    assert any("summary" in claim and count for claim, count in made.looked.items())


def test_an_answer_that_does_not_meet_its_summary_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = Clearance.paths_clear

    def lopsided(self: Clearance, one: Any, other: Any) -> bool:
        return real(self, one, other) and math.dist(one[0], other[-1]) < math.dist(
            one[-1], other[0]
        )

    monkeypatch.setattr(Clearance, "paths_clear", lopsided)
    files = [str(EXAMPLES / "task.krd"), str(EXAMPLES / "task_mixed.yaml")]
    code = main(["sim", *files, "--time", "3", "--check-summaries", "--keep-going", "--no-html"])
    out, err = capsys.readouterr()
    assert code in (Exit.VIOLATED, Exit.BAD_INPUT), err
    assert "summary pathsClear" in out + err or "K934" in err


def test_the_command_judges_runs_in_a_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [str(EXAMPLES / "follow_path.krd"), str(EXAMPLES / "task.krd")]
    flags = ["--target", "simulator", "--save", str(tmp_path)]
    assert main(["check-refinement", *lines, *flags]) == Exit.OK
    out, _ = capsys.readouterr()
    assert out.count("2 runs, 16 rounds") == 2
    assert "no violation" in out
    real = Library.find_path
    monkeypatch.setattr(Library, "find_path", lambda *given: real(*given)[1:])
    assert main(["check-refinement", lines[1], *flags]) == Exit.VIOLATED
    assert "refused" in capsys.readouterr().out
    assert (tmp_path / "refinement-simulated-0.json").exists()
    assert main(["check-refinement", *flags]) == Exit.BAD_INPUT


@pytest.mark.parametrize("name", first(1, ["waypoints", "task", "mapping"]))
def test_a_trace_that_grows_is_a_piece_of_the_one_that_is_kept(name: str) -> None:
    """[TRACE] And nothing of the run hangs on whether it grows."""
    traces = []
    for grows in (False, True):
        fitted = job(name)
        tracing = Tracing(fitted)
        made = simulation(fitted, Simulation, tracing=tracing.hear, check_summaries=True)
        tracing.heard(made.begin(), made)
        file = io.BytesIO()
        part = GrowingTrace(file)
        for decision in run(made, 0.8):
            tracing.heard(decision, made)
            if grows:
                part.grow(tracing.so_far(made))
        traces.append(encode(tracing.trace(tracing.ran(made))))
        if grows:
            assert traces[1].startswith(file.getvalue())
            assert file.getvalue().count(b"\n  {") == made.engine.round
    assert traces[0] == traces[1]
