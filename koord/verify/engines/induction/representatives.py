"""Symmetry reduction of claims: quantifiers over representatives of the robots. [SYMMETRY]

Where robots may change places, what breaks ``forall i, j: …`` breaks it for i = 0 and j ≤ 1 under
other names: each robot that a quantifier brings in is one of those that were named before, or the
next. So N² cases become two.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.core import BinaryOp, QuantifierKind
from koord.syntax.system import System
from koord.syntax.types import INT
from koord.verify.claims import Claim, claims_of


def representatives(system: System) -> Callable[[Claim], Claim]:
    """A claim over representatives that is broken in some configuration if and only if this one is.

    The two are of one configuration only up to the names of its robots, and of sets that are
    closed under renaming: of all that can be reached, or of all in which other claims hold.
    """
    asked = tuple(claim.stated for claim in claims_of(system) if claim.stated is not None)
    symmetry = symmetry_of(system, asked)
    everyone = (tuple(range(system.robots)),)
    if not isinstance(symmetry, Symmetry) or symmetry.groups != everyone:
        return lambda claim: claim
    return lambda claim: _represented(claim, system)


def _represented(claim: Claim, system: System) -> Claim:
    if claim.stated is None:
        return claim
    condition = _narrowed(claim.stated.condition, 1, system)
    return replace(claim, stated=replace(claim.stated, condition=condition))


def _narrowed(e: core.Expr, named: int, system: System) -> core.Expr:
    """Restrict outer quantifiers to ``named`` robots, and inner ones to one more each."""
    everyone = (None, system.kinds[0])  # of another kind than the first robot there are none
    match e:
        case core.Quantified(QuantifierKind.FORALL, domain=core.RobotRange(agent=kind)) if (
            kind in everyone
        ):
            few = core.IntRange(core.Const(0, INT), core.Const(min(named, system.robots), INT))
            return replace(e, domain=few, body=_narrowed(e.body, named + 1, system))
        case core.Binary(op=BinaryOp.AND):
            left, right = (_narrowed(part, named, system) for part in (e.left, e.right))
            return replace(e, left=left, right=right)
        case core.Binary(op=BinaryOp.IMPLIES):
            return replace(e, right=_narrowed(e.right, named, system))
        case _:
            return e
