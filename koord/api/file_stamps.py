"""Stamps of files, by which it is seen that they have changed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TypeAlias

#: Often enough to answer at once, seldom enough to cost nothing.
POLL_S = 0.05

#: A file's time of change and size; None while it is not there, as between the steps of a save.
Stamp: TypeAlias = "tuple[int, int] | None"


def stamps_of(paths: Sequence[str]) -> list[Stamp] | None:
    """The stamps of all files; None while one is not there."""
    found = [_stamp(path) for path in paths]
    return None if None in found else found


def _stamp(path: str) -> Stamp:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
