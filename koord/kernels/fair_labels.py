"""Labels of edges and of nodes in a graph of whole rounds. [FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME]

A label is one word. An edge has a bit for each robot that runs, and one for each pair of a robot
and a lock class that its event asks for. A node has, at the same places, a bit for each robot that
is not ready, and one for each pair that asks; and one for each expectation that it does not owe.
"""

from __future__ import annotations

from msgspec import Struct

from koord.kernels.choices import ChoiceInputs
from koord.kernels.terms import NoKernelError, Scalar
from koord.kernels.turns import TurnMaker
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.liveness import locks_of
from koord.semantics.turns import guard_of
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import Status, System

#: Labels have so many bits at most: one more says that there is an edge at all.
_MOST_BITS = 60


class LabelBits(Struct, frozen=True):
    """Where the bits of labels stand. ``locks`` are pairs of a robot and a lock class."""

    robots: int
    locks: tuple[tuple[int, int], ...]
    expectations: int

    @staticmethod
    def of(system: System, expectations: int) -> LabelBits:
        """The bits of a system's labels. Raises NoKernelError if there are too many."""
        made = LabelBits(system.robots, locks_of(system), expectations)
        if made.first_expectation + expectations > _MOST_BITS:
            raise NoKernelError("there are too many robots, locks and expectations")
        return made

    @property
    def first_expectation(self) -> int:
        return self.robots + len(self.locks)

    def run_by(self, robot: int, classes: frozenset[int]) -> int:
        """The label of a robot that runs an event with some lock classes in its text."""
        found = 1 << robot
        for k, (i, lock) in enumerate(self.locks):
            if i == robot and lock in classes:
                found |= 1 << self.robots + k
        return found

    def met(self, label: int) -> int:
        """What a label says of robots and expectations, robots first."""
        robots = label & ((1 << self.robots) - 1)
        return robots | label >> self.first_expectation << self.robots

    def granted(self, label: int) -> int:
        """What a label says of pairs of a robot and a lock class."""
        return label >> self.robots & ((1 << len(self.locks)) - 1)

    def wanted(self, met: int, granted: int) -> tuple[int, int]:
        """The bits of conditions to be met, and of those to be granted if asked."""
        robots = met & ((1 << self.robots) - 1)
        return robots | met >> self.robots << self.first_expectation, granted << self.robots


class Readiness(Struct, frozen=True):
    """Whether a robot is ready, and by lock class whether it asks for one, as terms."""

    ready: Scalar
    asks: tuple[tuple[int, Scalar], ...]


def readiness(maker: TurnMaker, robot: int) -> Readiness:
    """When a robot is ready and asks. Raises NoKernelError where guards ask what is left open."""
    d, system = maker.domain, maker.layout.system
    before = maker.before.robots[robot]
    runs = d.binary(BinaryOp.NE, before.status, int(Status.STOPPED))
    ready: list[Scalar] = []
    without: dict[int, list[Scalar]] = {k: [] for i, k in locks_of(system) if i == robot}
    for event in system.agent(robot).events:
        if event.urgent:
            raise NoKernelError("an event is urgent")
        inputs = ChoiceInputs(d, system)
        holds, sound = guard_of(d, system, robot, before, event, inputs)
        if inputs.counts:
            raise NoKernelError("a guard asks what is left open")
        ready.append(holds)
        may_be = d.binary(BinaryOp.OR, holds, d.unary(UnaryOp.NOT, sound))
        for k, others in without.items():
            if k not in event.lock_classes:
                others.append(may_be)
    is_ready = conjunction(d, [runs, disjunction(d, ready)])
    asks = tuple(
        (k, conjunction(d, [is_ready, d.unary(UnaryOp.NOT, disjunction(d, others))]))
        for k, others in without.items()
    )
    return Readiness(is_ready, asks)
