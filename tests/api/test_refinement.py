"""Compiled programs, simulated runs and the protocol held against the rules, from Python."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import koord
from koord.api import protocol_check
from koord.api.refinement import RunJudged, RunRefused, Target
from koord.refinement import running
from koord.runtime.compile import compiled
from koord.runtime.exploration.world import ExplorationBounds

COUNT = koord.Source(
    "count.krd",
    "allwrite:\n  int sum = 0\nUp:\n  pre: sum < 9\n  eff:\n    atomic:\n      sum = sum + 2\n",
)


def test_runs_of_a_program_are_runs_of_the_rules() -> None:
    heard: list[koord.Progress] = []
    found = koord.refine(COUNT, runs=6, target="engine", progress=heard.append)
    assert found.ok
    assert [one.runs for one in found.targets] == [6]
    assert [type(told) for told in heard] == [RunJudged] * 6
    assert json.loads(found.to_json())["failure"] is None
    assert "engine: 6 runs: no violation" in repr(found)
    assert "<td>engine</td><td>6</td>" in found._repr_html_()


def test_generated_programs_are_run_in_threads_alike() -> None:
    def steps(seed: int) -> int:
        return koord.refine(runs=3, target="network", rounds=3, seed=seed).targets[0].steps

    alone = [steps(seed) for seed in range(2)]
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(steps, range(2))) == alone


def test_a_run_that_is_refused_is_made_smaller_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "compiled", lambda core: compiled(core).replace("+ 2", "+ 1"))
    heard: list[koord.Progress] = []
    found = koord.refine(COUNT, runs=6, target=Target.ENGINE, save=tmp_path, progress=heard.append)
    assert found.failure is not None
    assert [Path(found.failure.path or "")] == list(tmp_path.iterdir())
    assert isinstance(heard[-1], RunRefused)
    assert "refused" in repr(found)
    failure = json.loads(found.to_json())["failure"]
    assert failure["again"].startswith("koord check-refinement - --runs 1 ")
    assert koord.refine(COUNT, runs=6, target="engine").failure is not None
    assert len(list(tmp_path.iterdir())) == 1


def test_refinement_is_cancelled() -> None:
    stop = koord.Cancellation()
    found = koord.refine(COUNT, progress=lambda told: stop.cancel(), cancellation=stop)
    assert found.interrupted
    assert found.targets[0].runs == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"programs": COUNT, "case": 1}, "generated"),
        ({"target": "moon"}, "none of engine, kernels, network, udp"),
        ({"faults": "rain"}, "none of none, loss, chaos"),
    ],
)
def test_what_cannot_be_asked_for(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(koord.ArgumentError, match=said):
        koord.refine(**arguments)  # type: ignore[arg-type]


def test_simulated_runs_are_judged() -> None:
    found = koord.refine_simulated(COUNT, koord.read_configuration(TWO), runs=1, rounds=2)
    assert found.ok
    assert (found.runs, found.rounds) == (1, 2)
    assert found.to_dict()["refused"] is None
    assert "1 runs, 2 rounds" in repr(found)


TWO = koord.Source("two.yaml", "num_robots: 2\n")


def test_the_protocol_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    bounds = {"one round": ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False)}
    monkeypatch.setattr(protocol_check, "_CASES", bounds)
    found = koord.check_protocol(runs=2, seed=1, faults="loss")
    assert found.ok
    assert json.loads(found.to_json())["runs"] == 2
    assert "every invariant of specs/protocol held" in repr(found)
    stop = koord.Cancellation()
    stop.cancel()
    assert koord.check_protocol(runs=2, cancellation=stop).interrupted
