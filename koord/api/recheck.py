"""Rechecking of certificates by another solver."""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import starmap
from typing import Final

from msgspec import convert, to_builtins

from koord.api import forms
from koord.api.certify import Certificate as Written
from koord.api.files import read_written
from koord.api.programs import Text, source_of
from koord.api.progress import Cancellation, CancelledError, Listener, asker, teller
from koord.api.results import Result, html_table
from koord.recheck.certificate import REWRITE, Certificate, digest_of, read
from koord.recheck.checking import Rechecked, RecheckOutcome
from koord.recheck.checking import recheck as settle
from koord.recheck.solving import MissingSolverError, SolverAnswer, version
from koord.syntax.diagnostics import refusal
from koord.syntax.source import NOWHERE, Source, Span, visible

#: Raised when the JSON changes in a way that its readers must know of.
RECHECK_VERSION: Final = 3


class RecheckReport(Result, frozen=True):
    """The result of a recheck."""

    certificate: Certificate
    found: Rechecked
    solver: str  #: which one, with its version

    @property
    def outcome(self) -> RecheckOutcome:
        """The outcome: confirmed, refuted or unknown."""
        return self.found.outcome

    @property
    def confirmed(self) -> bool:
        """True if all claims are confirmed."""
        return self.outcome is RecheckOutcome.CONFIRMED

    @property
    def vacuous(self) -> tuple[str, ...]:
        """The reasons why the claims say less than they seem to."""
        return tuple(self.found.hollow)

    @property
    def sha256(self) -> str:
        """The digest of the program's text in the certificate."""
        return digest_of(self.certificate.program.text)

    @property
    def reason(self) -> str:
        """The reason for a refutation, or for an unknown outcome."""
        return self.found.reason

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord recheck --json`` prints it."""
        found, about = self.found, self.found.about
        everyone, here = found.shown()
        form = forms.Recheck(
            version=RECHECK_VERSION,
            verdict=found.outcome.value,
            reason=found.reason,
            place=_place(found.span),
            solver=self.solver,
            program=self.certificate.program.name,
            sha256=self.sha256,
            problem=convert(about.problem.document(), forms.Problem),
            vacuous=list(found.hollow),
            claims=[
                forms.RecheckedClaim(
                    kind=s.claimed.kind.value,
                    subject=s.claimed.subject,
                    name=s.claimed.name,
                    statement=s.text,
                    place=_place(s.span),
                    shown_for="every number of robots"
                    if s in everyone
                    else "these robots"
                    if s in here
                    else None,
                )
                for s in about.statements
            ],
            relies_on=[
                forms.Premise(p.kind.value, p.name, p.text, _place(p.span)) for p in about.premises
            ],
            not_covered=list(starmap(forms.NotCovered, self.certificate.not_covered)),
            obligations=[
                forms.Obligation(
                    name=one.name,
                    every_number=part is not found.here,
                    answer=_MET[one.answer],
                    claim=one.claim,
                    configuration=list(one.state),
                )
                for part in found.parts
                for one in part.settled
            ],
            scripts=[
                forms.Script(one.name, _MET[one.answer], one.reason) for one in found.opinions
            ],
            seconds=round(found.seconds, 3),
        )
        plain: dict[str, object] = to_builtins(form)
        return plain

    def __repr__(self) -> str:
        why = f": {self.reason}" if self.reason else ""
        return f"<RecheckReport {self.found.about.problem}: {self.outcome.value}{why}>"

    def _repr_html_(self) -> str:
        everyone, here = self.found.shown()
        rows = [
            (s.claimed.name, "every number of robots" if s in everyone else "these robots")
            for s in (*everyone, *here)
        ]
        return html_table(repr(self), ("shown, in every round", "for"), rows)


def recheck(
    certificate: Written | str | os.PathLike[str],
    *,
    program: Text | None = None,
    timeout_s: float | None = None,
    seed: int = 0,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> RecheckReport:
    """Recheck the obligations of a certificate, or of one in a file, with another solver.

    ``program`` is the text that it has to be about. It takes up to ``timeout_s`` seconds; ``seed``
    is of the solver.

    Raises :class:`koord.KoordError` for a damaged certificate, for one about another text, and
    where there is no solver; and :class:`koord.CancelledError` after ``cancellation``.

    >>> koord.recheck("task.json").confirmed
    True
    """
    if isinstance(certificate, Written):
        raw, name = certificate.to_json().encode(), "certificate"
    else:
        raw, name = read_written(os.fspath(certificate)), visible(os.fspath(certificate))
    tell, cancelled = teller(progress), asker(cancellation)

    def waiting() -> None:
        if cancelled():
            raise CancelledError("while obligations were settled")

    def told(text: str) -> None:
        waiting()
        tell(text)

    about = None if program is None else source_of(program)
    return rechecked(read_about(raw, name, about), timeout_s, seed, told, waiting)


def read_about(raw: bytes, name: str, program: Source | None) -> Certificate:
    """Read the certificate in a file, which has to be about a program if one is given.

    Raises KoordError.
    """
    certificate = read(raw, name)
    if program is not None and program.text != certificate.program.text:
        raise refusal(
            "K941", name, f"the certificate is about another text than {program.name}", REWRITE
        )
    return certificate


def rechecked(
    certificate: Certificate,
    timeout_s: float | None,
    seed: int,
    tell: Callable[[str], None],
    waiting: Callable[[], None] = lambda: None,
) -> RecheckReport:
    """As :func:`recheck`, for a certificate."""
    try:
        found = settle(certificate, timeout_s, seed, tell, waiting)
        return RecheckReport(certificate, found, version())
    except MissingSolverError:
        message = "cvc5 is not installed, and a second opinion needs a second solver"
        hint = "install it with `pip install 'koord[recheck]'`, or `pip install cvc5`"
        raise refusal("K942", "cvc5", message, hint) from None


def _place(span: Span) -> forms.Place | None:
    """A place in the text; None if there is none."""
    if span.file == NOWHERE.file:
        return None
    return forms.Place(span.file, span.line, span.column)


_MET = {SolverAnswer.SAT: "not met", SolverAnswer.UNKNOWN: "unknown", SolverAnswer.UNSAT: "met"}
