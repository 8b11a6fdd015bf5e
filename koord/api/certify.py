"""Certificates: proofs for all rounds, in a file for others to check."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from koord.api.files import write_atomically
from koord.api.progress import Cancellation, CancelledError, Listener, asker, teller
from koord.api.results import Result
from koord.api.verify import in_process
from koord.version import __version__

if TYPE_CHECKING:
    from koord.api.verify_report import VerifyReport
    from koord.verify.certificates import Certificate as Made


class Certificate(Result, frozen=True):
    """A certificate; ``not_covered`` are claims that hold and are not in it, with reasons."""

    document: dict[str, Any]
    not_covered: Mapping[str, str]

    def to_dict(self) -> dict[str, object]:
        """The certificate as plain data, as ``koord verify --certificate`` writes it."""
        return self.document

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, whole or not at all. Raises :class:`koord.KoordError`."""
        write_atomically(os.fspath(path), self.to_json(indent=1).encode())

    def __repr__(self) -> str:
        claims = ", ".join(str(claim["name"]) for claim in self.document["claims"])
        return f"<Certificate of {claims}>"


def certify(
    report: VerifyReport,
    *,
    timeout_s: float | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Certificate | None:
    """Make the certificate of the claims that a report shows in all rounds; None if there are none.

    It takes up to ``timeout_s`` seconds. Raises :class:`koord.CancelledError` after
    ``cancellation``.

    >>> koord.certify(koord.verify("task.krd")).save("task.json")
    """
    program, system, found = report.program, report.system, report.at_ends

    def work(tell: object) -> tuple[Made | None]:
        from koord.verify.certificates import Texts, certificate, shown_by
        from koord.verify.effort import Deadline

        shown = shown_by(found)
        if not shown.holding:
            return (None,)
        texts = Texts(program.source, program.properties, program.settings)
        return (certificate(system, texts, shown, Deadline.after(timeout_s), __version__),)

    try:
        (made,) = in_process(work, teller(progress), asker(cancellation))
    except KeyboardInterrupt:
        if cancellation is None or not cancellation.requested:
            raise
        raise CancelledError("while proofs were looked for") from None
    return None if made is None else Certificate(dict(made.document), made.not_covered)
