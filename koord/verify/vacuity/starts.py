"""Whether runs can start: where none can, all verdicts hold of nothing. [PROP-VACUOUS]"""

from __future__ import annotations

from contextlib import suppress

from msgspec.structs import replace

from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.verdicts import Emptiness, Vacuity

#: How much may be written to ask whether many robots can start, in steps of evaluation: what is
#: said of each two of them takes a thousand times as much for 64 as for three.
_OF_ALL = 2_000

#: So many robots are asked about where that is not enough: what is amiss with some number of them
#: most often is so with these.
_SOME = 12


def never_starts(system: System, seed: int, deadline: Deadline, effort: Effort) -> Vacuity | None:
    """The vacuity that no run can start, with the reason; None if one can."""
    whole = Unrolling(system, seed)
    if whole.solver.check([], deadline, effort) is not SolverAnswer.UNSAT or whole.unknowns.limits:
        # Where lists may be longer than is looked at, a longer one may do.
        return None
    free = replace(system, program=replace(system.program, assumptions=()))
    if Unrolling(free, seed).solver.check([], deadline, effort) is not SolverAnswer.UNSAT:
        detail = "no initial configuration satisfies them all"
        return Vacuity(Emptiness.ASSUMPTIONS, "", detail, certain=True)
    detail = "no external functions satisfy them all"
    return Vacuity(Emptiness.SUMMARIES, "", detail, certain=True)


def many_never_start(
    system: System, seed: int, deadline: Deadline, effort: Effort
) -> Vacuity | None:
    """The same of many robots, of which a few can start.

    Where that takes long to write, some of them are asked about first, and all of them only if
    these cannot start: if they can, so can more most often.
    """
    with suppress(OutOfBudgetError):
        rationed = replace(system, budget=system.budget.rationed(_OF_ALL))
        return never_starts(rationed, seed, deadline, effort)
    some = some_of(system)
    if some is not None and never_starts(some, seed, deadline, effort) is None:
        return None
    return never_starts(system, seed, deadline, effort)


def some_of(system: System) -> System | None:
    """The system with some robots, of each kind in turn; None if it has no more."""
    if system.robots <= _SOME:
        return None
    # One of each kind, then two of each, …: kinds stay in the order of the robots.
    seen: dict[int, int] = {}
    ranks = []
    for robot, kind in enumerate(system.kinds):
        seen[kind] = seen.get(kind, 0) + 1
        ranks.append((seen[kind], robot))
    chosen = sorted(robot for _, robot in sorted(ranks)[:_SOME])
    return replace(system, kinds=tuple(system.kinds[robot] for robot in chosen))
