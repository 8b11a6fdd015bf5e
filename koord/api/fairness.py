"""Explanations of fair lassos, and expectations that would exclude them."""

from __future__ import annotations

import time

from msgspec import Struct, convert

from koord.api import verdict_forms as forms
from koord.api.programs import Program
from koord.semantics.domain import EXACT
from koord.semantics.recordings import execute
from koord.syntax.system import System
from koord.traces.fairness import Excuses, excuses
from koord.verify.fairness_suggestions import Lassoed, SourceTexts, excluding
from koord.verify.verdicts import Counterexample, Verdict


class Fair(Struct, frozen=True):
    """The reasons that a lasso is fair, and expectations under which it is not."""

    why: Excuses
    excluding: tuple[str, ...]


def fairness_of(
    program: Program,
    system: System,
    verdict: Verdict,
    found: Counterexample,
    left_s: float | None,
) -> Fair | None:
    """Explain a counterexample; None if it is no lasso. ``left_s``: the seconds left."""
    stated = verdict.claim.stated
    if found.recording.loop is None or stated is None:
        return None
    until = None if left_s is None else time.monotonic() + left_s
    steps = execute(EXACT, system, found.recording)
    ends = [step.configuration for step in steps if step.is_at_round]
    why = excuses(system, found.recording, ends)
    text = SourceTexts(program.source, program.settings, program.properties)
    lasso = Lassoed(system, found.recording, ends, why, stated)
    return Fair(why, excluding(text, lasso, until))


def fairness_form(fair: Fair) -> forms.FairRun:
    """The explanation as JSON has it; rounds count from 1."""
    robots = [
        forms.FairRobot(
            robot=of.robot,
            runs=list(of.runs),
            not_ready=list(of.idle),
            skips_though_ready=list(of.skips),
            events=convert(of.events, list[forms.FairEvent], from_attributes=True),
            locks=convert(of.locks, list[forms.FairLock], from_attributes=True),
        )
        for of in fair.why.robots
    ]
    expectations = convert(fair.why.expectations, list[forms.Expectation], from_attributes=True)
    return forms.FairRun(list(fair.why.rounds), robots, expectations, list(fair.excluding))
