"""Reachability: random runs, then the solver, then proofs of unreachability."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from random import Random

from msgspec import Struct
from msgspec.structs import replace

from koord.sampling.compiled.turns import Turns
from koord.sampling.made_rounds import MadeRound
from koord.sampling.monitors import Monitor, Search
from koord.sampling.policies import AtRandom, First, Play, Policy
from koord.sampling.running import Run, new_run
from koord.semantics.domain import disjunction
from koord.semantics.recordings import Recording, Step
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Numbers
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engines.explicit.limits import FEW_STATES, Limits
from koord.verify.engines.induction.proving import prove
from koord.verify.ledger import Ledger
from koord.verify.vacuity.reaching_runs import ReachingRuns
from koord.verify.verdicts import Counterexample, NotReplayedError, Outcome

#: How often robots skip though they need not, in runs by chance. (Besides them there is the run
#: that the runtime would make.) Deadlines are met only where robots seldom act of themselves.
SKIPS_PERCENT = (15, 15, 95)

#: So many states are all looked at sooner than runs are made by chance.
SMALL = 300

#: For how long a few runs are made before anything is asked, in seconds of work: where turns take
#: long, a solver is quicker.
_AT_FIRST_S = 0.1


#: So many times as many robots as move there are where it is sooner asked what few of them can do.
_FEWER = 2


#: Runs of so many rounds are worth code for whole rounds, which takes some milliseconds to make.
_LONG = 60


class _Onlooker(Monitor):
    """A monitor that ignores violations, so that runs go on."""

    def after(self, step: Step) -> None:
        return None


def runs_of(system: System, rounds: int, seed: int) -> Iterator[tuple[Run, Play]]:
    """Yield a few runs that ignore violations: one as the runtime's, and random ones."""
    turns = Turns(Numbers.EXACT.domain, system)
    for number, skips in enumerate((None, *SKIPS_PERCENT)):
        rng = Random(seed + number)
        policy: Policy = First() if skips is None else AtRandom(rng, skips)
        run = new_run(system, Numbers.EXACT, rng, turns)
        onlooker = _Onlooker if rounds < _LONG else Search
        yield run, Play(run, policy, rounds, onlooker(run.d, system, run.inputs))


def seen(
    system: System,
    nevers: Iterable[Claim],
    rounds: int,
    deadline: Deadline,
    seed: int,
    reaching: ReachingRuns | None = None,
) -> dict[Claim, int]:
    """The claims that a few runs of so many rounds break, each with the round.

    No solver need be asked about them. Where the inputs of a run cannot be made up, or a run
    faults, it ends there. Each run that breaks some is kept, up to where it has, as ``reaching``.
    """
    pending = set(nevers)
    broken: dict[Claim, int] = {}
    for _, play in runs_of(system, rounds, seed):
        reached: Recording | None = None
        try:
            _seek(play, pending)
            for part in play.parts():
                if isinstance(part, MadeRound):  # nothing that is sought was met in it
                    if deadline.passed():
                        return broken
                    continue
                step, configuration = part.step, part.step.configuration
                if not step.is_at_round or configuration.fault is not None:
                    continue
                unkept = {contract.name for _, contract in step.stepped.promises}
                hit = {c for c in pending if c.subject in unkept}
                hit |= {
                    c for c in pending if c.stated and not play.watch.holds(c.stated, configuration)
                }
                broken |= dict.fromkeys(hit, configuration.round)
                pending -= hit
                if hit:
                    _seek(play, pending)
                if hit and reaching is not None:
                    reached = play.run.recording(checks=True)
                if not pending or deadline.passed():
                    return broken
        except KoordError:
            continue
        finally:
            if reached is not None and reaching is not None:
                reaching.add(system, reached)
    return broken


def _seek(play: Play, claims: Iterable[Claim]) -> None:
    """Let a run by whole rounds stop where one of these may be broken."""
    if isinstance(play.watch, Search):
        stated = {claim.stated.name: claim.stated for claim in claims if claim.stated}
        play.watch.sought = tuple(stated[name] for name in sorted(stated))


class Unbroken(Struct, frozen=True):
    """Claims that no run breaks within some rounds; ``stuck``: a round that no run completes.

    ``known`` is False if the solver did not get so far. ``limits`` are runs that were left out.
    ``later`` are those of the claims that are known to be broken in rounds after those.
    """

    claims: frozenset[Claim]
    stuck: int | None = None
    known: bool = True
    limits: tuple[str, ...] = ()
    later: frozenset[Claim] = frozenset()


def unbroken(
    system: System,
    nevers: Collection[Claim],
    rounds: int,
    deadline: Deadline,
    effort: Effort,
    *,
    seed: int = 0,
    runs: int = 0,
    runs_s: float = 0,
    reaching: ReachingRuns | None = None,
    ever: bool = False,
) -> Unbroken:
    """The claims that hold in all runs of so many rounds, asked round by round.

    One round is looked at even if there is nothing to ask, to see whether it can end. With ``runs``
    a few runs at random are made first, for at most ``runs_s`` seconds of work: they break most
    claims. Longer ones, of so many rounds, show which of the others are broken later; and break
    some where the solver takes long. Runs that break some are kept as ``reaching``. Where
    claims that are broken later are of no interest (``ever``), the longer runs are made before a
    solver is asked.
    """
    hasty = effort if runs == 0 else Effort(effort.left // 8)
    pending = list(nevers)
    if runs > 0 and pending:
        soon = deadline.of_work(_AT_FIRST_S)
        met = seen(system, pending, min(rounds, runs), soon, seed, reaching)
        pending = [claim for claim in pending if claim not in met]
        if not pending and any(round_ > 0 for round_ in met.values()):
            return Unbroken(frozenset())
    later = frozenset[Claim]()
    if ever and runs > 0 and pending:
        lasting = _held_by_few_states(system, pending, SMALL, deadline)
        asked = [claim for claim in pending if claim not in lasting]
        met = seen(system, asked, runs, deadline.of_work(runs_s), seed)
        later = frozenset(claim for claim, round_ in met.items() if round_ > rounds)
        pending = [claim for claim in pending if claim not in met]
        if not pending and any(round_ > 0 for round_ in met.values()):
            return Unbroken(later, later=later)
    few = _of_few(system, pending, rounds, deadline, hasty, seed, reaching)
    if few.known and not few.claims and few.stuck is None:
        return _and_later(few, later)
    pending = [claim for claim in pending if claim in few.claims]
    if runs == 0:
        return _unbroken(system, seed, pending, rounds, deadline, effort, reaching=reaching)
    if not ever:
        met = seen(system, pending, min(rounds, runs), deadline.of_work(runs_s), seed, reaching)
        pending = [claim for claim in pending if claim not in met]
        if not pending and any(round_ > 0 for round_ in met.values()):
            return Unbroken(frozenset())
    left = _unbroken(system, seed, pending, rounds, deadline, hasty, reaching=reaching)
    if deadline.passed() or not left.claims:
        return _and_later(left, later)
    met = {}
    if not ever:
        lasting = set[Claim]()
        if left.known:
            unmet = [claim for claim in pending if claim in left.claims]
            lasting = _held_by_few_states(system, unmet, SMALL, deadline)
        met = seen(system, left.claims - lasting, runs, deadline.of_work(runs_s), seed)
    if not left.known:
        pending = [claim for claim in pending if claim in left.claims and claim not in met]
        few = _of_few(system, pending, rounds, deadline, effort, seed, reaching)
        pending = [claim for claim in pending if claim in few.claims]
        if few.known and few.claims:
            # What two of a kind cannot do all together seldom can, and that takes long to tell.
            effort = Effort(effort.left // 4)
        left = _unbroken(system, seed, pending, rounds, deadline, effort, reaching=reaching)
    return _and_later(left, later | (left.claims & met.keys()))


def _and_later(left: Unbroken, later: frozenset[Claim]) -> Unbroken:
    """What is left, with claims that are known to be broken later."""
    return replace(left, claims=left.claims | later, later=later)


def _of_few(
    system: System,
    nevers: Collection[Claim],
    rounds: int,
    deadline: Deadline,
    effort: Effort,
    seed: int,
    reaching: ReachingRuns | None,
) -> Unbroken:
    """Check runs in which most robots only skip, with half the effort.

    Where robots are few there are no such runs, and nothing is known. To ask about two of three
    takes nearly as long as to ask about all, and what these can do has to be asked again.
    """
    movers = _some_of_each_kind(system)
    if system.robots < _FEWER * len(movers):
        return Unbroken(frozenset(nevers), known=False)
    half = Effort(effort.left // 2)
    effort.left -= half.left
    asked = list(nevers)
    left = _unbroken(system, seed, asked, rounds, deadline, half, movers=movers, reaching=reaching)
    effort.left += half.left
    return left


def _some_of_each_kind(system: System) -> frozenset[int]:
    """Two robots of each kind, or one where it is alone."""
    found: list[int] = []
    for kind in set(system.kinds):
        found += [robot for robot, other in enumerate(system.kinds) if other == kind][:2]
    return frozenset(found)


def _unbroken(
    system: System,
    seed: int,
    claims: Sequence[Claim],
    rounds: int,
    deadline: Deadline,
    effort: Effort,
    *,
    movers: frozenset[int] | None = None,
    ending: bool = False,
    reaching: ReachingRuns | None = None,
) -> Unbroken:
    """Check rounds; with ``ending`` a violation counts only if its round can end."""
    pending = list(claims)
    with suppress(OutOfBudgetError):
        unrolling = Unrolling(system, seed, movers)
        return _round_by_round(
            unrolling, pending, rounds, deadline, effort, ending=ending, reaching=reaching
        )
    return Unbroken(frozenset(pending), known=False)


def _round_by_round(
    unrolling: Unrolling,
    pending: list[Claim],
    rounds: int,
    deadline: Deadline,
    effort: Effort,
    *,
    ending: bool,
    reaching: ReachingRuns | None,
) -> Unbroken:
    """Check round by round; broken claims are removed as they are found."""
    for moment in unrolling.moments():
        after = []
        if ending and moment.phase is ClaimPhase.MIDDLE:
            after = unrolling.rounds[-1].end.constraints
        answer = _strike(unrolling, moment, pending, deadline, effort, after, reaching)
        if (
            answer is not SolverAnswer.UNKNOWN
            and moment.phase is ClaimPhase.END
            and (unrolling.movers is None or not pending)
        ):
            # Nothing is broken any more if no run comes here. (Of some runs it is no news.)
            answer = unrolling.solver.check([], deadline, effort)
            if answer is SolverAnswer.UNSAT:
                if unrolling.movers is not None:
                    break  # others may get further
                stuck = _stuck(unrolling, moment.configuration.round, deadline)
                return Unbroken(
                    frozenset(pending), stuck, limits=tuple(unrolling.unknowns.uncovered)
                )
        if answer is SolverAnswer.UNKNOWN:
            return Unbroken(frozenset(pending), known=False)
        if moment.phase is ClaimPhase.END and (not pending or moment.configuration.round >= rounds):
            return Unbroken(frozenset(pending), limits=tuple(unrolling.unknowns.uncovered))
    return Unbroken(frozenset(pending), known=False)


def _strike(
    unrolling: Unrolling,
    moment: SymbolicConfiguration,
    pending: list[Claim],
    deadline: Deadline,
    effort: Effort,
    after: Sequence[Term] = (),
    reaching: ReachingRuns | None = None,
) -> SolverAnswer:
    """Remove the claims that a configuration can break. SAT: all claims are removed.

    It counts only if what has to hold ``after`` it can hold.
    """
    d, solver = unrolling.encoder.d, unrolling.solver
    asked = violations(unrolling.system, d, moment, pending)
    for _, needed in asked.values():
        solver.add(needed)
    while asked:
        question = disjunction(d, [violated for violated, _ in asked.values()])
        answer = solver.check([*after, question], deadline, effort)
        if answer is not SolverAnswer.SAT:
            return answer
        model = solver.model()
        if reaching is not None:
            reaching.note(unrolling, model, moment.phase)
        for claim in [c for c, (violated, _) in asked.items() if model.truth(violated)]:
            del asked[claim]
            pending.remove(claim)
    return SolverAnswer.SAT


def _stuck(unrolling: Unrolling, round_: int, deadline: Deadline) -> int | None:
    """The first round whose environment's turn no run can take; None if these turns fault."""
    alone = Unrolling(unrolling.system, unrolling.seed)
    for moment in alone.moments():
        if alone.solver.check([], deadline) is not SolverAnswer.SAT:
            return moment.configuration.round if moment.phase is ClaimPhase.END else None
        if moment.configuration.round >= round_:
            break
    return None


def inside_rounds(never: Claim) -> Claim:
    """The claim about every observed configuration, not about the ends of rounds only."""
    assert never.stated is not None
    return replace(never, stated=replace(never.stated, kind=PropertyKind.INVARIANT))


def broken_between(
    system: System,
    nevers: Collection[Claim],
    rounds: int,
    deadline: Deadline,
    effort: Effort,
    *,
    seed: int,
    ending: bool,
) -> tuple[set[Claim], bool]:
    """The claims about ends of rounds that break in between; and whether all were found.

    With ``ending`` they break only in rounds that can end.
    """
    asked = {inside_rounds(never): never for never in nevers}
    if not asked:
        return set(), True
    left = _unbroken(system, seed, list(asked), rounds, deadline, effort, ending=ending)
    return {never for claim, never in asked.items() if claim not in left.claims}, left.known


def never_broken(
    ledger: Ledger, system: System, nevers: Iterable[Claim], deadline: Deadline, effort: Effort
) -> set[Claim]:
    """The claims that hold in all rounds, as far as a short attempt can tell.

    They must be known to hold through the first round. ``system`` is that of the ledger, but for
    what the claims are stated with.
    """
    pending = list(nevers)
    found: set[Claim] = set()
    for depth in (1, 2):
        if pending:
            result = prove(
                system,
                pending,
                ledger.proved(),
                deadline,
                effort,
                depth=depth,
                seed=ledger.seed,
            )
            found |= set(result.proved)
            pending = [claim for claim in pending if claim not in found]
    if pending and not ledger.problem.is_abstract:
        found |= _held_by_few_states(system, pending, FEW_STATES, deadline)
    return found


def _held_by_few_states(
    system: System, claims: Sequence[Claim], most: int, deadline: Deadline
) -> set[Claim]:
    """Those of the claims that hold in all configurations, if there are at most so many."""
    from koord.verify.engines.explicit.exhaustive import exhaust

    few = Limits(states=most)
    searched = exhaust(system, claims, few, deadline, _unshown, lambda text: None)
    return {claim for claim, v in searched.verdicts.items() if v.outcome is Outcome.HOLDS}


def _unshown(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    """Skip the replay: the run that reaches a goal is not shown."""
    raise NotReplayedError("it is not shown")
