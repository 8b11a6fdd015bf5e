"""Which parts of a program may fault, as far as the text shows: more than do, and never fewer."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import Home
from koord.syntax.walk import operands


class Risks(Struct, frozen=True):
    """What may fault in a place of the program of which this much is known."""

    sure: Sure

    def expression(self, e: core.Expr) -> bool:
        """Whether evaluating an expression may fault."""
        return not self.sure.of(e)

    def statement(self, s: core.Stmt) -> bool:
        """Whether a statement itself may fault, apart from those in it."""
        match s:
            case core.Assign(place=place, value=value):
                return self.expression(value) or self._writing(place)
            case core.Append(place=place, value=value) | core.Remove(place=place, value=value):
                return self._any((value, core.Read(place)))
            case core.Pop():
                return True
            case core.Return():
                raise AssertionError("only functions return")
            case _:
                return any(self.expression(e) for e in operands(s) if not isinstance(e, core.Place))

    def in_range(self, slot: int, low: core.Expr, high: core.Expr) -> Sure:
        """What is known in a loop over a range."""
        match low, high:
            case core.Const(value=0), core.NumAgents():
                return self.sure.with_robot(slot, None)
            case _:
                return self.sure.with_value(slot)

    def _any(self, expressions: Iterable[core.Expr]) -> bool:
        return any(self.expression(e) for e in expressions)

    def _writing(self, place: core.Place) -> bool:
        """Whether the place may not exist for writing. [S-ASSIGN]"""
        own_entry = (
            place.variable.home is Home.ALLREAD
            and len(place.steps) == 1
            and isinstance(place.steps[0], core.IndexStep)
            and isinstance(place.steps[0].index, core.Pid)
        )
        if not place.steps or own_entry:
            return False
        match place.steps[-1]:
            case core.KeyStep(key=key):  # an entry that is not there is made
                before = replace(place, steps=place.steps[:-1])
                return self._any((key, core.Read(before)))
            case _:
                return self.expression(core.Read(place))
