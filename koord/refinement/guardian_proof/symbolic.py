"""Functions run on symbols: all ways that they can go, and for which numbers they go there.

A function that compares and subtracts numbers, and decides by ``if``, ``and`` and ``match``, is run
once for each of its ways. Where it asks whether something is true and both can be, it is so at
first; afterwards it is run again and it is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import z3

T = TypeVar("T")


class Undecided(Exception):  # noqa: N818 - nobody's mistake
    """Z3 cannot say whether a way can be gone."""


class Symbols:
    """The symbols of a question, and the way on which a function is being run."""

    def __init__(self) -> None:
        self._context = z3.Context()
        self._solver = z3.SimpleSolver(ctx=self._context)
        self._way: list[bool] = []  #: what is answered on this way, in the order of the questions
        self._asked = 0
        self._asserted = 0  #: to how many of them the solver has been told the answer
        self._forks: list[int] = []  #: the questions that both answers are still to be tried of
        self._known: dict[int, tuple[z3.BoolRef, bool]] = {}  #: answers on this way, by term
        self._numbers: dict[str, Number] = {}
        self._truths: dict[str, Truth] = {}

    def number(self, name: str) -> Number:
        """Any real number."""
        if name not in self._numbers:
            self._numbers[name] = Number(self, z3.Real(name, self._context))
        return self._numbers[name]

    def truth(self, name: str) -> Truth:
        """True or false, whatever else is so."""
        if name not in self._truths:
            self._truths[name] = Truth(self, z3.Bool(name, self._context), is_free=True)
        return self._truths[name]

    def ways(self, run: Callable[[], T]) -> Iterator[T]:
        """Yield what a function returns on each of its ways; ``example`` is of the last one."""
        self._solver.reset()
        self._way, self._forks, self._asserted = [], [], 0
        while True:
            self._asked, self._known = 0, {}
            yield run()
            if not self._forks:
                return
            last = self._forks.pop()
            self._solver.pop(self._asserted - last)
            self._way, self._asserted = [*self._way[:last], False], last

    def example(self) -> tuple[str, ...]:
        """Numbers and truths for which a function goes the way that it went."""
        if self._solver.check() != z3.sat:
            raise Undecided
        model = self._solver.model()
        found = {str(one.name()): f"{one.name()} = {model[one]}" for one in model.decls()}
        return tuple(found[name] for name in sorted(found))

    def decided(self, truth: Truth) -> bool:
        """The answer to a question on this way."""
        term = truth.term
        if term.get_id() in self._known:
            return self._known[term.get_id()][1]
        if self._asked < len(self._way):
            answer = self._way[self._asked]
        else:
            answer = self._can(truth, term)
            if answer and self._can(truth, z3.Not(term)):
                self._forks.append(self._asked)
            self._way.append(answer)
        self._asked += 1
        self._known[term.get_id()] = (term, answer)
        if self._asserted < self._asked:
            self._solver.push()
            self._solver.add(term if answer else z3.Not(term))
            self._asserted = self._asked
        return answer

    def _can(self, truth: Truth, term: z3.BoolRef) -> bool:
        if truth.is_free:
            return True  # nothing is known of it, else it was answered before
        answer = self._solver.check(term)
        if answer == z3.unknown:
            raise Undecided
        return bool(answer == z3.sat)


class Truth:
    """A symbol, or a comparison of numbers, that is true or false."""

    def __init__(self, symbols: Symbols, term: z3.BoolRef, *, is_free: bool = False) -> None:
        self._symbols = symbols
        self.term = term
        self.is_free = is_free

    def __bool__(self) -> bool:
        return self._symbols.decided(self)


class Number:
    """A number that is a symbol, or made of some."""

    def __init__(self, symbols: Symbols, term: z3.ArithRef) -> None:
        self._symbols = symbols
        self.term = term

    def __sub__(self, other: Number) -> Number:
        return Number(self._symbols, self.term - other.term)

    def __lt__(self, other: Any) -> Truth:
        return self._compared(self.term < _term(other))

    def __le__(self, other: Any) -> Truth:
        return self._compared(self.term <= _term(other))

    def __gt__(self, other: Any) -> Truth:
        return self._compared(self.term > _term(other))

    def __ge__(self, other: Any) -> Truth:
        return self._compared(self.term >= _term(other))

    def __eq__(self, other: object) -> Any:
        return NotImplemented if other is None else self._compared(self.term == _term(other))

    def __format__(self, spec: str) -> str:
        return str(self.term)

    def _compared(self, term: z3.BoolRef) -> Truth:
        return Truth(self._symbols, term)


def _term(number: Any) -> Any:
    return number.term if isinstance(number, Number) else number
