"""Lemmas that a proof of progress lacks: found from what speaks against it. [T-PROGRESS]

A configuration in which a claim is pending and nobody helps, or from which a round makes a measure
grow, may be none that is ever reached. What held in all samples of small systems and does not hold
in it is tried as an invariant: disjunctions of literals, as for claims about configurations, often
that *there is* a robot in some state; and that of the numbers from one shared variable to another
some robot has each. What is inductive is proved by itself, before anything rests on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice, permutations, product

from msgspec import Struct, field

from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.core import BinaryOp, PropertyKind, QuantifierKind
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import System
from koord.syntax.types import BOOL, IntType
from koord.syntax.walk import renamed
from koord.verify.claims import Claim, ClaimKind
from koord.verify.engines.every_n.bound import FREE_SLOT, I, K, M
from koord.verify.engines.every_n.conditions import value_in
from koord.verify.engines.every_n.disjunctions import Disjunction
from koord.verify.engines.every_n.lemma_search import Search, infer_from_counterexamples, searched
from koord.verify.engines.every_n.literals import OF_I, Existence, Literal, Snapshot
from koord.verify.engines.every_n.parts import Part
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import Means, Start, Step

#: So many disjunctions are tried at once against a configuration.
_AT_ONCE = 24

#: Who is there may be robot 0, or the neighbour of one: names of the second generation.
_LOOKED_AHEAD = 2

#: So many of those that need lemmas themselves are looked at.
_MOST_HELPED = 2


class Lemmas(Struct):
    """The lemmas found for proofs of progress of a system; ``known`` held before.

    ``found`` hold in every round of every number of robots, and so do the known ones.
    """

    system: System
    known: tuple[Claim, ...]
    means: Means
    search: Search
    found: list[Claim] = field(default_factory=list)
    _tried: set[str] = field(default_factory=set)

    @staticmethod
    def of(system: System, known: Sequence[Claim], means: Means) -> Lemmas | None:
        """Prepare the search; None where there is nothing to say about a program."""
        search = searched(system, system.budget, means.seed, somebody=True)
        return None if search is None else Lemmas(system, tuple(known), means, search)

    def against(self, here: Snapshot) -> bool:
        """Find lemmas that a configuration does not meet; return whether there are any."""
        try:
            # Where robots draw numbers nothing else is worth looking at before.
            new = self._helped(list(self._each_number()))
            if not new:
                new = self._inductive(list(islice(self._likely(here), _AT_ONCE)))
        except (NotFiniteError, OutOfBudgetError):
            return False
        self.found += new
        return bool(new)

    def naturals(self, differences: Sequence[tuple[core.Each, core.Expr, core.Binary]]) -> bool:
        """Find that differences are no negative numbers while a claim is pending, if they are.

        Each is of the robots that a claim means, with what holds of them while it is pending.
        """
        likely: list[tuple[core.Expr, int]] = []
        for each, pending, difference in differences:
            robots = core.RobotRange(each.agent)
            ordered = core.Binary(BinaryOp.LE, difference.right, difference.left, BOOL)
            body = core.Binary(BinaryOp.IMPLIES, pending, ordered, BOOL)
            said = core.Quantified(QuantifierKind.FORALL, each.variable, robots, body)
            likely.append((said, max(FREE_SLOT, each.variable.slot + 1)))
        return self.by_themselves(likely)

    def together(self, likely: Sequence[tuple[core.Expr, int]]) -> bool:
        """Find that statements hold, with each other only; return whether some do."""
        met = self._met(likely)
        new = self.proved(met) if met else []
        self.found += new
        return bool(new)

    def by_themselves(self, likely: Sequence[tuple[core.Expr, int]]) -> bool:
        """Find that statements hold, each with lemmas of its own; return whether some do.

        Each comes with how many variables are bound in it. Samples are asked first.
        """
        met, before = self._met(likely), len(self.found)
        try:
            for claim in met:
                # What was found for one is known of the next.
                self.found += self._helped([claim])
        except (NotFiniteError, OutOfBudgetError):
            pass
        return len(self.found) > before

    def _met(self, likely: Sequence[tuple[core.Expr, int]]) -> list[Claim]:
        """The statements that hold in all samples, as claims."""
        claims = (self._stated(said, bound) for said, bound in likely)
        return [claim for claim in claims if claim is not None and self._is_met(claim)]

    def _is_met(self, claim: Claim) -> bool:
        """Return whether a statement holds in all samples."""
        assert claim.stated is not None
        said = claim.stated
        return all(
            value_in(each.system, each.configuration, said.condition, said.bound) is True
            for each in self.search.reached
        )

    def _stated(self, said: core.Expr, bound: int) -> Claim | None:
        """The claim that a statement holds in every round; None if it was tried before."""
        text = Quoting.of(self.system.program).text(said)
        if text in self._tried:
            return None
        self._tried.add(text)
        stated = core.Property(text, PropertyKind.INVARIANT, said, bound)
        return Claim(text, ClaimKind.PROPERTY, stated)

    @property
    def given(self) -> list[Claim]:
        """All that holds in every round."""
        return [*self.known, *self.found]

    def _likely(self, here: Snapshot) -> Iterator[Claim]:
        """Yield what may be a lemma against a configuration, the simplest first."""
        search = self.search
        # That somebody is there is what is missing most often.
        there = search.sorted_(search.samples.of_nobody(here, search.budget))
        first = [x for x in there if self._asks_for_somebody(x)][: _AT_ONCE // 2]
        for x in dict.fromkeys([*first, *search.against(here, 3)]):
            claim = search.lemma(x)
            if claim.name not in self._tried:
                self._tried.add(claim.name)
                yield claim

    def _asks_for_somebody(self, x: Disjunction) -> bool:
        return any(isinstance(self.search.language.literals[n], Existence) for n in x)

    def _inductive(self, likely: Sequence[Claim]) -> list[Claim]:
        """The first of some statements that is inductive, and those that it rests on."""
        if not likely:
            return []
        start = Start(self.system, self.means)
        likely = start.sifted(likely, _LOOKED_AHEAD)
        step = Step(self.system, self.means)
        left = step.sifted([*self.given, *likely], _LOOKED_AHEAD)
        held = [claim for claim in likely if claim in left]
        if not held or start.limits or step.limits:
            return self._helped(likely[:_MOST_HELPED])
        best, *others = held
        return self.proved([best, *step.lemmas([best], others)])

    def _helped(self, likely: Sequence[Claim]) -> list[Claim]:
        """The first of some statements that is inductive with lemmas of its own, and these."""
        for claim in likely:
            effort, thrift = self.means.effort, self.means.thrift
            found = infer_from_counterexamples(
                self.system, [claim], self.given, self.means.deadline, effort, thrift
            )
            if found.proved:
                others = [x for x in found.invariants if x not in self.given]
                return self.proved([claim, *others])
        return []

    def proved(self, claims: Sequence[Claim]) -> list[Claim]:
        """Those of some statements that hold of every number of robots, by a proof of them."""
        means = self.means
        shown = prove(
            self.system, [*self.given, *claims], means.deadline, means.effort, means.thrift
        )
        return [claim for claim in claims if claim in shown.proved]

    # --- a robot for each number ----------------------------------------------------------------

    def _each_number(self) -> Iterator[Claim]:
        """Yield that of the numbers from one shared variable to another some robot has each.

        As with tickets: of those that were drawn and not served yet. It holds in all samples, and
        says something in some.
        """
        search = self.search
        language = search.language
        states = [x for x in language.literals if isinstance(x, Literal) and x.of == OF_I]
        ends = [n for n, part in enumerate(language.shared) if _is_number(part)]
        for (low, high), n in product(permutations(ends, 2), range(len(language.own))):
            if not _is_number(language.own[n]):
                continue
            for state in states:
                if state.cost <= 2 and self._has_each(low, high, n, state):
                    claim = self._stated(self._each(low, high, n, state), FREE_SLOT)
                    if claim is not None:
                        yield claim

    def _has_each(self, low: int, high: int, n: int, state: Literal) -> bool:
        said = False
        for here in self.search.snapshots:
            first, last = here.shared[low], here.shared[high]
            if not isinstance(first, int) or not isinstance(last, int):
                return False
            said = said or first + 1 < last
            having = {
                held[n]
                for robot, held in here.robots.items()
                if state.look(here, (robot, None, None, 0)) is True
            }
            if not having.issuperset(range(first, last)):
                return False
        return said

    def _each(self, low: int, high: int, n: int, state: Literal) -> core.Expr:
        language = self.search.language
        someone = core.Read(core.Place(M))
        has = core.Binary(BinaryOp.EQ, language.own[n].at(someone), core.Read(core.Place(K)), BOOL)
        both = core.Binary(BinaryOp.AND, has, renamed(state.said(), I, M), BOOL)
        there = core.Quantified(QuantifierKind.EXISTS, M, core.RobotRange(), both)
        numbers = core.IntRange(language.shared[low].at(None), language.shared[high].at(None))
        return core.Quantified(QuantifierKind.FORALL, K, numbers, there)


def _is_number(part: Part) -> bool:
    return isinstance(part.type, IntType) and part.size is None
