"""Uninterpreted functions of a robot's number: one symbol for the values of all robots."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from msgspec import Struct

from koord.semantics.every_number import Crowd, NotFiniteError
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.storage import Many, Storage, many_of
from koord.semantics.values import Family, Value, family_of, scalar
from koord.syntax import core
from koord.syntax.analysis.footprint import WriteExtent
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.core import Home
from koord.syntax.source import NOWHERE
from koord.syntax.types import INT, ArrayType, Robots, Type
from koord.verify.encoding.terms import Made, Term, Terms
from koord.verify.encoding.unknowns import Unknowns


class FunctionTerms(Terms):
    """Z3 terms of which fresh ones may be functions of others.

    ``arguments`` are what named unknowns are functions of at the moment; ``open`` are the blanks
    that everything new depends on otherwise.
    """

    def __init__(self, budget: Budget = ENDLESS) -> None:
        super().__init__(budget)
        self.arguments: tuple[Term, ...] | None = None
        self.open: tuple[Term, ...] = ()

    def fresh(self, name: str, type_: Type) -> Made:
        """A fresh term, or an application of the function of that name to the present arguments."""
        if self.arguments is not None:
            return self.applied(name, self.arguments, type_)
        if self.open:
            return self.applied(self.unused(name), self.open, type_)
        return super().fresh(name, type_)

    def fresh_like(self, name: str, term: Term) -> Made:
        """A fresh term of the sort of another."""
        made = super().fresh_like(name, term)
        return self.function_like(made, self.open) if self.open else made

    @contextmanager
    def opened(self, blanks: tuple[Term, ...]) -> Iterator[None]:
        """Within the context, fresh terms depend on these blanks."""
        outer, self.open = self.open, blanks
        try:
            yield
        finally:
            self.open = outer

    def blank(self) -> Made:
        """A fresh integer of which nothing is known."""
        return super().fresh("blank", INT)

    @contextmanager
    def depending_on(self, arguments: tuple[Term, ...] | None) -> Iterator[None]:
        """Within the context, named unknowns are functions of these (None: they are unnamed)."""
        outer, self.arguments = self.arguments, arguments
        try:
            yield
        finally:
            self.arguments = outer


class Functions(Unknowns):
    """Unknown values of a crowd's robots, by name and robot."""

    crowd: Crowd[Term] | None = None

    def of(
        self, name: str, type_: Type, arguments: tuple[Term, ...], length: int | None = None
    ) -> Value[Term]:
        """The value of function symbols, one per scalar, at arguments."""
        with self._scope(arguments):
            return self.value(name, type_, length)

    def value(
        self,
        name: str,
        type_: Type,
        length: int | None = None,
        scalar: Callable[[str, Type], Term] | None = None,
    ) -> Value[Term]:
        if not isinstance(type_, ArrayType) or type_.size is not Robots.ALL:
            return Unknowns.value(self, name, type_, length, scalar)
        outer, element, crowd = self.terms.arguments or (), type_.element, self.crowd
        assert crowd is not None
        return family_of(crowd, lambda i: self.of(f"{name}[]", element, (*outer, i)))

    def storage(
        self, name: str, type_: Type, initial: Storage[Term], written: WriteExtent
    ) -> Storage[Term]:
        if written is WriteExtent.NEVER or not isinstance(initial, Many):
            return Unknowns.storage(self, name, type_, initial, written)
        assert isinstance(type_, ArrayType)
        outer, element, like = self.terms.arguments or (), type_.element, initial.at

        def at(i: Term) -> Storage[Term]:
            return self.storage_of(f"{name}[]", element, like(i), written, (*outer, i))

        return many_of(initial.crowd, at)

    def storage_of(
        self,
        name: str,
        type_: Type,
        like: Storage[Term],
        written: WriteExtent,
        arguments: tuple[Term, ...],
    ) -> Storage[Term]:
        """Any storage of a variable, by function symbols at arguments."""
        with self._scope(arguments):
            return self.storage(name, type_, like, written)

    def every(self, types: Sequence[Type], body: Callable[[tuple[Value[Term], ...]], Term]) -> Term:
        blanks, d = self.terms.open, self.terms

        def reopened(values: tuple[Value[Term], ...]) -> Term:
            with d.opened(blanks):
                return body(values)

        # What a quantifier of the solver's is about depends on nothing.
        with d.opened(()):
            return Unknowns.every(self, types, reopened)

    def _axiom(self, external: core.External, promise: core.Expr) -> Term:
        with self.terms.opened(()), self.terms.depending_on(None):
            return Unknowns._axiom(self, external, promise)

    @property
    def terms(self) -> FunctionTerms:
        """The number domain, with functions."""
        assert isinstance(self.d, FunctionTerms)
        return self.d

    def _scope(self, arguments: tuple[Term, ...]) -> AbstractContextManager[None]:
        return self.terms.depending_on(arguments)


class RobotInputs(Struct):
    """The inputs of one robot in a step, as functions of its number (None: constants)."""

    unknowns: Functions
    label: str
    robot: Term | None

    def start(self, declaration: core.Declaration, robot: int | None) -> Value[Term]:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        name = f"{variable.home.value} {variable.name} {self.label}"
        return self.unknowns.of(name, type_, self._arguments(), declaration.length)

    def sensor(self, robot: int, port: core.Port) -> Value[Term]:
        variable = port.declaration.variable
        name = f"{port.module}.{variable.name} {self.label}"
        return self.unknowns.of(name, variable.type, self._arguments())

    def oracle(self, phase: Phase, robot: int) -> Oracle[Term]:
        return RobotOracle(self.unknowns, self, phase)

    def _arguments(self) -> tuple[Term, ...]:
        return () if self.robot is None else (self.robot,)


class TripOracle(Struct):
    """The oracle of a trip of a loop over all robots: mathematical functions only."""

    unknowns: Functions

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        raise NotFiniteError(NOWHERE, "a loop over all robots chooses in each trip")

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[Term], ...]
    ) -> Value[Term]:
        if function.kind is core.ExternalKind.FRESH:
            what = f"a loop over all robots asks {function.name} in each trip"
            raise NotFiniteError(function.span, what)
        return answer_of(self.unknowns, function, arguments)

    def every(self, type_: Type, body: Callable[[Value[Term]], Term]) -> Term:
        return every_value(self.unknowns, type_, body)

    def vouches_for(self, function: core.External) -> bool:
        return self.unknowns.vouches_for(function)


class RobotOracle(TripOracle):
    """The oracle of one robot's turn, as functions of its number. [CHOOSE] [EXTERNAL]"""

    inputs: RobotInputs
    phase: Phase

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        value = self._own(f"choose {self._place(key)}", type_)
        return scalar(value)

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[Term], ...]
    ) -> Value[Term]:
        if function.kind is core.ExternalKind.FUNCTION:
            return TripOracle.external(self, function, key, arguments)
        return self._own(f"{function.name} {self._place(key)}", function.result.type)

    def _own(self, name: str, type_: Type) -> Value[Term]:
        if self.phase is Phase.CHECK:
            raise NotFiniteError(NOWHERE, "a property asks for what is left open")
        return self.inputs.unknowns.of(name, type_, self.inputs._arguments())

    def _place(self, key: Key) -> str:
        return f"{self.inputs.label} {self.phase.value} {'.'.join(map(str, key))}"


def answer_of(
    unknowns: Functions, function: core.External, arguments: tuple[Value[Term], ...]
) -> Value[Term]:
    """The answer of a mathematical function: equal arguments give equal answers. [EXTERNAL]"""
    if any(isinstance(argument, Family) for argument in arguments):
        raise NotFiniteError(
            function.span, f"{function.name} is asked about an array over all robots"
        )
    with unknowns.terms.depending_on(None):
        return unknowns.function(function, arguments, function.name)


def every_value(unknowns: Functions, type_: Type, body: Callable[[Value[Term]], Term]) -> Term:
    """The condition that a Boolean holds of every value of a type (summaries only)."""
    with unknowns.terms.depending_on(None):
        return unknowns.every((type_,), lambda values: body(values[0]))
