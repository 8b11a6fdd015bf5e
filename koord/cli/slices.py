"""What each claim cannot depend on, in words: what engines were not asked about with it.

Of a claim about whole runs it is told as well what a lasso has to come back to all the same: where
it does not, more than the slice is asked.
"""

from __future__ import annotations

from collections.abc import Iterator

from koord.syntax.analysis.auxiliary import Var
from koord.syntax.core import Direction, Home
from koord.syntax.system import System
from koord.verify.claims import ClaimKind
from koord.verify.reduction.influence import Happens, Part
from koord.verify.reduction.problems import identity
from koord.verify.reduction.slices import Slices
from koord.verify.verdicts import Report


def lines(system: System, report: Report) -> Iterator[str]:
    """A line for each claim that cannot depend on all of the program."""
    slices = Slices(system)
    for claim, parts in _left_out(slices, report).items():
        yield f"{claim} does not depend on {', '.join(parts)}."
    for claim, parts in _returned_to(slices, report).items():
        what = f"a loop that breaks {claim} has to come back to {', '.join(parts)} all the same"
        yield f"{what}: where one of the slice does not, engines are asked about more than that."


def _returned_to(slices: Slices, report: Report) -> dict[str, list[str]]:
    """By claim about whole runs what is outside of its cone, and in what a lasso comes back to."""
    found = {}
    for claim in (verdict.claim for verdict in report.verdicts):
        if claim.kind is ClaimKind.LIVENESS:
            more = slices.extent(slices.returning([claim])) - slices.extent(slices.cone([claim]))
            if more:
                found[claim.name] = sorted({_shown(slices, part) for part in more})
    return found


def left_out(system: System, report: Report) -> dict[str, list[str]]:
    """By claim the variables, ports and events outside of its cone."""
    return _left_out(Slices(system), report)


def _left_out(slices: Slices, report: Report) -> dict[str, list[str]]:
    found = {}
    for verdict in report.verdicts:
        claim = slices.claims.get(identity(verdict.claim))
        if claim is None:
            continue
        outside = slices.everything - slices.extent(slices.cone([claim]))
        if outside:
            found[claim.name] = sorted({_shown(slices, part) for part in outside})
    return found


def _shown(slices: Slices, part: Part) -> str:
    name = slices.name(part)
    match part:
        case Happens():
            return f"event {name}"
        case Var(home=Home.PORT, kind=int(kind), slot=slot):
            port = slices.system.program.agents[kind].ports[slot]
            what = "sensor" if port.direction is Direction.SENSOR else "actuator"
            return f"{what} {port.module}.{name}"
        case _:
            return f"variable {name}"
