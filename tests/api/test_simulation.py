"""Simulations, campaigns and configurations from Python, as a user asks for them."""

from __future__ import annotations

import gc
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.api.campaign import CampaignBegun, RunOver
from koord.api.served_page import PageServed
from koord.api.sim_report import Ending, SimulationBegun, SimulationOver
from koord.cli.main import main

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"
TASK, MIXED = EXAMPLES / "task.krd", EXAMPLES / "task_mixed.yaml"

COUNT = koord.Source(
    "count.krd",
    "param int k = 3\nlocal:\n  int x = 0\nUp:\n  pre: x < k\n  eff: x = x + 1\n"
    "invariant Low: x < 3\n",
)


def timeless(document: Any) -> Any:
    return {name: value for name, value in document.items() if name != "wall_s"}


def test_a_simulation_is_what_the_command_tells(capsys: pytest.CaptureFixture[str]) -> None:
    program = koord.load(TASK)
    simulated = koord.simulate(program, MIXED, seed=1, duration_s=1.5)
    assert capsys.readouterr() == ("", "")
    assert simulated.ending is Ending.LIMIT
    assert simulated.ok
    assert simulated.figures.rounds == 15
    flags = ["--seed", "1", "--time", "1.5", "--json", "--no-html"]
    assert main(["sim", str(TASK), str(MIXED), *flags]) == 0
    document = json.loads(capsys.readouterr().out)
    assert timeless(json.loads(simulated.to_json())) == timeless(document)
    assert "seed 1: the time was up after 1.5 s" in repr(simulated)
    assert simulated._repr_html_().startswith('<iframe srcdoc="&lt;!doctype html')


def test_a_program_and_its_configuration_need_no_file() -> None:
    config = koord.read_configuration(koord.Source("two.yaml", "num_robots: 2\nparams: {k: 2}\n"))
    simulated = koord.simulate(COUNT, config, duration_s=5)
    assert (simulated.setup.configuration, len(simulated.setup.devices)) == ("two.yaml", 2)
    assert simulated.broken == ()
    broken = koord.simulate(koord.load(COUNT), config, params={"k": 3}, robots=1)
    assert [one.claim for one in broken.broken] == ["invariant Low"]
    assert not broken.ok
    assert "broken: invariant Low" in repr(broken)


def test_nobody_looks_for_cycles_while_a_simulation_is_made_and_runs() -> None:
    collects: list[bool] = []
    assert gc.isenabled()
    config = koord.read_configuration(koord.Source("two.yaml", "num_robots: 2\n"))
    koord.simulate(COUNT, config, duration_s=1, progress=lambda _: collects.append(gc.isenabled()))
    assert not any(collects)
    assert len(collects) > 2
    assert gc.isenabled()


def test_progress_is_heard_in_order_and_files_are_kept(tmp_path: Path) -> None:
    heard: list[koord.Progress] = []
    kept = [str(tmp_path / name) for name in ("run.html", "run.mcap")]
    trace = tmp_path / "run.json"
    simulated = koord.simulate(
        COUNT,
        robots=1,
        rounds=2,
        html=kept[0],
        record=kept[1],
        trace=trace,
        live=True,
        pace=1000,
        progress=heard.append,
    )
    kinds = [type(one) for one in heard]
    rounds = [one.round for one in heard if type(one) is koord.Progress]
    assert kinds[:2] == [SimulationBegun, PageServed]
    assert rounds == [1, 2]
    assert kinds[-1] is SimulationOver
    assert simulated.kept == tuple(kept)
    assert simulated.refused is None
    assert {path.name for path in tmp_path.iterdir()} == {"run.html", "run.mcap", "run.json"}
    assert (tmp_path / "run.html").read_bytes() == simulated.page()
    again = koord.simulate(COUNT, schedule=trace)
    assert again.ending is Ending.PLAYED


def test_a_simulation_is_cancelled_from_elsewhere() -> None:
    stop = koord.Cancellation()

    def hear(told: koord.Progress) -> None:
        if told.round == 3:
            stop.cancel()

    simulated = koord.simulate(TASK, MIXED, progress=hear, cancellation=stop)
    assert simulated.ending is Ending.INTERRUPTED
    assert simulated.figures.rounds == 3
    assert not simulated.ok


def test_several_simulations_go_on_at_a_time() -> None:
    program = koord.load(TASK)

    def digest(seed: int) -> str:
        return koord.simulate(program, MIXED, seed=seed, duration_s=0.5).figures.digest

    alone = [digest(seed) for seed in range(3)]
    with ThreadPoolExecutor(3) as threads:
        assert list(threads.map(digest, range(3))) == alone
    assert len(set(alone)) == 3


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        (
            {"config": koord.Source("a.yaml", "num_robots: 2.5\n")},
            koord.KoordError,
            "expected `int`",
        ),
        ({"config": "none.yaml"}, koord.KoordError, "there is no such file"),
        ({"params": {"q": 1}}, koord.KoordError, "q"),
        ({"delta_s": 0}, koord.ArgumentError, "δ must be"),
        ({"robots": 0}, koord.ArgumentError, "robots"),
        ({"record": "run.avi"}, koord.ArgumentError, "ends in none of .mcap"),
        ({"html": "none/run.html"}, koord.KoordError, "there is no folder"),
        ({"schedule": "run.json", "seed": 1}, koord.ArgumentError, "played as it is"),
    ],
)
def test_what_is_wrong_is_raised_as_diagnostics(
    arguments: dict[str, Any], error: type[koord.KoordError], said: str
) -> None:
    with pytest.raises(error, match=said) as raised:
        koord.simulate(COUNT, **arguments)
    assert raised.value.diagnostics


# --- campaigns ------------------------------------------------------------------------------------


def test_a_campaign_has_a_row_for_each_value_and_seed(tmp_path: Path) -> None:
    heard: list[koord.Progress] = []
    path = tmp_path / "runs.csv"
    made = koord.campaign(
        COUNT,
        runs=2,
        sweep={"robots": range(1, 3)},
        seed=4,
        rounds=1,
        csv=path,
        progress=heard.append,
    )
    assert [(row.swept, row.robots, row.seed) for row in made.runs] == [
        ("1", 1, 4),
        ("1", 1, 5),
        ("2", 2, 4),
        ("2", 2, 5),
    ]
    alone = koord.simulate(COUNT, robots=2, seed=5, rounds=1)
    assert made.runs[3].digest == alone.figures.digest
    assert made.ok
    assert json.loads(made.to_json())["runs"][3]["digest"] == alone.figures.digest
    assert [type(one) for one in heard if type(one) is not koord.Progress] == [
        CampaignBegun,
        *[RunOver] * 4,
    ]
    assert "<td>1</td><td>2</td>" in made._repr_html_()
    assert path.read_text("utf-8").count("\n") == 5
    rest = koord.campaign(
        COUNT, runs=2, sweep={"robots": [1, 2]}, seed=4, rounds=1, csv=path, resume=True
    )
    assert rest == made


def test_a_campaign_is_cancelled_and_goes_on() -> None:
    stop = koord.Cancellation()
    made = koord.campaign(
        COUNT,
        robots=1,
        runs=4,
        rounds=2,
        progress=lambda told: stop.cancel() if isinstance(told, RunOver) else None,
        cancellation=stop,
    )
    assert made.interrupted
    assert len(made.runs) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"resume": True}, "csv"),
        ({"sweep": {"robots": ["many"]}}, "robots must be from 1"),
        ({"sweep": {}}, "name one param"),
        ({"plot": "runs.krd"}, "is no picture"),
    ],
)
def test_campaigns_that_cannot_be_made(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(koord.ArgumentError, match=said):
        koord.campaign(COUNT, **arguments)


@pytest.mark.slow
def test_campaigns_in_processes_end_their_own_workers_alone() -> None:
    """One is cancelled while another, in another thread, goes on to its end."""
    stop, begun = koord.Cancellation(), threading.Event()

    def cancelled() -> bool:
        def hear(told: koord.Progress) -> None:
            if isinstance(told, RunOver):
                begun.set()
                stop.cancel()

        return koord.campaign(
            TASK, MIXED, runs=50, jobs=2, duration_s=5, progress=hear, cancellation=stop
        ).interrupted

    with ThreadPoolExecutor(2) as threads:
        first = threads.submit(cancelled)
        second = threads.submit(koord.campaign, COUNT, robots=1, runs=40, jobs=2, rounds=2)
        assert first.result(timeout=120)
        assert len(second.result(timeout=120).runs) == 40


# --- configurations -------------------------------------------------------------------------------


def test_a_configuration_is_checked_by_itself_and_with_a_program() -> None:
    alone = koord.check_configuration(koord.Source("a.yaml", "num_robots: 2\n"))
    assert alone.ok
    assert alone.program is None
    assert "<ConfigurationReport a.yaml: 2 robots" in repr(alone)
    both = koord.check_configuration(MIXED, TASK)
    assert (both.ok, both.program) == (True, str(TASK))
    many = koord.check_configuration(koord.Source("a.yaml", "num_robots: 300\n"), COUNT)
    assert many.ok, "there is room for as many as one likes, where nobody says how much"
    wrong = koord.check_configuration(koord.Source("a.yaml", "agents: [{kind: Boat}]\n"), COUNT)
    assert not wrong.ok
    Draft202012Validator(koord.schema("diagnostics")).validate(wrong.to_dict())


def test_the_configuration_beside_a_program_counts(tmp_path: Path) -> None:
    (tmp_path / "count.krd").write_text(COUNT.text)
    (tmp_path / "count.yaml").write_text("num_robots: 2\nparams: {k: 2}\n")
    simulated = koord.simulate(tmp_path / "count.krd", rounds=1)
    assert simulated.setup.configuration == str(tmp_path / "count.yaml")
    assert koord.check_configuration(tmp_path / "count.yaml").program is not None
