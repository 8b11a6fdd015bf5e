"""The file of ``--sarif``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from koord.api.files import write_atomically
from koord.api.sarif import sarif_text
from koord.cli.diagnostics import complain
from koord.syntax.diagnostics import Diagnostic

if TYPE_CHECKING:
    from koord.api.verify_report import VerifyReport


def write_sarif(
    path: str, diagnostics: Sequence[Diagnostic], reports: Sequence[VerifyReport] = ()
) -> None:
    """Write diagnostics and verdicts as SARIF. Raises KoordError."""
    from koord.api.verdicts import Parts

    write_atomically(path, sarif_text(diagnostics, reports, parts=Parts(complain)))
