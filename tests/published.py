"""Published programs: how many are accepted, as they stand or by ``koord migrate``.

    python -m tests.published FOLDER

takes every ``.krd`` and ``.koord`` file below a folder; equal files count once. A program is
*accepted*; accepted *with warnings* of old forms; *migrated* by ``koord migrate --stub``, which
declares what nobody declares; or *rejected*, with the codes of its errors. What comes out of a
migration has to stay as it is, and a program that is accepted has to mean what it did. The exit
code is 1 if that fails, or something raises an exception; 2 if there is no program.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

from msgspec import Struct

import koord
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.load import load

ENDINGS = (".krd", ".koord")


class Outcome(Enum):
    """What becomes of a program; the value says it."""

    ACCEPTED = "accepted"
    WARNED = "accepted with warnings"
    MIGRATED = "migrated"
    REJECTED = "rejected"
    BROKEN = "a mistake of koord"


class Finding(Struct, frozen=True):
    """A program, what became of it, and the codes that say why."""

    path: Path
    outcome: Outcome
    codes: tuple[str, ...] = ()
    trouble: str = ""

    def __str__(self) -> str:
        return f"{self.outcome.value:<22}  {self.path.name}  {' '.join(self.codes)}".rstrip()


def programs(folder: Path) -> Iterator[Path]:
    """The programs below a folder, of equal ones the first."""
    seen: set[bytes] = set()
    for path in sorted(folder.rglob("*")):
        if path.suffix in ENDINGS and path.is_file() and path.read_bytes() not in seen:
            seen.add(path.read_bytes())
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
    if report.errors:
        if not found.errors:
            return Finding(path, Outcome.MIGRATED, _codes(report.errors))
        return Finding(path, Outcome.REJECTED, _codes(found.errors))
    if load(found.migrated).program != load(found.source).program:
        return Finding(path, Outcome.BROKEN, trouble="what was migrated means something else")
    if found.steps:
        return Finding(path, Outcome.WARNED, _codes(found.steps))
    return Finding(path, Outcome.ACCEPTED)


def _codes(found: tuple[Diagnostic, ...]) -> tuple[str, ...]:
    warned = all(one.severity is Severity.WARNING for one in found)
    return tuple(sorted({d.code for d in found if warned or d.severity is Severity.ERROR}))


def main(arguments: list[str]) -> int:
    """Print what becomes of each program, and how many of each there are."""
    if len(arguments) != 1 or not Path(arguments[0]).is_dir():
        print("usage: python -m tests.published FOLDER", file=sys.stderr)
        return 2
    findings = [judged(path) for path in programs(Path(arguments[0]))]
    for finding in findings:
        print(finding)
        if finding.trouble:
            print(finding.trouble)
    print()
    for outcome in Outcome:
        print(f"{sum(f.outcome is outcome for f in findings):4}  {outcome.value}")
    print(f"{len(findings):4}  programs")
    if not findings:
        return 2
    return int(any(finding.outcome is Outcome.BROKEN for finding in findings))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
