"""The crowd of a system of unknown size: operations on all robots at once. [T-EVERY-N]"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.domain import conjunction
from koord.semantics.machine import Machine
from koord.semantics.values import scalar
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import INT, EnumType
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.functions import Functions, FunctionTerms
from koord.verify.engines.every_n.instantiation import Book
from koord.verify.engines.every_n.loops import Facts, MachineLoop
from koord.verify.engines.every_n.sums import Sums


class Everyone(Struct):
    """A crowd. ``count`` is the unknown number of robots, at least one.

    ``overlooked`` are loops that were not understood: what they change may then be anything.
    """

    book: Book
    unknowns: Functions
    program: core.Program
    count: Term
    sums: Sums
    seated: Term | None = None
    overlooked: list[Span] = field(default_factory=list)

    @property
    def first(self) -> Term:
        return 0

    def pid(self, robot: int) -> Term:
        assert self.seated is not None
        return self.seated

    def is_of(self, index: Term, kind: int) -> Term:
        if len(self.program.agents) == 1:
            return True
        d = self.unknowns.terms
        names = tuple(agent.name for agent in self.program.agents)
        with d.depending_on((index,)):
            its_kind = scalar(self.unknowns.value("kind", EnumType("kind", names)))
        return d.binary(BinaryOp.EQ, its_kind, d.const(kind, INT))

    def assume(self, fact: Term) -> None:
        self.book.note(fact)

    def every(self, low: Term, high: Term, body: Callable[[Term], Term]) -> Term:
        return self.book.every(low, high, body)

    def extreme(self, op: BinaryOp, low: Term, high: Term, body: Callable[[Term], Term]) -> Term:
        d, book = self.unknowns.terms, self.book
        best = d.fresh_like("extreme", book.glimpse(body))
        witness = d.fresh("witness", INT)
        book.name(witness)
        some = d.binary(BinaryOp.LT, low, high)
        there = book.between(low, witness, high)
        same = d.binary(BinaryOp.EQ, best, body(witness))
        book.note(book.implied(some, d.binary(BinaryOp.AND, there, same)))

        def says(names: tuple[Term, ...]) -> Term:
            other = body(names[0])
            pair = (best, other) if op is BinaryOp.MIN else (other, best)
            inside = book.between(low, names[0], high)
            return book.implied(inside, d.binary(BinaryOp.LE, *pair))

        book.state(1, says)
        return best

    def summed(self, low: Term, high: Term, body: Callable[[Term], Term]) -> Term:
        """The sum of a number over the robots."""
        return self.sums.of(low, high, body)

    def loop(
        self,
        m: Machine[Term],
        low: Term,
        high: Term,
        body: Callable[[Machine[Term], Term], None],
        span: Span,
    ) -> None:
        MachineLoop(Facts(self.book, self.sums, self.overlooked), m, low, high, body, span).run()


class ParameterisedSystem(Struct):
    """A program with a crowd of robots, and the facts known of it."""

    system: System
    book: Book
    unknowns: Functions
    crowd: Everyone

    @staticmethod
    def of(system: System) -> ParameterisedSystem:
        """Make the system of a program with any number of robots."""
        d, program = FunctionTerms(system.budget), system.program
        unknowns = Functions(d, program, 0)
        book = Book(unknowns)
        count = d.fresh("N", INT)
        book.note(d.binary(BinaryOp.LE, 1, count))
        crowd = Everyone(book, unknowns, program, count, Sums(book))
        unknowns.crowd = crowd
        return ParameterisedSystem(replace(system, kinds=(), crowd=crowd), book, unknowns, crowd)

    @property
    def d(self) -> FunctionTerms:
        return self.unknowns.terms

    @property
    def everywhere(self) -> System:
        """The system in which properties are evaluated: no robot runs."""
        return self.system

    @property
    def last(self) -> Term:
        """The greatest ``pid``."""
        return self.d.binary(BinaryOp.SUB, self.crowd.count, 1)

    def seat(self, kind: int, robot: Term) -> System:
        """The system in which one robot of a kind runs, as robot 0 of ``kinds``."""
        return replace(self.system, kinds=(kind,), crowd=replace(self.crowd, seated=robot))

    @property
    def program(self) -> core.Program:
        return self.system.program

    def cases(self, index: Term) -> list[tuple[int, Term]]:
        """The kinds that a robot may be of, each with the condition that it is."""
        there = self.book.between(0, index, self.crowd.count)
        return [
            (kind, conjunction(self.d, [there, self.crowd.is_of(index, kind)]))
            for kind in range(len(self.program.agents))
        ]
