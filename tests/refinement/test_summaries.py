"""Traces of robots lack what only summaries ask; it is asked when they are judged. [EXTERNAL]"""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.refinement.judging import judge
from koord.refinement.presuming import presumed
from koord.refinement.running import CompiledRun
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Answer
from koord.syntax import core
from koord.syntax.walk import nodes
from koord.traces.trace import Trace
from tests.refinement.running import ran

EXAMPLES = Path(__file__).resolve().parents[2] / "specs/examples"


def as_robots_make_it(trace: Trace) -> Trace:
    """The trace with the answers to the program's own questions alone."""
    externals = trace.system.program.externals
    summaries = tuple((function.requires, function.ensures) for function in externals)
    sites = {n.site for n in nodes(summaries) if isinstance(n, core.ExternalCall)}

    def own(answers: tuple[Answer, ...]) -> tuple[Answer, ...]:
        return tuple(a for a in answers if a.phase is not Phase.CHECK and a.key[0] not in sites)

    recording = trace.recording
    rounds = tuple(replace(r, answers=own(r.answers)) for r in recording.rounds)
    opening = replace(recording.opening, answers=own(recording.opening.answers))
    return replace(trace, recording=replace(recording, opening=opening, rounds=rounds))


@pytest.mark.parametrize("name", ["task", "delivery", "mapping"])
def test_what_only_summaries_ask_is_asked_later(name: str) -> None:
    outcome = ran((EXAMPLES / f"{name}.krd").read_text("utf-8"), robots=3, rounds=6, name=name)
    assert outcome.ran is not None
    trace = as_robots_make_it(outcome.ran.trace)
    assert trace.recording != outcome.ran.trace.recording
    refused = judge(CompiledRun(trace)).refused
    assert refused is not None
    assert refused.rule == "EXTERNAL"
    found = judge(CompiledRun(presumed(trace).trace))
    assert found.refused is None
    assert found.steps == outcome.judged.steps if outcome.judged is not None else False


def test_what_the_program_asks_has_to_be_recorded() -> None:
    outcome = ran((EXAMPLES / "task.krd").read_text("utf-8"), robots=2, rounds=3, name="task.krd")
    assert outcome.ran is not None
    trace = outcome.ran.trace
    rounds = tuple(replace(r, answers=()) for r in trace.recording.rounds)
    silent = replace(trace, recording=replace(trace.recording, rounds=rounds))
    refused = judge(CompiledRun(presumed(silent).trace)).refused
    assert refused is not None
    assert refused.rule == "EXTERNAL"
