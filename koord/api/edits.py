"""Edits of a program under simulation: inputs of a run, as data or as files are saved.

:class:`ListedEdits` has them by round. :class:`FileEdits` is the thin part that watches files, and
compiles what was saved in a thread of its own meanwhile.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Protocol

from msgspec import Struct
from msgspec.structs import replace

from koord.api.file_stamps import POLL_S, Stamp, stamps_of
from koord.api.files import read_program
from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.sim_setup import Built, build
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.source import Source


class Edit(Struct, frozen=True):
    """An edited program: compiled, or with what is wrong with it. ``sources`` are its texts.

    It is ``agreed`` to what it does not keep if it was put back, and saved again as it was.
    """

    sources: tuple[Source, ...]
    fitted: Fitted | None
    built: Built | None
    diagnostics: tuple[Diagnostic, ...] = ()
    agreed: bool = False


class Edits(Protocol):
    """A source of edits of a program under simulation."""

    def take(self, round_: int) -> Edit | None:
        """The edit to go on with before a round, if there is one; each is given once."""
        ...

    def put_back(self, edit: Edit) -> None:
        """Give an edit again, as agreed, when it is saved again as it is."""
        ...


def edit_of(request: FitRequest, source: Source, properties: tuple[Source, ...]) -> Edit:
    """Fit and compile a text in place of the program of a request."""
    sources = (source, *properties)
    try:
        fitted = fit(replace(request, source=source, properties=properties))
        return Edit(sources, fitted, build(fitted))
    except KoordError as error:
        return Edit(sources, None, None, error.diagnostics)


class _PutBack:
    """An edit that was put back: it is agreed to when it comes again as it was."""

    def __init__(self) -> None:
        self._edit: Edit | None = None

    def put(self, edit: Edit) -> None:
        self._edit = edit

    def agreed(self, sources: tuple[Source, ...]) -> Edit | None:
        """The edit if it has these sources; it is forgotten in any case."""
        edit, self._edit = self._edit, None
        return None if edit is None or edit.sources != sources else replace(edit, agreed=True)


class ListedEdits:
    """Edits as data: texts by the rounds before which they are there."""

    def __init__(self, request: FitRequest, texts: Iterable[tuple[int, str]]) -> None:
        self._request, self._texts = request, sorted(texts)
        self._back = _PutBack()

    def take(self, round_: int) -> Edit | None:
        text: str | None = None
        while self._texts and self._texts[0][0] <= round_:
            _, text = self._texts.pop(0)
        if text is None:
            return None
        source = replace(self._request.source, text=text)
        agreed = self._back.agreed((source, *self._request.properties))
        return agreed or edit_of(self._request, source, self._request.properties)

    def put_back(self, edit: Edit) -> None:
        self._back.put(edit)


class FileEdits:
    """Edits of files, which are watched while the context is open.

    ``paths`` are those of the program and of its properties.
    """

    def __init__(self, request: FitRequest, paths: Sequence[str]) -> None:
        self._request, self._paths = request, list(paths)
        self._before: list[Stamp] | None = []  # what was saved since they were read counts
        self._lock, self._over = threading.Lock(), threading.Event()
        self._edit: Edit | None = None
        self._back = _PutBack()
        self._texts = (request.source, *request.properties)
        self._thread = threading.Thread(target=self._watch, name="edits", daemon=True)

    def __enter__(self) -> FileEdits:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def take(self, round_: int) -> Edit | None:
        with self._lock:
            edit, self._edit = self._edit, None
        return edit

    def put_back(self, edit: Edit) -> None:
        with self._lock:
            self._back.put(edit)

    def look(self) -> None:
        """Look whether the files have changed, and compile them if so."""
        now = stamps_of(self._paths)
        if now is None or now == self._before:
            return
        self._before = now
        try:
            texts = tuple(read_program(path).source for path in self._paths)
        except KoordError as error:
            edit = Edit(self._texts, None, None, error.diagnostics)
        else:
            with self._lock:
                agreed = self._back.agreed(texts)
            if agreed is None and texts == self._texts:  # saved as it was
                return
            edit = agreed or edit_of(self._request, texts[0], texts[1:])
            self._texts = texts
        with self._lock:
            self._edit = edit

    def _watch(self) -> None:
        while not self._over.wait(POLL_S):
            self.look()
