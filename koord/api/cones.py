"""What claims do not depend on: what is outside of their cones of influence.

Of a claim about whole runs there is as well what a lasso has to come back to all the same: where it
does not, more than the slice is asked.
"""

from __future__ import annotations

from msgspec import Struct

from koord.syntax.analysis.auxiliary import Var
from koord.syntax.core import Direction, Home
from koord.syntax.system import System
from koord.verify.claims import ClaimKind
from koord.verify.reduction.influence import Happens, Part
from koord.verify.reduction.problems import identity
from koord.verify.reduction.slicing import Slices
from koord.verify.verdicts import Report


class Cones(Struct, frozen=True):
    """By claim, the variables, ports and events outside of its cone of influence.

    For a liveness claim also those of them to which a lasso has to return.
    """

    left_out: dict[str, list[str]]
    returned_to: dict[str, list[str]]


def cones_of(system: System, report: Report) -> Cones:
    """The parts that the claims of a report do not depend on."""
    slices = Slices(system)
    return Cones(_left_out(slices, report), _returned_to(slices, report))


def _returned_to(slices: Slices, report: Report) -> dict[str, list[str]]:
    found = {}
    for claim in (verdict.claim for verdict in report.verdicts):
        if claim.kind is ClaimKind.LIVENESS:
            more = slices.extent(slices.returning([claim])) - slices.extent(slices.cone([claim]))
            if more:
                found[claim.name] = sorted({_shown(slices, part) for part in more})
    return found


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
