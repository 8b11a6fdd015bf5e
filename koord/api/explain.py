"""The long story of a diagnostic's code, with an example and its cure."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches

from koord.api.results import ArgumentError
from koord.syntax.catalogue import Story, entries


def explain(code: str) -> Story:
    """What there is to be said of a code: title, story, a program that yields it and one that does
    not. Raises :class:`koord.ArgumentError` if there is no such code.

    >>> koord.explain("K201").title
    """
    wanted = code.strip().upper()
    if wanted in entries():
        return entries()[wanted]
    near = get_close_matches(wanted, entries(), n=3)
    cure = f"; there are {', '.join(near)}" if near else "; `koord explain` lists all codes"
    raise ArgumentError("code", f"there is no code {code!r}{cure}")


def codes() -> Mapping[str, Story]:
    """Every code that there is, in order, with its story."""
    return entries()
