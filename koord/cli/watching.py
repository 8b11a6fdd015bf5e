"""Watching of files: work that is done again after each change."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

from koord.api.file_stamps import POLL_S, stamps_of


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
            before = stamps_of(paths)
            code = work()
            print("\nwatching; Ctrl-C ends it", file=sys.stderr, flush=True)
            while stamps_of(paths) in (before, None):
                pause(POLL_S)
            print(file=sys.stderr)
    except KeyboardInterrupt:
        return code
