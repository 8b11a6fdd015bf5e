"""What becomes of published programs: as they stand, or by ``koord migrate``."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

from msgspec import Struct

import koord
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.published.expected import BAD_PROGRAMS, codes_of, older

ENDINGS = (".krd", ".koord")


class Outcome(Enum):
    """What becomes of a file; the value says it."""

    ACCEPTED = "accepted"
    WARNED = "accepted with warnings"
    MIGRATED = "migrated"
    SCENE = "a scene"
    OTHER = "something else, and told so"
    BAD = "rejected, as is meant"
    OLDER = "older than the grammar"
    REJECTED = "rejected"
    BROKEN = "a mistake of koord"

    @property
    def is_wanted(self) -> bool:
        return self not in (Outcome.REJECTED, Outcome.BROKEN)


class Finding(Struct, frozen=True):
    """A file, what became of it, and the codes that say why."""

    path: Path
    outcome: Outcome
    codes: tuple[str, ...] = ()
    trouble: str = ""
    source: Source | None = None  #: a program in today's forms, if there is one

    def __str__(self) -> str:
        return f"{self.outcome.value:<27}  {self.path.name}  {' '.join(self.codes)}".rstrip()


def files(folder: Path, endings: tuple[str, ...]) -> Iterator[Path]:
    """The files below a folder with such names, of equal ones the first."""
    seen: set[bytes] = set()
    for path in sorted(folder.rglob("*")):
        if path.suffix not in endings or not path.is_file():
            continue
        data = path.read_bytes()
        if data not in seen:
            seen.add(data)
            yield path


def judged(path: Path) -> Finding:
    """What becomes of a program."""
    try:
        return _judged(path)
    except Exception:
        return Finding(path, Outcome.BROKEN, trouble=traceback.format_exc())


def _judged(path: Path) -> Finding:
    report = koord.check(path)
    found = koord.migrate(path, stub=bool(report.errors))
    again = koord.migrate(found.migrated, stub=True)
    if again.changed:
        return Finding(path, Outcome.BROKEN, trouble="what was migrated is migrated again")
    told, wanted = codes(report.errors), codes_of(path, BAD_PROGRAMS)
    if wanted:
        is_right = bool(found.errors) and not set(wanted).isdisjoint(told)
        trouble = "" if is_right else f"it should be rejected for {' or '.join(wanted)}"
        return Finding(path, Outcome.BAD if is_right else Outcome.REJECTED, told, trouble)
    if report.errors:
        if not found.errors:
            return Finding(path, Outcome.MIGRATED, told, source=found.migrated)
        why = older(path)
        return Finding(path, Outcome.OLDER if why else Outcome.REJECTED, codes(found.errors), why)
    if load(found.migrated).program != load(found.source).program:
        return Finding(path, Outcome.BROKEN, trouble="what was migrated means something else")
    if found.steps:
        return Finding(path, Outcome.WARNED, codes(found.steps), source=found.migrated)
    return Finding(path, Outcome.ACCEPTED, source=found.source)


def codes(found: tuple[Diagnostic, ...]) -> tuple[str, ...]:
    """The codes of errors, each once; of warnings where there is nothing else."""
    warned = all(one.severity is Severity.WARNING for one in found)
    return tuple(sorted({d.code for d in found if warned or d.severity is Severity.ERROR}))
