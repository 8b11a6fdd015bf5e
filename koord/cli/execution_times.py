"""Worst-case execution times as a table: an event a row, its worst path below."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.wcet import EventPaths, ExecutionTimes, MeasuredTimes
from koord.cli.terminal import Paint, Style, visible
from koord.syntax.source import Span, counted


def lines(times: ExecutionTimes, file: str, delta_s: float, style: Style) -> Iterator[str]:
    """The lines of a report: worst paths, and what turns took in sampled runs.

    Places in ``file`` are told by their line alone.
    """
    yield "  execution times: the most steps, and CPU of turns on this machine in sampled runs"
    widest = max((len(e.event.name) for a in times.agents for e in a.events), default=0)
    for paths, measured in zip(times.agents, times.measured, strict=True):
        if paths.agent.name:
            yield f"    {visible(paths.agent.name)}"
        for number, event in enumerate(paths.events):
            name = visible(event.event.name).ljust(widest)
            took = _took(measured.get(number))
            yield f"    {name}  {_steps(event.steps, is_bound=event.is_bound)}  {took}"
            for text in _notes(event, file):
                yield style.paint(f"        {text}", Paint.GUTTER)
        whole = _steps(paths.turn_steps, is_bound=paths.is_bound)
        yield f"    {'a turn'.ljust(widest)}  {whole}"
    longest_us = times.longest_us
    if longest_us is not None:
        share = longest_us / 1e6 / delta_s
        yield f"    the longest turn took {longest_us:.0f} µs, {share:.2%} of δ = {delta_s:g} s"


def _steps(steps: int, *, is_bound: bool) -> str:
    """At most so many, or at least, where a loop may go on for longer."""
    return f"{'≤' if is_bound else '≥'} {steps:>6,} steps"


def _took(measured: MeasuredTimes | None) -> str:
    if measured is None or measured.median_us is None or measured.longest_us is None:
        return "never ran"
    turns = counted(len(measured.ns), "turn")
    return f"median {measured.median_us:.0f} µs, longest {measured.longest_us:.0f} µs of {turns}"


def _notes(event: EventPaths, file: str) -> Iterator[str]:
    """The worst path, and why it is no bound."""
    paths = (event.guard, event.effect)
    branches = dict.fromkeys(branch for path in paths for branch in path.branches)
    if branches:
        told = (f"{_place(x.span, file)} {'then' if x.is_true else 'else'}" for x in branches)
        yield f"worst path: {', '.join(told)}"
    loops = dict.fromkeys(span for path in paths for span in path.endless)
    if loops:
        told = (_place(span, file) for span in loops)
        yield f"no bound: what the loop at {', '.join(told)} goes through may grow"
    asked = dict.fromkeys(name for path in paths for name in path.unknown)
    if asked:
        yield f"no bound: outside of the program: {', '.join(map(visible, asked))}"


def _place(span: Span, file: str) -> str:
    return f"line {span.line}" if span.file == file else f"{visible(span.file)}:{span.line}"
