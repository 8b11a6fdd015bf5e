"""What is left open, as bits: with ranges where the text gives them, and functions by cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

from koord.syntax import core
from koord.syntax.types import ScalarType, Type, is_flat
from koord.verify.encoding.externals import scalars
from koord.verify.encoding.unknowns import Symbolic, Unknowns
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits
from koord.verify.engines.bits.numbers import Number


@dataclass(slots=True)
class BitUnknowns(Unknowns):
    """Fresh bits of one formula."""

    @property
    def bits(self) -> BitDomain:
        return cast(BitDomain, self.d)

    def function(
        self, external: core.External, arguments: tuple[Symbolic, ...], name: str
    ) -> Symbolic:
        """The answer of a mathematical function; across rounds alike for few arguments only."""
        result = external.result.type
        variables = (external.result, *external.parameters)
        if all(is_flat(v.type) for v in variables) and isinstance(result, ScalarType):
            flat = [scalar for argument in arguments for scalar in scalars(argument)]
            if self.bits.is_relation(cast(Any, flat), result):
                return cast(Any, self.bits.applied(external.name, cast(Any, flat), result))
        return self.alike(external, arguments, name)

    def every(self, types: Sequence[Type], body: Callable[[tuple[Symbolic, ...]], Any]) -> Any:
        """Whether a statement holds of all values of some types: may be either."""
        return Bit(self.bits.graph.input("of all"))

    def chosen(self, low: Any, high: Any, type_: Type) -> Any:
        """Any number between the bounds, as far as these are known."""
        first, last = self.bits.number(low), self.bits.number(high)
        loose = first.loose or last.loose
        if loose or first.scale or last.scale:
            return low if low == high else self.bits.fresh("choose", type_)
        return self.bits.between("choose", first.low, last.high)


__all__ = ["BitUnknowns", "Bits", "Number"]
