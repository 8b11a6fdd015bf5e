"""The judge lets nothing pass that the rules do not allow."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.refinement.cases import SchedulePolicy, Tried, ever_smaller, generated, tried
from koord.refinement.judging import judge
from koord.refinement.running import CompiledRun
from koord.traces.trace import Trace
from tests.refinement.running import ran, seeds

TEXT = (
    "allwrite:\n  int sum = 0\nlocal:\n  int mine = 0\n"
    "Add:\n  eff:\n    atomic:\n      sum = sum + 1\n    mine = sum\n    stdout << mine\n"
    "Rest:\n  pre: mine > 1\n  eff:\n    mine = 0\n"
)


def outcome() -> Tried:
    return ran(TEXT, robots=2, rounds=4)


def changed(trace: Trace, number: int, **fields: object) -> Trace:
    """The trace with another round."""
    rounds = list(trace.recording.rounds)
    rounds[number] = replace(rounds[number], **fields)
    return replace(trace, recording=replace(trace.recording, rounds=tuple(rounds)))


def refused(trace: Trace, place: str | None = None) -> str:
    found = judge(CompiledRun(trace, place)).refused
    assert found is not None
    return found.rule


def test_a_run_of_the_rules_passes() -> None:
    good = outcome()
    assert good.refused is None
    assert good.judged is not None
    assert good.judged.steps == 13


def test_another_order_event_or_skip_is_refused() -> None:
    assert outcome().ran is not None
    trace = outcome().ran.trace  # type: ignore[union-attr]
    first = trace.recording.rounds[0]
    assert refused(changed(trace, 0, events=(0, 0))) == "ATOMIC"
    assert refused(changed(trace, 0, events=(1, None))) == "SELECT"
    assert refused(changed(trace, 0, events=(None, None))) != ""
    assert refused(changed(trace, 0, order=(*first.order, first.order[0]))) == "EVENT-TRANS"


def test_another_configuration_is_refused() -> None:
    trace = outcome().ran.trace  # type: ignore[union-attr]
    one, two, *others = trace.configurations
    swapped = replace(trace, configurations=(one, replace(two, store=one.store), *others))
    assert refused(swapped) == "ENV-TRANS"


def test_other_output_is_refused() -> None:
    trace = outcome().ran.trace  # type: ignore[union-attr]
    assert refused(replace(trace, outputs=trace.outputs[1:])) == "OUTPUT"
    assert refused(replace(trace, outputs=(*trace.outputs, trace.outputs[0]))) == "OUTPUT"


def test_a_fault_elsewhere_is_refused() -> None:
    broken = ran("local:\n  int n = 0\nE:\n  eff:\n    n = 1 / n + 1 % n\n", robots=1)
    assert broken.ran is not None
    assert broken.refused is None
    assert refused(broken.ran.trace, "app.krd:5:21") == "FAULT"
    kept = replace(broken.ran.trace, configurations=broken.ran.trace.configurations[:1] * 2)
    assert refused(kept, "app.krd:5:13") != ""


@pytest.mark.parametrize("programs", [False, True])
def test_a_case_that_fails_is_made_smaller(programs: bool) -> None:
    """With a failure made up: a robot runs an event of at least one statement."""

    def attempt(case: object) -> Tried:
        made = tried(case)  # type: ignore[arg-type]
        assert not made.crash, made.crash
        rounds = made.ran.trace.recording.rounds if made.ran is not None else ()
        fails = any(event is not None for r in rounds for event in r.events)
        return replace(made, crash="made up") if fails else made

    cases = (generated(seed, 6) for seed in seeds(40))
    failing = next(t for t in map(attempt, cases) if t.failed and t.case.system.robots > 1)
    *_, small = ever_smaller(failing, attempt, programs=programs)
    assert small.failed
    assert small.case.rounds == 1
    assert small.case.system.robots == 1
    assert small.case.policy in SchedulePolicy
    statements = [len(e.effect) for a in small.case.system.program.agents for e in a.events]
    assert (sum(statements) == 0) is programs
