"""Meaning of proofs of progress in certificates: their texts, beside the program.

Each text is an invariant of Koord, which begins with the robots that it is about: any robot, where
it is of each by itself, and then the one that the claim means, if it means one. A number stands
behind ``0 <=``. What does not look so is damage.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.recheck.certificate import REWRITE, Certificate, HelpText, ProgressText
from koord.recheck.claims import Claim, ClaimKind
from koord.recheck.meaning import (
    INVARIANTS,
    CertifiedProblem,
    conjuncts_of,
    elaborated,
    one_invariant,
)
from koord.recheck.progress_argument import (
    First,
    Help,
    HelpKind,
    LockClass,
    Measure,
    Phrase,
    ProgressArgument,
)
from koord.recheck.reading import is_plain
from koord.recheck.world import Instance
from koord.syntax import ast, core
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.printing.program import Stated, with_invariants
from koord.syntax.types import BOOL, FLOAT, INT, Type

#: Texts of invariants by what they are called.
_Texts = dict[str, Stated[ast.Invariant]]


class ProgressArguments(Struct, frozen=True):
    """The proofs of a certificate about whole runs: of any number of robots, with the invariant."""

    world: Instance
    claims: tuple[Claim, ...]
    proofs: tuple[ProgressArgument, ...]


def progress_arguments(
    certificate: Certificate, about: CertifiedProblem
) -> ProgressArguments | None:
    """The proofs about whole runs, if there are any. Raises KoordError, and NotRecheckedError."""
    claimed = [one for one in certificate.claims if one.kind is ClaimKind.LIVENESS]
    proofs = {proof.claim: proof for proof in certificate.progress}
    if len(proofs) != len(certificate.progress):
        raise _damage(certificate, "a claim about whole runs is proved twice")
    if [one.name for one in claimed] != list(proofs):
        raise _damage(certificate, "the claims about whole runs are not those that are proved")
    if not proofs:
        return None
    if not all(one.everyone for one in claimed):
        raise _damage(certificate, "a proof about whole runs is for every number of robots")
    invariant = list(zip(certificate.invariant, conjuncts_of(certificate), strict=True))
    beside = [(f"conjunct {c.name}", text) for c, text in invariant if c.everyone]
    parts = [part for proof in proofs.values() for part in _parts(certificate, proof).items()]
    sections = with_invariants(about.sections, [*beside, *parts], of_runs=True)
    program = elaborated(certificate, sections)
    by_name = {stated.name: stated for stated in program.properties}
    claims = (
        Claim(c.name, ClaimKind.STATEMENT, by_name[f"conjunct {c.name}"])
        for c in certificate.invariant
        if c.everyone
    )
    read = (_Reading(certificate, program, by_name, p).argument() for p in proofs.values())
    world = Instance(program, (), certificate.delta_s)
    return ProgressArguments(world, tuple(claims), tuple(read))


def _parts(certificate: Certificate, proof: ProgressText) -> _Texts:
    """The texts of a proof, parsed, by what they are called."""
    texts = dict(_texts(proof))
    parsed = {name: one_invariant(certificate.name, name, text) for name, text in texts.items()}
    for name, one in parsed.items():
        if one.agent is not None:
            raise _damage(certificate, f"{name} stands in a block of a kind of robot")
    return parsed


def _texts(proof: ProgressText) -> Iterator[tuple[str, str]]:
    for k, text in enumerate(proof.lasting, start=1):
        yield _called(proof, "what lasts", k), text
    for k, one in enumerate(proof.order, start=1):
        if one.lock_class is None:
            yield _called(proof, "measure", k), one.text
    for k, way in enumerate(proof.help, start=1):
        yield _called(proof, "help", k), way.state
        if way.falls:
            yield _called(proof, "what falls", k), way.falls
    for k, first in enumerate(proof.first, start=1):
        yield _called(proof, "who is first", k), first.state
        yield _called(proof, "what number is first", k), first.number


def _called(proof: ProgressText, what: str, number: int) -> str:
    return f"{what} {number} of {proof.claim}"


class _Reading(Struct):
    """The reading of one proof."""

    certificate: Certificate
    program: core.Program
    by_name: dict[str, core.Property]
    proof: ProgressText

    def argument(self) -> ProgressArgument:
        stated = self.stated()
        return ProgressArgument(
            stated,
            tuple(
                self.phrase("what lasts", k, stated, each=False)
                for k, _ in enumerate(self.proof.lasting, start=1)
            ),
            tuple(self.order(stated)),
            tuple(self.help(stated, k, way) for k, way in enumerate(self.proof.help, start=1)),
            tuple(self.first(stated, k) for k, _ in enumerate(self.proof.first, start=1)),
        )

    def stated(self) -> core.Property:
        """The claim, as the program has it."""
        for stated in self.program.properties:
            if stated.name == self.proof.claim and stated.kind not in INVARIANTS:
                return stated
        raise self.damage(f"the program claims no {self.proof.claim!r} of whole runs")

    def order(self, stated: core.Property) -> Iterator[Measure | LockClass]:
        """The measures and lock classes. Locks are asked for by the robot that is meant."""
        for k, one in enumerate(self.proof.order, start=1):
            if one.lock_class is None:
                number = INT if one.number else None
                yield Measure(
                    self.phrase("measure", k, stated, each=one.every_robot, number=number)
                )
                continue
            if stated.each is None:
                raise self.damage("locks are granted to nobody where no robot is meant")
            if one.lock_class >= len(self.program.lock_classes):
                raise self.damage(f"there is no lock class {one.lock_class}")
            yield LockClass(one.lock_class)

    def help(self, stated: core.Property, k: int, way: HelpText) -> Help:
        state = self.phrase("help", k, stated, each=True)
        timed = way.kind is HelpKind.TIME
        owed = way.kind in (HelpKind.EXPECTED, HelpKind.AFTER_RUN)
        if timed != bool(way.falls) or owed != bool(way.assumption):
            raise self.damage(f"help {k} does not name what its kind rests on")
        expected = self.expected(way.assumption, state.kind) if owed else None
        falls = None
        if timed:
            falls = self.phrase("what falls", k, stated, each=True, number=FLOAT)
            if falls.kind != state.kind:
                raise self.damage(f"help {k} is of other robots than what falls")
        if way.unmoved and way.kind is not HelpKind.ROBOT:
            raise self.damage(f"help {k} rests on more than that nothing moves")
        return Help(way.kind, state, expected, falls, way.unmoved)

    def first(self, stated: core.Property, k: int) -> First:
        """Who is the first: of robots of one kind, by what stands in variables alone."""
        state = self.phrase("who is first", k, stated, each=True)
        number = self.phrase("what number is first", k, stated, each=True, number=INT)
        if number.kind != state.kind:
            raise self.damage(f"the first {k} are other robots than those that have a number")
        if not (is_plain(state.said) and is_plain(number.said)):
            raise self.damage(f"who is first {k} hangs on more than variables")
        return First(state, number)

    def expected(self, name: str, kind: int | None) -> core.Property:
        """An assumption about whole runs, of each robot of a kind at least."""
        for expected in self.program.expectations:
            if expected.name == name:
                if expected.each is None or expected.trigger is None:
                    raise self.damage(f"{name!r} is not expected of each robot by itself")
                if expected.each.agent not in (None, kind):
                    raise self.damage(f"{name!r} is expected of other robots")
                return expected
        raise self.damage(f"the program does not assume {name!r} of whole runs")

    def phrase(
        self,
        what: str,
        number_: int,
        stated: core.Property,
        *,
        each: bool,
        number: Type | None = None,
    ) -> Phrase:
        """A statement, or a number of some type, behind the robots that it is about."""
        called = _called(self.proof, what, number_)
        found = self.by_name[called]
        said, robot, kind, meant = found.condition, None, None, None
        if each:
            robot, kind, said = self.robots(called, said)
        if stated.each is not None:
            meant, agent, said = self.robots(called, said)
            if agent != stated.each.agent:
                raise self.damage(f"{called} means another kind of robot than the claim")
        if number is not None:
            said = self.behind_zero(called, said, number)
        elif said.type != BOOL:
            raise self.damage(f"{called} is no statement")
        return Phrase(said, found.bound, robot, meant, kind)

    def robots(self, called: str, said: core.Expr) -> tuple[int, int | None, core.Expr]:
        """The slot and the kind of the robots that a text begins with, and what it says of them."""
        if (
            isinstance(said, core.Quantified)
            and said.quantifier is QuantifierKind.FORALL
            and isinstance(said.domain, core.RobotRange)
        ):
            return said.variable.slot, said.domain.agent, said.body
        raise self.damage(f"{called} does not begin with the robots that it is about")

    def behind_zero(self, called: str, said: core.Expr, type_: Type) -> core.Expr:
        """The number in ``0 <= number``."""
        if (
            isinstance(said, core.Binary)
            and said.op is BinaryOp.LE
            and said.right.type == type_
            and _is_zero(said.left)
        ):
            return said.right
        raise self.damage(f"{called} is no number behind `0 <=`")

    def damage(self, story: str) -> KoordError:
        return _damage(self.certificate, story)


def _is_zero(e: core.Expr) -> bool:
    if isinstance(e, core.Unary) and e.op is UnaryOp.WIDEN:
        e = e.operand
    return isinstance(e, core.Const) and e.value == 0 and e.value is not False


def _damage(certificate: Certificate, story: str) -> KoordError:
    return refusal("K941", certificate.name, story, REWRITE)
