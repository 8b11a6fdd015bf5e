"""What proofs rest on, as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from koord.api.programs import Program
from koord.cli.terminal import Paint, Style
from koord.syntax.analysis.premises import Premise, PremiseKind
from koord.verify.proof_core import ProofCore


def core_lines(loaded: Program, found: ProofCore, style: Style) -> Iterator[str]:
    """A table: what is needed, what is not, and what there was no time to leave out."""
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
