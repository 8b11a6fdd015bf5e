"""Verdicts as tables: of a program, of each number of robots, and what proofs need."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, assert_never

from msgspec.structs import replace

from koord.api.programs import Program
from koord.cli.terminal import Paint, Style, visible
from koord.syntax.analysis.premises import Premise, PremiseKind
from koord.syntax.problem import Problem
from koord.syntax.source import counted
from koord.verify.claims import ClaimKind
from koord.verify.engine_names import Engine, engine_named
from koord.verify.obstacles import Failure
from koord.verify.verdicts import (
    EnumerationResult,
    Outcome,
    Report,
    Vacuity,
    Verdict,
)

if TYPE_CHECKING:
    from koord.api.cones import Cones
    from koord.api.verify_report import VerifyReport
    from koord.verify.proof_core import ProofCore


def core_lines(loaded: Program, found: ProofCore, style: Style) -> Iterator[str]:
    """A table of premises: needed ones, others, and those not tried in time."""
    if not found.claims:
        yield "  nothing holds in every round, so nothing rests on anything"
        return
    if not found.needed:
        yield "  what holds in every round rests on no assumption, contract or summary"
    parts = (
        ("what holds in every round rests on", found.needed),
        ("and not on", found.spare),
        ("not tried in time", found.untried),
    )
    for heading, premises in parts:
        if premises:
            yield f"  {heading}:"
            yield from _rows(loaded, premises, style)


def _rows(loaded: Program, premises: Sequence[Premise], style: Style) -> Iterator[str]:
    grouped = groupby(premises, key=lambda p: (p.kind, p.name, p.span, p.promises))
    rows = []
    for (kind, name, span, promises), group in grouped:
        numbers = [premise.promise for premise in group]
        place = f"{span.file}:{span.line}"
        rows.append((kind.value, place, _what(loaded, kind, name, numbers, promises, span.line)))
    widths = [max(len(row[k]) for row in rows) for k in range(2)]
    for kind_, place, what in rows:
        edge = style.paint(place.ljust(widths[1]), Paint.GUTTER)
        yield f"    {kind_.ljust(widths[0])}  {edge}  {what}"


def _what(
    loaded: Program, kind: PremiseKind, name: str, numbers: list[int], of: int, line: int
) -> str:
    if kind is PremiseKind.ASSUMPTION:
        return loaded.source.line_text(line).strip()
    if len(numbers) == of:
        return name
    listed = ", ".join(map(str, numbers))
    return f"{name}: promise{'s' if len(numbers) > 1 else ''} {listed} of {of}"


def cone_lines(cones: Cones) -> Iterator[str]:
    """A line for each claim that cannot depend on all of the program."""
    for claim, parts in cones.left_out.items():
        yield f"{claim} does not depend on {', '.join(parts)}."
    for claim, parts in cones.returned_to.items():
        what = f"a loop that breaks {claim} has to come back to {', '.join(parts)} all the same"
        yield f"{what}: where one of the slice does not, engines are asked about more than that."


#: So many invariants that were found are shown, of so many characters; files have all of them.
MOST_SHOWN, LONGEST_SHOWN = 12, 200

#: What is said of a violation where nobody looked at all runs with fewer rounds.
SOONER = ", perhaps sooner"

PAINT = {Outcome.HOLDS: Paint.ADDED, Outcome.VIOLATED: Paint.ERROR, Outcome.UNKNOWN: Paint.WARNING}


def lines(found: VerifyReport, style: Style) -> Iterator[str]:
    """The report as a table, and then its vacuities."""
    report = found.report
    yield style.paint(visible(str(found.problem)), Paint.BOLD)
    yield ""
    rows = [(v.claim.name, said(v), _by(v), _time(v)) for v in report.verdicts]
    widths = [max((len(row[k]) for row in rows), default=0) for k in range(4)]
    for verdict, row in zip(report.verdicts, rows, strict=True):
        shown = style.paint(row[1].ljust(widths[1]), PAINT[verdict.outcome])
        time = row[3].rjust(widths[3])
        yield f"  {row[0].ljust(widths[0])}  {shown}  {row[2].ljust(widths[2])}  {time}".rstrip()
        if verdict.reason:
            yield f"      {verdict.reason}"
        if verdict.fairness:
            yield f"      {_fairly(verdict.fairness)}"
        if verdict.ways is not None and (verdict.ways.complete or verdict.ways.reason):
            yield f"      {_ways(1 + len(verdict.others), verdict.ways)}"
    yield from _in_the_way(found)
    invariants = found.found_invariants
    if invariants:
        yield ""
        yield "  invariants that were found for it:"
    readable = [text for text in invariants if len(text) <= LONGEST_SHOWN][:MOST_SHOWN]
    for text in readable:
        yield f"    {text}"
    if others := len(invariants) - len(readable):
        them = "more" if readable else "long ones"
        yield f"    … {others} {them}: --save-invariants FILE writes them all"
    if report.vacuities:
        yield ""
    for vacuity in report.vacuities:
        yield f"  {_empty(vacuity, style)}"
    if report.unlooked:
        yield ""
        yield from _given_up(found.not_looked_at, style)
    if report.failures:
        yield ""
    for failure in report.failures:
        yield f"  {style.paint('failed:', Paint.WARNING)} {_failed(failure)}"


def _failed(failure: Failure) -> str:
    """Describe a failure of an engine in a line."""
    place = f" ({failure.where})" if failure.where else ""
    mistake = ""
    if failure.where:
        mistake = (
            "; this is a mistake in koord: please report it with the program, "
            "KOORD_DEBUG=1 shows the traceback"
        )
    instead = ", others were asked instead" if engine_named(failure.who) is not Engine.NONE else ""
    return f"{failure.who}{instead}: {failure.what}{place}{mistake}"


def _fairly(fairness: tuple[str, ...]) -> str:
    """Describe the fairness that a proof rests on."""
    kinds = [f"to {kind}" for kind in ("robots", "locks") if kind in fairness]
    expected = [name for name in fairness if name not in ("robots", "locks")]
    said = [f"fairness {' and '.join(kinds)}"] if kinds else []
    said += [f"what is expected: {', '.join(expected)}"] if expected else []
    return f"it rests on {'; '.join(said)}"


def _ways(count: int, ways: EnumerationResult) -> str:
    """Describe the number of counterexamples, where fewer were found than asked for."""
    found = f"{counted(count, 'way')} to break it"
    if ways.complete:
        return f"{found}: there is no other within the bound"
    return f"{found}; there may be more: {ways.reason}"


def _in_the_way(found: VerifyReport) -> Iterator[str]:
    """Describe the obstacles of unknown claims; claims with the same ones share an entry."""
    stopped: dict[tuple[bool, tuple[str, ...]], list[str]] = {}
    for verdict in found.verdicts:
        if verdict.obstacles:
            stopped.setdefault((verdict.holds, verdict.obstacles), []).append(verdict.name)
    for (is_answered, said_), claims in stopped.items():
        yield ""
        named = ", ".join(claims)
        if is_answered:
            yield f"  a proof for all rounds was looked for besides, and given up, of {named}:"
        else:
            yield f"  what stands in the way of {named}:"
        yield from (f"    {line}" for line in said_)


def _given_up(unlooked: Sequence[str], style: Style) -> Iterator[str]:
    """Describe in a line the goals whose search was given up."""
    label = style.paint("note:", Paint.NOTE)
    some = ", ".join(unlooked[:MOST_SHOWN])
    more = len(unlooked) - MOST_SHOWN
    rest = f" and {more} more" if more > 0 else ""
    yield f"  {label} not looked at to the end, whether it ever happens: {some}{rest}"


def _empty(vacuity: Vacuity, style: Style) -> str:
    """Describe a vacuity in a line."""
    label = style.paint("vacuous:" if vacuity.certain else "warning:", Paint.WARNING)
    place = f" ({vacuity.span})" if vacuity.span is not None else ""
    return f"{label} {vacuity.what.of(vacuity.subject)}: {vacuity.detail}{place}"


def summary(found: VerifyReport, style: Style) -> str:
    """One line: the outcome, for whom, how far, in how long."""
    problem, report, most = found.problem, found.report, found.bounds.rounds
    outcome = style.paint(report.outcome.value, PAINT[report.outcome])
    stopped = "interrupted, " if report.interrupted else ""
    about = f"{counted(len(report.verdicts), 'claim')}, {_robots(problem, report)}"
    if report.outcome is Outcome.HOLDS:
        reach = "every number of rounds" if _everywhere(report) else f"{most} rounds"
        vacuously = ", but vacuously" if report.is_vacuous else ""
        text = f"{outcome}{vacuously}: {about}, {reach}"
    else:
        count = sum(v.outcome is report.outcome for v in report.verdicts)
        text = f"{outcome}: {count} of {about}"
    return f"{text}; {stopped}{report.seconds:.2f} s"


def _everywhere(report: Report) -> bool:
    return all(verdict.rounds is None for verdict in report.verdicts)


def outcome_of(report: Report) -> str:
    """Describe the outcome of all claims together."""
    match report.outcome:
        case Outcome.HOLDS:
            reach = "in every round" if _everywhere(report) else "within the bound"
            return f"holds {reach}" + (", vacuously" if report.is_vacuous else "")
        case Outcome.VIOLATED:
            broken = [(v.counterexample, v.fewest) for v in report.verdicts if v.counterexample]
            ended = [(c.round, fewest) for c, fewest in broken if c.recording.loop is None]
            if not ended:
                return "violated by a run without end"
            sooner = "" if all(fewest for _, fewest in ended) else SOONER
            return f"violated in round {min(ended)[0]}{sooner}"
        case Outcome.UNKNOWN:
            return "unknown"
    assert_never(report.outcome)


def said(verdict: Verdict) -> str:
    """Describe the verdict, and how far it reaches."""
    match verdict.outcome:
        case Outcome.HOLDS if verdict.claim.kind is ClaimKind.LIVENESS:
            everyone = verdict.engine is Engine.EVERY_N
            if verdict.fairness:
                return "holds for every N, under fairness" if everyone else "holds, under fairness"
            return "holds for every N, in every run" if everyone else "holds in every run"
        case Outcome.HOLDS if verdict.engine is Engine.EVERY_N:
            return "holds for every N, in every round"
        case Outcome.HOLDS if verdict.rounds is None:
            return "holds in every round"
        case Outcome.HOLDS:
            return f"holds through round {verdict.rounds}"
        case Outcome.VIOLATED:
            assert verdict.counterexample is not None
            found = verdict.counterexample
            if found.recording.loop is not None:
                from koord.traces.rendering import repeats

                return f"violated: {repeats(found.recording)}"
            where = f"in round {found.round}" if found.round else "at the start"
            whose = "" if verdict.robots is None else f" by {counted(verdict.robots, 'robot')}"
            return f"violated {where}{'' if verdict.fewest else SOONER}{whose}"
        case Outcome.UNKNOWN if verdict.rounds is None:
            return "unknown"
        case Outcome.UNKNOWN:
            return f"unknown; holds through round {verdict.rounds}"
    assert_never(verdict.outcome)


def _by(verdict: Verdict) -> str:
    if verdict.engine is Engine.NONE:
        return ""
    if verdict.engine is Engine.INDUCTION and verdict.depth > 1:
        return f"induction over {verdict.depth} rounds"
    return str(verdict.engine.value)


def _time(verdict: Verdict) -> str:
    """How long it took to find out; nothing was asked where it was known before."""
    return "kept" if verdict.kept else f"{verdict.seconds:.2f} s"


def _robots(problem: Problem, report: Report) -> str:
    if all(v.engine is Engine.EVERY_N for v in report.verdicts):
        return replace(problem, kinds=None).fleet
    return problem.fleet


def heading(problem: Problem, style: Style) -> list[str]:
    """The heading above the table: settings that are the same for all numbers of robots."""
    return [
        style.paint(visible(f"{problem.name}: {', '.join(problem.values)}"), Paint.BOLD),
        "",
        f"  {'robots':>6}  {'outcome':<26}  {'engines':<20}  {'time':>9}",
    ]


def row(found: VerifyReport, style: Style) -> str:
    """One line of the table, to be printed as soon as it is known."""
    report = found.report
    shown = style.paint(outcome_of(report).ljust(26), PAINT[report.outcome])
    engines = ", ".join(engine.value for engine in found.engines)
    time = f"{report.seconds:.2f} s"
    return f"  {found.system.robots:>6}  {shown}  {engines:<20}  {time:>9}"
