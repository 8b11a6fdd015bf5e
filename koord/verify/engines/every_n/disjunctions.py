"""Disjunctions of literals that held in all samples, found where they are wanted.

A literal's truth in all samples is the bits of one integer; a disjunction holds in all of them if
the union of its literals' bits is full.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from msgspec import Struct

from koord.syntax import core
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.core import BinaryOp, PropertyKind, QuantifierKind
from koord.syntax.printing.quoting import Quoting
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import renamed
from koord.verify.claims import Claim, ClaimKind, reads_ports
from koord.verify.engines.every_n.bound import FREE_SLOT, READ_I, READ_J, I, J, K, M
from koord.verify.engines.every_n.language import Language
from koord.verify.engines.every_n.literals import (
    AnyLiteral,
    ConditionLiteral,
    Existence,
    Literal,
    Quantity,
    Row,
    Snapshot,
    compared,
    follows,
    twin_of,
)

#: Positions of literals in their language, ascending.
Disjunction = tuple[int, ...]

#: So many disjunctions, with each order of their literals, are looked at in a step of work.
_PER_STEP = 6_000

#: So many literals a disjunction has at most, where nothing longer is asked for.
USUAL = 3

#: More rows of samples are not looked at: their bits would be slow.
_MOST_ROWS = 6_000


class Looking:
    """Looking at all literals of a language at once, where each quantity is looked at once."""

    def __init__(self, language: Language) -> None:
        self._quantities: dict[tuple[object, ...], tuple[int, Quantity]] = {}
        self._others = [x for x in language.literals if not isinstance(x, Literal)]
        self._literals = [
            (self._place(x.left), x.op, self._place(x.right), x.positive)
            for x in language.literals
            if isinstance(x, Literal)
        ]

    def _place(self, q: Quantity) -> int:
        return self._quantities.setdefault(twin_of(q), (len(self._quantities), q))[0]

    def values(self, here: Snapshot, row: Row) -> tuple[object, ...]:
        """The values of quantities, and whether the literals hold that have none."""
        found = [q.look(here, row) for _, q in self._quantities.values()]
        return *found, *(x.look(here, row) for x in self._others)

    def truths(self, values: Sequence[object]) -> tuple[bool, ...]:
        """Of each literal whether it holds, in the order of the language."""
        found = [
            compared(values[a], op, values[b], positive=positive) is True
            for a, op, b, positive in self._literals
        ]
        return *found, *(holds is True for holds in values[len(self._quantities) :])


class Samples(Struct):
    """The truth of literals in sampled rows, as bits."""

    language: Language
    bits: list[int]
    full: int

    @staticmethod
    def of(language: Language, snapshots: Iterable[Snapshot]) -> Samples:
        looking = Looking(language)
        rows: set[tuple[bool, ...]] = set()
        met: set[tuple[object, ...]] = set()
        for here in snapshots:
            for row in language.rows(here):
                values = looking.values(here, row)
                if values not in met:
                    met.add(values)
                    rows.add(looking.truths(values))
            if len(rows) >= _MOST_ROWS:
                break
        bits = [_packed(column) for column in zip(*rows, strict=True)]
        return Samples(language, bits, (1 << len(rows)) - 1)

    def against(
        self, here: Snapshot, row: Row, budget: Budget = ENDLESS, most: int = USUAL
    ) -> list[Disjunction]:
        """The smallest disjunctions that held in all samples and are false in a row.

        They have at most so many literals.
        """
        false = [n for n, x in enumerate(self.language.literals) if x.look(here, row) is False]
        open_ = [n for n in false if self.bits[n]]
        budget.spend(1 + len(open_) ** most // _PER_STEP)
        found = set(self._grown((), self.full, open_, most))
        return [x for x in found if not any(x[:k] + x[k + 1 :] in found for k in range(len(x)))]

    def _grown(
        self, begun: Disjunction, without: int, rest: Sequence[int], most: int
    ) -> Iterator[Disjunction]:
        """Yield what a disjunction can be grown to, given the samples in which it does not hold."""
        bits = self.bits
        if most == 1:
            yield from ((*begun, n) for n in rest if not without & ~bits[n])
            return
        for place, n in enumerate(rest, 1):
            left = without & ~bits[n]
            if not left:
                yield (*begun, n)
            elif left != without:
                yield from self._grown((*begun, n), left, rest[place:], most - 1)


def _packed(truths: Iterable[bool]) -> int:
    return int("".join("1" if truth else "0" for truth in truths) or "0", 2)


def is_false(language: Language, x: Disjunction, here: Snapshot) -> bool:
    """Return whether a disjunction is known to be false of some robots."""
    literals = [language.literals[n] for n in x]
    return any(
        all(literal.look(here, row) is False for literal in literals) for row in language.rows(here)
    )


def canonical(language: Language, x: Disjunction) -> Disjunction:
    """One of the two ways to name the robots."""
    literals = language.literals
    swapped = tuple(sorted(language.swapped[n] for n in x))
    if any(literals[n].of and language.swapped[n] == n for n in x):
        return x
    about = [_about(literals[n] for n in one) for one in (x, swapped)]
    return min((about[0] == 2, x), (about[1] == 2, swapped))[1]


def cost(language: Language, x: Disjunction) -> tuple[int, ...]:
    """What comes first: few literals, of one robot, that compare little.

    That there is a robot is worth two: in the little that is known of a model there is hardly one.
    """
    literals = [language.literals[n] for n in x]
    there = sum(isinstance(literal, Existence) for literal in literals)
    return len(x) + there, _about(literals) == 3, sum(literal.cost for literal in literals), *x


def implied(language: Language, weaker: Disjunction, stronger: Disjunction) -> bool:
    """Return whether it can be seen at once that a disjunction follows from another."""
    literals = language.literals
    return all(any(follows(literals[a], literals[b]) for a in weaker) for b in stronger)


def _about(literals: Iterable[AnyLiteral]) -> int:
    found = 0
    for literal in literals:
        found |= literal.of
    return found


# --- in Koord -----------------------------------------------------------------------------------


def lemma(program: core.Program, language: Language, x: Disjunction) -> Claim:
    """The claim that a disjunction holds of any two robots, and any index."""
    literals = [language.literals[n] for n in x]
    condition = _implication(literals, apart=_about(literals) == 3)
    if any(literal.indexed for literal in literals):
        domain = core.IntRange(core.Const(0, INT), core.Const(language.size, INT))
        condition = core.Quantified(QuantifierKind.FORALL, K, domain, condition)
    for robot, variable in ((2, J), (1, I)):
        if _about(literals) & robot:
            condition = core.Quantified(
                QuantifierKind.FORALL, variable, core.RobotRange(), condition
            )
    text = Quoting.of(program).text(condition)
    bound = [x.condition.bound for x in literals if isinstance(x, ConditionLiteral)]
    stated = core.Property(text, PropertyKind.INVARIANT, condition, max([FREE_SLOT, *bound]))
    ports = reads_ports(program, condition)
    return Claim(text, ClaimKind.PROPERTY, stated, reads_ports=ports)


def _implication(literals: Sequence[AnyLiteral], *, apart: bool) -> core.Expr:
    """A disjunction as what follows from what."""
    rest = [x for x in literals if not isinstance(x, Existence)]
    there = [x for x in literals if isinstance(x, Existence)]
    if there:
        conclusion = _somebody(there, M if any(x.of & 2 for x in rest) else J)
    else:
        last = max(rest, key=lambda x: (x.positive, x.cost, x.of))
        rest = [x for x in rest if x is not last]
        conclusion = last.said()
    parts = [x.said(denied=True) for x in rest]
    if apart:
        parts.insert(0, core.Binary(BinaryOp.NE, READ_I, READ_J, BOOL))
    if not parts:
        return conclusion
    premise = parts[0]
    for part in parts[1:]:
        premise = core.Binary(BinaryOp.AND, premise, part, BOOL)
    return core.Binary(BinaryOp.IMPLIES, premise, conclusion, BOOL)


def _somebody(cases: Sequence[Existence], somebody: core.Variable) -> core.Expr:
    """That there is a robot of which one of the cases holds."""
    body, *others = (renamed(x.witness.said(), I, somebody) for x in cases)
    for other in others:
        body = core.Binary(BinaryOp.OR, body, other, BOOL)
    return core.Quantified(QuantifierKind.EXISTS, somebody, core.RobotRange(), body)
