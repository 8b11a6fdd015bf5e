"""Answers from other machines, looked at again before they count."""

from __future__ import annotations

from msgspec.structs import replace

from koord.syntax.system import System
from koord.verify.obstacles import Unreplayed
from koord.verify.reduction.problems import plain_problem
from koord.verify.verdicts import NotReplayedError, Outcome, Report, Verdict


def confirmed(system: System, report: Report) -> Report:
    """The report, where each run that is to break a claim was replayed on this machine.

    What does not replay is unknown.
    """

    def looked_at(verdict: Verdict) -> Verdict:
        shown = verdict.counterexample
        if shown is None:
            return verdict
        judge = plain_problem(verdict.broken_system(system)).judge
        for run in (shown, *verdict.others):
            try:
                judge(run.recording, verdict.claim, run.phase)
            except NotReplayedError as error:
                return Verdict(
                    verdict.claim,
                    Outcome.UNKNOWN,
                    verdict.engine,
                    verdict.seconds,
                    reason=f"a violation found on another machine did not replay: {error}",
                    obstacles=(Unreplayed(verdict.engine),),
                )
        return verdict

    return replace(report, verdicts=tuple(map(looked_at, report.verdicts)))
