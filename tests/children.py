"""Which processes were forked from this one and have not been put away."""

from __future__ import annotations

import os
from pathlib import Path


def forked_children() -> set[int]:
    """The numbers of processes that this one forked, and that run what it runs.

    Others, as the helpers of multiprocessing, run something else by now.
    """
    own, found = Path("/proc/self/cmdline").read_bytes(), set[int]()
    for task in Path(f"/proc/{os.getpid()}/task").iterdir():
        for number in (task / "children").read_text().split():
            try:
                line = Path(f"/proc/{number}/cmdline").read_bytes()
            except OSError:  # it was put away just now
                continue
            if line in (own, b""):  # what has ended, and was not waited for, has no line
                found.add(int(number))
    return found
