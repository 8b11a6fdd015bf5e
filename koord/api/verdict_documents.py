"""Verdicts and reports as JSON has them: forms, made of what was found."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from msgspec import UNSET, convert, to_builtins

from koord.api import verdict_forms as forms
from koord.syntax.problem import Problem
from koord.verify import obstacles
from koord.verify.engine_names import Engine
from koord.verify.obstacles import Failure
from koord.verify.verdicts import Bounds, Counterexample, Outcome, Report, Vacuity, Verdict

if TYPE_CHECKING:
    from koord.api.wcet import ExecutionTimes, MeasuredTimes
    from koord.refinement.compiled_replay import Rerun
    from koord.syntax.analysis.worst_paths import EventPaths
    from koord.verify.proof_core import ProofCore

#: Changes when readers of the JSON have to change.
VERDICTS_VERSION: Final = 1


def reports_dict(reports: list[forms.Report]) -> dict[str, object]:
    """Several reports as one document."""
    plain: dict[str, object] = to_builtins(forms.Verdicts(VERDICTS_VERSION, reports))
    return plain


def report_form(
    problem: Problem,
    report: Report,
    bounds: Bounds,
    claims: list[forms.Claim],
    *,
    found_invariants: Sequence[str],
    failures: Iterable[Failure],
    left_out: dict[str, list[str]],
    rests_on: ProofCore | None,
    execution_times: ExecutionTimes | None,
) -> forms.Report:
    """A report with the forms of its claims, and with what else was found of it."""
    return forms.Report(
        program=problem.texts[0],
        robots=None if problem.kinds is None else len(problem.kinds),
        delta_s=float(problem.delta_s),
        problem=convert(problem.document(), forms.Problem),
        rounds=bounds.rounds,
        outcome=report.outcome,
        seconds=round(report.seconds, 3),
        interrupted=report.interrupted,
        claims=claims,
        found_invariants=list(found_invariants),
        vacuous=report.is_vacuous,
        vacuities=[_vacuity(vacuity) for vacuity in report.vacuities],
        not_looked_at=[forms.NotLookedAt(x.what, x.subject) for x in report.unlooked],
        failures=failure_forms(failures),
        left_out=left_out,
        rests_on=UNSET if rests_on is None else _rests_on(rests_on),
        execution_times=UNSET if execution_times is None else _times(execution_times),
    )


def claim_form(
    name: str, found: Verdict, violated: forms.Violation | None, others: list[forms.Violation]
) -> forms.Claim:
    """The verdict on a claim that users know by a name, with the forms of its violations."""
    ways = found.ways
    return forms.Claim(
        name=name,
        kind=found.claim.kind,
        outcome=found.outcome,
        engine=found.engine.value,
        every_number_of_robots=found.engine is Engine.EVERY_N,
        all_rounds=found.outcome is Outcome.HOLDS and found.rounds is None,
        through_round=found.rounds,
        seconds=round(found.seconds, 3),
        reason=found.reason or None,
        obstacles=[
            forms.Obstacle(
                each.engine.value,
                type(each).__name__,
                list(obstacles.names(each)),
                each.what,
                each.cure(name),
            )
            for each in found.obstacles
        ],
        fairness=list(found.fairness),
        violated=violated,
        fewest_rounds=found.fewest,
        others=others,
        ways=None
        if ways is None
        else forms.Ways(1 + len(others), ways.complete, ways.reason or None),
        kept=found.kept or UNSET,
    )


def violation_form(
    run: Counterexample, robots: int | None, departure: Rerun, fair: forms.FairRun | None
) -> forms.Violation:
    """A counterexample, what the compiled program does in it, and why it is fair if it is a lasso.

    ``robots`` is how many robots it has, where these are others than were asked about.
    """
    from koord.api.replay import compiled_form  # where all holds, nothing is replayed

    fault = run.fault
    return forms.Violation(
        round=run.round,
        phase=run.phase,
        robot=run.robot,
        detail=run.detail,
        place=None if run.span is None else str(run.span),
        fault=None if fault is None else forms.Fault(fault.kind.value, str(fault.span)),
        loop=None if run.recording.loop is None else run.recording.loop + 1,
        fair=fair,
        compiled=compiled_form(departure, first=1),
        robots=UNSET if robots is None else robots,
    )


def failure_forms(failures: Iterable[Failure]) -> list[forms.Failure]:
    """Failures as JSON has them."""
    return [forms.Failure(each.who, each.what, each.where or None) for each in failures]


def _vacuity(vacuity: Vacuity) -> forms.Vacuity:
    return forms.Vacuity(
        vacuity.what,
        vacuity.subject or None,
        vacuity.detail,
        vacuity.certain,
        None if vacuity.span is None else str(vacuity.span),
    )


def _rests_on(found: ProofCore) -> forms.RestsOn:
    needed, spare, untried = (
        [forms.Premise(x.kind, x.name, x.promise, x.promises, str(x.span)) for x in premises]
        for premises in (found.needed, found.spare, found.untried)
    )
    return forms.RestsOn(list(found.claims), needed, spare, untried)


def _times(found: ExecutionTimes) -> list[forms.AgentTimes]:
    return [
        forms.AgentTimes(
            paths.agent.name,
            paths.turn_steps,
            paths.is_bound,
            [
                _event_times(event, measured.get(number))
                for number, event in enumerate(paths.events)
            ],
        )
        for paths, measured in zip(found.agents, found.measured, strict=True)
    ]


def _event_times(paths: EventPaths, measured: MeasuredTimes | None) -> forms.EventTimes:
    parts = (paths.guard, paths.effect)
    return forms.EventTimes(
        paths.event.name,
        paths.steps,
        paths.is_bound,
        [forms.Branch(str(x.span), x.is_true) for part in parts for x in part.branches],
        [str(span) for part in parts for span in part.endless],
        list(dict.fromkeys(name for part in parts for name in part.unknown)),
        len(measured.ns) if measured else 0,
        measured.median_us if measured else None,
        measured.longest_us if measured else None,
    )
