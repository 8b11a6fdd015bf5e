"""Verdicts at the places of a text that they are about, for editors."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.api.editing import Document
from koord.api.verdicts import Verdict
from koord.api.verify_report import VerifyReport
from koord.syntax.editing.symbols import Symbol, SymbolKind, with_children
from koord.syntax.source import Source, Span, counted
from koord.verify.claims import ClaimKind
from koord.verify.verdicts import Outcome, Vacuity


class MarkKind(Enum):
    """What a mark tells; the value is the word for it."""

    HOLDS = "holds"  #: in every round
    BOUNDED = "bounded"  #: through so many rounds, of which nothing is known beyond
    VACUOUS = "vacuous"  #: it holds, but says less than it seems to
    VIOLATED = "violated"
    UNKNOWN = "unknown"


class VerdictMark(Struct, frozen=True):
    """The verdict on a claim, where the claim stands: ``title`` in a line, ``story`` in full.

    ``broken_at`` is the place that a counterexample breaks, if it is in this text.
    """

    name: str
    kind: MarkKind
    span: Span
    title: str
    story: str
    engine: str
    seconds: float
    kept: bool
    has_trace: bool
    broken_at: Span | None = None


def verdict_marks(report: VerifyReport, document: Document) -> tuple[VerdictMark, ...]:
    """The verdicts of a report on the program of a document, one mark a claim, in order.

    A file of properties has its own alone; the program's own text has besides those that somebody
    has to do something about, on its first line.
    """
    marks = [(verdict, _mark(verdict, report, document)) for verdict in report.verdicts]
    good = (MarkKind.HOLDS, MarkKind.BOUNDED)
    return tuple(
        mark
        for verdict, mark in marks
        if _is_own(verdict, document) or (document.is_main and mark.kind not in good)
    )


def _is_own(verdict: Verdict, document: Document) -> bool:
    """Whether a claim is about the text of a document, and not about other files beside it."""
    stated = verdict.found.claim.stated
    if stated is None:
        return document.is_main
    others = {file.name for file in document.files} - {document.source.name}
    return stated.span.file not in others


def vacuity_places(report: VerifyReport, document: Document) -> tuple[tuple[Span, str], ...]:
    """What is vacuous in the program, and where, as far as that is certain."""
    return tuple(
        (_own(vacuity.span, document.source) or _first_line(document.source), _told(vacuity))
        for vacuity in report.vacuities
        if vacuity.certain
    )


def _mark(verdict: Verdict, report: VerifyReport, document: Document) -> VerdictMark:
    empty = [v for v in report.vacuities if v.certain and v.subject in ("", verdict.name)]
    kind = _kind(verdict, empty)
    story = _story(verdict, kind, empty, report)
    run = verdict.found.counterexample
    return VerdictMark(
        verdict.name,
        kind,
        _place(verdict, document),
        _title(verdict, kind, report),
        story,
        verdict.engine.value,
        verdict.seconds,
        verdict.kept,
        run is not None,
        None if run is None else _own(run.span, document.source),
    )


def _kind(verdict: Verdict, empty: list[Vacuity]) -> MarkKind:
    match verdict.outcome:
        case Outcome.VIOLATED:
            return MarkKind.VIOLATED
        case Outcome.UNKNOWN:
            return MarkKind.UNKNOWN
        case Outcome.HOLDS:
            if empty:
                return MarkKind.VACUOUS
            return MarkKind.HOLDS if verdict.rounds is None else MarkKind.BOUNDED


def _title(verdict: Verdict, kind: MarkKind, report: VerifyReport) -> str:
    robots = "any number of robots" if report.report.every_n else None
    robots = robots or counted(report.system.robots, "robot")
    match kind:
        case MarkKind.HOLDS:
            return f"{verdict.name} holds in every round · {robots} · {verdict.engine.value}"
        case MarkKind.BOUNDED:
            return f"{verdict.name} holds through round {verdict.rounds} · {robots}"
        case MarkKind.VACUOUS:
            return f"{verdict.name} holds, but says nothing · {robots}"
        case MarkKind.VIOLATED:
            run = verdict.found.counterexample
            where = "" if run is None else f" in round {run.round}"
            if run is not None and run.recording.loop is not None:
                where = " by a run that repeats itself"
            return f"{verdict.name} is violated{where} · {robots}"
        case MarkKind.UNKNOWN:
            through = "" if verdict.rounds is None else f", holds through round {verdict.rounds}"
            return f"{verdict.name} is unknown{through} · {robots}"


def _story(verdict: Verdict, kind: MarkKind, empty: list[Vacuity], report: VerifyReport) -> str:
    run = verdict.found.counterexample
    parts = [_title(verdict, kind, report)]
    if run is not None and run.detail:
        parts.append(run.detail)
    if kind is MarkKind.UNKNOWN:
        parts += [verdict.reason, *verdict.obstacles]
    parts += [_told(vacuity) for vacuity in empty]
    if verdict.found.fairness:
        parts.append(f"the proof needs {', '.join(verdict.found.fairness)}")
    return "\n".join(part for part in parts if part)


def _told(vacuity: Vacuity) -> str:
    subject = vacuity.what.of(vacuity.subject)
    return f"{subject}: {vacuity.detail}" if vacuity.detail else subject


def _place(verdict: Verdict, document: Document) -> Span:
    """The place of a claim: its section, or what it is about; the first line for `no fault`."""
    claim = verdict.found.claim
    if claim.stated is not None:
        return _own(claim.stated.span, document.source) or _first_line(document.source)
    found: Symbol | None = None
    if claim.kind is ClaimKind.CONTRACT:
        found = _symbol(document, claim.subject, SymbolKind.CONTRACT)
    elif claim.kind is ClaimKind.LOST_UPDATE:
        found = _symbol(document, claim.subject, SymbolKind.ALLWRITE)
    if found is None or found.name_span is None:
        return _first_line(document.source)
    return found.name_span


def _symbol(document: Document, name: str, kind: SymbolKind) -> Symbol | None:
    for symbol in with_children(document.symbols):
        if symbol.kind is kind and symbol.name == name:
            return symbol
    return None


def _own(span: Span | None, source: Source) -> Span | None:
    return span if span is not None and span.file == source.name and span.line > 0 else None


def _first_line(source: Source) -> Span:
    return Span(source.name, 1, 1, 1, len(source.line_text(1)) + 1)
