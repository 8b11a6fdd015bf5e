"""Verification while somebody types: one at a time for each program, ended as the text changes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeAlias

from msgspec import Struct

from koord.api.cache import Cache, usual_folder
from koord.api.editing import Document, KoordError, Span
from koord.api.progress import Progress
from koord.api.results import ArgumentError
from koord.api.session import Session
from koord.api.verdict_marks import VerdictMark, vacuity_places, verdict_marks
from koord.api.verify import load_for_threads
from koord.api.verify_report import VerdictProgress, VerifyReport
from koord.lsp.settings import VerifySettings


class Verified(Struct, frozen=True):
    """What came of a verification: marks, vacuities, or why there are none.

    As long as it is not ``done``, the claims that are settled have marks, and nothing is known of
    what makes them vacuous.
    """

    marks: tuple[VerdictMark, ...] = ()
    vacuities: tuple[tuple[Span, str], ...] = ()
    report: VerifyReport | None = None
    refused: str = ""
    done: bool = True

    @property
    def interrupted(self) -> bool:
        """Whether the verification was ended before it was done."""
        return self.report is not None and self.report.interrupted


#: What is called with the version of a text, and what is known of its claims.
Tell: TypeAlias = Callable[[int, Verified], None]


class Verifier:
    """The verifications of one program: a new one ends the one before.

    Each has a thread of its own, and solvers have processes of their own. ``tell`` is called from
    the thread with the version of the text and what came out, also of one that was ended, and
    before that whenever claims are settled.
    """

    def __init__(self, settings: VerifySettings) -> None:
        self._session = Session(
            robots=settings.robots,
            rounds=settings.rounds,
            timeout_s=settings.timeout_s,
            jobs=settings.jobs,
            cache=Cache(usual_folder()) if settings.cache else None,
        )
        self._threads: list[threading.Thread] = []

    def start(self, document: Document, version: int, tell: Tell) -> None:
        """Verify a text without errors."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        name = f"verification of {document.source.name} {version}"
        thread = threading.Thread(
            target=self._verify, args=(document, version, tell), name=name, daemon=True
        )
        self._threads.append(thread)
        thread.start()

    def cancel(self) -> None:
        """End the one that is going on, if there is one."""
        self._session.cancel()

    def close(self, patience_s: float = 2.0) -> None:
        """End what is going on, and wait a little for its processes to be put away."""
        self.cancel()
        for thread in self._threads:
            thread.join(patience_s)

    def _verify(self, document: Document, version: int, tell: Tell) -> None:
        try:
            found = self._verified(document, version, tell)
        except Exception as error:  # of koord itself: the server goes on
            found = Verified(refused=f"the verification failed: {error!r}")
        tell(version, found)

    def _verified(self, document: Document, version: int, tell: Tell) -> Verified:
        def heard(progress: Progress) -> None:
            if isinstance(progress, VerdictProgress):
                known = progress.report
                tell(version, Verified(verdict_marks(known, document), (), known, done=False))

        program = document.program
        if program is None:
            return Verified(refused="a text with errors, or of properties alone")
        try:
            report = self._session.verify(program, progress=heard)
        except KoordError as error:
            return Verified(refused="; ".join(d.message for d in error.diagnostics))
        except ArgumentError as error:
            return Verified(refused=str(error))
        except MemoryError:
            return Verified(refused="there is not enough memory")
        marks = verdict_marks(report, document)
        return Verified(marks, vacuity_places(report, document), report)


def warm_up() -> None:
    """Load what verifies, so that the first verdict need not wait for it."""
    load_for_threads()
