"""Oracles: answers to ``choose`` and to external calls. [CHOOSE] [EXTERNAL]

Each use of ``choose`` and each external call has a key that all domains compute alike: the number
of its place in the program, then the trip counts of the loops and the sites of the calls around it.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, Protocol, TypeVar

from koord.semantics.values import Value
from koord.syntax import core
from koord.syntax.types import Type

V = TypeVar("V")

Key = tuple[int, ...]


class Oracle(Protocol[V]):
    """An oracle: the source of answers for one turn of one robot."""

    def choose(self, key: Key, low: V, high: V, type_: Type) -> V:
        """Choose a value; the caller checks that it lies between the bounds."""
        ...

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[V], ...]
    ) -> Value[V]:
        """Answer an external call; the caller checks the answer against the function's summary."""
        ...

    def every(self, type_: Type, body: Callable[[Value[V]], V]) -> V:
        """Return the condition that ``body`` holds of every value of a type (summaries only)."""
        ...

    def vouches_for(self, function: core.External) -> bool:
        """Return whether all answers of a function meet its summary, so that no check is needed."""
        ...


class NoOracle:
    """The oracle for expressions that ask nothing: a query is an internal error."""

    def choose(self, key: Key, low: V, high: V, type_: Type) -> V:
        raise AssertionError("choose where nothing may be open")

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[V], ...]
    ) -> Value[V]:
        raise AssertionError(f"{function.name} where nothing may be open")

    def every(self, type_: Type, body: Callable[[Value[V]], V]) -> V:
        raise AssertionError("a quantifier over a type where nothing may be open")

    def vouches_for(self, function: core.External) -> bool:
        return False


class Phase(Enum):
    """The part of a run in which an input is asked for: a turn, or the evaluation of a property."""

    INIT = "init"
    PROG = "prog"
    ENV = "env"
    CHECK = "check"


class Inputs(Protocol[V]):
    """The inputs of one step of a system: all that is left open besides the schedule."""

    def start(self, declaration: core.Declaration, robot: int | None) -> Value[V]:
        """The start value of an arbitrary variable; ``robot`` is None for allwrite variables.

        The type is that of the declaration; for an allread variable, of the robot's own entry.
        """
        ...

    def sensor(self, robot: int, port: core.Port) -> Value[V]:
        """The value that a sensor without a model reads after the environment's turn."""
        ...

    def oracle(self, phase: Phase, robot: int) -> Oracle[V]:
        """The oracle for one turn of one robot."""
        ...


class NoInputs:
    """Inputs for steps that leave nothing open."""

    def start(self, declaration: core.Declaration, robot: int | None) -> Any:
        raise AssertionError(declaration.variable.name)

    def sensor(self, robot: int, port: core.Port) -> Any:
        raise AssertionError(port.declaration.variable.name)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Any]:
        return NoOracle()
