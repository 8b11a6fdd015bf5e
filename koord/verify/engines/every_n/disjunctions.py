"""Disjunctions of literals that held in all samples, found where they are wanted.

A literal's truth in all samples is the bits of one integer; a disjunction holds in all of them if
the union of its literals' bits is full.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from itertools import combinations
from operator import and_
from typing import TypeAlias

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.core import BinaryOp, PropertyKind, QuantifierKind
from koord.syntax.printing.quoting import Quoting
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import renamed
from koord.verify.claims import Claim, ClaimKind, reads_ports
from koord.verify.engines.every_n.bound import (
    FREE_SLOT,
    READ_H,
    READ_I,
    READ_J,
    H,
    I,
    J,
    K,
    M,
)
from koord.verify.engines.every_n.language import Language
from koord.verify.engines.every_n.literals import (
    OF_H,
    OF_I,
    OF_J,
    PLACES,
    AnyLiteral,
    Between,
    ConditionLiteral,
    Existence,
    Literal,
    Row,
    Snapshot,
    follows,
)
from koord.verify.engines.every_n.looking import Looking

#: Positions of literals in their language, ascending.
Disjunction = tuple[int, ...]

#: What is said of the robots of a row, and not that there is one.
Said: TypeAlias = Literal | ConditionLiteral | Between

#: A disjunction to be grown, the samples in which it does not hold, and the literals that may be
#: added, all of them as bits.
_Begun: TypeAlias = tuple[int, int, int]

#: So many disjunctions, with each order of their literals, are looked at in a step of work.
_PER_STEP = 6_000

#: So many literals a disjunction has at most, where nothing longer is asked for.
USUAL = 3

#: And of what is shared, and of somebody, where there are so few literals that are false.
_LONGER, _MOST_OF_NOBODY = 5, 24

#: More rows of samples are not looked at: their bits would be slow.
_MOST_ROWS = 6_000


class _Looked(Struct):
    """Which literals are false of a snapshot's robots, by the robots that they are about."""

    here: Snapshot | None = None
    false: dict[tuple[int | None, ...], list[int]] = field(default_factory=dict)


class Samples(Struct):
    """The truth of literals in sampled rows, as bits."""

    language: Language
    rows: Sequence[int]  #: which literals hold in each sample, as bits
    bits: Sequence[int]  #: the samples in which each literal holds, as bits
    full: int
    known: dict[tuple[int, int, tuple[int, ...]], list[Disjunction]] = field(default_factory=dict)
    #: The literals, by the robots that they are about.
    literals: dict[int, list[tuple[int, AnyLiteral]]] = field(default_factory=dict)
    looked: _Looked = field(default_factory=_Looked)

    @staticmethod
    def of(
        language: Language,
        snapshots: Iterable[Snapshot],
        rows_of: Callable[[Snapshot], Iterable[Row]],
    ) -> Samples:
        looking = Looking(language)
        rows: dict[int, None] = {}
        for here in snapshots:
            rows.update(dict.fromkeys(looking.truths(here, rows_of(here))))
            if len(rows) >= _MOST_ROWS:
                break
        return Samples.of_rows(language, rows)

    @staticmethod
    def of_rows(language: Language, rows: Iterable[int]) -> Samples:
        """The samples in which these literals hold, each as bits."""
        # The last one is looked at first: fewest literals hold in it, so fewest can be added.
        ordered = sorted(rows, key=int.bit_count, reverse=True)
        # Columns of rows, by way of their digits; those of the last row are the highest ones.
        width = len(language.literals)
        columns = list(zip(*(f"{row:0{width}b}" for row in reversed(ordered)), strict=True))[::-1]
        bits = [int("".join(column), 2) for column in columns]
        return Samples(language, ordered, bits, (1 << len(ordered)) - 1)

    def against(
        self,
        here: Snapshot,
        row: Row,
        budget: Budget = ENDLESS,
        most: int = USUAL,
    ) -> list[Disjunction]:
        """The smallest disjunctions of ``most`` literals that held in all samples, and not here."""
        open_ = [n for n in self._false(here, row) if self.bits[n]]
        return self._smallest(self.full, open_, most, budget)

    def of_nobody(self, here: Snapshot, budget: Budget = ENDLESS) -> list[Disjunction]:
        """The same of no robot by name, with more literals: of what is shared, and who there is."""
        row: Row = (next(iter(here.robots), 0), None, None, 0)
        literals = self.language.literals
        open_ = [
            n
            for n, x in enumerate(literals)
            if not x.of and self.bits[n] and _says_there_is(x) and x.look(here, row) is False
        ][:_MOST_OF_NOBODY]
        return self._smallest(self.full, open_, _LONGER, budget)

    def on_the_ring(self, here: Snapshot, row: Row, budget: Budget = ENDLESS) -> list[Disjunction]:
        """The same of three robots on a ring, one of which is between the others."""
        false = self._false(here, row)
        between = next(n for n in false if isinstance(self.language.literals[n], Between))
        open_ = [n for n in false if self.bits[n] and n != between]
        fewest = self._smallest(self.full & ~self.bits[between], open_, USUAL - 1, budget)
        return [tuple(sorted((between, *x))) for x in fewest if not self._holds(x)]

    def _false(self, here: Snapshot, row: Row) -> list[int]:
        """The literals that are false of a row; those of one robot are, whoever the others are."""
        if here is not self.looked.here:
            self.looked = _Looked(here)
        if not self.literals:
            for n, x in enumerate(self.language.literals):
                self.literals.setdefault(x.of, []).append((n, x))
        found: list[int] = []
        for of, literals in self.literals.items():
            key = of, row[-1], *(row[place] for bit, place in PLACES.items() if of & bit)
            false = self.looked.false.get(key)
            if false is None:
                false = [n for n, x in literals if x.look(here, row) is False]
                self.looked.false[key] = false
            found += false
        return sorted(found)

    def _smallest(
        self, without: int, open_: Sequence[int], most: int, budget: Budget
    ) -> list[Disjunction]:
        """The smallest disjunctions of some literals that hold in some samples.

        Of many an element of an array the same is false: what is said then is known.
        """
        asked = without, most, tuple(open_)
        if asked not in self.known:
            self.known[asked] = self._looked_for(without, open_, most, budget)
        return self.known[asked]

    def _looked_for(
        self, without: int, open_: Sequence[int], most: int, budget: Budget
    ) -> list[Disjunction]:
        budget.spend(1 + len(open_) ** most // _PER_STEP)
        rows = self.rows
        lacks = {1 << n: without & ~self.bits[n] for n in open_}
        found: list[Disjunction] = [(n,) for n in open_ if not lacks[1 << n]]
        # What says nothing of these samples, or all by itself, is no part of what is smaller.
        useful = sum(one for one, lacking in lacks.items() if lacking and lacking != without)
        begun: list[_Begun] = [(0, without, useful)]
        for size in range(1, most + 1):
            longer, whole = list[_Begun](), list[tuple[int, int]]()
            for x, lacking, others in begun:
                # What is missing holds in one of the samples that are left, as in all others.
                after = rows[lacking.bit_length() - 1] & others
                while after:
                    one = after & -after
                    left = lacking & lacks[one]
                    if left and size == most:
                        # The only one that may be added holds in these samples as well.
                        after &= rows[left.bit_length() - 1]
                        continue
                    after ^= one
                    others ^= one  # all with this one are looked at from here on
                    if left:
                        longer.append((x | one, left, others))
                    else:
                        whole.append((x, one))
            found += sorted(_positions(x | one) for x, one in whole if _is_smallest(x, one, lacks))
            begun = longer
        return found

    def _holds(self, x: Disjunction) -> bool:
        """Return whether a disjunction held in all samples."""
        held = 0
        for n in x:
            held |= self.bits[n]
        return held == self.full


def _is_smallest(x: int, last: int, lacks: Mapping[int, int]) -> bool:
    """Return whether a disjunction does not hold in all samples with one literal less.

    Its literals are those of ``x``, which do not hold in all samples, and the ``last`` one.
    """
    others = []
    while x:
        one = x & -x
        others.append(lacks[one])
        x ^= one
    left = lacks[last]
    if len(others) == 1:
        return left != 0
    return all(
        reduce(and_, others[:place] + others[place + 1 :], left) for place in range(len(others))
    )


def _positions(bits: int) -> Disjunction:
    """The places of the bits that are set, ascending."""
    found = []
    while bits:
        found.append((bits & -bits).bit_length() - 1)
        bits &= bits - 1
    return tuple(found)


def _says_there_is(x: AnyLiteral) -> bool:
    """Return whether a literal of no robot is about values, or that somebody is in a state."""
    return not isinstance(x, Existence) or x.witness.positive


def is_false(language: Language, x: Disjunction, here: Snapshot) -> bool:
    """Return whether a disjunction is known to be false of some robots."""
    literals = [language.literals[n] for n in x]
    rows = language.triples(here) if _about(literals) & OF_H else language.rows(here)
    return any(all(literal.look(here, row) is False for literal in literals) for row in rows)


def canonical(language: Language, x: Disjunction) -> Disjunction:
    """One of the ways to name the robots."""
    literals, ways = language.literals, [x]
    of_three = bool(_about(literals[n] for n in x) & OF_H)
    for renaming in language.renamed if of_three else language.renamed[:1]:
        named = [renaming[n] for n in x]
        if None not in named:
            ways.append(tuple(sorted(n for n in named if n is not None)))

    def worth(way: Disjunction) -> tuple[bool, int, Disjunction]:
        said = [literals[n] for n in way]
        between = sum(isinstance(x, Between) and x.positive for x in said)
        return _about(said) == OF_J, between, way

    return min(ways, key=worth)


def cost(language: Language, x: Disjunction) -> tuple[int, ...]:
    """What comes first: few literals, of one robot, that compare little.

    That there is a robot is worth two: in the little that is known of a model there is hardly one.
    """
    literals = [language.literals[n] for n in x]
    there = sum(isinstance(literal, Existence) for literal in literals)
    robots = max(1, _about(literals).bit_count())
    return len(x) + there, robots, sum(literal.cost for literal in literals), *x


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


def lemma(quoting: Quoting, language: Language, x: Disjunction) -> Claim:
    """The claim that a disjunction holds of any two or three robots, and any index."""
    literals = [language.literals[n] for n in x]
    condition = _implication(literals)
    if any(literal.indexed for literal in literals):
        domain = core.IntRange(core.Const(0, INT), core.Const(language.size, INT))
        condition = core.Quantified(QuantifierKind.FORALL, K, domain, condition)
    for robot, variable in ((OF_H, H), (OF_J, J), (OF_I, I)):
        if _about(literals) & robot:
            condition = core.Quantified(
                QuantifierKind.FORALL, variable, core.RobotRange(), condition
            )
    text = quoting.text(condition)
    bound = [x.condition.bound for x in literals if isinstance(x, ConditionLiteral)]
    stated = core.Property(text, PropertyKind.INVARIANT, condition, max([FREE_SLOT, *bound]))
    ports = reads_ports(quoting.program, condition)
    return Claim(text, ClaimKind.PROPERTY, stated, reads_ports=ports)


def _implication(literals: Sequence[AnyLiteral]) -> core.Expr:
    """A disjunction as what follows from what."""
    rest = [x for x in literals if not isinstance(x, Existence)]
    there = [x for x in literals if isinstance(x, Existence)]
    if there:
        conclusion = _somebody(there, M if any(x.of & OF_J for x in rest) else J)
    else:
        last = _conclusion(rest)
        rest = [x for x in rest if x is not last]
        conclusion = last.said()
    parts = [x.said(denied=True) for x in rest]
    parts = [*_apart(literals), *parts]
    if not parts:
        return conclusion
    premise = parts[0]
    for part in parts[1:]:
        premise = core.Binary(BinaryOp.AND, premise, part, BOOL)
    return core.Binary(BinaryOp.IMPLIES, premise, conclusion, BOOL)


def _apart(literals: Sequence[AnyLiteral]) -> list[core.Expr]:
    """That robots are different ones, where nothing else says so."""
    about = _about(literals)
    if len(literals) > 1 and any(isinstance(x, Between) for x in literals):
        return []
    robots = [read for of, read in ((OF_I, READ_I), (OF_J, READ_J), (OF_H, READ_H)) if about & of]
    return [core.Binary(BinaryOp.NE, *pair, BOOL) for pair in combinations(robots, 2)]


def _conclusion(rest: Sequence[Said]) -> Said:
    """The literal that the others imply."""
    return max(rest, key=lambda x: (not isinstance(x, Between), x.positive, x.cost, x.of))


def _somebody(cases: Sequence[Existence], somebody: core.Variable) -> core.Expr:
    """That there is a robot of which one of the cases holds."""
    body, *others = (renamed(x.witness.said(), I, somebody) for x in cases)
    for other in others:
        body = core.Binary(BinaryOp.OR, body, other, BOOL)
    return core.Quantified(QuantifierKind.EXISTS, somebody, core.RobotRange(), body)
