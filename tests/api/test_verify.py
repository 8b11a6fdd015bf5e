"""Verifying from Python: results, progress, cancellation, and several threads at a time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.refinement.sampling_hosts import SampledHost
from koord.verify.encoding.terms import Terms
from koord.verify.engine_names import Engine
from koord.verify.verdicts import Outcome

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
invariant Low: forall i: x@i >= 0
invariant Small: forall i: x@i < 2
""",
)

#: A sensor, so that there is something between the ends of rounds.
DIAL = koord.Source(
    "dial.krd",
    COUNTER.text
    + "using Dial:\n  sensors:\n    int level = 0\ninvariant Read: forall i: Dial.level@i >= 0\n",
)

#: More than any engine does at once: products of numbers without bounds.
ENDLESS = koord.Source(
    "endless.krd",
    """\
local:
  int x = 3
  int y = 5
Grow:
  eff:
    x = x * y + 1
    y = y * x + 2
invariant Never: forall i: x@i * x@i * x@i != 3 * y@i * y@i + 6006
""",
)


def valid(report: koord.VerifyReport) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(report.to_json())
    Draft202012Validator(koord.schema("verdicts")).validate(document)
    return document


def test_a_report_has_a_verdict_on_each_claim() -> None:
    report = koord.verify(COUNTER, robots=2, rounds=4)
    assert [v.name for v in report.verdicts] == ["Low", "Small", "no fault"]
    assert (report.outcome, report.holds, report.interrupted) == (Outcome.VIOLATED, False, False)
    assert report.verdict("Low").holds
    assert report.verdict("Low").rounds is None
    assert report.verdict("Low").counterexample is None
    with pytest.raises(KeyError):
        report.verdict("High")
    assert "Small: violated in round 2" in repr(report)
    row = '<td>Small</td><td><b style="color: #d0403f">violated</b></td><td>round 2</td>'
    assert row in report._repr_html_()
    (document,) = valid(report)["reports"]
    assert document["outcome"] == "violated"
    assert document["problem"]["robots"] == 2


def test_a_counterexample_is_a_trace() -> None:
    report = koord.verify(COUNTER, robots=2, rounds=4)
    trace = report.verdict("Small").counterexample
    assert trace is not None
    assert trace == report.counterexample
    assert (trace.rounds, trace.robots) == (2, 2)
    assert trace.violation is not None
    assert trace.violation.name == "Small"
    assert "2 rounds, which breaks Small" in repr(trace)
    assert "x@" in trace._repr_html_()
    Draft202012Validator(koord.schema("trace")).validate(trace.to_dict())
    assert trace.to_itf()["states"]


def test_params_robots_and_engines_are_asked_for() -> None:
    program = koord.load(COUNTER, params={"most": 1})
    report = koord.verify(program, robots=1, rounds=3, engine="bmc", delta_s=0.25)
    assert {v.engine for v in report.verdicts} == {Engine.BMC}
    assert report.verdict("Small").rounds == 3
    assert float(report.system.delta_s) == 0.25
    many = koord.verify(program, robots="any", properties=["Low"])
    assert [v.engine for v in many.verdicts] == [Engine.EVERY_N]
    assert valid(many)["reports"][0]["robots"] is None


@pytest.mark.parametrize(
    ("arguments", "argument", "message"),
    [
        ({"robots": 0}, "robots", "there must be 1 to"),
        ({"robots": {"Car": 2}}, "robots", "there is no agent Car here"),
        ({"properties": ["High"]}, "properties", "there is no 'High'; there are Low"),
        ({"engine": "magic"}, "engine", "there is no 'magic'; there are auto"),
        ({"delta_s": -1.0}, "delta_s", "δ must be from"),
        ({"robots": "any", "engine": "bmc"}, "robots", "leave out `engine=`"),
    ],
)
def test_arguments_that_do_not_fit(arguments: dict[str, Any], argument: str, message: str) -> None:
    with pytest.raises(koord.ArgumentError, match=message) as raised:
        koord.verify(COUNTER, **arguments)
    assert raised.value.argument == argument
    assert [d.code for d in raised.value.diagnostics] == ["K905"]


def test_what_proofs_need_and_what_is_between_rounds() -> None:
    text = koord.Source(
        "a.krd", COUNTER.text.replace("int x = 0", "int x") + "assume Start: forall i: x@i >= 0\n"
    )
    report = koord.verify(text, robots=1, properties=["Low"], rests_on=True)
    assert report.rests_on is not None
    assert len(report.rests_on.needed) == 1
    assert valid(report)["reports"][0]["rests_on"]["claims"] == ["Low"]
    instants = koord.verify(DIAL, robots=1, rounds=2, engine="bmc", instants=True)
    assert instants.verdict("Read between rounds").outcome is Outcome.VIOLATED
    assert instants.verdict("Read between rounds").counterexample is not None


def test_progress_is_told() -> None:
    heard: list[koord.Progress] = []
    koord.verify(COUNTER, rounds=2, engine="bmc", progress=heard.append)
    assert heard
    assert all(each.message for each in heard)


def test_verdicts_are_told_as_they_come() -> None:
    """Each report has what the one before had; the last one said of each claim what all say."""
    heard: list[koord.VerifyReport] = []

    def listen(told: koord.Progress) -> None:
        if isinstance(told, koord.VerdictProgress):
            heard.append(told.report)

    report = koord.verify(COUNTER, rounds=4, progress=listen)
    names = [[verdict.name for verdict in by_now.verdicts] for by_now in heard]
    assert names
    assert all(set(old) <= set(new) for old, new in pairwise(names))
    assert set(names[-1]) == {verdict.name for verdict in report.verdicts}
    for verdict in heard[-1].verdicts:
        assert verdict.outcome is report.verdict(verdict.name).outcome
    assert heard[-1].verdict("Small").counterexample is not None


def test_of_some_properties_the_verdicts_on_these_are_told() -> None:
    told: set[str] = set()

    def listen(progress: koord.Progress) -> None:
        if isinstance(progress, koord.VerdictProgress):
            told.update(verdict.name for verdict in progress.report.verdicts)

    koord.verify(COUNTER, rounds=4, properties=["Small"], progress=listen)
    assert told == {"Small"}


def test_a_call_is_ended_from_another_thread() -> None:
    stop, begun = koord.Cancellation(), threading.Event()

    def cancelling() -> None:
        begun.wait()
        stop.cancel()

    thread = threading.Thread(target=cancelling)
    thread.start()
    started = time.monotonic()
    report = koord.verify(
        ENDLESS, robots=2, rounds=50, cancellation=stop, progress=lambda told: begun.set()
    )
    thread.join()
    assert report.interrupted
    assert report.verdict("Never").outcome is Outcome.UNKNOWN
    assert time.monotonic() - started < 20
    assert valid(report)["reports"][0]["interrupted"]


def test_a_call_ends_in_time() -> None:
    report = koord.verify(ENDLESS, robots=2, rounds=50, timeout_s=0.5)
    assert not report.interrupted
    assert report.verdict("Never").outcome is Outcome.UNKNOWN


def test_no_solver_works_in_the_process_that_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Z3 may not be at work in a thread while another one forks."""
    here, make = os.getpid(), Terms.__init__

    def elsewhere(self: Terms, *words: Any, **named: Any) -> None:
        assert os.getpid() != here
        make(self, *words, **named)

    monkeypatch.setattr(Terms, "__init__", elsewhere)
    report = koord.verify(
        DIAL, robots=1, rounds=2, properties=["Low"], instants=True, rests_on=True
    )
    assert report.failures == ()
    assert koord.certify(report) is not None
    valid(report)


def test_a_certificate_has_what_was_shown(tmp_path: Path) -> None:
    report = koord.verify(COUNTER, robots=1, properties=["Low"])
    certificate = koord.certify(report)
    assert certificate is not None
    assert repr(certificate) == "<Certificate of Low>"
    Draft202012Validator(koord.schema("certificate")).validate(certificate.to_dict())
    certificate.save(tmp_path / "c.json")
    assert json.loads((tmp_path / "c.json").read_text()) == certificate.to_dict()
    bounded = koord.verify(COUNTER, robots=1, rounds=1, engine="bmc")
    assert koord.certify(bounded) is None


def test_nothing_is_left_to_load_once_there_are_threads() -> None:
    script = """
import sys, threading
from pathlib import Path
import koord.api.verify
thread = threading.Thread(target=koord.api.verify.load_for_threads)
thread.start()
thread.join()
here = Path(koord.__file__).parent
found = (here / "verify").rglob("*.py")
names = {".".join(path.relative_to(here.parent).with_suffix("").parts) for path in found}
modules = {name.removesuffix(".__init__") for name in names}
print(*sorted(modules - set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    elsewhere = ["koord.verify.answering", "koord.verify.running_code"]  # for other machines
    alone = ["koord.verify.fairness_suggestions"]  # asked where no other is
    assert sorted(done.stdout.split()) == sorted(elsewhere + alone)


def outcomes(name: str) -> list[tuple[str, str]]:
    report = koord.verify(EXAMPLES / name, rounds=3, jobs=2)
    return [(v.name, v.outcome.value) for v in report.verdicts]


def test_threads_verify_at_the_same_time() -> None:
    texts = [COUNTER, DIAL, COUNTER, DIAL]

    def asked(text: koord.Source) -> list[tuple[str, str]]:
        report = koord.verify(text, robots=1, rounds=3, engine="bmc", jobs=2)
        return [(v.name, v.outcome.value) for v in report.verdicts]

    alone = {text.name: asked(text) for text in texts[:2]}
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(asked, texts))
    assert found == [alone[text.name] for text in texts]


@pytest.mark.slow
def test_threads_verify_examples_under_load() -> None:
    names = ["leader_elect.krd", "sum_of_ids.krd", "fischer.krd", "broken/shapeform_edge.krd"]
    alone = [outcomes(name) for name in names]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(4):
            assert list(pool.map(outcomes, names)) == alone


def test_execution_times_are_those_of_events() -> None:
    report = koord.verify(COUNTER, robots=2, properties=["Low"], wcet=True)
    times = report.execution_times
    assert times is not None
    ((paths,), (measured,)) = (times.agents, times.measured)
    (up,) = paths.events
    assert up.is_bound
    assert up.steps <= paths.turn_steps
    # Each robot counts to three, and has no event to run from then on.
    ran, idle = measured[0], measured[None]
    assert len(ran.ns) % 6 == 0
    assert min(ran.ns) > 0
    assert len(idle.ns) > len(ran.ns)
    (told,) = valid(report)["reports"][0]["execution_times"]
    (event,) = told["events"]
    assert (event["event"], event["steps"], event["turns"]) == ("Up", up.steps, len(ran.ns))
    assert event["median_us"] <= event["longest_us"]


def test_execution_times_leave_out_what_is_outside_of_the_program(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A host that thinks for a second is no part of the program."""
    now_ns, ask = count(), SampledHost.ask

    def slow(self: SampledHost, *asked: Any) -> Any:
        nonlocal now_ns
        now_ns = count(next(now_ns) + 10**9)
        return ask(self, *asked)

    monkeypatch.setattr("koord.api.wcet.time.thread_time_ns", lambda: next(now_ns))
    monkeypatch.setattr(SampledHost, "ask", slow)
    text = koord.Source(
        "asks.krd",
        "def fun far(int a) -> int: extern\n  ensures: result > 100 * a\n"
        "local:\n  int x = 0\nAsk:\n  eff: x = far(x % 7)\ninvariant Low: forall i: x@i > -1\n",
    )
    times = koord.verify(text, robots=2, wcet=True).execution_times
    assert times is not None
    (event,) = times.agents[0].events
    ran = times.measured[0][0]
    assert 0 < max(ran.ns) < 10
    assert event.effect.unknown == ("far",)
    assert not event.is_bound


def test_execution_times_are_of_one_number_of_robots() -> None:
    with pytest.raises(koord.ArgumentError, match="one number of robots"):
        koord.verify(COUNTER, robots="any", wcet=True)
