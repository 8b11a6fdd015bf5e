"""Unreachable goals: events that never run, and suppositions never true. [PROP-VACUOUS]

Most of it can be proved in no time, by steps that do not ask whether rounds can end. What is left
is looked for in runs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.analysis.premises import without
from koord.syntax.system import System
from koord.verify.claims import Claim
from koord.verify.effort import Effort
from koord.verify.ledger import Ledger
from koord.verify.reachability_goals import Aim, ReachabilityGoal, reachability_goals_of
from koord.verify.vacuity.reachability import (
    Unbroken,
    broken_between,
    inside_rounds,
    never_broken,
    unbroken,
)
from koord.verify.verdicts import Emptiness, Vacuity

#: Proofs are of one round or two, and rest on what is so in the first ones.
_FIRST = 2


def unmet(ledger: Ledger, unbroken_: Collection[Claim], effort: Effort) -> Iterator[Vacuity]:
    """The goals that no run reaches, among those not reached at ends of rounds, and why."""
    wished = reachability_goals_of(ledger.system)
    asking = _Asking(ledger, wished.system, effort)
    goals = {goal.never: goal for goal in wished.all if goal.never in unbroken_}
    sure = asking.never_begun(goals)
    left = {never: goal for never, goal in goals.items() if never not in sure}
    met, is_all = asking.between([n for n, goal in left.items() if goal.observed], ending=True)
    left = {never: goal for never, goal in left.items() if never not in met}
    blocked = asking.blocked([n for n, goal in left.items() if goal.aim is not Aim.CONTRACT])
    # What is before the end of a round that contracts rule out is as good as never there.
    lasting = [
        never
        for never, goal in left.items()
        if not goal.observed or (is_all and never in blocked and not never.reads_ports)
    ]
    proved = asking.proved(asking.system, lasting)
    blocked |= {n for n in proved if asking.is_kept_off(goals[n])}
    for never, goal in goals.items():
        if never not in met:
            rounds = ledger.bounds.rounds
            yield told(goal, rounds, certain=never in sure | proved, blocked=never in blocked)


class _Asking(Struct, frozen=True):
    """The queries about goals, in the system in which they are stated."""

    ledger: Ledger
    system: System
    effort: Effort

    def never_begun(self, goals: dict[Claim, ReachabilityGoal]) -> set[Claim]:
        """The goals that nothing reaches, not even in rounds that cannot end."""
        inside = [never for never, goal in goals.items() if goal.aim is not Aim.CONTRACT]
        soon, is_all = self.between(inside, ending=False, rounds=_FIRST)
        asked = {inside_rounds(never): never for never in inside if is_all and never not in soon}
        found = {asked[claim] for claim in self.proved(self.system, asked)}
        # Up to the first turn that begins as contracts suppose, nothing hangs on what they promise
        # of it: what is proved of the program serves there, too.
        begun = [goal for goal in goals.values() if goal.aim is Aim.CONTRACT]
        still = [inside_rounds(goal.still) for goal in begun if goal.still is not None]
        free = self._freed(begun)
        first = self._left(free, [*(goal.never for goal in begun), *still], _FIRST)
        return found | self.proved(free, first.claims if first.known else ())

    def between(
        self, nevers: Collection[Claim], *, ending: bool, rounds: int | None = None
    ) -> tuple[set[Claim], bool]:
        """The goals reached between the ends of rounds; and whether all were found."""
        at_most = self.ledger.bounds.rounds
        return broken_between(
            self.system,
            nevers,
            at_most if rounds is None else min(rounds, at_most),
            self.ledger.deadline,
            self.effort,
            seed=self.ledger.seed,
            ending=ending,
        )

    def blocked(self, nevers: Collection[Claim]) -> set[Claim]:
        """The goals reached only inside rounds that cannot end."""
        modules = [module for agent in self.system.program.agents for module in agent.modules]
        if not any(module.contracts for module in modules if module.environment is None):
            return set()
        return self.between(nevers, ending=False)[0]

    def is_kept_off(self, goal: ReachabilityGoal) -> bool:
        """Return whether a contract's premise holds in some turn, but its promise lets none end."""
        if not goal.promises:
            return False
        left = self._left(self._freed([goal]), [goal.never], self.ledger.bounds.rounds)
        return goal.never not in left.claims

    def proved(self, system: System, nevers: Collection[Claim]) -> set[Claim]:
        """The goals that no round reaches, as far as a short attempt can prove."""
        return never_broken(self.ledger, system, nevers, self.ledger.deadline, self.effort)

    def _left(self, system: System, nevers: Collection[Claim], rounds: int) -> Unbroken:
        if not nevers:
            return Unbroken(frozenset())
        ledger = self.ledger
        at_most = min(rounds, ledger.bounds.rounds)
        return unbroken(system, nevers, at_most, ledger.deadline, self.effort, seed=ledger.seed)

    def _freed(self, goals: Collection[ReachabilityGoal]) -> System:
        """The system without the promises that rest on the goals."""
        promises = [promise for goal in goals for promise in goal.promises]
        return replace(self.system, program=without(self.system.program, promises))


def told(goal: ReachabilityGoal, rounds: int, *, certain: bool, blocked: bool) -> Vacuity:
    """Make the vacuity that reports an unreachable goal."""
    what = Emptiness.EVENT if goal.aim is Aim.EVENT else Emptiness.SUPPOSITION
    verb = "run" if goal.aim is Aim.EVENT else "come true"
    if blocked:
        detail = f"can {verb}, but no round in which it does can end: contracts rule it out"
    elif certain:
        detail = f"can never {verb}"
    else:
        detail = f"cannot {verb} within {rounds} rounds"
    return Vacuity(what, goal.subject, detail, certain, goal.span)
