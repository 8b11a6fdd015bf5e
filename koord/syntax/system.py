"""Systems: a program with its robots and δ. [CONFIG]"""

from __future__ import annotations

from enum import IntEnum
from fractions import Fraction
from typing import Any, ClassVar

from msgspec import field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.content import ByContent
from koord.syntax.problem import fleet


class Status(IntEnum):
    """The status of a robot: whether it runs events. [STOP]"""

    RUNNING = 0
    ASKED = 1  #: ``trystop()`` was called: goes on until everyone asked
    STOPPED = 2


class System(ByContent, frozen=True):
    """A program with its robots: ``kinds[i]`` is robot i's position in ``program.agents``.

    With a ``crowd`` the robots of ``kinds`` are only those that are looked at, and not all.
    ``budget`` is no part of it: it ends what takes too long.
    """

    ASIDE: ClassVar[frozenset[str]] = frozenset({"budget"})

    program: core.Program
    kinds: tuple[int, ...]
    delta_s: Fraction = core.USUAL_DELTA_S
    crowd: Any = None  #: a ``Crowd`` of ``semantics/every_number.py``, or no
    budget: Budget = field(default_factory=lambda: ENDLESS)

    @property
    def robots(self) -> int:
        """``numAgents``."""
        return len(self.kinds)

    @property
    def size(self) -> Any:
        """The size of an array over robots: a number, or the crowd."""
        return len(self.kinds) if self.crowd is None else self.crowd

    @property
    def fleet(self) -> str:
        """The robots in words, by kind: ``3 robots``, ``3 robots (2 Car, 1 Drone)``."""
        return fleet(self.program, self.kinds)

    def agent(self, robot: int) -> core.Agent:
        """The kind of one robot."""
        return self.program.agents[self.kinds[robot]]


def dealt(program: core.Program, robots: int, delta_s: Fraction = core.USUAL_DELTA_S) -> System:
    """A system of a number of robots, dealt to the kinds round-robin in order of declaration."""
    return System(program, core.round_robin(robots, len(program.agents)), delta_s)


def resized(system: System, robots: int) -> System:
    """A system of the same program with another number of robots."""
    return replace(dealt(system.program, robots, system.delta_s), budget=system.budget)
