"""Counterexamples as tables of rounds."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.verdicts import Verdict
from koord.cli.departures import rerun_lines
from koord.cli.excerpt import place
from koord.cli.fairness import fairness_lines
from koord.cli.tables import RunTable, ShownStep, repeats
from koord.cli.terminal import Paint, Style
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.traces.names import Names
from koord.verify.verdicts import Counterexample


def lines(verdict: Verdict, style: Style) -> Iterator[str]:
    """The runs that break a claim: a heading, the rounds, and the place in the text."""
    assert verdict.found.counterexample is not None
    shown = [verdict.found.counterexample, *verdict.found.others]
    for number, found in enumerate(shown, start=1):
        count = f", {number} of {len(shown)} ways" if len(shown) > 1 else ""
        if number > 1:
            yield ""
        yield from _lines(verdict, found, count, style)
        if (fair := verdict.fairness(found)) is not None:
            yield from fairness_lines(fair)


def _lines(verdict: Verdict, found: Counterexample, count: str, style: Style) -> Iterator[str]:
    yield style.paint(f"{verdict.name}: {_headline(verdict, found)}{count}", Paint.ERROR)
    yield ""
    yield from _rounds(verdict, found, RunTable(Names(verdict.system), style))
    yield ""
    yield f"  {found.detail} [{verdict.rule}]"
    if found.span is not None:
        yield from place(verdict.program.sources, found.span, style)
    yield from rerun_lines(verdict.rerun(found))


def _headline(verdict: Verdict, found: Counterexample) -> str:
    if found.recording.loop is not None:
        return f"broken by a run without end, in which {repeats(found.recording)}"
    if found.round == 0:
        return "broken by the initial configuration"
    instant = verdict.instant(found)
    if instant is not None:
        return f"broken in round {found.round}, {float(instant):.6g} s into the environment's turn"
    return f"broken in round {found.round}, {found.phase.value}"


def _rounds(verdict: Verdict, found: Counterexample, table: RunTable) -> Iterator[str]:
    """The rounds as ``koord run`` shows them, run by the reference semantics once more."""
    last: Configuration[Constant] | None = None
    first: Configuration[Constant] | None = None  #: of the rounds that repeat
    steps: list[ShownStep] = []
    for step in verdict.steps(found):
        if last is not None and not steps and step.round == found.recording.loop:
            first = last
            yield from table.looped(found.recording)
        if last is None:
            yield from table.start(step)
        else:
            steps.append(ShownStep(step, last))
            if step.rule == "ENV-TRANS":
                yield from table.round(step.round, steps)
                steps = []
        last = step.configuration
    if steps:
        yield from table.round(steps[0].step.round, steps)
    yield from table.idle()
    if first is not None and last is not None:
        yield table.goes_on(found.recording, verdict.left_behind(first, last))
