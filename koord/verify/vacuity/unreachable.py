"""Unreachable goals: events and suppositions, for given robots or any number. [PROP-VACUOUS]

Most goals are quickly proved unreachable, by steps that do not ask whether rounds can end. The
others are searched for in runs.

What some robots cannot do more of them may be able to. So that something never happens is certain
only where it is proved for every number; elsewhere it is said of the numbers that were looked at.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.footprint import footprint
from koord.syntax.analysis.limits import excesses
from koord.syntax.analysis.premises import without
from koord.syntax.core import Home, PropertyKind, Start
from koord.syntax.system import System
from koord.syntax.types import BOOL
from koord.syntax.walk import reached, statements, written
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Effort
from koord.verify.engines.every_n.candidates import FEW, candidates
from koord.verify.engines.every_n.proving import infer, prove
from koord.verify.engines.every_n.questions import SPARING
from koord.verify.ledger import Ledger
from koord.verify.reachability_goals import Aim, ReachabilityGoal, idle, reachability_goals_of
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
    """Yield a vacuity for each unreachable goal, among those not reached at ends of rounds."""
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


#: So many times as many robots of each kind are looked at as well.
_TIMES = 3


def examples(system: System) -> list[System]:
    """The systems to check: the given one, and one with more robots if that is not too large."""
    more = replace(system, kinds=system.kinds * _TIMES)
    return [system] if excesses(more.program, more.kinds) else [system, more]


#: So many robots of each kind show what is possible with some number of them.
_FEW_ROBOTS = 3


def few_of(system: System) -> System | None:
    """The system with few robots of each kind; None if it has no more than those."""
    seen: dict[int, int] = {}
    kinds = []
    for kind in system.kinds:
        seen[kind] = seen.get(kind, 0) + 1
        if seen[kind] <= _FEW_ROBOTS:
            kinds.append(kind)
    return replace(system, kinds=tuple(kinds)) if len(kinds) < system.robots else None


def surely_unmet(
    ledger: Ledger, system: System, goals: Collection[ReachabilityGoal]
) -> frozenset[Claim]:
    """The denials of goals that no round reaches, not even in between, for any number of robots.

    ``system`` is that of the ledger, but for what the goals are stated with. Contracts are left
    out: their turns are looked at with the robots that are asked about.
    """
    inside = {inside_rounds(g.never): g.never for g in goals if g.aim is not Aim.CONTRACT}
    sure = proved(ledger, system, list(inside)) if inside else set[Claim]()
    return frozenset(inside[claim] for claim in sure)


def with_robots_of(system: System, ledger: Ledger) -> Ledger:
    """The ledger, with the robots of another system."""
    problem = ledger.problem
    original = replace(problem.original, kinds=system.kinds) if problem.is_abstract else system
    return replace(ledger, problem=replace(problem, system=system, original=original))


def fleets(system: System) -> str:
    """Name the robots of the examples, in words."""
    return " or ".join(example.fleet for example in examples(system))


def proved(ledger: Ledger, system: System, claims: Collection[Claim]) -> set[Claim]:
    """The claims that hold for every number of robots, as far as a short attempt can tell.

    ``system`` is that of the ledger, but for what the claims are stated with.
    """
    means = ledger.deadline, Effort.of_seconds(SPARING.seconds), SPARING, ledger.seed
    known = ledger.proved()
    found = set(prove(system, [*known, *claims], *means).proved)
    left = [claim for claim in claims if claim not in found]
    likely = candidates(system.program) if left else []
    if 0 < len(likely) <= FEW:
        pool = [claim for claim in (*known, *found, *likely) if claim.is_state_property]
        found |= set(infer(system, left, pool, *means).proved)
    return found.intersection(claims)


def never_starts(ledger: Ledger) -> bool:
    """Return whether there is no initial configuration, for any number of robots."""
    stated = core.Property("never starts", PropertyKind.AT_ROUND, core.Const(False, BOOL), 0)
    claim = Claim(stated.name, ClaimKind.PROPERTY, stated)
    return claim in proved(ledger, ledger.system, [claim])


def never_ends(ledger: Ledger) -> bool:
    """Return whether no round can end, from any configuration, for any number of robots."""
    contract = core.Contract("never ends", (), (core.Const(False, BOOL),))
    claim = Claim(contract.name, ClaimKind.CONTRACT, None, contract.name)
    agents = tuple(
        replace(agent, modules=(*agent.modules, idle([contract])))
        for agent in ledger.system.program.agents
    )
    program = replace(ledger.system.program, agents=agents)
    return claim in proved(ledger, replace(ledger.system, program=program), [claim])


def unmet_by_any(ledger: Ledger, unbroken_: Collection[Claim], effort: Effort) -> Iterator[Vacuity]:
    """The goals, unreached with a few robots, that more robots do not reach either."""
    wished = reachability_goals_of(ledger.system)
    goals = {goal.never: goal for goal in wished.all if goal.never in unbroken_}
    rounds, deadline, seed = ledger.bounds.rounds, ledger.deadline, ledger.seed
    for system in examples(wished.system):
        left = unbroken(system, list(goals), rounds, deadline, effort, seed=seed)
        observed = [n for n, goal in goals.items() if goal.observed and n in left.claims]
        met, _ = broken_between(system, observed, rounds, deadline, effort, seed=seed, ending=True)
        goals = {n: goal for n, goal in goals.items() if n in left.claims and n not in met}
    asked = {n: inside_rounds(n) if goal.observed else n for n, goal in goals.items()}
    still = [inside_rounds(goal.still) for goal in goals.values() if goal.still is not None]
    sure = proved(ledger, wished.system, [*asked.values(), *still])
    for never, goal in goals.items():
        found = told(goal, rounds, certain=asked[never] in sure, blocked=False)
        yield found if found.certain else among(ledger, found)


def among(ledger: Ledger, vacuity: Vacuity) -> Vacuity:
    """The goals that no run with the checked numbers of robots reaches."""
    detail = f"{vacuity.detail}, with {fleets(ledger.system)}"
    return replace(vacuity, detail=detail, certain=False)


def true_of_anything(ledger: Ledger, claims: Collection[Claim]) -> list[Claim]:
    """The statements that hold for all values of variables, for every number of robots."""
    program = ledger.system.program
    asked = [claim for claim in claims if not _reads_history(program, claim)]
    system = replace(ledger.system, program=_of_anything(program))
    effort = Effort.of_seconds(SPARING.seconds)
    return list(prove(system, asked, ledger.deadline, effort, SPARING, ledger.seed).proved)


def _reads_history(program: core.Program, claim: Claim) -> bool:
    below = reached(program, claim.stated.condition if claim.stated is not None else ())
    return any(isinstance(node, core.Ran | core.Stopped) for node in below)


def _of_anything(program: core.Program) -> core.Program:
    """A program that starts with any values of written variables, and does nothing."""
    changed = set(footprint(program))
    for kind, agent in enumerate(program.agents):
        for statement in statements(agent.init):
            for place in written(statement):
                home, slot = place.variable.home, place.variable.slot
                changed.add((home, kind if home in (Home.LOCAL, Home.PORT) else 0, slot))

    def free(kind: int, declared: tuple[core.Declaration, ...]) -> tuple[core.Declaration, ...]:
        return tuple(
            replace(entry, initial=Start.ARBITRARY)
            if (entry.variable.home, kind, entry.variable.slot) in changed
            else entry
            for entry in declared
        )

    def idling(kind: int, agent: core.Agent) -> core.Agent:
        declared = free(kind, tuple(port.declaration for port in agent.ports))
        pairs = zip(agent.ports, declared, strict=True)
        ports = tuple(replace(port, declaration=declaration) for port, declaration in pairs)
        locals_ = free(kind, agent.locals)
        return replace(agent, locals=locals_, ports=ports, modules=(), init=(), events=())

    return replace(
        program,
        agents=tuple(idling(kind, agent) for kind, agent in enumerate(program.agents)),
        allread=free(0, program.allread),
        allwrite=free(0, program.allwrite),
        assumptions=(),
    )
