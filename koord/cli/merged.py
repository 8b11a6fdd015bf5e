"""What merging has to say of a deployed run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from koord.cli.exits import Exit
from koord.cli.terminal import visible
from koord.cli.violations import claim_lines
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.source import counted

if TYPE_CHECKING:
    from koord.api.deployed import Deployed
    from koord.api.merge import Merged, PartRead

#: The code of robots that acted on different decisions.
_DISAGREEMENT = "K919"

#: How parts end that do not end in good order.
_ENDS = {"silent": "it tells nothing after", "torn": "it ends in the middle of a line after"}


def merge_lines(path: str, merged: Merged) -> Iterator[str]:
    """Describe a merged run, and what is missing of it."""
    trace, refused = merged.trace, merged.refused
    what = f"{counted(trace.rounds, 'round')} of {counted(trace.robots, 'robot')}"
    if refused is None:
        yield f"{visible(path)}: {what}, every step legal"
        yield from claim_lines(merged.broken, (*merged.unjudged, *map(str, merged.presumed)))
    else:
        where = f"round {refused.step.round + 1}" if refused.step.round >= 0 else "INIT"
        yield f"{visible(path)}: {what}, not legal by {refused.rule} in {where}"
        yield f"  {visible(refused.reason)}"
    for part in merged.parts:
        if part.missed:
            reports = counted(part.missed, "report")
            yield f"  robot {part.pid}: {reports} could not be written, and are missing"
        if part.end.value in _ENDS:
            yield f"  robot {part.pid}: {_ends(part)}"
    if merged.missing:
        whose = ", ".join(map(str, merged.missing))
        yield f"  there is no part of {whose}: what is not known is as the program allows"
    if trace.rounds < merged.rounds_told:
        known, more = counted(trace.rounds, "round"), merged.rounds_told
        yield f"  no part tells of round {trace.rounds + 1}: {known} of {more} are in the trace"


def _ends(part: PartRead) -> str:
    return f"{_ENDS[part.end.value]} round {part.rounds}"


def left_lines(deployed: Deployed) -> Iterator[str]:
    """Describe what lies beside the trace of a run, or its recording."""
    if deployed.left is not None:
        yield f"  all that robots told is in {visible(deployed.left)}"
    if deployed.aside is not None:
        yield (
            f"an earlier run was killed: what its robots told is in {visible(deployed.aside)}, "
            "for `koord merge`"
        )


def refusal_code(diagnostics: Sequence[Diagnostic]) -> Exit:
    """The exit code of a run that could not be merged."""
    disagree = any(one.code == _DISAGREEMENT for one in diagnostics)
    return Exit.VIOLATED if disagree else Exit.BAD_INPUT
