"""Running and replaying from Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.api.progress import Listener
from koord.traces.trace import Numbers, ViolationKind

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"

COUNTER = koord.Source(
    "counter.krd",
    """\
param int most = 3
local:
  int x = 0
Up:
  pre: x < most
  eff: x = x + 1
invariant Small: forall i: x@i < 3
""",
)


def valid(document: str, result: koord.Trace | koord.ReplayReport | koord.RunReport) -> Any:
    found = json.loads(result.to_json())
    Draft202012Validator(koord.schema(document)).validate(found)
    return found


def test_a_run_ends_with_its_rounds() -> None:
    heard: list[koord.Progress] = []
    report = koord.run(EXAMPLES / "leader_elect.krd", rounds=3, progress=heard.append)
    assert (report.rounds, report.fault, report.violation) == (3, None, None)
    assert [told.round for told in heard[1:]] == [1, 2, 3]
    assert "done, 3 rounds" in repr(report)
    assert report.trace.robots == 3
    valid("trace", report)
    assert "<th>robot 2</th>" in report._repr_html_()


def test_a_run_ends_where_a_property_breaks() -> None:
    report = koord.run(COUNTER, robots={"": 2})
    assert report.violation is not None
    assert (report.violation.kind, report.violation.name) == (ViolationKind.PROPERTY, "Small")
    assert report.rounds == 2
    assert "violated: Small" in repr(report)


def test_runs_by_chance_hang_on_the_seed() -> None:
    one, same, other = (
        koord.run(COUNTER, rounds=2, policy="random", seed=seed, numbers="double")
        for seed in (1, 1, 2)
    )
    assert one.trace == same.trace != other.trace
    assert one.trace.recorded.numbers is Numbers.DOUBLE
    with pytest.raises(koord.ArgumentError, match="there is no 'last'; there are first, random"):
        koord.run(COUNTER, policy="last")
    with pytest.raises(koord.ArgumentError, match="a run needs a number of robots"):
        koord.run(COUNTER, robots="any")


def cancelling(stop: koord.Cancellation, after: int) -> Listener:
    def hear(told: koord.Progress) -> None:
        if told.round == after:
            stop.cancel()

    return hear


def test_a_run_that_is_cancelled_can_be_replayed() -> None:
    stop = koord.Cancellation()
    report = koord.run(
        COUNTER, rounds=1_000, robots=1, progress=cancelling(stop, 2), cancellation=stop
    )
    assert report.interrupted
    assert report.rounds == 2
    assert koord.replay(report.trace).legal
    with pytest.raises(koord.CancelledError):
        koord.run(EXAMPLES / "task.krd", cancellation=stop)


@pytest.mark.slow
def test_time_ends_runs_and_replays() -> None:
    endless = koord.Source(
        "endless.krd", "local:\n  int x = 0\nUp:\n  pre: true\n  eff: x = x + 1\n"
    )
    report = koord.run(endless, rounds=1_000_000, robots=1, timeout_s=0.5)
    assert report.interrupted
    assert 0 < report.rounds < 1_000_000
    with pytest.raises(TimeoutError, match="the time was up while looking for a start"):
        koord.run(EXAMPLES / "task.krd", timeout_s=0.0)
    assert koord.replay(report.trace, compiled=True, timeout_s=600).agrees
    for compiled in (False, True):
        with pytest.raises(TimeoutError, match="the time was up while a trace was replayed"):
            koord.replay(report.trace, compiled=compiled, timeout_s=0.0)


def test_a_replay_is_cancelled() -> None:
    """Behind its last round, so that it is the compiled program that ends."""
    trace = koord.run(COUNTER, rounds=2, robots=1).trace
    stop = koord.Cancellation()
    with pytest.raises(koord.CancelledError, match="while a trace was replayed"):
        koord.replay(trace, compiled=True, progress=cancelling(stop, 2), cancellation=stop)


def test_a_trace_comes_back_from_a_file(tmp_path: Path) -> None:
    trace = koord.run(COUNTER, rounds=2).trace
    for name in ("t.json", "t.itf.json"):
        trace.save(tmp_path / name)
        assert koord.load_trace(tmp_path / name) == trace
    report = koord.replay(tmp_path / "t.json", compiled=True)
    assert (report.legal, report.compared, report.agrees, report.rounds) == (True, True, True, 2)
    assert valid("replay", report)["compiled"]["agrees"]
    assert "legal, 2 rounds" in repr(report)


def test_the_first_step_that_is_not_legal_is_named() -> None:
    trace = koord.run(COUNTER, rounds=2, robots=1).trace
    other = koord.Source("counter.krd", COUNTER.text.replace("x + 1", "x + 2"))
    heard: list[koord.Progress] = []
    report = koord.replay(trace, program=other, progress=heard.append)
    assert not report.legal
    assert report.refused is not None
    assert (report.refused.step.round, report.refused.step.robot) == (0, None)
    assert [(change.name, change.new) for change in report.refused.differences] == [("x", "1")]
    assert not valid("replay", report)["legal"]
    assert "not legal by" in repr(report)
    assert "<td>x</td>" in report._repr_html_()


def test_a_counterexample_is_replayed() -> None:
    found = koord.verify(COUNTER, robots=1, rounds=4, engine="bmc").counterexample
    assert found is not None
    report = koord.replay(found, compiled=True)
    assert report.legal
    assert report.agrees


def test_what_is_no_trace_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    path.write_text("{}")
    with pytest.raises(koord.KoordError, match="K911"):
        koord.replay(path)


def test_a_run_by_hand() -> None:
    stepper = koord.step(COUNTER, robots=2, rounds=2)
    assert {(o.robot, o.event) for o in stepper.options()} >= {(0, "Up"), (1, "Up")}
    stepper.make(next(o for o in stepper.options() if o.robot == 1))
    assert {o.robot for o in stepper.options()} == {0}
    assert stepper.undo()
    assert {o.robot for o in stepper.options()} == {0, 1}
    assert len([*stepper.finish_round()]) == 2
    assert stepper.options() == ()
    stepper.evolve()
    assert stepper.ending.rounds == 1
    assert koord.replay(stepper.trace()).legal
