"""The collector of garbage, which looks for cycles: made to wait where there are none to find."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Spare the collector while much is made that has no cycles.

    Trees, values of programs and recordings have none, and are many: looking at all of them again
    and again takes as long as making them.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
