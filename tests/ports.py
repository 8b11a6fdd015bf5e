"""Ports that are fixed, which one test of this machine may have at a time."""

from __future__ import annotations

import fcntl
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def held(name: str) -> Iterator[None]:
    """Have what is called so to oneself, as soon as other tests have let it go."""
    with Path(tempfile.gettempdir(), f"koord-tests-{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
