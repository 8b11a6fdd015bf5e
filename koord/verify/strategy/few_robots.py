"""Claims that are open for every number of robots: whether a few robots break them. [T-EVERY-N]

What some number of robots breaks does not hold of every number: as of programs for two robots. The
search is a short one, so what it does not find says nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress

from msgspec.structs import replace

from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System, resized
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
    """The verdicts, where what is open and some number of robots breaks is violated."""
    open_ = {v.claim.name: v for v in verdicts if v.outcome is Outcome.UNKNOWN}
    broken: dict[str, Verdict] = {}
    for robots in _FEW:
        left = open_.keys() - broken.keys()
        if left and not deadline.passed():
            progress(f"every N, a run of {robots} that breaks what is open")
            for found in _broken(system, robots, left, deadline, progress):
                was = open_[found.claim.name]
                seconds = was.seconds + found.seconds
                broken[was.claim.name] = replace(
                    found, claim=was.claim, robots=robots, seconds=seconds
                )
    return [_for_whom(broken.get(v.claim.name, v), system) for v in verdicts]


def _broken(
    system: System,
    robots: int,
    names: Collection[str],
    deadline: Deadline,
    progress: Callable[[str], None],
) -> list[Verdict]:
    """The verdicts on claims that a short search sees broken; each run is replayed."""
    # Seldom needed, and takes a while to load.
    from koord.verify.engines.explicit.exhaustive import SearchResults, exhaust
    from koord.verify.engines.explicit.finiteness import not_finite

    some = resized(system, robots)
    claims = [claim for claim in claims_of(some) if claim.name in names]
    properties = [claim.stated for claim in claims if claim.stated is not None]
    if not claims or not_finite(some, properties) is not None:
        return []
    found, judge = SearchResults(), plain_problem(some).judge
    with suppress(OutOfBudgetError):
        limits = Limits(states=_STATES)
        exhaust(some, claims, limits, deadline, judge, progress, found, compiled_from=None)
    return [v for v in found.verdicts.values() if v.outcome is Outcome.VIOLATED]


def _for_whom(verdict: Verdict, system: System) -> Verdict:
    """A verdict, where one that is open says of how many robots the text is."""
    stated = len(system.program.instance.kinds)
    if verdict.outcome is not Outcome.UNKNOWN or not stated:
        return verdict
    these = f"{verdict.reason}; the text states {stated}, which is asked without `--robots any`"
    return replace(verdict, reason=these)
