"""Claims that are open for every number of robots: whether a few robots break them. [T-EVERY-N]

What some number of robots breaks does not hold of every number, and nobody need look for a proof:
as of programs for two robots. The search is a short one, so what it does not find says nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress

from msgspec.structs import replace

from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System, dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engines.explicit.limits import Limits
from koord.verify.reduction.problems import plain_problem
from koord.verify.verdicts import Outcome, Verdict

#: So many robots are looked at, one number after the other, and so many states with each.
_FEW = (1, 2, 3, 4)
_STATES = 1_000


def looked_at_with_few(
    system: System,
    verdicts: Sequence[Verdict],
    deadline: Deadline,
    progress: Callable[[str], None],
) -> list[Verdict]:
    """The verdicts; those that are open tell of a number of robots that breaks what is claimed."""
    open_ = {v.claim.name for v in verdicts if v.outcome is Outcome.UNKNOWN}
    broken: dict[str, int] = {}
    for robots in _FEW:
        left = open_ - broken.keys()
        if left and not deadline.passed():
            progress(f"every N, a run of {robots} that breaks what is open")
            broken |= dict.fromkeys(_broken(system, robots, left, deadline, progress), robots)
    return [
        _told(v, broken.get(v.claim.name), system) if v.claim.name in open_ else v for v in verdicts
    ]


def _broken(
    system: System,
    robots: int,
    names: Collection[str],
    deadline: Deadline,
    progress: Callable[[str], None],
) -> list[str]:
    """The claims that a short search sees broken; each run is replayed."""
    # Seldom needed, and takes a while to load.
    from koord.verify.engines.explicit.exhaustive import SearchResults, exhaust
    from koord.verify.engines.explicit.finiteness import not_finite

    some = replace(dealt(system.program, robots, system.delta_s), budget=system.budget)
    claims = [claim for claim in claims_of(some) if claim.name in names]
    properties = [claim.stated for claim in claims if claim.stated is not None]
    if not claims or not_finite(some, properties) is not None:
        return []
    found, judge = SearchResults(), plain_problem(some).judge
    with suppress(OutOfBudgetError):
        limits = Limits(states=_STATES)
        exhaust(some, claims, limits, deadline, judge, progress, found, compiled_from=None)
    return [c.name for c, v in found.verdicts.items() if v.outcome is Outcome.VIOLATED]


def _told(verdict: Verdict, robots: int | None, system: System) -> Verdict:
    """An open verdict, with what is known of few robots, or of those that the text states."""
    if robots is not None:
        who = "one robot breaks" if robots == 1 else f"{robots} robots break"
        reason = f"it does not hold of every number: {who} it, as `--robots {robots}` shows"
        return replace(verdict, reason=reason, obstacles=())
    stated = len(system.program.instance.kinds)
    if not stated:
        return verdict
    these = f"{verdict.reason}; the text states {stated}, which is asked without `--robots any`"
    return replace(verdict, reason=these)
