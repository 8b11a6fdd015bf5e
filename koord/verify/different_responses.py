"""Responses to look at: one of each group of robots that may change places. [T-FULL-STATES]"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from koord.semantics.liveness import Response, responses
from koord.syntax import core
from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.core import QuantifierKind
from koord.syntax.system import System


def different_responses(system: System, stated: core.Property) -> list[Response]:
    """The responses of a property, without those that differ from one by robots' names alone.

    A renaming maps fair runs to fair runs, so each of these is broken if that one is. [SYMMETRY]
    """
    found = responses(system, stated)
    if stated.each is None:
        return list(found)
    symmetry = symmetry_of(system, sides(system, (stated,)))
    groups = symmetry.groups if isinstance(symmetry, Symmetry) else ()
    others = {robot for group in groups for robot in group[1:]}
    return [response for response in found if response.robot not in others]


def sides(system: System, stated: Sequence[core.Property]) -> tuple[core.Property, ...]:
    """Both sides of responses and expectations, quantified over their robots."""
    found = []
    for each in (*stated, *system.program.expectations):
        trigger = () if each.trigger is None else (each.trigger,)
        for side in (*trigger, each.condition):
            whole = _of_all(each, side)
            found.append(replace(each, condition=whole, trigger=None, each=None))
    return tuple(found)


def _of_all(stated: core.Property, side: core.Expr) -> core.Expr:
    if stated.each is None:
        return side
    domain = core.RobotRange(stated.each.agent)
    return core.Quantified(QuantifierKind.FORALL, stated.each.variable, domain, side)
