"""Vacuity analysis of a verification: no run starts, or events and premises never happen."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.footprint import footprint
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.walk import reached
from koord.verify.claims import NO_FAULT, Claim, ClaimPhase, StepFindings, liveness_of
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engine_names import Engine
from koord.verify.engines.induction.proving import representatives
from koord.verify.ledger import Ledger
from koord.verify.reachability_goals import (
    Aim,
    ReachabilityGoal,
    ReachabilityGoals,
    reachability_goals_of,
    supposes,
)
from koord.verify.vacuity import unreachable
from koord.verify.vacuity.contradictions import dead_end, unanswerable
from koord.verify.vacuity.reachability import Unbroken, unbroken
from koord.verify.vacuity.reaching_runs import MOST_RUNS, ReachingRuns
from koord.verify.vacuity.starts import many_never_start, never_starts
from koord.verify.vacuity.unreachable import unmet
from koord.verify.verdicts import (
    NOTHING_KNOWN,
    Emptiness,
    Outcome,
    ReachingRun,
    Substance,
    UnsearchedGoal,
    Vacuity,
    Verdict,
)

#: For how long it is looked at all whether verdicts say something: so many seconds of work, or so
#: many times as long as the verdicts took.
WORTH_S, WORTH = 8.0, 0.5

#: The same where all verdicts are proofs for every number of robots: no more than so many times as
#: long as these took, so that the search costs less than what it is about; but so many seconds of
#: work, in which small programs are looked at to the end.
SHARE, SHARE_S = 0.5, 2.0

#: What the search for what can happen may cost.
WISHES_S = 10.0

#: How long runs at random are that show what happens later, in turns of robots; and what they may
#: cost, where turns take long.
TURNS = 600
RUNS_S = 3.0

#: So many rounds few robots run at least, where it is all the same when something happens: what
#: counts up to a round number ends behind it.
_ROUNDS_OF_FEW = 300

#: What it may cost to see that invariants hold of anything whatever, all of them and each.
REGARDLESS_S = 2.0
_AT_MOST = Effort.of_seconds(0.1).left


class GoalSearch(Struct, frozen=True):
    """The vacuity results that do not depend on verdicts.

    ``never`` are the goals that no run reaches; None if no run can start, as ``empty`` says.
    ``effort`` is what is left of it, and ``spent_s`` the work that was done. ``sure`` are goals
    that are proved unreachable for every number of robots. ``of_few``: few of them
    were looked at, as verdicts are for every number of them. ``runs`` are some that reach goals.
    """

    empty: tuple[Vacuity, ...]
    never: Unbroken | None
    effort: Effort
    spent_s: float = 0.0
    sure: frozenset[Claim] = frozenset()
    of_few: bool = False
    runs: tuple[ReachingRun, ...] = ()


class FoundVacuities(Struct, frozen=True):
    """The vacuities of verdicts, and the goals whose search was given up."""

    vacuities: tuple[Vacuity, ...] = ()
    unlooked: tuple[UnsearchedGoal, ...] = ()


def look(
    ledger: Ledger,
    *,
    every_n: bool = False,
    before: Sequence[ReachingRun] = (),
    keeps_runs: bool = False,
    known: Substance = NOTHING_KNOWN,
) -> GoalSearch:
    """Search for vacuities that depend on no verdict, so that it can run in parallel.

    ``every_n``: all verdicts are proofs for every number of robots, so that it is looked at few of
    them first. ``before`` are runs that reached goals once, which are replayed, and what is
    ``known`` is not looked at; ``keeps_runs``: further ones are told. [PROP-VACUOUS]
    """
    runs = ReachingRuns(before, MOST_RUNS if keeps_runs else 0)
    started = time.process_time()
    effort = Effort.of_seconds(WISHES_S)
    wished = _asked(reachability_goals_of(ledger.system), known)
    if known.happens and not wished.all:
        return GoalSearch((), Unbroken(frozenset()), effort)
    tell(ledger, wished.all)
    own = _limited(ledger, _worth(ledger, every_n=every_n))
    few = unreachable.few_of(ledger.system) if every_n else None
    try:
        own_goals = _asked(reachability_goals_of(own.system), known)
        if few is None:
            looked = _look(own, own_goals, effort, runs, known, ever=every_n)
        else:
            looked = _look_at_few(own, few, own_goals, effort, runs, known)
    except OutOfBudgetError:
        nevers = frozenset(goal.never for goal in wished.all)
        looked = GoalSearch((), Unbroken(nevers, known=False), effort)
    spent_s = time.process_time() - started
    return replace(looked, spent_s=spent_s, runs=tuple(runs.useful))


def is_every_n(
    system: System, ledger: Ledger, names: Collection[str], runs: Collection[Verdict] = ()
) -> bool:
    """Return whether all verdicts that are asked for are proofs for every number of robots.

    ``runs`` are those about whole runs, as far as they are known.
    """
    asked = [ledger.verdict(claim) for claim in ledger.claims if not names or claim.name in names]
    of_runs = {claim.name for claim in liveness_of(system) if not names or claim.name in names}
    told = [verdict for verdict in runs if verdict.claim.name in of_runs]
    if not asked + told or len(told) < len(of_runs):
        return False
    return all(v.outcome is Outcome.HOLDS and v.engine is Engine.EVERY_N for v in asked + told)


def _look_at_few(
    ledger: Ledger,
    few: System,
    wished: ReachabilityGoals,
    effort: Effort,
    runs: ReachingRuns,
    known: Substance,
) -> GoalSearch:
    """Search with few robots; what these do not reach is proved, or looked for with all of them."""
    some = unreachable.with_robots_of(few, ledger)
    goals = _asked(reachability_goals_of(some.system), known)
    looked = _look(some, goals, effort, runs, known, ever=True)
    if looked.never is None or looked.never.stuck is not None:
        # More robots may start, or go on, where few do not.
        return _look(ledger, wished, effort, runs, known)
    with suppress(OutOfBudgetError):  # where few start, many most often do
        start = None
        if not known.happens:
            start = many_never_start(ledger.system, ledger.seed, ledger.deadline, effort)
        if start is not None:
            return GoalSearch((start,), None, effort)
    # Where all holds in every round it is all the same when something happens.
    unmet_by_few = looked.never.claims - looked.never.later
    left = tuple(goal for goal in wished.all if goal.never in unmet_by_few)
    if not left:
        return replace(looked, of_few=True)
    sure = unreachable.surely_unmet(ledger, wished.system, left)
    left = tuple(goal for goal in left if goal.never not in sure)
    found = Unbroken(frozenset(), limits=looked.never.limits)
    if left:
        try:
            searched = _look(ledger, replace(wished, all=left), effort, runs, known)
        except OutOfBudgetError:
            found = Unbroken(frozenset(goal.never for goal in left), known=False)
        else:
            if searched.never is None:
                return searched
            looked, found = searched, searched.never
    never = replace(found, claims=found.claims | sure)
    return replace(looked, never=never, sure=sure, of_few=True)


def _asked(wished: ReachabilityGoals, known: Substance) -> ReachabilityGoals:
    """The goals that are not known to be reached."""

    def is_known(goal: ReachabilityGoal) -> bool:
        return goal.subject in known.claims if goal.aim is Aim.SUPPOSITION else known.happens

    return replace(wished, all=tuple(goal for goal in wished.all if not is_known(goal)))


def _worth(ledger: Ledger, *, every_n: bool = False) -> float:
    """The seconds of work that the vacuity analysis may take."""
    took = max((ledger.verdict(c).seconds for c in ledger.claims), default=0.0)
    return max(SHARE_S, SHARE * took) if every_n else max(WORTH_S, WORTH * took)


def _limited(ledger: Ledger, seconds: float) -> Ledger:
    """The ledger limited to so many seconds of work, evaluation included."""
    deadline, whole = ledger.deadline.of_work(seconds), ledger.system.budget
    budget = Budget(lambda: deadline.passed() or whole.is_over())
    problem = replace(
        ledger.problem,
        system=replace(ledger.system, budget=budget),
        original=replace(ledger.problem.original, budget=budget),
    )
    if not ledger.problem.is_abstract:
        problem = replace(problem, original=problem.system)
    return replace(ledger, problem=problem, deadline=deadline)


def tell(ledger: Ledger, goals: Sequence[ReachabilityGoal]) -> None:
    """Report the present search."""
    asked = list(dict.fromkeys(_aim(goal).of(goal.subject) for goal in goals))
    more = f" and {len(asked) - 2} more" if len(asked) > 2 else ""
    ledger.say(f"looking for what never happens: {', '.join(asked[:2])}{more}")


def _aim(goal: ReachabilityGoal) -> Emptiness:
    return Emptiness.EVENT if goal.aim is Aim.EVENT else Emptiness.SUPPOSITION


def unlooked(system: System, nevers: Collection[Claim] | None = None) -> tuple[UnsearchedGoal, ...]:
    """The goals whose reachability is unknown, all of them or by their denials."""
    goals = (w for w in reachability_goals_of(system).all if nevers is None or w.never in nevers)
    return tuple(dict.fromkeys(UnsearchedGoal(_aim(goal), goal.subject) for goal in goals))


def _look(
    ledger: Ledger,
    wished: ReachabilityGoals,
    effort: Effort,
    reaching: ReachingRuns,
    known: Substance,
    *,
    ever: bool = False,
) -> GoalSearch:
    """Search with the robots of a ledger; ``ever``: these are few, and all rounds count alike."""
    system, deadline, seed = ledger.system, ledger.deadline, ledger.seed
    nevers, rounds = [goal.never for goal in wished.all], ledger.bounds.rounds
    shown = reaching.replayed(wished.system, nevers, rounds)
    happens = known.happens
    start = None if happens or shown.starts else never_starts(system, seed, deadline, effort)
    if start is not None:
        return GoalSearch((start,), None, effort)
    silent = () if happens else tuple(_silent(ledger, deadline, effort))
    nevers = [never for never in nevers if never not in shown.claims]
    # Making up positions and paths that meet assumptions can cost more than it spares.
    longest = max(TURNS // system.robots, _ROUNDS_OF_FEW if ever else 0)
    runs = 0 if ledger.problem.is_abstract else max(rounds, longest)
    never = Unbroken(frozenset())
    if nevers or not (happens or shown.goes_on):
        never = unbroken(
            wished.system,
            nevers,
            rounds,
            deadline,
            effort,
            seed=seed,
            runs=runs,
            runs_s=RUNS_S,
            reaching=reaching,
            ever=ever,
        )
    ended = None
    if never.stuck is None and not happens:
        ended = dead_end(ledger.problem.original, deadline, seed)
    return GoalSearch(silent if ended is None else (*silent, ended), never, effort)


def of_any_number(ledger: Ledger, *, of_all_rounds: bool) -> FoundVacuities:
    """The vacuities of verdicts for every number of robots."""
    for system in unreachable.examples(ledger.system):
        some = unreachable.with_robots_of(system, ledger)
        looked = look(some)
        if looked.never is not None:
            return vacuities(some, looked, of_all_rounds=of_all_rounds, of_any_number=True)
    if unreachable.never_starts(ledger):
        return FoundVacuities(looked.empty)
    return FoundVacuities(tuple(unreachable.among(ledger, empty) for empty in looked.empty))


def vacuities(
    ledger: Ledger,
    looked: GoalSearch,
    *,
    of_all_rounds: bool,
    of_any_number: bool = False,
    known: Substance = NOTHING_KNOWN,
) -> FoundVacuities:
    """The vacuities of a ledger's verdicts, but for what is ``known`` to have none.

    Verdicts ``of_all_rounds`` say something if things happen late, too; those ``of_any_number`` of
    robots if more can do them.
    """
    if looked.never is None:
        return FoundVacuities(looked.empty)
    later = looked.never.later if of_all_rounds else frozenset()
    left = replace(looked.never, claims=looked.never.claims - later)
    tell(
        ledger,
        [goal for goal in reachability_goals_of(ledger.system).all if goal.never in left.claims],
    )
    few = unreachable.few_of(ledger.system) if looked.of_few else None
    own = _limited(ledger, max(0.0, _worth(ledger, every_n=few is not None) - looked.spent_s))
    missing: list[Vacuity] = [
        unreachable.told(goal, ledger.bounds.rounds, certain=True, blocked=False)
        for goal in reachability_goals_of(ledger.system).all
        if goal.never in looked.sure
    ]
    left = replace(left, claims=left.claims - looked.sure)
    given_up: tuple[UnsearchedGoal, ...] = ()
    try:
        missing += _missing(own, left, looked.effort, of_any_number)
    except OutOfBudgetError:
        given_up = unlooked(ledger.system, left.claims)
    if not left.known:
        given_up = unlooked(ledger.system, left.claims)
    about = ledger if few is None else unreachable.with_robots_of(few, ledger)
    own = _limited(about, REGARDLESS_S)
    untouched: list[Vacuity] = []
    unbreakable: list[Vacuity] = []
    try:
        untouched += _untouched(own, known)
        every = of_any_number or few is not None
        unbreakable += _unbreakable(own, [*untouched, *missing], every, known)
    except OutOfBudgetError:
        pass  # it is seldom so, and each verdict says how far it holds in any case
    return FoundVacuities((*looked.empty, *missing, *untouched, *unbreakable), given_up)


def _unbreakable(
    ledger: Ledger, found: Sequence[Vacuity], of_any_number: bool, known: Substance
) -> Iterator[Vacuity]:
    """Invariants that hold in any configuration, except those already reported."""
    sure = [vacuity for vacuity in found if vacuity.certain]
    told = {vacuity.subject for vacuity in sure if vacuity.what is not Emptiness.EVENT}
    told |= known.claims
    regardless = list(_regardless(ledger, told))
    if of_any_number:
        regardless = unreachable.true_of_anything(ledger, regardless)
    detail = "it is true whatever the events do"
    for claim in regardless:
        if claim.stated is not None:
            span = claim.stated.span
            yield Vacuity(Emptiness.UNTOUCHED, claim.name, detail, certain=True, span=span)


def _silent(ledger: Ledger, deadline: Deadline, effort: Effort) -> Iterator[Vacuity]:
    """External functions whose summaries are contradictory."""
    original = ledger.problem.original
    for external, detail in unanswerable(original, ledger.seed, deadline, effort):
        yield Vacuity(Emptiness.SUMMARIES, "", detail, certain=True, span=external.span)


def _missing(
    ledger: Ledger, left: Unbroken, effort: Effort, of_any_number: bool
) -> Iterator[Vacuity]:
    """Events that never run, and suppositions that are never true."""
    if left.stuck is not None:
        detail = f"no run gets through round {left.stuck}"
        found = _within(Vacuity(Emptiness.CONTRACTS, "", detail, certain=True), left.limits)
        everyone = not of_any_number or unreachable.never_ends(ledger)
        yield found if everyone else unreachable.among(ledger, found)
        return
    if not left.known or not left.claims:
        return
    verdict = ledger.verdicts.get(NO_FAULT)
    faults = verdict is not None and verdict.outcome is Outcome.VIOLATED
    search = unreachable.unmet_by_any if of_any_number else unmet
    for told in search(ledger, left.claims, effort):
        # An event that faults ends the run, and so was not seen to run.
        full = replace(told, detail=f"{told.detail} without a fault") if faults else told
        yield full if told.certain else _within(full, left.limits)


def _within(vacuity: Vacuity, limits: Sequence[str]) -> Vacuity:
    """The vacuities of the runs that were checked."""
    if not limits:
        return vacuity
    detail = f"{vacuity.detail}; not covered: {'; '.join(limits)}"
    return replace(vacuity, detail=detail, certain=False)


def _held(ledger: Ledger) -> Iterator[tuple[Claim, core.Property]]:
    """The properties that hold as far as is known, perhaps for some rounds only."""
    for claim in ledger.claims:
        verdict = ledger.verdict(claim)
        is_seen = verdict.outcome is Outcome.HOLDS or verdict.rounds is not None
        if claim.stated is not None and is_seen and verdict.outcome is not Outcome.VIOLATED:
            yield claim, claim.stated


def _untouched(ledger: Ledger, known: Substance) -> Iterator[Vacuity]:
    """Invariants that hold because no event changes what they read."""
    for _, stated in _held(ledger):
        if stated.name in known.claims:
            continue
        if never_changes(ledger.system.program, stated.condition):
            detail = "nothing that it reads changes after the start"
            yield Vacuity(Emptiness.UNTOUCHED, stated.name, detail, True, stated.span)


def never_changes(program: core.Program, condition: core.Expr) -> bool:
    """Return whether a statement reads nothing that changes after INIT."""
    written = {(home, slot) for home, _, slot in footprint(program)}
    below = list(reached(program, condition))
    if any(isinstance(n, core.Ran | core.Stopped) for n in below):
        return False
    return not any(
        (n.home, n.slot) in written
        for n in below
        if isinstance(n, core.Variable) and n.home is not Home.BOUND
    )


def _regardless(ledger: Ledger, told: Collection[str]) -> Iterator[Claim]:
    """Invariants that are valid in any configuration, except those reported already.

    What nothing writes is as it was at the start; all else has any value of its type. Statements
    that suppose something may be about mathematics: what they suppose is asked by itself.
    """
    program = ledger.system.program
    claims = [
        claim
        for claim, stated in _held(ledger)
        if claim.name not in told and not supposes(program, stated.condition)
    ]
    if not claims:
        return
    unrolling = Unrolling(ledger.system, ledger.seed)
    d, solver, represented = unrolling.encoder.d, unrolling.solver, representatives(ledger.system)
    start = unrolling.encoder.arbitrary(unrolling.opening.moment.configuration, "#")
    checks = SymbolicInputs(unrolling.unknowns, "start")
    moment = SymbolicConfiguration(ClaimPhase.INIT, start, [], StepFindings(False), checks)
    effort = Effort.of_seconds(REGARDLESS_S)
    for claim in claims:
        asked = violations(ledger.system, d, moment, [represented(claim)])
        question = [term for violated, needed in asked.values() for term in (*needed, violated)]
        answer = SolverAnswer.UNSAT  # what is seen to hold without a solver is not asked at all
        if asked:
            answer = solver.check(question, ledger.deadline, effort, at_most=_AT_MOST)
        if answer is SolverAnswer.UNSAT and not unrolling.unknowns.limits:
            yield claim
