"""Proofs about whole runs for certificates: found, and written in Koord. [T-PROGRESS]

Each part is written as an invariant about the robots that it is about, which is how ``recheck``
reads it; it is no invariant.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import chain, count

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind
from koord.syntax.printing.quoting import Quoting
from koord.syntax.system import System
from koord.syntax.types import BOOL, FLOAT, INT
from koord.syntax.walk import nodes, renamed
from koord.verify import certificate_form as forms
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.every_n.progress import ProgressProof, progress
from koord.verify.engines.every_n.progress_least import Least
from koord.verify.engines.every_n.progress_parts import (
    MEANT,
    ROBOT,
    Help,
    Measure,
    Phrase,
    lemmas_of,
)
from koord.verify.engines.every_n.progress_reduction import ReducedProof, reduced
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import GENEROUS, Means


class FoundProgress(Struct, frozen=True):
    """Proofs of claims about whole runs, and the invariants that they rest on.

    ``everyone`` are claims that hold for every number of robots, ``lemmas`` what was found beside.
    """

    proofs: dict[Claim, ProgressProof]
    everyone: tuple[Claim, ...] = ()
    lemmas: tuple[core.Property, ...] = ()


def find_progress(
    system: System,
    of_runs: Sequence[Claim],
    holding: Sequence[Claim],
    known: Sequence[Claim],
    deadline: Deadline,
) -> FoundProgress:
    """Find proofs of claims about whole runs, with as few invariants as they need.

    ``known`` holds for every number of robots; others of what is ``holding`` may do.
    """
    search = _Search(system, deadline)
    proofs = search.proofs(of_runs, (), infer=False)
    if left := [claim for claim in of_runs if claim not in proofs]:
        proofs |= search.proofs(left, search.known(holding, known), infer=True)
    invariants = dict.fromkeys(one for proof in proofs.values() for one in proof.invariants)
    lemmas = (c.stated for c in invariants if c not in holding and c.stated is not None)
    return FoundProgress(
        {claim: proof.proof for claim, proof in proofs.items()},
        tuple(claim for claim in invariants if claim in holding),
        tuple(replace(lemma, name="") for lemma in lemmas),
    )


class _Search(Struct, frozen=True):
    """A search for proofs, with means of its own for each question."""

    system: System
    deadline: Deadline

    def proofs(
        self, claims: Sequence[Claim], known: Sequence[Claim], *, infer: bool
    ) -> dict[Claim, ReducedProof]:
        """Proofs of those claims for which one is found in time."""
        found = {}
        for claim in claims:
            if not self.deadline.passed() and (proof := self._proof(claim, known, infer=infer)):
                found[claim] = proof
        return found

    def _proof(self, claim: Claim, known: Sequence[Claim], *, infer: bool) -> ReducedProof | None:
        """A proof of a claim, with what it needs of what is known and of lemmas."""
        assert claim.stated is not None
        found = progress(self.system, claim.stated, known, self._means(), infer=infer)
        if not isinstance(found, ProgressProof):
            return None
        lemmas = [
            Claim(f"of {claim.name} {k}", ClaimKind.PROPERTY, lemma)
            for k, lemma in enumerate(found.lemmas)
        ]
        return reduced(self.system, claim, found, [*known, *lemmas], self._means())

    def known(self, holding: Sequence[Claim], known: Sequence[Claim]) -> list[Claim]:
        """What is known, and what can be shown of every number of robots by itself."""
        others = [claim for claim in holding if claim not in known]
        shown = self._proved(others, known)
        found = [*known, *(claim for claim in shown if claim.is_state_property)]
        likely = [
            Claim(f"lemma {k}", ClaimKind.PROPERTY, stated)
            for k, stated in enumerate(lemmas_of(self.system.program))
        ]
        return [*found, *self._proved(likely, found)]

    def _proved(self, claims: Sequence[Claim], known: Sequence[Claim]) -> Sequence[Claim]:
        if not claims:
            return ()
        means = self._means()
        budget = means.deadline, means.effort, means.thrift
        return prove(self.system, claims, *budget, known=known).proved

    def _means(self) -> Means:
        return Means(self.deadline, Effort.of_seconds(GENEROUS.seconds), GENEROUS, 0)


# --- in Koord -------------------------------------------------------------------------------------


def written(program: core.Program, claim: Claim, proof: ProgressProof) -> forms.Progress:
    """Write a proof of a claim."""
    assert claim.stated is not None
    return _Writing(program, Quoting.of(program), claim.stated).proof(claim.name, proof)


class _Writing(Struct, frozen=True):
    program: core.Program
    quoting: Quoting
    stated: core.Property

    def proof(self, name: str, proof: ProgressProof) -> forms.Progress:
        return forms.Progress(
            claim=name,
            lasting=[self._lasting(said) for said in proof.lasting],
            order=[
                forms.Settling(text="", every_robot=False, number=False, lock_class=part)
                if isinstance(part, int)
                else self._measure(part)
                for part in proof.order
            ],
            help=[self._help(way, unmoved=way in proof.unmoved) for way in proof.help],
            first=[self._first(least) for least in proof.least],
        )

    def _lasting(self, said: core.Expr) -> str:
        each = self.stated.each
        if each is not None:
            said = renamed(said, each.variable, MEANT)
        return self._text(said, None)

    def _measure(self, measure: Measure) -> forms.Settling:
        said = measure.term.said
        number = said.type == INT
        text = self._text(_behind_zero(said) if number else said, measure.each)
        return forms.Settling(
            text=text, every_robot=measure.each is not None, number=number, lock_class=None
        )

    def _first(self, least: Least) -> forms.First:
        robots = core.RobotRange()
        return forms.First(
            state=self._text(least.state.said, robots),
            number=self._text(_behind_zero(least.number.said), robots),
        )

    def _help(self, way: Help, *, unmoved: bool) -> forms.Help:
        expectations = self.program.expectations
        return forms.Help(
            kind=way.kind.value,
            state=self._text(self._of_robot(way.state), way.each),
            assumption="" if way.expectation is None else expectations[way.expectation].name,
            falls=""
            if way.falls is None
            else self._text(_behind_zero(self._of_robot(way.falls)), way.each),
            unmoved=unmoved,
        )

    def _of_robot(self, phrase: Phrase) -> core.Expr:
        """A phrase of the robot that helps, however its variable is called."""
        own = (
            node
            for node in nodes(phrase.said)
            if isinstance(node, core.Variable)
            and node.home is Home.BOUND
            and node.slot == phrase.robot
        )
        said: core.Expr = phrase.said
        for variable in dict.fromkeys(own):
            said = renamed(said, variable, ROBOT)
        return said

    def _text(self, said: core.Expr, each: core.RobotRange | None) -> str:
        """A statement as an invariant, of all the robots that it is about."""
        variables = (
            node for node in nodes((said, self.program)) if isinstance(node, core.Variable)
        )
        taken = {variable.name for variable in variables if variable not in (ROBOT, MEANT)}
        meant = self.stated.each
        if meant is not None:
            said = _of_all(said, MEANT, core.RobotRange(meant.agent), taken)
        if each is not None:
            said = _of_all(said, ROBOT, each, taken)
        return self.quoting.invariant(core.Property("", core.PropertyKind.INVARIANT, said, 0), "It")


def _of_all(
    said: core.Expr, robot: core.Variable, each: core.RobotRange, taken: set[str]
) -> core.Expr:
    """Say something of all robots of a kind, by a name that nothing else has."""
    names = chain([robot.name], (f"{robot.name}{k}" for k in count(1)))
    called = replace(robot, name=next(name for name in names if name not in taken))
    return core.Quantified(QuantifierKind.FORALL, called, each, renamed(said, robot, called))


def _behind_zero(number: core.Expr) -> core.Expr:
    """The statement ``0 <= number``, which tells what the number is."""
    zero = core.Const(0, INT) if number.type == INT else core.Const(Fraction(0), FLOAT)
    return core.Binary(BinaryOp.LE, zero, number, BOOL)
