"""Systems with any number of robots: operations on all at once, and statements. [T-EVERY-N]"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import Configuration
from koord.semantics.domain import conjunction
from koord.semantics.expressions import statement
from koord.semantics.machine import Machine
from koord.semantics.oracle import Phase
from koord.semantics.statements import machine
from koord.semantics.storage import Many, Storage, Tree, held, many_of
from koord.semantics.values import scalar
from koord.syntax import core
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import INT, EnumType
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.functions import Functions, FunctionTerms, RobotInputs
from koord.verify.engines.every_n.instantiation import Book
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
    _extremes: dict[tuple[object, ...], Term] = field(default_factory=dict)

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

    def is_never(self, low: Term, index: Term, high: Term, condition: Term) -> bool:
        d = self.unknowns.terms
        if d.known(condition) is not None:
            return condition is False
        inside = self.book.between(low, index, high)
        return d.is_valid(self.book.implied(inside, d.unary(UnaryOp.NOT, condition)))

    def extreme(self, op: BinaryOp, low: Term, high: Term, body: Callable[[Term], Term]) -> Term:
        d, book = self.unknowns.terms, self.book
        said = book.said_of_any(low, high, body)
        if said is None:
            return self._extreme(op, low, high, body)
        key = op, *map(d.key, said)
        if key not in self._extremes:
            # What is the same for all robots is worked out once, and not of each.
            with book.about(said[-1]):
                self._extremes[key] = self._extreme(op, low, high, body)
            for term in said:
                book.keep(term)
        return self._extremes[key]

    def _extreme(self, op: BinaryOp, low: Term, high: Term, body: Callable[[Term], Term]) -> Term:
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
        from koord.verify.engines.every_n.loops import Facts, MachineLoop

        MachineLoop(Facts(self.book, self.sums, self.overlooked), m, low, high, body, span).run()


class ParameterisedSystem(Struct):
    """A program with a crowd of robots, and the facts known of it."""

    system: System
    book: Book
    unknowns: Functions
    crowd: Everyone

    @staticmethod
    def of(system: System, after: ParameterisedSystem | None = None) -> ParameterisedSystem:
        """Make the system of a program with any number of robots.

        Its terms have the context of another one, of which nothing is asked any more.
        """
        d, program = FunctionTerms(system.budget), system.program
        if after is not None:
            d.follow(after.d)
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
    def last(self) -> Term:
        """The greatest ``pid``."""
        return self.d.binary(BinaryOp.SUB, self.crowd.count, 1)

    def seat(self, kind: int, robot: Term) -> System:
        """The system in which one robot of a kind runs, as robot 0 of ``kinds``."""
        return replace(self.system, kinds=(kind,), crowd=replace(self.crowd, seated=robot))

    def naming(self, storage: Storage[Term]) -> Storage[Term]:
        """The storage; indices at which its arrays over robots are read become names."""
        if isinstance(storage, Many):
            element = storage.at

            def at(robot: Term) -> Storage[Term]:
                self.book.name(robot)
                return self.naming(element(robot))

            return many_of(storage.crowd, at)
        if isinstance(storage, Tree):
            return Tree(tuple(self.naming(part) for part in storage.parts))
        return storage

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


class Universal(Struct, frozen=True):
    """``forall x1, …, xk: body`` over robots: the slots and kinds of the x, and the body.

    A statement that holds of some robots and faults of none of them holds; so the quantifiers may
    be taken off one by one, and those over fixed ranges may come after them. [PROP-FAULT]
    """

    robots: tuple[tuple[int, int | None], ...]
    body: core.Expr
    bound: int

    @staticmethod
    def of(condition: core.Expr, bound: int) -> Universal:
        robots: list[tuple[int, int | None]] = []
        ranges: list[core.Quantified] = []
        body = condition
        while isinstance(body, core.Quantified) and body.quantifier is QuantifierKind.FORALL:
            if isinstance(body.domain, core.RobotRange):
                robots.append((body.variable.slot, body.domain.agent))
            elif _is_fixed(body.domain):
                ranges.append(body)
            else:
                break
            body = body.body
        for each in reversed(ranges):
            body = replace(each, body=body)
        return Universal(tuple(robots), body, bound)

    @property
    def arity(self) -> int:
        return len(self.robots)

    def of_robots(self, world: ParameterisedSystem, names: tuple[Term, ...]) -> Term:
        """The condition that the names are robots of the quantified kinds."""
        parts = []
        for name, (_, agent) in zip(names, self.robots, strict=True):
            parts.append(world.book.between(0, name, world.crowd.count))
            if agent is not None:
                parts.append(world.crowd.is_of(name, agent))
        return conjunction(world.d, parts)

    def holds(
        self,
        world: ParameterisedSystem,
        configuration: Configuration[Term],
        names: tuple[Term, ...],
    ) -> Term:
        """The condition that the body holds of some robots in a configuration. [PROP-INVARIANT]"""
        oracle = RobotInputs(world.unknowns, "check", None).oracle(Phase.CHECK, 0)
        m = machine(world.d, world.system, oracle, bound=self.bound, view=configuration)
        for name, (slot, _) in zip(names, self.robots, strict=True):
            m.memory.bound[slot] = held(world.d, name)
        truth = statement(m, self.body)
        for needed in m.legality:
            # Of functions, which are the same everywhere: nothing else may be open in a statement.
            world.book.note(needed.condition)
        return truth

    def suppose(
        self, world: ParameterisedSystem, configuration: Configuration[Term], when: Term
    ) -> None:
        """Assume the statement of a configuration from now on, where ``when`` holds."""

        def says(names: tuple[Term, ...]) -> Term:
            applies = conjunction(world.d, [when, self.of_robots(world, names)])
            return world.book.implied(applies, self.holds(world, configuration, names))

        world.book.state(self.arity, says)

    def broken(
        self,
        world: ParameterisedSystem,
        configuration: Configuration[Term],
        names: tuple[Term, ...],
    ) -> Term:
        """The condition that some robots break the statement."""
        fails = world.d.unary(UnaryOp.NOT, self.holds(world, configuration, names))
        return conjunction(world.d, [self.of_robots(world, names), fails])


def _is_fixed(domain: core.QuantifierDomain) -> bool:
    """Return whether a quantifier is over integers between two constants."""
    return (
        isinstance(domain, core.IntRange)
        and isinstance(domain.low, core.Const)
        and isinstance(domain.high, core.Const)
    )
