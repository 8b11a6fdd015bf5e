"""Smaller proofs of progress: what the premises of the theorem do not need is left out.

A search takes whatever settles and whoever helps. What it found is asked once more, premise by
premise, and of each it is told what it takes: measures and lock classes before it, and invariants.
Backwards from who helps, only what is taken is kept. [T-PROGRESS]
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System
from koord.verify.claims import Claim
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.progress import ProgressProof, without_promises
from koord.verify.engines.every_n.progress_least import read_by
from koord.verify.engines.every_n.progress_parts import Help
from koord.verify.engines.every_n.progress_questions import RoundQuestions, StateQuestion
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import Means, Step

#: How many generations of names are known where it is asked what invariants rest on.
_GENERATIONS = 2


class ReducedProof(Struct, frozen=True):
    """A proof of progress, and the invariants that it rests on, which prove themselves."""

    proof: ProgressProof
    invariants: tuple[Claim, ...]


def reduced(
    system: System, claim: Claim, proof: ProgressProof, known: Sequence[Claim], means: Means
) -> ReducedProof | None:
    """The part of a proof that is needed, if that is seen; ``known`` is what it may rest on."""
    assert claim.stated is not None
    bare = replace(system, program=without_promises(system.program))
    try:
        taken: set[Claim] = set()
        state = StateQuestion(bare, claim.stated, known, means, apart=True)
        found = state.taken(proof.help, proof.lasting, proof.locks)
        if found is None:
            return None
        ways, locks = found.ways, found.locks
        taken |= set(found.known)
        rounds = _Rounds(RoundQuestions(bare, claim.stated, known, means), known)
        order = rounds.order(proof, ways, locks, taken)
        if order is None:
            return None
        needed = [each for each in known if each in taken]
        kept = _closed(system, needed, [each for each in known if each not in taken], means)
    except NotFiniteError:
        return None
    if kept is None:
        return None
    small = replace(
        proof,
        order=tuple(proof.order[k] for k in sorted(order)),
        help=tuple(proof.help[k] for k in sorted(ways)),
        unmoved=tuple(proof.help[k] for k in ways if proof.help[k] in proof.unmoved),
        least=tuple(found.least),
    )
    return ReducedProof(small, tuple(kept))


class _Rounds:
    """The premises about rounds, with what each of them takes."""

    def __init__(self, questions: RoundQuestions, known: Sequence[Claim]) -> None:
        self.questions, self.known = questions, known

    def order(
        self, proof: ProgressProof, ways: Sequence[int], locks: Sequence[int], taken: set[Claim]
    ) -> set[int] | None:
        """The positions in the order that are needed; invariants are added to what is taken."""
        questions = self.questions
        for said in proof.lasting:
            positions = self._taken(questions.open_round(proof.lasting), questions.ends(said))
            if positions is None:
                return None
            taken |= {self.known[p] for p in positions if p < len(self.known)}
        questions.pend(proof.lasting)
        base = len(questions.given)
        starts: list[int] = []
        before: list[frozenset[int]] = []
        for part in proof.order:
            starts.append(len(questions.given))
            goal = questions.vain(part) if isinstance(part, int) else questions.grows(part)
            positions = self._taken(questions.given, goal)
            if positions is None:
                return None
            before.append(positions)
            if isinstance(part, int):
                questions.ask_no_more(part)
            else:
                questions.keep(part)

        def parts_of(positions: frozenset[int]) -> set[int]:
            return {max(k for k, s in enumerate(starts) if s <= p) for p in positions if p >= base}

        needed = {k for k, part in enumerate(proof.order) if part in locks}
        all_taken = set[int]()
        for k in ways:
            positions = self._taken_to_help(proof.help[k], unmoved=proof.help[k] in proof.unmoved)
            if positions is None:
                return None
            all_taken |= positions
            needed |= parts_of(positions)
        for k in reversed(range(len(proof.order))):
            if k in needed:
                all_taken |= before[k]
                needed |= parts_of(before[k])
        taken |= {self.known[p] for p in all_taken if p < len(self.known)}
        return needed

    def _taken_to_help(self, way: Help, *, unmoved: bool) -> frozenset[int] | None:
        """The positions in what is given by which help is not refused."""
        questions = self.questions
        goals = [questions.refused(way)]
        if unmoved:
            reads = read_by(questions.program, way) or ()
            goals = [questions.refused_unmoved(way), *map(questions.differs, reads)]
        found: set[int] = set()
        for goal in goals:
            positions = self._taken(questions.given, goal)
            if positions is None:
                return None
            found |= positions
        return frozenset(found)

    def _taken(self, given: Sequence[Term], goal: Term) -> frozenset[int] | None:
        """The positions in what is given that refute a goal; None if nothing does."""
        found = self.questions.step.asking.fewest([*given, goal], len(self.known))
        return None if found is None else found - {len(given)}


def _closed(
    system: System, needed: Sequence[Claim], others: Sequence[Claim], means: Means
) -> list[Claim] | None:
    """Invariants that are needed, with those that their own proofs rest on."""
    if not needed:
        return []
    step = Step(system, means)
    step.asking.look_ahead(_GENERATIONS)
    kept = [*needed, *step.lemmas(needed, others)]
    for invariants in (kept, [*needed, *others]):
        shown = prove(system, invariants, means.deadline, means.effort, means.thrift, means.seed)
        if len(shown.proved) == len(invariants):
            return invariants
    return None
