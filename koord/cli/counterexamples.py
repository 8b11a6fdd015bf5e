"""Counterexamples as tables: runs, fair runs, reruns of compiled programs, broken steps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from koord.api.fairness import Fair
from koord.api.verdicts import Verdict
from koord.cli.diagnostics import place
from koord.cli.tables import RunTable, ShownStep
from koord.cli.terminal import Paint, Style, visible
from koord.semantics.configurations import NO_EVENT, Configuration
from koord.semantics.domain import Constant
from koord.syntax.system import System
from koord.traces.changes import Change
from koord.traces.fairness import told
from koord.traces.json_reader import shortened
from koord.traces.names import Names
from koord.traces.rendering import repeats
from koord.verify.verdicts import BrokenStep, Counterexample

if TYPE_CHECKING:
    from koord.refinement.compiled_replay import Rerun


def fairness_lines(fair: Fair) -> Iterator[str]:
    """Describe why the run is fair, and expectations that would exclude it."""
    yield "  the run is fair, so that nothing forbids it [LASSO]:"
    yield from (f"    {line}" for line in told(fair.why))
    if fair.excluding:
        either = (
            "one of these lines excludes it" if len(fair.excluding) > 1 else "it is excluded by"
        )
        yield f"  if what is so may be expected, {either} [FAIR-ASSUME]:"
    else:
        yield "  no expectation of a single event that any run meets was found to exclude it"
    for text in fair.excluding:
        yield from (f"    {line}" for line in text.splitlines())


_WIDEST = 40


def rerun_lines(departure: Rerun) -> Iterator[str]:
    """Describe the run of the compiled program, and its first difference."""
    from koord.api.stories import compiled_changes, compiled_lines  # only violations need it

    yield from (f"  {line}" for line in compiled_lines(departure))
    yield from told_apart(compiled_changes(departure), "recorded", "compiled")


def told_apart(changes: Iterable[Change], old: str, new: str) -> Iterator[str]:
    """Locations that differ, as a table with these headings; no lines if there are none."""
    rows = [(_location(change), change.old, change.new) for change in changes]
    if not rows:
        return
    cut = [
        tuple(shortened(visible(cell), _WIDEST) for cell in row) for row in [("", old, new), *rows]
    ]
    widths = [max(len(row[k]) for row in cut) for k in range(3)]
    for row in cut:
        yield "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()


def _location(change: Change) -> str:
    return change.name if change.robot is None else f"{change.name} of robot {change.robot}"


def step_lines(verdict: Verdict, style: Style) -> Iterator[str]:
    """Describe the step that breaks a claim, though the claim may be true all the same."""
    system, step = verdict.system, verdict.found.step
    assert step is not None
    name = verdict.name
    yield style.paint(f"{name}: not inductive", Paint.WARNING)
    yield "  Here all claims hold (nobody knows whether a run comes here):"
    table = RunTable(Names(system), style)
    yield from table.configuration(step.configurations[0])
    rounds = len(step.events)
    for number in range(rounds):
        last = number + 1 == rounds
        until = f", {step.phase.value}" if last else ""
        yield f"  One round later{until}:" if number else f"  One round on{until}:"
        before, after = step.configurations[number : number + 2]
        yield from table.step(_names(system, step, number), before, after)
    yield f"  There {name} does not hold. An invariant that rules out the first would prove it."


def _names(system: System, step: BrokenStep, number: int) -> list[str]:
    return [
        "" if position == NO_EVENT else system.agent(robot).events[position].name
        for robot, position in enumerate(step.events[number])
    ]


def lines(verdict: Verdict, style: Style) -> Iterator[str]:
    """Describe the runs that break a claim: a heading, the rounds, and the place in the text."""
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
    """The rounds as ``koord run`` shows them, executed by the reference semantics."""
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
