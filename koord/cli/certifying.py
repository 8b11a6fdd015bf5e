"""``koord verify --certificate``: what was shown for all rounds, in a file for others to check."""

from __future__ import annotations

import json
import sys

from koord import __version__
from koord.api.files import write_atomically
from koord.api.programs import Program
from koord.syntax.system import System
from koord.verify.certificates import Texts, certificate, shown_by
from koord.verify.effort import Deadline
from koord.verify.verdicts import Report


def certify(
    loaded: Program, system: System, report: Report, path: str, timeout_s: float | None
) -> None:
    """Write the certificate of the claims that hold in all rounds; say what is not in it."""
    shown = shown_by(report)
    texts = Texts(loaded.source, loaded.properties, loaded.settings)
    deadline = Deadline.after(timeout_s)
    made = certificate(system, texts, shown, deadline, __version__) if shown.holding else None
    if made is None:
        _note("no claim is shown by induction in all rounds, so there is nothing to certify")
        return
    write_atomically(path, json.dumps(made.document, indent=1).encode())
    for name, reason in made.not_covered.items():
        _note(f"not in the certificate: {name}: {reason}")


def _note(text: str) -> None:
    print(f"koord verify: {text}", file=sys.stderr)
