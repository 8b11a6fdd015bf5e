"""Checks in real time, while other tests are made on the same machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from koord import Conformance
from koord.testing.conformance import Finding


def failing_alone(
    told: Conformance, again: Callable[[Sequence[str]], Conformance]
) -> tuple[Finding, ...]:
    """What fails once more where it is made alone.

    Where a vehicle is by a time hangs on whether its process had its turns: beside four other kits
    it may be some centimetres too late.
    """
    failed = [one.check for one in told.failed]
    return again(failed).failed if failed else ()
