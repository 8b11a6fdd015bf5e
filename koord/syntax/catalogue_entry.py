"""The shape of an entry of the catalogue of diagnostics."""

from __future__ import annotations

from dataclasses import dataclass

from koord.syntax.diagnostics import Severity


@dataclass(frozen=True, slots=True)
class Entry:
    """What ``koord explain CODE`` tells. ``bad`` is a program that yields the code; ``good``: mended."""

    code: str
    title: str
    severity: Severity
    story: str
    bad: str
    good: str
