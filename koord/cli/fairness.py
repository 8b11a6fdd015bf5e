"""Why a run without end is fair, and what would exclude it, as text."""

from __future__ import annotations

from collections.abc import Iterator

from koord.api.fairness import Fair
from koord.traces.fairness import told


def fairness_lines(fair: Fair) -> Iterator[str]:
    """Why the run is fair, and what to write to exclude it."""
    yield "  the run is fair, so that nothing forbids it [LASSO]:"
    yield from (f"    {line}" for line in told(fair.why))
    if fair.excluding:
        either = (
            "one of these lines excludes it" if len(fair.excluding) > 1 else "it is excluded by"
        )
        yield f"  if what is so may be expected, {either} [FAIR-ASSUME]:"
    else:
        yield "  no expectation of a single event that any run meets was found to exclude it"
    for text in fair.excluding:
        yield from (f"    {line}" for line in text.splitlines())
