"""Where a configuration gives a value to a param."""

from __future__ import annotations

from functools import lru_cache

from koord.runtime.configuration.reading import Document, read
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source, Span


def param_place(source: Source, name: str) -> Span | None:
    """The place of a param's name in a configuration (YAML); None if it gives it no value."""
    document = _read(source)
    return None if document is None else document.names.get(("params", name))


@lru_cache(maxsize=16)
def _read(source: Source) -> Document | None:
    try:
        return read(source)
    except KoordError:  # told where the configuration is read for a run
        return None
