"""``koord verify --certificate``: what was shown for all rounds, in a file for others to check."""

from __future__ import annotations

import json
import sys

from koord import __version__
from koord.cli.files import write_atomically
from koord.cli.inputs import LoadedProgram
from koord.semantics.configurations import System
from koord.verify.certificates import Lemma, Shown, Texts, certificate
from koord.verify.claims import ClaimKind
from koord.verify.solving import Deadline
from koord.verify.verdicts import Engine, Outcome, Report


def certify(
    loaded: LoadedProgram, system: System, report: Report, path: str, timeout_s: float | None
) -> None:
    """Write the certificate of the claims that hold in all rounds; say what is not in it."""
    settled = [v for v in report.verdicts if v.outcome is Outcome.HOLDS and v.rounds is None]
    holding = [v for v in settled if v.claim.kind is not ClaimKind.LIVENESS]
    shown = Shown(
        tuple(v.claim.name for v in holding),
        frozenset(v.claim.name for v in holding if v.engine is Engine.EVERY_N),
        tuple(
            dict.fromkeys(
                Lemma(text, v.engine is Engine.EVERY_N) for v in holding for text in v.lemmas
            )
        ),
        {v.claim.name: _OF_RUNS for v in settled if v.claim.kind is ClaimKind.LIVENESS},
        {
            v.claim.name: f"its invariant is not said in Koord: {v.unsaid}"
            for v in holding
            if v.unsaid
        },
    )
    texts = Texts(loaded.source, loaded.reading.properties, loaded.reading.settings)
    deadline = Deadline.after(timeout_s)
    made = certificate(system, texts, shown, deadline, __version__) if holding else None
    if made is None:
        _note("no claim is shown by induction in all rounds, so there is nothing to certify")
        return
    write_atomically(path, json.dumps(made.document, indent=1).encode())
    for name, reason in made.not_covered.items():
        _note(f"not in the certificate: {name}: {reason}")


#: Why a claim is not certified that is about whole runs.
_OF_RUNS = "it is about whole runs, and a certificate is about configurations"


def _note(text: str) -> None:
    print(f"koord verify: {text}", file=sys.stderr)
