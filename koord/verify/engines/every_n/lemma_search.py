"""Lemmas from counterexamples to induction. [T-EVERY-N]

Claims that are not inductive are asked for with what the solver shows: a configuration from which
a round breaks one, though all hold in it. A disjunction of literals that held in all samples of
small systems, and does not hold in that configuration, becomes a lemma, which has to be inductive
with the others as well, if anybody needs it: asked for are the claims, and the lemmas that proofs
use. What cannot be kept is given up; what nobody needs is left out in the end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from msgspec import Struct, field
from msgspec.structs import replace

from koord.sampling.reached import reached
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.every_number import NotFiniteError
from koord.semantics.storage import Cell, Many, Storage
from koord.syntax import core
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.system import System, dealt
from koord.syntax.types import INT, Type
from koord.verify.claims import Claim
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Model, SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.disjunctions import (
    Disjunction,
    Samples,
    canonical,
    cost,
    implied,
    is_false,
    lemma,
)
from koord.verify.engines.every_n.initial_states import ArbitraryState
from koord.verify.engines.every_n.literals import UNSET, Held, Language, Snapshot
from koord.verify.engines.every_n.proving import STEPS_PER_SECOND, Inferred
from koord.verify.engines.every_n.questions import Means, ProofBudget, Start, Step

#: Sampled systems: how many robots, and how many turns are spent on them.
_SAMPLED = ((2, 800), (3, 2_400))

#: So many steps of work a sampled system may cost: what is slow is sampled less.
_SAMPLING = 100_000

#: So many lemmas are tried against one counterexample at once.
_AT_ONCE = 3

#: So many counterexamples to a lemma are answered with others, before it is given up.
_MOST_DEFENCES = 5

#: Counterexamples are asked for at most so often.
_MOST_QUESTIONS = 150


class Search(Struct):
    """The search for lemmas of open claims of a program.

    ``active`` are the lemmas assumed now, ``dead`` those given up.
    """

    program: core.Program
    language: Language
    samples: Samples
    budget: Budget
    active: dict[Disjunction, Claim] = field(default_factory=dict)
    dead: set[Disjunction] = field(default_factory=set)

    def against(self, here: Snapshot) -> list[Disjunction]:
        """Disjunctions to try against a configuration, the best first."""
        found: set[Disjunction] = set()
        for row in self.language.rows(here):
            found.update(
                canonical(self.language, x) for x in self.samples.against(here, row, self.budget)
            )
        return sorted(found - self.dead, key=lambda x: cost(self.language, x))

    def lemma(self, x: Disjunction) -> Claim:
        return lemma(self.program, self.language, x)

    def keep(self, claims: Sequence[Claim]) -> None:
        """Forget the lemmas that are not among some claims."""
        self.active = {x: claim for x, claim in self.active.items() if claim in claims}

    def is_met(self, here: Snapshot) -> bool:
        """Return whether all active lemmas hold of the robots that are known."""
        return not any(is_false(self.language, x, here) for x in self.active)


def searched(system: System, budget: Budget, seed: int) -> Search | None:
    """Prepare the search; None where there is nothing to say about a program."""
    program = system.program
    if len(program.agents) != 1:
        return None
    language = Language.of_program(program)
    snapshots = [
        language.sampled(configuration)
        for count, turns in _SAMPLED
        for configuration in _reached(system, count, turns, seed)
        if configuration.fault is None
    ]
    if not language.literals or not snapshots:
        return None
    return Search(program, language, Samples.of(language, snapshots), budget)


def _reached(system: System, count: int, turns: int, seed: int) -> list[Configuration[Constant]]:
    few = dealt(system.program, count, system.delta_s)
    return reached(replace(few, budget=system.budget.rationed(_SAMPLING)), turns, seed)


def configuration_of(
    language: Language, world: ParameterisedSystem, start: ArbitraryState, model: Model, limit: int
) -> Snapshot:
    """The robots of a model that names were given to, in the configuration before the round."""
    store = start.configuration.store
    count = model.scalar(world.crowd.count, INT)
    assert isinstance(count, int)

    def read(cell: Cell[Term], type_: Type) -> object:
        return model.scalar(cell.value, type_) if model.truth(cell.is_set) else UNSET

    robots: dict[int, Held[Term]] = {}
    for name in world.book.names(limit):
        number = model.scalar(name, INT)
        if isinstance(number, int) and 0 <= number < count and number not in robots:
            element = partial(_element, name)
            robots[number] = language.held(start.robot(0, name), store, element)
    return language.snapshot(robots, store.allwrite, read)


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
    system = replace(system, budget=whole.rationed(int(thrift.seconds * STEPS_PER_SECOND)))
    means = Means(deadline, effort, thrift, seed)
    try:
        start = Start(system, means)
        step = Step(system, means)
        failing = start.failing(claims)
        open_ = [claim for claim in claims if claim not in failing]
        search = searched(given, system.budget, seed) if open_ else None
        if search is None:
            return nothing
        again = partial(Step, system, means)
        loop = _Loop(start, step, again, search, tuple(known))
        proved, step = loop.proved(open_), loop.step
        if not proved or start.limits or step.limits:
            return nothing
        found = step.lemmas(proved, [*known, *search.active.values()])
        return Inferred(proved, tuple(step.fewest(proved, found)))
    except NotFiniteError:
        return nothing
    except OutOfBudgetError:
        if whole.is_over():
            raise
    return nothing


class _Loop(Struct):
    """The loop of questions and lemmas.

    Names of so many ``generations`` are put into facts, and of ``most`` where that is not enough.
    """

    start: Start
    step: Step
    again: Callable[[], Step]
    search: Search
    known: tuple[Claim, ...]
    generations: int = 1
    most: int = 3
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
                if self.generations == 1:
                    return ()
                # So many names are too much for the solver.
                self.generations = self.most = self.generations - 1
                self.step, hit = self.again(), doubtful
            elif self._is_worth_it(hit, left):
                here = configuration_of(
                    search.language,
                    self.step.world,
                    self.step.start,
                    self.step.asking.solver.model(),
                    self.generations - 1,
                )
                if search.is_met(here) and self._add(here):
                    continue
                if self.generations < self.most:
                    # Some other robot may be what is wrong with the configuration.
                    self.generations, doubtful = self.generations + 1, hit
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
        """Ask for a round that breaks something wanted, and what; if none, what else it takes."""
        used: set[Claim] = set()
        for moment in self.step.moments():
            found = self.step.counterexample(
                wanted, [*given, *self.known], moment, self.generations
            )
            if found[0] is not SolverAnswer.UNSAT:
                return found
            used |= found[1]
        return SolverAnswer.UNSAT, used - {*wanted, *self.known}

    def _add(self, here: Snapshot) -> bool:
        """Add lemmas that do not hold in a configuration; return whether there are any."""
        search, added = self.search, list[Disjunction]()
        for x in search.against(here):
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
