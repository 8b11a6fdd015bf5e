"""Counterexamples to induction as tables: what an invariant leaves open."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.verdicts import Verdict
from koord.cli.tables import RunTable
from koord.cli.terminal import Paint, Style
from koord.semantics.configurations import NO_EVENT
from koord.syntax.system import System
from koord.traces.names import Names
from koord.verify.verdicts import BrokenStep


def step_lines(verdict: Verdict, style: Style) -> Iterator[str]:
    """The step that breaks a claim which may be true all the same."""
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
