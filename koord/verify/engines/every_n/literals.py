"""Literals of lemmas, and what they are worth in configurations that somebody looked at.

A literal is a truth value, a member of an enumeration, or a comparison of two integers of one
kind, of robots i and j, shared variables, and elements of fixed arrays at an index k (elements of
arrays over robots are the robots' own); or, where
a program asks such things of all robots at once, that *there is* a robot of which one of them
holds. Each can be said in Koord, and worked out in a *snapshot*: the values that a sample or a
solver's model gives.
"""

from __future__ import annotations

from typing import TypeAlias

from msgspec import Struct

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL
from koord.verify.engines.every_n.bound import READ_J
from koord.verify.engines.every_n.conditions import UNSET, Asked, Condition

#: The position of the number of robots, which is no part.
COUNT = -2


class Snapshot(Struct):
    """The values of a configuration's parts, as far as they are known, and of conditions.

    Of a part with an index it is a tuple. ``robots`` are those known, by number; ``count`` is how
    many there are.
    """

    count: int
    robots: dict[int, tuple[object, ...]]
    shared: tuple[object, ...]
    asked: Asked


#: Robots i and j (None: there is no other), and the index k.
Row: TypeAlias = "tuple[int, int | None, int]"


class Quantity(Struct, frozen=True):
    """A term: a part of robot i (1) or j (2), a shared part (0), a robot, k, a constant, N.

    ``look`` gives its value; None where it is unknown.
    """

    said: core.Expr
    of: int
    indexed: bool
    position: int = -1  #: among the parts
    value: Constant | None = None

    def look(self, here: Snapshot, row: Row) -> object:
        if self.value is not None:
            return self.value
        if self.position == COUNT:
            return here.count
        robot = row[0] if self.of == 1 else row[1]
        if self.of and robot is None:
            return None
        if self.position < 0:
            return robot if self.of else row[2]
        held = here.robots[robot] if robot is not None and self.of else here.shared
        found = held[self.position]
        if self.indexed:
            assert isinstance(found, tuple)
            return found[row[2]]
        return found


class Literal(Struct, frozen=True):
    """An atom or its negation: ``left op right``, or ``left`` is ``right``'s value."""

    left: Quantity
    op: BinaryOp
    right: Quantity
    positive: bool
    cost: int

    @property
    def of(self) -> int:
        """The robots that it is about: 1 of i, 2 of j, 3 of both."""
        return self.left.of | self.right.of

    @property
    def indexed(self) -> bool:
        return self.left.indexed or self.right.indexed

    def look(self, here: Snapshot, row: Row) -> bool | None:
        """The truth of the literal; None where it is about a robot that is unknown."""
        a, b = self.left.look(here, row), self.right.look(here, row)
        return compared(a, self.op, b, positive=self.positive)

    def said(self, *, denied: bool = False) -> core.Expr:
        """The literal, or its negation, in Koord."""
        left, right, positive = self.left.said, self.right.said, self.positive is not denied
        if left.type == BOOL:
            return left if positive else core.Unary(UnaryOp.NOT, left, BOOL)
        if self.op is BinaryOp.EQ:
            op = BinaryOp.EQ if positive else BinaryOp.NE
            return core.Binary(op, left, right, BOOL)
        if positive:
            return core.Binary(BinaryOp.LE, left, right, BOOL)
        return core.Binary(BinaryOp.LT, right, left, BOOL)


def compared(a: object, op: BinaryOp, b: object, *, positive: bool) -> bool | None:
    """The truth of a comparison of two values, or of its negation."""
    if a is None or b is None:
        return None
    if a is UNSET or b is UNSET:
        return False
    if op is BinaryOp.EQ:
        return (a == b) is positive
    assert isinstance(a, int)
    assert isinstance(b, int)
    return (a <= b) is positive


class Existence(Struct, frozen=True):
    """That there is a robot of which a literal (of robot i) holds.

    Of the robots of a snapshot that is: a robot that somebody has to find is not in it. That there
    is none is said of robot i or j.
    """

    witness: Literal

    @property
    def of(self) -> int:
        return 0

    @property
    def indexed(self) -> bool:
        return self.witness.indexed

    @property
    def cost(self) -> int:
        return self.witness.cost + 2

    def look(self, here: Snapshot, row: Row) -> bool:
        return any(self.witness.look(here, (robot, None, row[2])) is True for robot in here.robots)


class ConditionLiteral(Struct, frozen=True):
    """That a condition holds of robot i or j, or of none; or that it does not."""

    condition: Condition
    position: int
    of: int
    positive: bool

    #: What stands in a lemma instead of many robots is worth more than what is said of one.
    cost: int = 2

    @property
    def indexed(self) -> bool:
        return self.condition.indexed

    def look(self, here: Snapshot, row: Row) -> bool | None:
        robot = row[self.of - 1] if self.of else None
        if self.of and robot is None:
            return None
        value = here.asked.get((self.position, robot, row[2] if self.indexed else 0))
        return None if value is None else value is self.positive

    def said(self, *, denied: bool = False) -> core.Expr:
        """The literal, or its negation, in Koord."""
        e = self.condition.at(READ_J if self.of == 2 else None)
        return e if self.positive is not denied else core.Unary(UnaryOp.NOT, e, BOOL)


#: What a disjunction consists of.
AnyLiteral: TypeAlias = "Literal | ConditionLiteral | Existence"


def follows(weaker: AnyLiteral, stronger: AnyLiteral) -> bool:
    """Return whether it can be seen at once that a literal follows from another."""
    if isinstance(weaker, ConditionLiteral) or isinstance(stronger, ConditionLiteral):
        return weaker == stronger
    if isinstance(weaker, Literal) and isinstance(stronger, Existence):
        return False
    whose = isinstance(weaker, Literal)
    a = weaker if isinstance(weaker, Literal) else weaker.witness
    b = stronger if isinstance(stronger, Literal) else stronger.witness
    if a.op is not b.op or twin_of(a.left, whose=whose) != twin_of(b.left, whose=whose):
        return False
    if twin_of(a.right, whose=whose) == twin_of(b.right, whose=whose):
        return a.positive is b.positive
    constants = a.right.value is not None and b.right.value is not None
    return constants and a.op is BinaryOp.EQ and b.positive and not a.positive


def twin_of(q: Quantity, *, whose: bool = True) -> tuple[object, ...]:
    """What tells one quantity from another; ``whose``: also those of i from those of j."""
    return q.of if whose else q.of > 0, q.position, q.indexed, q.value, q.said.type
