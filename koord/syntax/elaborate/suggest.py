"""Guesses at what a misspelt name was meant to be."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

#: Words of other languages for what Koord has under another name.
_ELSEWHERE = {
    "double": "float",
    "real": "float",
    "number": "float",
    "str": "string",
    "text": "string",
    "long": "int",
    "vector": "pos",
    "position": "pos",
    "add": "append",
    "push": "append",
    "enqueue": "append",
    "delete": "remove",
    "dequeue": "pop",
    "size": "length",
    "count": "length",
}

#: How many names one misspelt name is compared with.
MOST_COMPARED = 100


def closest(name: str, known: Iterable[str]) -> str | None:
    """The known name most like ``name``, or None if none is much like it."""
    folded = {candidate.lower(): candidate for candidate in known}
    if name.lower() in folded:
        return folded[name.lower()]
    # Comparing is slow, and a program with thousands of names may misspell thousands.
    likely = list(folded)
    if len(likely) > MOST_COMPARED:
        likely = [candidate for candidate in likely if abs(len(candidate) - len(name)) <= 1]
    found = get_close_matches(name.lower()[:60], likely[:MOST_COMPARED], n=1, cutoff=0.6)
    return folded[found[0]] if found else None


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A hint that names the closest known name."""
    known = list(known)
    elsewhere = _ELSEWHERE.get(name.lower())
    found = elsewhere if elsewhere in known else closest(name, known)
    return f"did you mean `{found}`?" if found else None
