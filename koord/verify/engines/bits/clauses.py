"""Clauses of literals of a graph, for a SAT solver: the only file that uses one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from threading import Timer
from typing import Any, cast

import pysolvers
from pysat.solvers import Solver

from koord.syntax.budget import OutOfBudgetError
from koord.verify.effort import Deadline
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.engines.bits.graph import Graph

#: In which directions a node's clauses are needed: where it is true, where it is false.
TRUE_SIDE = 1
FALSE_SIDE = 2
BOTH_SIDES = 3

#: Which is quick where questions come by the thousand, but cannot be interrupted: it is asked for
#: so many conflicts at once, some tenths of a second, and goes on with what it learnt.
QUICK = "cadical153"
AT_ONCE = 2_000

#: Which can be interrupted. It shares nothing with the other: what that found is asked again here.
OTHER = "glucose4"

#: A question whether one of several things can hold is asked of each where it takes so many
#: conflicts or more: many easy questions are quicker than a hard one.
IN_WHOLE = 2_000

#: So often parts are taken apart again: phases and claims, robots, elements.
DEPTH = 3

#: What a question costs, most often, in steps of evaluation.
_PER_QUESTION = 5


class NoAnswerError(OutOfBudgetError):
    """Raised where a solver came to no answer within its limits."""


class Clauses:
    """A SAT solver over one graph, which encodes the nodes asked about.
    Its literals are signed numbers.

    A conjunction is written down only in the directions in which somebody needs it.
    """

    def __init__(
        self,
        graph: Graph,
        engine: str = QUICK,
        deadline: Deadline | None = None,
        left: int | None = None,
        heard: Callable[[int], None] = lambda steps: None,
    ) -> None:
        self.graph = graph
        self.engine = engine
        self.deadline = Deadline() if deadline is None else deadline
        self.left = left  #: so often questions may go on after ``AT_ONCE`` conflicts
        self._heard = heard  #: is told of work, as a program's budget is
        self._numbers: dict[int, int] = {}
        self._sides: dict[int, int] = {}
        self._top = 1
        self._core: list[int] | None = None  #: of a question that was asked in parts
        self._solver: Any = Solver(name=self.engine)
        self._solver.add_clause([1])

    def close(self) -> None:
        """Free the solver's memory."""
        self._solver.delete()

    def variable(self) -> int:
        """A new literal."""
        self._top += 1
        return self._top

    def of(self, literal: int, sides: int = BOTH_SIDES) -> int:
        """The solver's literal of a graph's literal, with clauses for the given directions."""
        self._write(literal, sides)
        return self._signed(literal)

    def known(self, node: int) -> int | None:
        """The solver's literal of a node, if it was encoded."""
        return self._numbers.get(node)

    def add(self, clause: Iterable[int]) -> None:
        self._solver.add_clause(list(clause))

    def require(self, literal: int) -> None:
        """Require a literal of the graph to be true."""
        for part in self.graph.conjuncts(literal) or ():
            self._solver.add_clause([self.of(part, TRUE_SIDE)])

    def solve(self, assumptions: Sequence[int]) -> bool:
        """Return whether the clauses are satisfiable under assumptions.

        Raises NoAnswerError where the deadline passes first, or too many questions were hard.
        """
        return _is_satisfiable(self.solve_in_time(assumptions, self.deadline))

    def can_hold(self, literal: int, assumptions: Sequence[int] = ()) -> bool:
        """Return whether a literal of the graph can hold, as ``solve`` does; in parts if hard."""
        return _is_satisfiable(self.can_hold_in_time(literal, self.deadline, assumptions))

    def can_hold_in_time(
        self, literal: int, deadline: Deadline, assumptions: Sequence[int] = ()
    ) -> SolverAnswer:
        """Return whether a literal of the graph can hold, or UNKNOWN. A hard one is taken apart.

        After UNSAT the core is one of all parts together.
        """
        return self._asked_in_parts(literal, deadline, assumptions, DEPTH)

    def _asked_in_parts(
        self, literal: int, deadline: Deadline, assumptions: Sequence[int], depth: int
    ) -> SolverAnswer:
        asked = [*assumptions, self.of(literal, TRUE_SIDE)]
        if not depth:
            return self.solve_in_time(asked, deadline)
        found = self._answer(asked, deadline, IN_WHOLE)
        if found is not SolverAnswer.UNKNOWN or deadline.passed() or self._is_too_hard():
            return found
        ways = self.graph.ways(literal)
        if len(ways) < 2:
            return self.solve_in_time(asked, deadline)
        core: dict[int, None] = {}
        for way in ways:
            found = self._asked_in_parts(way, deadline, asked, depth - 1)
            if found is not SolverAnswer.UNSAT:
                return found
            core |= dict.fromkeys(self.core())
        self._core = list(core)
        return SolverAnswer.UNSAT

    def solve_in_time(self, assumptions: Sequence[int], deadline: Deadline) -> SolverAnswer:
        """Solve under assumptions, or answer UNKNOWN where the deadline passes first."""
        return self._answer(assumptions, deadline)

    def _answer(
        self, assumptions: Sequence[int], deadline: Deadline, conflicts: int | None = None
    ) -> SolverAnswer:
        """Solve under assumptions, with at most so many conflicts."""
        self._core = None
        self._heard(_PER_QUESTION)
        try:
            if conflicts is not None:
                found = self._solved_at_once(assumptions, deadline, conflicts)
            elif self.engine == QUICK:
                found = self._solved_by_and_by(assumptions, deadline)
            else:
                found = self._solved_unless_interrupted(assumptions, deadline)
        except pysolvers.error as error:
            # It listens to Ctrl-C by itself, and says so in a way of its own.
            raise KeyboardInterrupt from error
        if found is None:
            return SolverAnswer.UNKNOWN
        return SolverAnswer.SAT if found else SolverAnswer.UNSAT

    def _solved_at_once(
        self, assumptions: Sequence[int], deadline: Deadline, conflicts: int
    ) -> bool | None:
        if deadline.passed():
            return None
        self._solver.conf_budget(conflicts)
        found: bool | None = self._solver.solve_limited(assumptions=assumptions)
        self._solver.conf_budget(-1)
        return found

    def _solved_by_and_by(self, assumptions: Sequence[int], deadline: Deadline) -> bool | None:
        while not deadline.passed():
            self._solver.conf_budget(AT_ONCE)
            found: bool | None = self._solver.solve_limited(assumptions=assumptions)
            if found is not None:
                return found
            if self._is_too_hard():
                return None
        return None

    def _is_too_hard(self) -> bool:
        """Count a question that goes on. Return whether there were too many."""
        if self.left is not None:
            self.left -= 1
        return self.left is not None and self.left <= 0

    def _solved_unless_interrupted(
        self, assumptions: Sequence[int], deadline: Deadline
    ) -> bool | None:
        left = deadline.left_s()
        if left is None:
            return bool(self._solver.solve(assumptions=assumptions))
        if left <= 0:
            return None
        timer = Timer(left, self._solver.interrupt)
        timer.start()
        try:
            found: bool | None = self._solver.solve_limited(
                assumptions=assumptions, expect_interrupt=True
            )
        finally:
            timer.cancel()
            self._solver.clear_interrupt()
        return found

    def core(self) -> list[int]:
        """The assumptions in the unsatisfiable core of the last answer."""
        return (self._solver.get_core() or []) if self._core is None else self._core

    def model(self) -> list[int]:
        """The last model: at position v the literal v or -v, where 0 stands for none."""
        return [0, *cast("list[int]", self._solver.get_model())]

    def _signed(self, literal: int) -> int:
        if literal < 2:
            return 1 if literal else -1
        number = self._numbers.get(literal >> 1)
        if number is None:
            number = self._numbers[literal >> 1] = self.variable()
        return -number if literal & 1 else number

    def _write(self, literal: int, sides: int) -> None:
        g, solver = self.graph, self._solver
        stack = [(literal, sides)]
        while stack:
            x, wanted = stack.pop()
            node = x >> 1
            if x & 1:
                wanted = _turned(wanted)
            missing = wanted & ~self._sides.get(node, 0)
            if not missing or node == 0 or g.is_input(node):
                continue
            self._sides[node] = self._sides.get(node, 0) | missing
            me = self._signed(2 * node)
            choice = self._choice(node)
            if choice is not None:
                condition, then, other = choice
                c, t, e = (self._signed(y) for y in choice)
                if missing & TRUE_SIDE:
                    solver.append_formula([[-me, -c, t], [-me, c, e], [-me, t, e]])
                if missing & FALSE_SIDE:
                    solver.append_formula([[me, -c, -t], [me, c, -e], [me, -t, -e]])
                stack += ((condition, BOTH_SIDES), (then, missing), (other, missing))
                continue
            parts = self._parts(node)
            signed = [self._signed(y) for y in parts]
            if missing & TRUE_SIDE:
                solver.append_formula([[-me, y] for y in signed])
            if missing & FALSE_SIDE:
                solver.add_clause([me, *(-y for y in signed)])
            stack += ((y, missing) for y in parts)

    def _parts(self, node: int) -> list[int]:
        """The operands of a conjunction; inner conjunctions used only here are flattened."""
        g = self.graph
        found: list[int] = []
        stack = [g.right[node], g.left[node]]
        while stack:
            x = stack.pop()
            inner = x >> 1
            if x & 1 or g.is_input(inner) or g.uses[inner] > 1 or inner in self._numbers:
                found.append(x)
            else:
                stack += (g.right[inner], g.left[inner])
        return found

    def _choice(self, node: int) -> tuple[int, int, int] | None:
        """The condition and both sides of a node that is an if-then-else or an exclusive or."""
        g = self.graph
        p, q = g.left[node], g.right[node]
        if not (p & q & 1) or g.is_input(p >> 1) or g.is_input(q >> 1):
            return None
        if g.uses[p >> 1] > 1 or g.uses[q >> 1] > 1:
            return None
        for c, t in ((g.left[p >> 1], g.right[p >> 1]), (g.right[p >> 1], g.left[p >> 1])):
            for n, e in ((g.left[q >> 1], g.right[q >> 1]), (g.right[q >> 1], g.left[q >> 1])):
                if c == n ^ 1:
                    return c, t ^ 1, e ^ 1
        return None


def _turned(sides: int) -> int:
    """The directions of encoding that the negation of a literal needs."""
    return (sides & 1) << 1 | sides >> 1


def now() -> float:
    """The time in seconds, for durations."""
    return time.monotonic()


def _is_satisfiable(answer: SolverAnswer) -> bool:
    """Return whether it is. Raises NoAnswerError where that is not known."""
    if answer is SolverAnswer.UNKNOWN:
        raise NoAnswerError
    return answer is SolverAnswer.SAT
