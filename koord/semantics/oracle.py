"""Where the answers come from that a program leaves open. [CHOOSE] [EXTERNAL]

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
    """Answers for one turn of one robot."""

    def choose(self, key: Key, low: V, high: V, type_: Type) -> V:
        """A value; whoever asks checks that it lies between the bounds."""
        ...

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[V], ...]
    ) -> Value[V]:
        """The answer of an external function; whoever asks checks it against the summary."""
        ...

    def every(self, type_: Type, body: Callable[[Value[V]], V]) -> V:
        """Whether ``body`` holds of every value of a type (summaries only)."""
        ...

    def vouches_for(self, function: core.External) -> bool:
        """Whether all answers of a function meet its summary, so that nobody need check them."""
        ...


class NoOracle:
    """For expressions that leave nothing open: asking is an error of ours."""

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
    """When something may be left open: in a turn, or while a property is looked at."""

    INIT = "init"
    PROG = "prog"
    ENV = "env"
    CHECK = "check"


class Inputs(Protocol[V]):
    """All that one step of a system leaves open, besides the schedule."""

    def start(self, declaration: core.Declaration, robot: int | None) -> Value[V]:
        """What an arbitrary variable starts with; ``robot`` is None for allwrite variables.

        The type is that of the declaration; for an allread variable, of the robot's own entry.
        """
        ...

    def sensor(self, robot: int, port: core.Port) -> Value[V]:
        """What a sensor without a model reads after the environment's turn."""
        ...

    def oracle(self, phase: Phase, robot: int) -> Oracle[V]:
        """The answers for one turn of one robot."""
        ...


class NoInputs:
    """Inputs for what leaves nothing open."""

    def start(self, declaration: core.Declaration, robot: int | None) -> Any:
        raise AssertionError(declaration.variable.name)

    def sensor(self, robot: int, port: core.Port) -> Any:
        raise AssertionError(port.declaration.variable.name)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Any]:
        return NoOracle()
