"""Questions about every number of robots: what holds after INIT, and what a round preserves.

All claims are assumed of some configuration, and each is asked for after one more step. [T-EVERY-N]
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, TypeVar

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import conjunction, disjunction
from koord.syntax import core
from koord.syntax.analysis.footprint import footprint, stops_show
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes
from koord.verify.claims import Claim, ClaimKind, ClaimPhase
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Solver, SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem, Universal
from koord.verify.engines.every_n.initial_states import ArbitraryState, ParameterisedInit, faults_of
from koord.verify.engines.every_n.rounds import ParameterisedRound, RoundStart
from koord.verify.engines.every_n.watching import Watching

if TYPE_CHECKING:
    from koord.verify.engines.every_n.conditions import Condition

#: What a goal is for: a claim, or a premise of a proof.
G = TypeVar("G", bound=Hashable)


class ProofBudget(Struct, frozen=True):
    """Budgets of a proof: generations of names, instances, and solver effort.

    ``generations`` of names, ``instances`` in all, ``seconds`` of a solver in all (about), and
    units of its work on one ``question``; fewer ``with_products`` of unknown reals.
    """

    generations: int
    instances: int
    seconds: float
    question: int
    with_products: int


#: Where there is nobody else to ask.
GENEROUS = ProofBudget(
    generations=3, instances=20_000, seconds=60.0, question=6_000_000, with_products=1_500_000
)

#: Where others are asked afterwards.
SPARING = ProofBudget(
    generations=3, instances=12_000, seconds=3.0, question=1_500_000, with_products=120_000
)


#: What a question may cost that is to save a lemma: a little, and so many times what the proof did.
_LITTLE, _TIMES = 100_000, 3


class Means(Struct, frozen=True):
    """The budgets and the seed of queries."""

    deadline: Deadline
    effort: Effort
    thrift: ProofBudget
    seed: int


class Asking:
    """A system and a solver that knows its facts.

    A goal may take one of so many ``shares`` of the effort that is left.
    """

    def __init__(self, world: ParameterisedSystem, means: Means, shares: int = 1) -> None:
        self.world = world
        self.means = means
        self._shares = shares
        self._given = 0
        self._limit: int = -1
        self.solver = Solver(self.world.d, self.world.unknowns, self.means.seed)
        self.world.book.most = self.means.thrift.instances
        self.robots: tuple[Term, ...] = tuple(self.world.d.fresh(f"y{k}", INT) for k in range(4))

    def failing(self, goals: Sequence[tuple[G, list[Term]]]) -> dict[G, str]:
        """The claims (or premises) whose goals (each a conjunction) the facts do not refute."""
        pending = list(goals)
        for _, goal in goals:
            self.world.book.ask(goal)
        failed: dict[G, str] = {}
        first = max(self._limit, 0)
        for limit in range(first, self.means.thrift.generations):
            if limit > self._limit:
                self.world.book.settle(limit)
                self._limit = limit
            self.world.book.settle(self._limit)
            still = []
            for claim, goal in pending:
                why = self._why_open(goal)
                failed.pop(claim, None)
                if why:
                    failed[claim] = why
                # More facts refute what can be met with fewer. What is too much is asked with more
                # of them once: a solver that does not come upon a model may refute it at once.
                again = limit == first and why == _TOO_MUCH and self._has_plenty
                if why == NOT_INDUCTIVE or again:
                    still.append((claim, goal))
            pending = still
            if not pending:
                break
        return failed

    def sift(
        self,
        goals: Sequence[tuple[G, list[Term]]],
        given: Sequence[Term],
        at_most: int | None = None,
        *,
        halves: bool = False,
    ) -> set[G]:
        """The claims (or premises) with satisfiable goals, as far as the solver tells: one query.

        ``given`` holds besides. Where the solver gives up, all claims that are left are met; that
        is when it has done ``at_most`` units of work, or four times the usual. Or it gives up
        sooner on several, and is asked of each of their ``halves`` by itself: so that one goal is
        hard to meet says nothing of the others.
        """
        met: set[G] = set()
        parts = [self._pending(goals, given)]
        while parts:
            pending = parts.pop()
            if not pending:
                continue
            divides = halves and len(pending) > 1
            most = at_most or (self._most if divides else 4 * self._most)
            hit = self._hit(pending, given, most)
            if hit is None and divides:
                half, items = len(pending) // 2, list(pending.items())
                parts += [dict(items[half:]), dict(items[:half])]
            elif hit is None:
                met |= set(pending)
            elif hit:
                met |= hit
                parts.append({claim: goal for claim, goal in pending.items() if claim not in hit})
        return met

    def _pending(
        self, goals: Sequence[tuple[G, list[Term]]], given: Sequence[Term]
    ) -> dict[G, Term]:
        """The goals as terms, with facts about their names."""
        if not goals:
            return {}
        pending = {claim: conjunction(self.world.d, goal) for claim, goal in goals}
        self.world.book.ask([*given, *pending.values()])
        self.look_ahead(1)
        self.world.book.settle(self._limit)
        return pending

    def _hit(self, pending: dict[G, Term], given: Sequence[Term], at_most: int) -> set[G] | None:
        """The goals that a model meets, none if none can be; None if the solver gives up."""
        self._tell()
        question = [*given, disjunction(self.world.d, list(pending.values()))]
        answer = self.solver.check(
            question, self.means.deadline, self.means.effort, at_most=at_most
        )
        if answer is SolverAnswer.UNKNOWN:
            return None
        if answer is SolverAnswer.UNSAT:
            return set()
        model = self.solver.model()
        # A model that leaves open what was asked says nothing of which goal it meets.
        return {claim for claim, goal in pending.items() if model.truth(goal)} or set(pending)

    def counterexample(
        self,
        goals: Sequence[tuple[G, list[Term]]],
        given: Sequence[Term],
        at_most: int | None = None,
    ) -> tuple[SolverAnswer, set[G]]:
        """Ask whether one of some goals can be met, and which of them are in the model.

        If none can be, the solver's core has positions of what of the given it takes. It gives up
        when it has done ``at_most`` units of work, if it would go on for longer.
        """
        d, book, means = self.world.d, self.world.book, self.means
        asked = {claim: conjunction(d, goal) for claim, goal in goals}
        book.ask([*given, *asked.values()])
        self.look_ahead(1)
        book.settle(self._limit)
        self._tell()
        question = [*given, disjunction(d, list(asked.values()))]
        most = min(self._most, at_most or self._most)
        answer = self.solver.check(question, means.deadline, means.effort, at_most=most)
        if answer is not SolverAnswer.SAT:
            return answer, set()
        model = self.solver.model()
        return answer, {claim for claim, goal in asked.items() if model.truth(goal)}

    def look_ahead(self, generations: int) -> None:
        """Instantiate names of so many generations from now on."""
        self._limit = max(self._limit, generations - 1)

    def needed(self, goal: Sequence[Term]) -> frozenset[int] | None:
        """The positions in a goal of its unsatisfiable core; None if it is not refuted."""
        self.world.book.ask(goal)
        self.world.book.settle(self._limit)
        return self.solver.core() if not self._why_open(goal) else None

    def fewest(self, goal: Sequence[Term], first: int) -> frozenset[int] | None:
        """As ``needed``, with as few generations of names as it takes.

        Of the ``first`` positions none can be left out by itself.
        """
        core_: frozenset[int] | None = None
        for generations in range(1, self.means.thrift.generations + 1):
            self.look_ahead(generations)
            core_ = self.needed(goal)
            if core_ is not None:
                break
        if core_ is None:
            return None
        for position in range(first):
            if position in core_:
                fewer = sorted(core_ - {position})
                found = self.needed([goal[k] for k in fewer])
                core_ = core_ if found is None else frozenset(fewer[k] for k in found)
        return core_

    def _tell(self) -> None:
        """Pass new facts to the solver."""
        self.solver.add(self.world.book.facts[self._given :])
        self._given = len(self.world.book.facts)

    def _why_open(self, goal: Sequence[Term]) -> str:
        """The reason why a goal is not refuted; empty if it is."""
        self._tell()
        means = self.means
        most = min(self._most, max(1, means.effort.left // self._shares))
        answer = self.solver.check(
            goal, means.deadline, means.effort, at_most=most, for_model=False
        )
        if answer is SolverAnswer.UNSAT:
            return ""
        if answer is SolverAnswer.SAT:
            return NOT_INDUCTIVE
        return "timeout" if means.deadline.is_near() else _TOO_MUCH

    @property
    def _most(self) -> int:
        """The effort that one query may use."""
        thrift = self.means.thrift
        return thrift.with_products if self.world.d.has_products else thrift.question

    @property
    def _has_plenty(self) -> bool:
        """Whether there is effort for other questions, too, if one takes all that it may."""
        return self.means.effort.left > 4 * self._most

    @property
    def limits(self) -> list[str]:
        return list(self.world.unknowns.limits)


#: How the reason begins why a claim is open of which nobody knows whether it holds to begin with.
AFTER_INIT = "after INIT"

NOT_INDUCTIVE = "not inductive for every number of robots"

#: How it begins where a program has what proofs do not follow, such as long lists.
NOT_COVERED = "not covered"

_TOO_MUCH = "too much for the solver"


def universal(claim: Claim) -> Universal:
    """The statement of a claim about configurations."""
    assert claim.stated is not None
    return Universal.of(claim.stated.condition, claim.stated.bound)


class Start:
    """The base case: the state after INIT."""

    def __init__(self, system: System, means: Means) -> None:
        program = system.program
        self.world = ParameterisedSystem.of(system)
        self._opening = ParameterisedInit(self.world)
        # What is asked in vain here is not to be missing where a round is asked about.
        self._asking = Asking(self.world, means, shares=2)
        self.world.book.expect(*self._asking.robots[:2])
        self.world.book.expect(0, self.world.last, generation=1)
        for assumption in program.assumptions:
            given = Universal.of(assumption.condition, assumption.bound)
            given.suppose(self.world, self._opening.configuration, True)

    @property
    def limits(self) -> list[str]:
        return self._asking.limits

    def sifted(self, claims: Sequence[Claim], generations: int = 1) -> list[Claim]:
        """The claims that hold after INIT, as far as a quick query with few names tells."""
        self._asking.look_ahead(generations)
        goals = [(claim, self._goal(claim)) for claim in claims]
        met = self._asking.sift(goals, [])
        return [claim for claim in claims if claim not in met]

    def failing(self, claims: Sequence[Claim]) -> dict[Claim, str]:
        """The claims that are not proved to hold after INIT."""
        goals = [(claim, self._goal(claim)) for claim in claims if claim.looked_at(ClaimPhase.INIT)]
        found = self._asking.failing(goals)
        return {claim: f"{AFTER_INIT}: {why}" for claim, why in found.items()}

    def _goal(self, claim: Claim) -> list[Term]:
        world, d = self.world, self.world.d
        robot = self._asking.robots[0]
        if claim.kind is ClaimKind.FAULT:
            moves = self._opening.moves(robot)
            faults = faults_of(self.world, moves)
            return [d.binary(core.BinaryOp.OR, self._opening.fault, faults)]
        asked = universal(claim)
        names = self._asking.robots[: asked.arity]
        return [self._opening.calm, asked.broken(world, self._opening.configuration, names)]


class Step:
    """The inductive step: one round from any configuration in which the claims hold.

    Of ``conditions`` models say how they are; those with an index, of so many (``size``). With
    ``earlier`` rounds it is the round behind so many others, before and behind which the claims
    hold; ``from_init`` the first of these begins after INIT, and not anywhere. It is asked
    ``after`` questions about another world, of which nothing is asked any more.
    """

    def __init__(
        self,
        system: System,
        means: Means,
        conditions: Sequence[Condition] = (),
        size: int = 1,
        *,
        earlier: int = 0,
        from_init: bool = False,
        after: ParameterisedSystem | None = None,
    ) -> None:
        program = system.program
        self._stops_show = stops_show(program)
        world = self.world = ParameterisedSystem.of(system, after)
        self._opening = ParameterisedInit(world)
        self.start = ArbitraryState(world, self._opening)
        self.asking = Asking(world, means)
        world.book.expect(*self.asking.robots[:2])
        world.book.expect(0, world.last, generation=1)
        world.book.note(self._opening.calm)
        begins: RoundStart = self._opening if from_init else self.start
        self._before = [begins.configuration]
        for number in range(earlier):
            begins = self._whole(begins, f"{number} before ")
        self.round = ParameterisedRound(world, begins)
        self.watching = Watching(world, conditions, size)
        self.watching.define(self.start.configuration)
        self._supposed: dict[Claim, Term] = {}
        self._goals: dict[tuple[Claim, ClaimPhase], list[Term]] = {}
        for assumption in program.assumptions if from_init else _lasting(program):
            given = Universal.of(assumption.condition, assumption.bound)
            given.suppose(world, self._opening.configuration, True)

    def _whole(self, begins: RoundStart, label: str) -> ParameterisedRound:
        """A whole round, behind which the claims hold."""
        round_ = ParameterisedRound(self.world, begins, label)
        for fact in (round_.calm, round_.legal, round_.gentle):
            self.world.book.note(fact)
        self._before.append(round_.end)
        return round_

    @property
    def limits(self) -> list[str]:
        return self.asking.limits

    def failing(self, candidates: Sequence[Claim], known: Sequence[Claim] = ()) -> dict[Claim, str]:
        """The claims that are not proved to be preserved by a round, if others are ``known``."""
        supposed = (*known, *candidates)
        given = [self.suppose(claim) for claim in supposed if claim.is_state_property]
        failed: dict[Claim, str] = {}
        for moment in self.moments():
            goals = [
                (claim, [*given, *goal])
                for claim in candidates
                if claim not in failed and (goal := self._goal(claim, moment))
            ]
            failed |= self.asking.failing(goals)
        return failed

    def sifted(self, claims: Sequence[Claim], generations: int) -> list[Claim]:
        """The largest subset of the claims that a round preserves, with few names."""
        left = list(claims)
        self.asking.look_ahead(generations)
        while True:
            before = len(left)
            for moment in self.moments():
                given = [self.suppose(claim) for claim in left if claim.is_state_property]
                goals = [(claim, g) for claim in left if (g := self._goal(claim, moment))]
                met = self.asking.sift(goals, given)
                left = [claim for claim in left if claim not in met]
            if len(left) == before:
                return left

    def counterexample(
        self,
        claims: Sequence[Claim],
        given: Sequence[Claim],
        moment: ClaimPhase,
        generations: int,
        at_most: int,
    ) -> tuple[SolverAnswer, set[Claim]]:
        """Ask for a round that breaks one of the claims, with names of so many generations.

        Returned are the claims that it breaks; if there is none, the given ones that it takes.
        The solver does ``at_most`` units of work.
        """
        self.asking.look_ahead(generations)
        state = [claim for claim in given if claim.is_state_property]
        supposed = [self.suppose(claim) for claim in state]
        goals = [(claim, goal) for claim in claims if (goal := self._goal(claim, moment))]
        if not goals:
            return SolverAnswer.UNSAT, set()
        answer, hit = self.asking.counterexample(goals, supposed, at_most)
        if answer is SolverAnswer.UNSAT:
            used = self.asking.solver.core()
            return answer, {claim for k, claim in enumerate(state) if k in used}
        return answer, hit

    def lemmas(self, claims: Sequence[Claim], others: Sequence[Claim]) -> list[Claim]:
        """The lemmas that proofs of the claims use, found one by one."""
        state = [claim for claim in (*claims, *others) if claim.is_state_property]
        given = [self.suppose(claim) for claim in state]
        waiting, found = list(claims), list[Claim]()
        while waiting:
            claim = waiting.pop()
            for moment in self.moments():
                goal = self._goal(claim, moment)
                core_ = self.asking.needed([*given, *goal]) if goal else frozenset()
                if core_ is None:
                    return list(others)
                for position in sorted(core_):
                    if position < len(state) and state[position] not in (*claims, *found):
                        found.append(state[position])
                        waiting.append(state[position])
        return found

    def fewest(self, claims: Sequence[Claim], lemmas: Sequence[Claim]) -> list[Claim]:
        """A minimal set of lemmas: none can be left out by itself.

        As far as is seen without much more work than it is to show them all: that something is
        missing can take a solver a hundred times as long.
        """
        effort, kept = self.asking.means.effort, list(lemmas)
        before = effort.left
        if not self.is_closed([*claims, *lemmas]):
            return kept
        most = _LITTLE + _TIMES * (before - effort.left)
        for lemma in lemmas[::-1]:
            rest = [claim for claim in kept if claim is not lemma]
            if self.is_closed([*claims, *rest], most):
                kept = rest
        return kept

    def is_closed(self, claims: Sequence[Claim], at_most: int | None = None) -> bool:
        """Return whether every round preserves some claims, if all of them hold before it.

        A solver does ``at_most`` units of work for each question, or four times the usual.
        """
        given = [self.suppose(claim) for claim in claims if claim.is_state_property]
        for moment in self.moments():
            goals = [(claim, goal) for claim in claims if (goal := self._goal(claim, moment))]
            if self.asking.sift(goals, given, at_most):
                return False
        return True

    def moments(self) -> list[ClaimPhase]:
        """The moments of a round at which claims are asked."""
        if self._stops_show:
            return [ClaimPhase.INSIDE, ClaimPhase.MIDDLE, ClaimPhase.END]
        return [ClaimPhase.INSIDE, ClaimPhase.END]

    def suppose(self, claim: Claim) -> Term:
        """The literal under which a claim is assumed of where the rounds start."""
        if claim not in self._supposed:
            when = self.world.d.fresh(f"suppose {claim.name}", BOOL)
            self._supposed[claim] = when
            for configuration in self._before:
                universal(claim).suppose(self.world, configuration, when)
        return self._supposed[claim]

    def _goal(self, claim: Claim, moment: ClaimPhase) -> list[Term]:
        """The negation of a claim at a moment, as a conjunction; empty if it cannot fail there."""
        if (claim, moment) not in self._goals:
            self._goals[claim, moment] = self._negation(claim, moment)
        return self._goals[claim, moment]

    def _negation(self, claim: Claim, moment: ClaimPhase) -> list[Term]:
        if not claim.looked_at(ClaimPhase.MIDDLE if moment is ClaimPhase.INSIDE else moment):
            return []
        round_, robot, other = self.round, *self.asking.robots[:2]
        before: list[Term] = [] if moment is ClaimPhase.INSIDE else [round_.calm, round_.legal]
        match claim.kind:
            case ClaimKind.PROPERTY:
                asked = universal(claim)
                names = self.asking.robots[: asked.arity]
                broken = asked.broken(self.world, self._configuration(moment), names)
                gentle = [round_.gentle] if moment is ClaimPhase.END else []
                return [round_.calm, *before, *gentle, broken]
            case ClaimKind.FAULT if moment is ClaimPhase.END:
                return [*before, round_.breaks(robot)]
            case ClaimKind.FAULT:
                return [round_.faults(robot)] if moment is ClaimPhase.INSIDE else []
            case ClaimKind.LOST_UPDATE:
                if moment is not ClaimPhase.INSIDE:
                    return []
                return [round_.calm, round_.loses(robot, other, claim.subject)]
            case ClaimKind.CONTRACT:
                return [*before, round_.gentle, round_.fails(robot, claim.subject)]
            case ClaimKind.LIVENESS:
                raise AssertionError("of whole runs nothing is asked here")

    def _configuration(self, moment: ClaimPhase) -> Configuration[Term]:
        match moment:
            case ClaimPhase.INSIDE:
                return self.round.inside
            case ClaimPhase.MIDDLE:
                return self.round.middle
            case _:
                return self.round.end


def _lasting(program: core.Program) -> list[core.Assumption]:
    """The assumptions about values that never change."""
    changing = {(home, slot) for home, _, slot in footprint(program)}
    bodies = tuple(function.body for function in program.functions)

    def lasts(assumption: core.Assumption) -> bool:
        return not any(
            isinstance(node, core.Ran | core.Stopped)
            or (isinstance(node, core.Variable) and (node.home, node.slot) in changing)
            for node in nodes((assumption.condition, bodies))
            if not isinstance(node, core.Variable) or node.home is not Home.BOUND
        )

    return [assumption for assumption in program.assumptions if lasts(assumption)]
