"""Counterexamples as tables of rounds, and as traces that other commands read."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.programs import Program
from koord.api.traces import sources_of
from koord.cli import departures, fairness
from koord.cli.excerpt import place
from koord.cli.tables import Shown, Table, repeats
from koord.cli.terminal import Paint, Style
from koord.refinement.compiled_replay import Departure, Rerun, rerun
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.execution import execute
from koord.semantics.recording import Recording
from koord.syntax.system import System
from koord.traces.lassos import left_behind
from koord.traces.names import Names
from koord.traces.trace import Numbers, Sources, Trace, Violation, ViolationKind, traced
from koord.verify.claims import Claim, ClaimKind, rule_of
from koord.verify.instants import instant_of
from koord.verify.verdicts import Counterexample, Verdict

_KINDS = {
    ClaimKind.PROPERTY: ViolationKind.PROPERTY,
    ClaimKind.CONTRACT: ViolationKind.CONTRACT,
    ClaimKind.LOST_UPDATE: ViolationKind.LOST_UPDATE,
    ClaimKind.LIVENESS: ViolationKind.PROPERTY,
}


def lines(
    loaded: Program,
    system: System,
    verdict: Verdict,
    style: Style,
    left_s: float | None = None,
) -> Iterator[str]:
    """The runs that break a claim: a heading, the rounds, and the place in the text.

    ``left_s`` is what is left of the time for everything.
    """
    assert verdict.counterexample is not None
    shown = [verdict.counterexample, *verdict.others]
    for number, found in enumerate(shown, start=1):
        count = f", {number} of {len(shown)} ways" if len(shown) > 1 else ""
        if number > 1:
            yield ""
        yield from _lines(loaded, system, verdict, found, count, style)
        if (fair := fairness.of(loaded, system, verdict, found, left_s)) is not None:
            yield from fairness.lines(fair)


def _lines(
    loaded: Program,
    system: System,
    verdict: Verdict,
    found: Counterexample,
    count: str,
    style: Style,
) -> Iterator[str]:
    yield style.paint(f"{verdict.claim.name}: {_headline(found)}{count}", Paint.ERROR)
    yield ""
    yield from _rounds(system, found, Table(Names(system), style))
    yield ""
    yield f"  {found.detail} [{rule_of(verdict.claim)}]"
    if found.span is not None:
        yield from place(loaded.sources, found.span, style)
    yield from departures.lines(rerun_of(loaded, system, verdict.claim, found))


def _headline(found: Counterexample) -> str:
    if found.recording.loop is not None:
        return f"broken by a run without end, in which {repeats(found.recording)}"
    if found.round == 0:
        return "broken by the initial configuration"
    instant = instant_of(found.recording)
    if instant is not None:
        return f"broken in round {found.round}, {float(instant):.6g} s into the environment's turn"
    return f"broken in round {found.round}, {found.phase.value}"


def _rounds(system: System, found: Counterexample, table: Table) -> Iterator[str]:
    """The rounds as ``koord run`` shows them, run by the reference semantics once more."""
    last: Configuration[Constant] | None = None
    first: Configuration[Constant] | None = None  #: of the rounds that repeat
    steps: list[Shown] = []
    for step in execute(Numbers.EXACT.domain, system, found.recording):
        if last is not None and not steps and step.round == found.recording.loop:
            first = last
            yield from table.looped(found.recording)
        if last is None:
            yield from table.start(step)
        else:
            steps.append(Shown(step, last))
            if step.rule == "ENV-TRANS":
                yield from table.round(step.round, steps)
                steps = []
        last = step.configuration
    if steps:
        yield from table.round(steps[0].step.round, steps)
    yield from table.idle()
    if first is not None and last is not None:
        yield table.goes_on(found.recording, left_behind(system, first, last))


def rerun_of(loaded: Program, system: System, claim: Claim, found: Counterexample) -> Rerun:
    """Where the compiled program departs from the run, if it does."""
    return rerun(trace_of(sources_of(loaded), system, claim, found))


def not_compared() -> Departure:
    """Of a run that the compiled program could not be given."""
    return Departure(0, "the run could not be compared")


def trace_of(sources: Sources, system: System, claim: Claim, found: Counterexample) -> Trace:
    """A counterexample as a trace."""
    kind = _KINDS.get(claim.kind)
    violation = None
    if kind is not None:
        violation = Violation(kind, claim.subject or claim.name, found.round - 1, found.robot)
    return traced(sources, system, Numbers.EXACT, found.recording, violation)


def trace_of_run(loaded: Program, system: System, recording: Recording) -> Trace:
    """A run as a trace that claims nothing of it."""
    return traced(sources_of(loaded), system, Numbers.EXACT, recording, None)
