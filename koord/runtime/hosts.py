"""Hosts: the environment of compiled programs, and the turns in which they ask it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from koord.runtime.robot import Robot

#: Names one evaluation of ``choose`` or of an external function within one turn. [RECORDING]
Key = tuple[int, ...]


class Turn(Enum):
    """The turn in which a program calls its host."""

    INIT = "init"
    PROG = "prog"
    ENV = "env"


class Host(Protocol):
    """The environment of a program: sensors, external functions, choices.

    Values are what :mod:`koord.runtime.shapes` says; lists do for tuples, and tuples for records.
    """

    def start(self, robot: int | None, name: str) -> Any:
        """The start of an arbitrary variable; ``robot`` is None for allwrite variables."""
        ...

    def read(self, robot: Robot) -> Mapping[str, Any]:
        """The readings of the sensors without a model after a round, by attribute."""
        ...

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        """The answer of an external function, whose ``requires`` are met."""
        ...

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        """A value from ``low`` to ``high``, both included."""
        ...


class Forwarding:
    """A host that asks another; what it changes of the answers, subclasses say."""

    def __init__(self, host: Host) -> None:
        self.host = host

    def start(self, robot: int | None, name: str) -> Any:
        return self.host.start(robot, name)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        return self.host.read(robot)

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        return self.host.ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return self.host.choose(turn, robot, key, low, high)
