"""Running bodies: memory, with faults and legality under the condition of the path.

Statements are guarded commands: each changes memory where its path holds and leaves it elsewhere.
Reads are from the memory of the robot that runs; writes to shared variables go to that memory and
are kept, in their order, as a sequence that can be made on any store.

Expressions call functions, whose bodies are statements. So a body carries the rules for both, and
the files about places, quantifiers and loops ask ``value`` and ``run`` of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from koord.recheck.sorts import NotRecheckedError, Value
from koord.recheck.storage import (
    Fault,
    Frame,
    Memory,
    ParameterisedState,
    State,
    Storage,
    Storages,
    Write,
)
from koord.recheck.terms import Term, Terms
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax import core
from koord.syntax.source import Span

#: What an expression gives, and what statements do.
Rules: TypeAlias = (
    "tuple[Callable[[RunningBody, core.Expr], Value], Callable[[RunningBody, core.Block], None]]"
)


class RunningBody:
    """A running body. ``robot`` is the robot that runs it, None in a property."""

    def __init__(
        self, world: Instance, values: Values, robot: Term | None, memory: Memory, rules: Rules
    ) -> None:
        self.world = world
        self.v = values
        self.t: Terms = values.t
        self.s = Storages(values)
        self.robot = robot
        self.memory = memory
        self.evaluator, self.runner = self.rules = rules
        self.bound: list[Storage | None] = []
        self.path: Term = self.t.truth(True)
        #: When this body is run at all: the path of its caller, or that an event is enabled. What
        #: is remembered only while it runs does not depend on that, so terms leave it out.
        self.outside: Term = self.t.truth(True)
        self.faults: list[Fault] = []
        self.legal: list[Term] = []  #: what answers satisfy if this body is run at all
        self.entered: dict[int, Term] = {}
        self.writes: list[Write] = []
        self.asked = self.stopped = self.t.truth(False)
        self.frame: Frame | None = None
        self.broke: list[Term] = []
        self.in_summary = False
        #: Numbers that are surely those of robots, where it is open how many there are.
        self.here: list[Term] = []
        #: Whether this is a statement about configurations: no answer of it is anyone's to choose.
        self.closed = memory.state is not None

    def apart(self) -> RunningBody:
        """A body without a robot and without a configuration."""
        return RunningBody(self.world, self.v, None, Memory(), self.rules)

    # --- paths ----------------------------------------------------------------------------------

    @contextmanager
    def where(self, condition: Term) -> Iterator[None]:
        """Continue under a further condition."""
        outer = self.path
        self.path = self.t.both(outer, condition)
        yield
        self.path = outer

    @contextmanager
    def among(self, index: Term, low: Term, high: Term) -> Iterator[None]:
        """Continue with a number of a range, which may be known to be that of a robot."""
        sure = low.value is not None and low.value >= 0 and high is self.v.count
        self.here += [index] if sure else []
        yield
        if sure:
            self.here.remove(index)

    def fault_unless(self, holds: Term, what: str, span: Span) -> None:
        when = self.t.conjunction([self.outside, self.path, self.t.negation(holds)])
        if when.value is not False:
            self.faults.append(Fault(when, what, span))

    def require(self, holds: Term) -> None:
        """Record a condition that answers satisfy, if they are asked for."""
        # Behind a fault nothing is asked.
        going_on = self.t.conjunction([self.outside, self.path, self.t.negation(self.faulted())])
        needed = self.t.implies(going_on, holds)
        if needed.value is not True:
            self.legal.append(needed)

    def faulted(self) -> Term:
        return self.t.disjunction(fault.when for fault in self.faults)

    # --- expressions ----------------------------------------------------------------------------

    def condition(self, e: core.Expr) -> Term:
        value = self.value(e)
        assert isinstance(value, Term)
        return value

    def statement(self, e: core.Expr) -> Term:
        """The condition that a statement is true and evaluates without a fault."""
        faults, self.faults = self.faults, []
        outer, self.path = (self.path, self.outside), self.t.truth(True)
        self.outside = self.t.truth(True)
        holds = self.t.both(self.condition(e), self.t.negation(self.faulted()))
        self.faults, (self.path, self.outside) = faults, outer
        return holds

    def value(self, e: core.Expr) -> Value:
        """Evaluate an expression; faults are recorded, and evaluation goes on."""
        return self.evaluator(self, e)

    def run(self, block: core.Block) -> None:
        """Run statements; paths that left the block do not go on."""
        self.runner(self, block)

    # --- configurations -------------------------------------------------------------------------

    def items(self, value: Value, span: Span) -> tuple[Value, ...]:
        if not isinstance(value, tuple):
            raise NotRecheckedError(
                "going through a map, or a list whose length is not fixed by the text, is not"
                " rechecked",
                span,
            )
        return value

    def state(self) -> State:
        assert isinstance(self.memory.state, State)
        return self.memory.state

    @property
    def crowd(self) -> ParameterisedState | None:
        """The configuration of a property, if the number of robots is open."""
        return self.memory.state if isinstance(self.memory.state, ParameterisedState) else None

    def everyone(self) -> range:
        return range(len(self.world.kinds))
