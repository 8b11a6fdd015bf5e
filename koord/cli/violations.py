"""What a run breaks, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import assert_never

from koord.cli.terminal import visible
from koord.traces.trace import Violation, ViolationKind


def does(violation: Violation) -> str:
    """Describe what a run does that violates a claim."""
    name = visible(violation.name)
    match violation.kind:
        case ViolationKind.PROPERTY:
            return f"breaks {name}"
        case ViolationKind.CONTRACT:
            return f"breaks contract {name}"
        case ViolationKind.LOST_UPDATE:
            return f"loses an update of {name}"
    assert_never(violation.kind)


def claim_lines(broken: Violation | None, unjudged: Sequence[str]) -> Iterator[str]:
    """Describe the first claim that a run of robots breaks, and those that nobody can judge."""
    if broken is not None:
        when = "at the start" if broken.round < 0 else f"in round {broken.round + 1}"
        whose = "" if broken.robot is None else f", in the turn of robot {broken.robot}"
        yield f"  it {does(broken)} {when}{whose}"
    if unjudged:
        names = ", ".join(map(visible, unjudged))
        yield f"  not judged, since nobody answered what they ask: {names}"
