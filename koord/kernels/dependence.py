"""Machine code that finds which choices a turn hangs on, so that no other is made. [CHOOSE]

Of what a turn leaves open most does not matter most of the time: who may not claim a task is not
asked whether the way to it is clear. With the value of a term comes a set of choices, found as the
value is: whoever makes these choices alike, and any others as he likes, gets the same value.
"""

from __future__ import annotations

from koord.kernels.assembling import Evaluation
from koord.kernels.terms import Scalar, Term
from koord.machine.code import I1, Ir, word
from koord.syntax.core import BinaryOp


class Dependence:
    """Which choices terms hang on, in the body of one function: bit k is that of choice k."""

    def __init__(self, terms: Evaluation) -> None:
        self._terms = terms
        self._b = terms.code.b
        self._done: dict[int, Ir | None] = {}

    def of(self, scalar: Scalar) -> Ir | None:
        """The choices that a value hangs on, of 64 bits; None where there is none of any value."""
        if not isinstance(scalar, Term):
            return None
        # Not by recursion: terms of long loops are deep.
        waiting = [scalar]
        while waiting:
            term = waiting[-1]
            missing = [a for a in term.args if isinstance(a, Term) and id(a) not in self._done]
            if missing and id(term) not in self._done:
                waiting += missing
                continue
            if id(term) not in self._done:
                self._done[id(term)] = self._made(term)
            waiting.pop()
        return self._done[id(scalar)]

    def where(self, condition: Scalar, scalar: Scalar) -> Ir | None:
        """The choices that a value which matters on a condition hangs on, with the condition's."""
        hangs, value = self.of(condition), self.of(scalar)
        if value is None or condition is False:
            return hangs
        held = self._b.select(self._terms.value(condition), value, word(0))
        return self.either(hangs, held)

    def either(self, *parts: Ir | None) -> Ir | None:
        """The choices in any of some sets."""
        whole: Ir | None = None
        for part in parts:
            if part is not None:
                whole = part if whole is None else self._b.or_(whole, part)
        return whole

    def _made(self, term: Term) -> Ir | None:
        if term.op == "choice":
            return word(1 << term.number)
        parts = [self._done[id(a)] if isinstance(a, Term) else None for a in term.args]
        if all(part is None for part in parts):
            return None
        match term.op:
            case "ite":
                condition, then, other = (part if part is not None else word(0) for part in parts)
                held = self._b.select(self._terms.value(term.args[0]), then, other)
                return self._b.or_(condition, held)
            case BinaryOp.AND | BinaryOp.OR:
                return self._connected(term, term.op is BinaryOp.OR, parts)
        return self.either(*parts)

    def _connected(self, term: Term, decides: bool, parts: list[Ir | None]) -> Ir:
        """Where an operand decides by itself, only what it hangs on matters."""
        b, whole = self._b, self.either(*parts)
        assert whole is not None
        # Of two that decide the one that hangs on nothing is believed.
        pairs = sorted(zip(term.args, parts, strict=True), key=lambda pair: pair[1] is None)
        for operand, part in pairs:
            its = self._terms.value(operand)
            assert its.type == I1
            whole = b.select(
                its if decides else b.not_(its), part if part is not None else word(0), whole
            )
        return whole
