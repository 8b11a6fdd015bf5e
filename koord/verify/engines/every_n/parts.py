"""The scalar parts of variables that lemmas speak of: of each robot, of each pair, of nobody."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    RecordType,
    Robots,
    Type,
)
from koord.verify.engines.every_n.bound import READ_K

SHARED = (Home.ALLREAD, Home.ALLWRITE)


class Part(Struct, frozen=True):
    """A scalar part of a variable. ``steps`` lead to it; an index stands at most once, and is k."""

    variable: core.Variable
    steps: tuple[core.Step, ...]
    type: Type
    size: int | None = None  #: of the array that k is an index of

    def at(self, robot: core.Expr | None, other: core.Expr | None = None) -> core.Expr:
        """The part as an expression, of a robot if each has it; what it has of another."""
        steps = self.steps if other is None else (core.IndexStep(other, self.type), *self.steps)
        element = element_of(self.variable)
        if element is not None:
            assert robot is not None
            own = core.IndexStep(robot, element)
            return core.Read(core.Place(self.variable, (own, *steps)))
        return core.Read(core.Place(self.variable, steps, robot=robot))


def element_of(variable: core.Variable) -> Type | None:
    """The type of each robot's element of a shared array over robots; None of anything else."""
    match variable.type:
        case ArrayType(element=element, size=Robots.ALL) if variable.home in SHARED:
            return element
    return None


def parts_of(
    variable: core.Variable, steps: tuple[core.Step, ...], type_: Type, size: int | None = None
) -> Iterator[Part]:
    match type_:
        case BoolType() | IntType() | EnumType():
            yield Part(variable, steps, type_, size)
        case RecordType(fields=fields):
            for position, (name, below) in enumerate(fields):
                step = core.FieldStep(position, name, below)
                yield from parts_of(variable, (*steps, step), below, size)
        case ArrayType(element=element, size=int(count)) if size is None:
            index = core.IndexStep(READ_K, element)
            yield from parts_of(variable, (*steps, index), element, count)
        case _:
            return


def mutual_parts(variable: core.Variable, type_: Type) -> Iterator[Part]:
    """Yield what a robot has of each other: an array over robots of scalars."""
    match type_:
        case ArrayType(element=BoolType() | IntType() | EnumType() as element, size=Robots.ALL):
            yield Part(variable, (), element)
        case _:
            return
