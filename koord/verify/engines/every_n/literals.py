"""Literals of lemmas, and what they are worth in configurations that somebody looked at.

A literal is a truth value, a member of an enumeration, or a comparison of two integers of one
kind, of robots i and j, shared variables, and elements of fixed arrays at an index k (elements of
arrays over robots are the robots' own, and of what each robot has of each other those of the two);
or, where a program asks such things of all robots at once, that *there is* a robot of which one of
them holds; or, where robots stand in a ring, that a third robot h stands between i and j. Each can
be said in Koord, and worked out in a *snapshot*: the values that a sample or a solver's model
gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from msgspec import Struct

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL
from koord.verify.engines.every_n.bound import READ_H, READ_I, READ_J
from koord.verify.engines.every_n.conditions import UNSET, Asked, Condition

#: The position of the number of robots, which is no part.
COUNT = -2


class Snapshot(Struct):
    """The values of a configuration's parts, as far as they are known, and of conditions.

    Of a part with an index it is a tuple. ``robots`` are those known, by number; ``pairs`` is what
    each has of each; ``count`` is how many there are.
    """

    count: int
    robots: dict[int, tuple[object, ...]]
    pairs: Mapping[tuple[int, int], tuple[object, ...]]
    shared: tuple[object, ...]
    asked: Asked


#: Robots i, j and h (None: there is no other, or it is not spoken of), and the index k.
Row: TypeAlias = "tuple[int, int | None, int | None, int]"

#: The bits of robots i, j and h in what a literal is about.
OF_I, OF_J, OF_H = 1, 2, 4

#: Where they stand in a row.
PLACES = {OF_I: 0, OF_J: 1, OF_H: 2}


class Quantity(Struct, frozen=True):
    """A term: a part of robot i (1), j (2) or h (4), a shared part (0), a robot, k, a constant, N.

    Of two robots (3) it is what the ``owner`` (1 or 2) has of the other. ``look`` gives its value;
    None where it is unknown.
    """

    said: core.Expr
    of: int
    indexed: bool
    position: int = -1  #: among the parts
    value: Constant | None = None
    owner: int = 0

    def look(self, here: Snapshot, row: Row) -> object:
        if self.value is not None:
            return self.value
        if self.position == COUNT:
            return here.count
        if self.owner:
            owner, other = row[:2] if self.owner == OF_I else row[1::-1]
            if owner is None or other is None:
                return None
            return here.pairs[owner, other][self.position]
        robot = row[PLACES[self.of]] if self.of else None
        if self.of and robot is None:
            return None
        if self.position < 0:
            return robot if self.of else row[-1]
        held = here.shared if robot is None else here.robots[robot]
        found = held[self.position]
        if self.indexed:
            assert isinstance(found, tuple)
            return found[row[-1]]
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
        """The robots that it is about: the bits of i, j and h."""
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
        rows = ((robot, None, None, row[-1]) for robot in here.robots)
        return any(self.witness.look(here, each) is True for each in rows)


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
        robot = row[PLACES[self.of]] if self.of else None
        if self.of and robot is None:
            return None
        value = here.asked.get((self.position, robot, row[-1] if self.indexed else 0))
        return None if value is None else value is self.positive

    def said(self, *, denied: bool = False) -> core.Expr:
        """The literal, or its negation, in Koord."""
        e = self.condition.at(READ_J if self.of == 2 else None)
        return e if self.positive is not denied else core.Unary(UnaryOp.NOT, e, BOOL)


class Between(Struct, frozen=True):
    """That on the way round the ring from robot i to j there is h, or on that from j to i."""

    positive: bool

    cost: int = 1
    of: int = OF_I | OF_J | OF_H
    indexed: bool = False

    def look(self, here: Snapshot, row: Row) -> bool | None:
        i, j, h, _ = row
        if j is None or h is None:
            return None
        return ((i < h < j) or (h < j < i) or (j < i < h)) is self.positive

    def said(self, *, denied: bool = False) -> core.Expr:
        """The literal, or its negation, in Koord: of three different robots."""
        forth = self.positive is not denied
        i, j = (READ_I, READ_J) if forth else (READ_J, READ_I)
        ways = [_ascending(*three) for three in ((i, READ_H, j), (READ_H, j, i), (j, i, READ_H))]
        one, *others = ways
        for other in others:
            one = core.Binary(BinaryOp.OR, one, other, BOOL)
        return one


def _ascending(a: core.Expr, b: core.Expr, c: core.Expr) -> core.Expr:
    low, high = (core.Binary(BinaryOp.LT, *pair, BOOL) for pair in ((a, b), (b, c)))
    return core.Binary(BinaryOp.AND, low, high, BOOL)


#: What a disjunction consists of.
AnyLiteral: TypeAlias = "Literal | ConditionLiteral | Existence | Between"


def follows(weaker: AnyLiteral, stronger: AnyLiteral) -> bool:
    """Return whether it can be seen at once that a literal follows from another."""
    opaque = ConditionLiteral | Between
    if isinstance(weaker, opaque) or isinstance(stronger, opaque):
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
    return q.of if whose else q.of > 0, q.owner, q.position, q.indexed, q.value, q.said.type
