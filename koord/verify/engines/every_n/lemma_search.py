"""Lemmas from counterexamples to induction. [T-EVERY-N]

Claims that are not inductive are asked for with what the solver shows: a configuration from which
a round breaks one, though all hold in it. A disjunction of literals that held in all samples of
small systems, and does not hold in that configuration, becomes a lemma, which has to be inductive
with the others as well, if anybody needs it: asked for are the claims, and the lemmas that proofs
use. What cannot be kept is given up; what nobody needs is left out in the end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from functools import partial
from itertools import islice

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.semantics.storage import Cell, Many, Storage
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import System
from koord.syntax.types import INT, Type
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Model, SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.conditions import UNSET
from koord.verify.engines.every_n.disjunctions import (
    USUAL,
    Disjunction,
    Samples,
    canonical,
    cost,
    implied,
    is_false,
    lemma,
)
from koord.verify.engines.every_n.initial_states import ArbitraryState
from koord.verify.engines.every_n.language import Held, Language
from koord.verify.engines.every_n.literals import Snapshot
from koord.verify.engines.every_n.proving import STEPS_PER_SECOND, Inferred
from koord.verify.engines.every_n.questions import GENEROUS, Means, ProofBudget, Start, Step
from koord.verify.engines.every_n.small_systems import Sample, sampled
from koord.verify.engines.every_n.watching import WATCHED, Watching

#: Where so few are too much for the solver at once, they are asked one by one.
_ONE_BY_ONE = 16

#: So many steps of work the search has at least: with fewer nothing that asks of all is found.
_LEAST_STEPS = 26_000

#: With so little of a solver's time there are fewer samples, one in so many: they cost most.
_HASTE_S, _HASTY = 0.1, 8

#: How many units of work a solver does for a question: where that was too little, all begins again.
#: Questions that are of use take little, most often, and hopeless ones whatever they may.
_PATIENCE = (400_000, 1_600_000, 6_400_000)

#: For a claim alone it does so many times as much: what is not known of one is the end.
_OF_CLAIMS = 5

#: So many lemmas are tried against one counterexample at once.
_AT_ONCE = 3

#: Where nothing else helps, lemmas have so many literals, and are of the first rows of a model. So
#: often that is tried, if there is nobody else to ask.
_MOST_LITERALS, _FEW_ROWS, _MOST_LONGER = 4, 12, 6

#: So many choices of three robots are looked at.
_MANY_ROWS = 200

#: Where names were too many for the solver so often, there are fewer from then on.
_MOST_TOO_MUCH = 3

#: So many counterexamples to a lemma are answered with others, before it is given up.
_MOST_DEFENCES = 5

#: Counterexamples are asked for at most so often.
_MOST_QUESTIONS = 150


class Search(Struct):
    """The search for lemmas of open claims of a program.

    ``active`` are the lemmas assumed now, ``dead`` those given up.
    """

    quoting: Quoting
    language: Language
    reached: Sequence[Sample]
    samples: Samples
    budget: Budget
    ring: Samples | None = None  #: of three robots, where they were looked at
    active: dict[Disjunction, Claim] = field(default_factory=dict)
    dead: set[Disjunction] = field(default_factory=set)

    def against(self, here: Snapshot, most: int) -> list[Disjunction]:
        """Disjunctions to try against a configuration, the best first."""
        found: set[Disjunction] = set()
        rows = self.language.rows(here)
        for row in rows if most <= USUAL else islice(rows, _FEW_ROWS):
            found.update(self.samples.against(here, row, self.budget, most))
        return self.sorted_({canonical(self.language, x) for x in found})

    def on_the_ring(self, here: Snapshot) -> list[Disjunction]:
        """The same about three robots of a ring, one of which stands between the others."""
        language = self.language
        if not language.ring:
            return []
        if self.ring is None:
            self.ring = Samples.of(language, self.snapshots, language.triples)
        found: set[Disjunction] = set()
        for row in islice(language.triples(here), _MANY_ROWS):
            found.update(
                canonical(language, x) for x in self.ring.on_the_ring(here, row, self.budget)
            )
        return self.sorted_(found)

    def sorted_(self, found: Collection[Disjunction]) -> list[Disjunction]:
        return sorted(set(found) - self.dead, key=lambda x: cost(self.language, x))

    @property
    def snapshots(self) -> list[Snapshot]:
        return [sample.snapshot for sample in self.reached]

    @property
    def lemmas(self) -> set[Claim]:
        """The active lemmas as claims."""
        return set(self.active.values())

    def begin(self) -> None:
        """Forget all lemmas: those given up may be kept by more work."""
        self.active, self.dead = {}, set()

    def lemma(self, x: Disjunction) -> Claim:
        return lemma(self.quoting, self.language, x)

    def keep(self, claims: Sequence[Claim]) -> None:
        """Forget the lemmas that are not among some claims."""
        self.active = {x: claim for x, claim in self.active.items() if claim in claims}

    def is_met(self, here: Snapshot) -> bool:
        """Return whether all active lemmas hold of the robots that are known."""
        return not any(is_false(self.language, x, here) for x in self.active)


def searched(
    system: System, budget: Budget, seed: int, *, somebody: bool = False, part: int = 1
) -> Search | None:
    """Prepare the search; None where there is nothing to say about a program.

    ``somebody``: it says that there is a robot in some state, also where no event asks that. It is
    prepared by one in ``part`` of the usual samples.
    """
    program = system.program
    if len(program.agents) != 1:
        return None
    language = Language.of_program(program, somebody=somebody)
    found = sampled(system, language, seed, part)
    if not language.literals or not found:
        return None
    samples = Samples.of(language, (sample.snapshot for sample in found), language.rows)
    return Search(Quoting.of(program), language, found, samples, budget)


class Place(Struct, frozen=True):
    """A configuration of a system of any number of robots, and what is watched of it."""

    world: ParameterisedSystem
    start: ArbitraryState
    watching: Watching


def configuration_of(language: Language, step: Step | Place, model: Model, limit: int) -> Snapshot:
    """The robots of a model that names were given to, in the configuration before the round."""
    world, start = step.world, step.start
    store = start.configuration.store
    count = model.scalar(world.crowd.count, INT)
    assert isinstance(count, int)

    def read(cell: Cell[Term], type_: Type) -> object:
        return model.scalar(cell.value, type_) if model.truth(cell.is_set) else UNSET

    robots: dict[int, Held[Term]] = {}
    named: dict[int, Term] = {}
    asked: dict[tuple[int, int | None, int], object] = {}
    watched = world.book.names(WATCHED)
    with world.book.reading():
        for name in world.book.names(limit):
            number = model.scalar(name, INT)
            if isinstance(number, int) and 0 <= number < count and number not in robots:
                element, named[number] = partial(_element, name), name
                robots[number] = language.held(start.robot(0, name), store, element)
    for name in watched:
        number = model.scalar(name, INT)
        if isinstance(number, int) and number in robots:
            asked |= step.watching.truths(model, name, number)
    asked |= step.watching.truths(model, None, None)
    with world.book.reading():
        return language.snapshot(
            robots,
            store.allwrite,
            lambda kept, other: _element(named[other], kept),
            read,
            count,
            asked,
        )


def _element(robot: Term, storage: Storage[Term]) -> Storage[Term]:
    assert isinstance(storage, Many)
    return storage.at(robot)


def infer_from_counterexamples(
    system: System,
    claims: Sequence[Claim],
    known: Sequence[Claim],
    deadline: Deadline,
    effort: Effort,
    thrift: ProofBudget,
    seed: int = 0,
) -> Inferred:
    """Find claims that are inductive together with lemmas found on the way.

    ``known`` are invariants that were proved before, which may be among the lemmas.
    """
    nothing = Inferred((), ())
    given, whole = system, system.budget
    steps = max(_LEAST_STEPS, int(thrift.seconds * STEPS_PER_SECOND))
    system = replace(system, budget=whole.rationed(steps))
    means = Means(deadline, effort, thrift, seed)
    best = nothing
    try:
        start = Start(system, means)
        failing = start.failing(claims)
        open_ = [claim for claim in claims if claim not in failing]
        part = _HASTY if thrift.seconds <= _HASTE_S else 1
        search = searched(given, system.budget, seed, part=part) if open_ else None
        if search is None:
            return nothing
        language = search.language
        again = partial(Step, system, means, language.conditions, language.size)
        longer = _MOST_LONGER if thrift.seconds >= GENEROUS.seconds else 0
        for patience in _PATIENCE:
            search.begin()
            loop = _Loop(start, again(), again, search, tuple(known), patience, longer=longer)
            proved, step = loop.proved(open_), loop.step
            if start.limits or step.limits:
                break
            if len(proved) > len(best.proved):
                found = step.lemmas(proved, [*known, *search.active.values()])
                best = Inferred(proved, tuple(step.fewest(proved, found)))
            if len(proved) == len(open_) or not loop.gave_up or patience >= thrift.question:
                break
    except NotFiniteError:
        return nothing
    except OutOfBudgetError:
        if whole.is_over():
            raise
    return best


class _Loop(Struct):
    """The loop of questions and lemmas.

    Names of so many ``generations`` are put into facts, and of ``most`` where that is not enough.
    A question may take so many units of a solver's work as there is ``patience``.
    """

    start: Start
    step: Step
    again: Callable[[], Step]
    search: Search
    known: tuple[Claim, ...]
    patience: int
    gave_up: bool = False  #: whether a solver did not answer with so little work
    generations: int = 1
    most: int = 3
    too_much: int = 0  #: how often names were too many
    longer: int = 0  #: how often longer lemmas may be looked for
    defended: Counter[Claim] = field(default_factory=Counter)

    def proved(self, claims: Sequence[Claim]) -> tuple[Claim, ...]:
        """The claims that are inductive with the active lemmas that they need, in the end.

        All active lemmas are assumed; asked for are the claims, and the lemmas that their proofs
        use, and theirs. So nothing is spent on lemmas that nobody needs.
        """
        left, search = list(claims), self.search
        wanted, doubtful = list(claims), set[Claim]()
        for _ in range(_MOST_QUESTIONS):
            answer, hit = self._ask(wanted, [*left, *search.active.values()])
            if answer is SolverAnswer.UNSAT:
                if not hit:
                    search.keep(wanted)
                    return tuple(left)
                wanted += [claim for claim in search.active.values() if claim in hit]
                continue
            if answer is SolverAnswer.UNKNOWN:
                if self.generations == 1 and not hit:
                    return ()
                if not hit or not hit.isdisjoint(left):
                    # So many names are too much for the solver: now and then, or always.
                    self.too_much += 1
                    if self.generations == 1:
                        return ()
                    if self.too_much >= _MOST_TOO_MUCH:
                        self.most = self.generations - 1
                    self.generations = min(self.generations - 1, self.most)
                    self.step, hit = self.again(), hit or doubtful
            elif self._is_worth_it(hit, left):
                model = self.step.asking.solver.model()
                here = configuration_of(search.language, self.step, model, self.generations - 1)
                if search.is_met(here) and self._add(here):
                    continue
                if self.generations < self.most:
                    # Some other robot may be what is wrong with the configuration.
                    self.generations, doubtful = self.generations + 1, hit
                    continue
                if self.longer and search.is_met(here):
                    self.longer -= 1
                    if self._add(here, _MOST_LITERALS):
                        continue
            left = [claim for claim in left if claim not in hit]
            wanted = list(left)
            self._drop(hit)
            if not left:
                return ()
        return ()

    def _is_worth_it(self, hit: set[Claim], claims: Sequence[Claim]) -> bool:
        """Return whether to look for lemmas: of what is only a lemma not for ever."""
        if not hit.isdisjoint(claims):
            return True
        self.defended.update(hit)
        return all(self.defended[claim] <= _MOST_DEFENCES for claim in hit)

    def _drop(self, claims: set[Claim]) -> None:
        """Give up lemmas."""
        for x in [x for x, claim in self.search.active.items() if claim in claims]:
            del self.search.active[x]
            self.search.dead.add(x)

    def _ask(
        self, wanted: Sequence[Claim], given: Sequence[Claim]
    ) -> tuple[SolverAnswer, set[Claim]]:
        """Ask for a round that breaks something wanted, and what; if none, what else it takes.

        Where the solver does not know, returned is what it does not know of, if it is one thing.
        """
        used: set[Claim] = set()
        for moment in self.step.moments():
            found = self._ask_of(wanted, given, moment)
            if found[0] is SolverAnswer.UNKNOWN and 1 < len(wanted) <= _ONE_BY_ONE:
                # All at once is too much: one by one may not be.
                for claim in wanted:
                    found = self._ask_of([claim], given, moment)
                    if found[0] is SolverAnswer.UNKNOWN:
                        return SolverAnswer.UNKNOWN, {claim}
                    if found[0] is SolverAnswer.SAT:
                        return found
                    used |= found[1]
            if found[0] is not SolverAnswer.UNSAT:
                return found
            used |= found[1]
        return SolverAnswer.UNSAT, used - {*wanted, *self.known}

    def _ask_of(
        self, wanted: Sequence[Claim], given: Sequence[Claim], moment: ClaimPhase
    ) -> tuple[SolverAnswer, set[Claim]]:
        given, most = [*given, *self.known], self.patience
        if self.search.lemmas.isdisjoint(wanted):
            most *= _OF_CLAIMS
        answer, hit = self.step.counterexample(wanted, given, moment, self.generations, most)
        self.gave_up |= answer is SolverAnswer.UNKNOWN
        return answer, hit

    def _add(self, here: Snapshot, most: int = USUAL) -> bool:
        """Add lemmas that do not hold in a configuration; return whether there are any."""
        if self._tried(self.search.against(here, most)):
            return True
        return most == USUAL and self._tried(self.search.on_the_ring(here))

    def _tried(self, found: Sequence[Disjunction]) -> bool:
        """Make lemmas of the first that hold after INIT; return whether there are any."""
        search, added = self.search, list[Disjunction]()
        for x in found:
            if any(implied(search.language, x, other) for other in added):
                continue
            claim = search.lemma(x)
            if self.start.sifted([claim]):
                search.active[x] = claim
                added.append(x)
                if len(added) == _AT_ONCE:
                    break
            else:
                search.dead.add(x)
        return bool(added)
