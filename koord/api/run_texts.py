"""Counterexamples as Markdown, for editors that show no pages."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.stories import of_verdict
from koord.api.verdicts import Verdict
from koord.semantics.configurations import NO_EVENT
from koord.traces.changes import changes
from koord.traces.names import Names
from koord.traces.trace import Trace


def run_text(verdict: Verdict) -> str:
    """The run that breaks a claim: a row a round, with events and what changed.

    Raises ValueError if the claim is not violated.
    """
    run, trace = verdict.found.counterexample, verdict.counterexample
    if run is None or trace is None:
        raise ValueError(f"{verdict.name} is not violated")
    lines = [f"# {verdict.name} is violated", ""]
    if run.detail:
        lines += [run.detail, ""]
    robots = range(trace.recorded.system.robots)
    lines += [
        " | ".join(["| round", *(f"robot {robot}" for robot in robots), "changes |"]),
        f"|{' --- |' * (len(robots) + 2)}",
        *_rows(trace.recorded),
        "",
    ]
    if run.recording.loop is not None:
        lines += [f"From round {run.recording.loop + 1} on it repeats itself, for ever.", ""]
    else:
        lines += [f"{next(of_verdict(verdict)).headline}.", ""]
    return "\n".join(lines)


def _rows(trace: Trace) -> Iterator[str]:
    system, names = trace.system, Names(trace.system)
    for number, round_ in enumerate(trace.recording.rounds):
        ran = [
            "–" if event is None or event == NO_EVENT else system.agent(robot).events[event].name
            for robot, event in enumerate(round_.events)
        ]
        found = changes(names, *trace.configurations[number : number + 2])
        changed = ", ".join(change.told() for change in found)
        yield " | ".join([f"| {number + 1}", *ran, f"{_cell(changed)} |"])


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
