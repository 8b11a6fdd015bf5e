"""Results as pages: one HTML file that loads nothing, for a browser, a notebook or an editor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING

from koord.api.results import ArgumentError
from koord.api.stories import Story, of_programs, of_refused, of_step, of_verdict, story
from koord.api.story_page import ToldClaim, ToldReport, page_of
from koord.api.verdict_documents import claim_form
from koord.traces import story_form

if TYPE_CHECKING:
    from koord.api.refinement import Refinement
    from koord.api.replay import ReplayReport
    from koord.api.run import RunReport
    from koord.api.traces import Trace
    from koord.api.verdicts import Parts, Verdict
    from koord.api.verify_report import VerifyReport
    from koord.traces.trace import Trace as Recorded


def html(
    found: Story | Trace | RunReport | ReplayReport | Verdict | VerifyReport | Refinement,
) -> str:
    """Show a result as one page that loads nothing.

    Of a trace, a run, a replay, a verdict with a counterexample or a refused run of
    :func:`koord.refine` it shows the run, turn by turn; of a whole verification all verdicts, what
    they rest on, and each counterexample. A run whose program was changed has a story for each
    program. Raises :class:`koord.ArgumentError` for a verdict without
    a counterexample, or where no run was refused.

    >>> Path("task.html").write_text(koord.html(koord.verify("task.krd")))
    """
    from koord.api.replay import ReplayReport
    from koord.api.run import RunReport
    from koord.api.traces import Trace
    from koord.api.verdicts import Verdict
    from koord.api.verify_report import VerifyReport

    match found:
        case Story():
            return found.to_html()
        case VerifyReport():
            return verification_page([found])
        case Trace() | RunReport() | ReplayReport() if _has_programs(found):
            return _page_of_programs(found)
        case Trace() | RunReport() | ReplayReport() | Verdict():
            return story(found).to_html()
        case _:  # a refinement, whose module loads robots and their networks
            return of_refinement(found).to_html()


def _recorded(found: Trace | RunReport | ReplayReport) -> Recorded:
    from koord.api.traces import Trace

    return found.recorded if isinstance(found, Trace) else found.trace.recorded


def _has_programs(found: Trace | RunReport | ReplayReport) -> bool:
    """Whether a run has more than one program, and is legal as far as is known."""
    return bool(_recorded(found).later) and getattr(found, "legal", True)


def _page_of_programs(found: Trace | RunReport | ReplayReport) -> str:
    """A page of a run whose program was changed, with a story for each program. [RELOAD]"""
    recorded = _recorded(found)
    told = of_programs(recorded, getattr(found, "broken", None))
    title = f"a run of {recorded.sources.program.name}"
    return page_of(title, [one.told for one in told])


def of_refinement(found: Refinement) -> Story:
    """The story of the run that is refused. Raises ArgumentError where there is none."""
    failure = found.failure
    judged = None if failure is None else failure.outcome.judged
    refused = None if failure is None else failure.outcome.refused
    if judged is None or refused is None:
        raise ArgumentError("found", "no run was refused, so there is none to tell of")
    return of_refused(judged.trace, refused)


def verification_page(reports: Sequence[VerifyReport], parts: Parts | None = None) -> str:
    """A page of verifications; ``parts`` records what of them cannot be told."""
    from koord.api.verdicts import Parts

    parts = Parts() if parts is None else parts
    stories: list[story_form.Story] = []
    told = [_told(report, parts, stories) for report in reports]
    title = ", ".join(dict.fromkeys(PurePath(report.problem.name).name for report in reports))
    return page_of(title, stories, told)


def _told(report: VerifyReport, parts: Parts, stories: list[story_form.Story]) -> ToldReport:
    """A verification; the stories of its counterexamples are added to ``stories``."""
    claims = []
    for verdict in report.verdicts:
        first = len(stories)
        with parts.enduring(f"the story of {verdict.name}"):
            stories += [one.told for one in of_verdict(verdict)]
        with parts.enduring(f"the step of {verdict.name}"):
            step = of_step(verdict)
            stories += [] if step is None else [step.told]
        form = claim_form(verdict.name, verdict.found, None, [])
        stated = verdict.found.claim.stated
        text = "" if stated is None else _stated(report, stated.span.line, stated.span.file)
        claims.append(ToldClaim(form, verdict.rule, text, list(range(first, len(stories)))))
    form_of_all = report.form_of([], parts)
    texts = [story_form.StoryText(s.name, s.text) for s in report.program.sources]
    return ToldReport(str(report.problem), form_of_all, claims, texts)


def _stated(report: VerifyReport, line: int, file: str) -> str:
    """The line in which a claim is stated."""
    source = next((s for s in report.program.sources if s.name == file), None)
    return "" if source is None else source.line_text(line).strip()
