"""Watching of files: work that is done again after each change."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence

#: Often enough to answer at once, seldom enough to cost nothing.
POLL_S = 0.05

#: A file's time of change and size; None while it is not there, as between the steps of a save.
Stamp = tuple[int, int] | None


def watched(
    paths: Sequence[str],
    work: Callable[[], int],
    *,
    pause: Callable[[float], None] = time.sleep,
) -> int:
    """Repeat the work after each change of the files, until Ctrl-C; return the last exit code."""
    code = 0
    try:
        while True:
            # Before the work: a change that comes during it counts.
            before = _stamps(paths)
            code = work()
            print("\nwatching; Ctrl-C ends it", file=sys.stderr, flush=True)
            while _stamps(paths) in (before, None):
                pause(POLL_S)
            print(file=sys.stderr)
    except KeyboardInterrupt:
        return code


def _stamps(paths: Sequence[str]) -> list[Stamp] | None:
    """The stamps of all files; None while one is not there."""
    found = [_stamp(path) for path in paths]
    return None if None in found else found


def _stamp(path: str) -> Stamp:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
