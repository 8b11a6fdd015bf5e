"""Worst paths: the most steps that a turn of a robot may take, and the branches that take them.

Of the two branches of an ``if`` the longer one counts, of a loop all of its trips, though it may
be left before, and of `and` and `or` both sides. So what is said is a bound: no run takes more
steps, and perhaps none takes so many. A list may grow in a run: what loops over one has no bound,
and neither has what asks an external function. A step is what ``work.py`` says.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.work import Counters, Range, TypeSizes, Work, WorkEstimate
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.syntax.types import ArrayType
from koord.syntax.walk import children, nodes


class Branch(Struct, frozen=True):
    """A branch of a worst path: where the ``if`` is, and whether its condition is true."""

    span: Span
    is_true: bool


class WorstPath(Struct, frozen=True):
    """The worst path through a body of a program.

    It takes ``steps`` at most if there are neither ``endless`` loops, whose trips nobody knows
    before a run and which count with one, nor ``unknown`` external functions, which count with
    what asks them.
    """

    steps: int
    branches: tuple[Branch, ...]
    endless: tuple[Span, ...]
    unknown: tuple[str, ...]

    @property
    def is_bound(self) -> bool:
        """True if no run takes more steps."""
        return not self.endless and not self.unknown


class EventPaths(Struct, frozen=True):
    """The worst paths of an event."""

    event: core.Event
    guard: WorstPath
    effect: WorstPath

    @property
    def steps(self) -> int:
        """Those of its guard and its effect."""
        return self.guard.steps + self.effect.steps

    @property
    def is_bound(self) -> bool:
        """True if no run takes more steps."""
        return self.guard.is_bound and self.effect.is_bound


class AgentPaths(Struct, frozen=True):
    """The worst paths of a kind of robot."""

    agent: core.Agent
    events: tuple[EventPaths, ...]

    @property
    def turn_steps(self) -> int:
        """The most steps of a program turn: all guards, all urgent effects and the longest other.

        A robot asks guards in the order of the text until one is true, and runs each urgent event
        that is enabled into a buffer of its own. [SELECT]
        """
        urgent = sum(one.effect.steps for one in self.events if one.event.urgent)
        others = (one.effect.steps for one in self.events if not one.event.urgent)
        return sum(one.guard.steps for one in self.events) + urgent + max(others, default=0)

    @property
    def is_bound(self) -> bool:
        """True if no turn takes more steps."""
        return all(one.is_bound for one in self.events)


def worst_paths(system: System) -> tuple[AgentPaths, ...]:
    """The worst paths of all kinds of robots that there are, for so many robots.

    Raises TooLargeError if the program is too large to be looked through.
    """
    program = system.program
    estimate = _Longest(program, system.kinds, TypeSizes(system.robots))
    return tuple(_of_agent(estimate, program.agents[kind]) for kind in sorted(set(system.kinds)))


def _of_agent(estimate: _Longest, agent: core.Agent) -> AgentPaths:
    events = (
        EventPaths(event, estimate.path((event.guard,), ()), estimate.path((), event.effect))
        for event in agent.events
    )
    return AgentPaths(agent, tuple(events))


class _Longest(WorkEstimate):
    """The work of bodies where the longer branch is taken; which one that is, and what is unknown.

    What was found of a place is kept by its identity: a place of a function is looked at once.
    """

    def __init__(self, program: core.Program, kinds: Sequence[int], sizes: TypeSizes) -> None:
        self._is_true: dict[int, bool] = {}
        self._endless: set[int] = set()
        self._bodies = {function.name: function.body for function in program.functions}
        super().__init__(program, tuple(kinds), sizes)

    def path(self, parts: tuple[core.Expr, ...], block: core.Block) -> WorstPath:
        """The worst path through expressions and a block that are evaluated as one."""
        work, _ = self.body(parts, block)
        whole = list(self._reached((*parts, *block), everything=True))
        taken = self._reached((*parts, *block), everything=False)
        branches = (
            Branch(node.span, self._is_true[id(node)])
            for node in taken
            if isinstance(node, core.If)
        )
        endless = (node.span for node in whole if id(node) in self._endless)
        asked = (node.function for node in whole if isinstance(node, core.ExternalCall))
        return WorstPath(
            work.steps,
            tuple(dict.fromkeys(branches)),
            tuple(dict.fromkeys(endless)),
            tuple(dict.fromkeys(asked)),
        )

    def of(self, node: core.Node, counters: Counters) -> Work:
        if not isinstance(node, core.If):
            return super().of(node, counters)
        self._count()
        then, otherwise = self.block(node.then, counters), self.block(node.otherwise, counters)
        is_true = then.steps >= otherwise.steps
        self._is_true[id(node)] = is_true
        longer = Work((then if is_true else otherwise).steps, max(then.deep, otherwise.deep))
        return self._beside(self.of(node.condition, counters), longer)

    def _trips(
        self,
        node: core.Node,
        variable: core.Variable,
        low: core.Expr,
        high: core.Expr,
        counters: Counters,
    ) -> tuple[int, dict[int, Range]]:
        ranges = (self._ranges.range(bound, counters) for bound in (low, high))
        lists = (
            part
            for bound in (low, high)
            for part in nodes(bound)
            if isinstance(part, core.Builtin) and part.op is core.ListOp.LENGTH
        )
        if None in ranges or any(_may_grow(part.arguments[0]) for part in lists):
            self._endless.add(id(node))
        return super()._trips(node, variable, low, high, counters)

    def _length(self, node: core.Node, sequence: core.Expr) -> int:
        if _may_grow(sequence):
            self._endless.add(id(node))
        return super()._length(node, sequence)

    def _reached(self, parts: Iterable[core.Node], *, everything: bool) -> Iterator[core.Node]:
        """Yield the places of some parts and of what they call, or those of the worst path."""
        called = set[str]()
        waiting = [*parts][::-1]
        while waiting:
            node = waiting.pop()
            yield node
            below: list[core.Node]
            if isinstance(node, core.If) and not everything:
                taken = node.then if self._is_true[id(node)] else node.otherwise
                below = [node.condition, *taken]
            else:
                below = [*children(node)]
            if isinstance(node, core.Call) and node.function not in called:
                called.add(node.function)
                below += self._bodies[node.function]
            waiting += reversed(below)


def _may_grow(sequence: core.Expr) -> bool:
    """Return whether nobody knows before a run how long a value is."""
    fixed = (core.MakeList, core.MakeMap)
    return not isinstance(sequence.type, ArrayType) and not isinstance(sequence, fixed)
