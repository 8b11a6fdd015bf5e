"""The context of a search: the words that Python and machine code share, and what is looked for."""

from __future__ import annotations

from msgspec import Struct

from koord.machine.code import BYTES, I64, WORD_BYTES, Code, Ir, word
from koord.syntax import core

#: The words of a context, by position. ``STATES`` and the like are addresses of tables, ``…_MOST``
#: numbers of entries from which a table is to grow, ``…_ROOM`` those that there is room for.
(
    STATES,
    STATE_COUNT,
    STATE_MOST,
    TABLE,
    TABLE_MASK,
    BEFORE,
    MIDDLES,
    MIDDLE_COUNT,
    MIDDLE_MOST,
    MIDDLE_TABLE,
    MIDDLE_MASK,
    FOUND,
    CURRENT,
    LEFT,
    STATE_ROOM,
    MIDDLE_ROOM,
    WORK,
    WORK_MOST,
    WAITING,
    WAITING_COUNT,
) = range(20)
CONTEXT_WORDS = 20

#: Why a search leaves machine code before its end (``LEFT``).
LEFT_TOO_LARGE, LEFT_FULL, LEFT_TOO_MANY = 1, 2, 3


class Goals(Struct, frozen=True):
    """What is looked for: statements, of which those ``inside`` also between turns, in this order;
    then faults; then lost updates of ``allwrite`` variables, by slot.
    """

    statements: tuple[tuple[core.Expr, int], ...] = ()
    inside: frozenset[int] = frozenset()
    on_ports: frozenset[int] = frozenset()  #: of those inside, that read what models change
    faults: bool = False
    lost: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """The number of goals."""
        return len(self.statements) + 1 + len(self.lost)

    @property
    def fault(self) -> int:
        """The number of the goal that is a fault."""
        return len(self.statements)


class Context:
    """The words of a context in the body of one function."""

    def __init__(self, code: Code, address: Ir) -> None:
        self.code = code
        self.address = address

    def get(self, field: int) -> Ir:
        """Load a word."""
        return self.code.get(self.address, WORD_BYTES * field, I64)

    def put(self, field: int, value: Ir) -> None:
        """Store a word."""
        self.code.put(self.address, WORD_BYTES * field, value)

    def add(self, field: int, value: Ir) -> None:
        """Add to a word."""
        self.put(field, self.code.b.add(self.get(field), value))

    def block(self, field: int) -> Ir:
        """The table whose address is in a word."""
        return self.code.b.inttoptr(self.get(field), BYTES)

    def leave(self, reason: int) -> None:
        """Note that the search has to leave machine code."""
        self.put(LEFT, word(reason))

    def find(self, goal: int, where: Ir) -> None:
        """Note where a goal was met, the first time."""
        b, found = self.code.b, self.block(FOUND)
        with b.if_then(b.icmp_signed("<", self.code.get(found, WORD_BYTES * goal, I64), word(0))):
            self.code.put(found, WORD_BYTES * goal, where)

    def behind(self) -> Ir:
        """What is noted of a goal that is met in the round behind the current state."""
        b = self.code.b
        return b.or_(b.shl(self.get(CURRENT), word(1)), word(1))
