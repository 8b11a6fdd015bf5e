"""Which variables race, and who wins."""

from __future__ import annotations

import pytest

from koord.semantics.locations import Mask
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    EnumType,
    ListType,
    MapType,
    OpaqueType,
    QueueType,
    RecordType,
    Type,
    is_flat,
)
from koord.verify.encoding.choices import (
    Write,
    precedes,
    racy_variables,
    set_where_written,
    winning,
)
from koord.verify.encoding.terms import Term, Terms
from tests.semantics.building import (
    TRUE,
    Build,
    E,
    bound,
    for_each,
    for_range,
    lst,
    queue,
    when,
)

K = bound("k", 0, INT)


def shared() -> tuple[Build, E, E]:
    b = Build()
    return b, b.allwrite("x", INT, 0), b.allwrite("y", QueueType(INT), queue(INT, 1))


def racy(b: Build, *effect: core.Stmt) -> set[str]:
    b.event("Go", TRUE, *effect, bound=2)
    program = b.program()
    return {program.allwrite[slot].variable.name for slot in racy_variables(program)}


def test_what_is_written_in_atomic_blocks_only_does_not_race() -> None:
    """[T-COMMIT] [ATOMIC]"""
    b, x, y = shared()
    assert racy(b, b.atomic(x.set(1), y.append(2)), when(x.eq(y[0]))) == set()


def test_a_write_outside_of_atomic_races_wherever_it_stands() -> None:
    for number in range(7):
        b, x, y = shared()
        effect = [
            x.set(1),
            when(TRUE, x.set(1)),
            when(TRUE, otherwise=[x.set(1)]),
            for_range(K, 0, 2, x.set(K)),
            for_each(K, lst(INT, 1), x.set(K)),
            y.pop(into=x),
            when(TRUE, b.atomic(x.set(2)), x.set(1)),
        ][number]
        assert racy(b, effect) >= {"x"}, number


def test_list_operations_race_too() -> None:
    """[S-APPEND] [S-REMOVE] [S-POP]: they write the list as a whole."""
    for number in range(3):
        b, _, y = shared()
        assert racy(b, [y.append(1), y.remove(1), y.pop()][number]) == {"y"}


def test_own_entries_and_locals_do_not_race() -> None:
    """[ALLREAD]"""
    b, _, _ = shared()
    z, mine = b.allread("z", INT, 0), b.local("mine", INT, 0)
    assert racy(b, z[E(core.Pid(INT))].set(1), mine.set(2)) == set()


PAIR = RecordType("Pair", (("a", INT), ("b", BOOL)))
FLAT: list[Type] = [INT, FLOAT, PAIR, ArrayType(PAIR, 2), EnumType("M", ("a",)), OpaqueType("o")]
DEEP: list[Type] = [
    ListType(INT),
    QueueType(INT),
    MapType(INT, INT),
    ArrayType(ListType(INT), 2),
    RecordType("R", (("a", INT), ("b", MapType(INT, INT)))),
]


@pytest.mark.parametrize("type_", FLAT + DEEP, ids=str)
def test_flat_is_what_has_locations_that_are_always_there(type_: Type) -> None:
    """[LOCATION]"""
    assert is_flat(type_) is (type_ in FLAT)


def test_one_of_two_robots_comes_first() -> None:
    d = Terms()
    first = d.fresh("0<1", BOOL)
    before = {(0, 1): first}
    assert precedes(d, 0, 1, before) is first
    assert str(precedes(d, 1, 0, before)) == f"Not({first})"


def test_what_all_robots_write_is_set_whoever_wins() -> None:
    """[ATOM] [T-COMMIT]: nothing of the order is left in whether an atom is set."""
    d = Terms()
    before = {(0, 1): d.fresh("0<1", BOOL)}
    unset: Storage[Term] = Tree((Cell(False, 0), Cell(False, 0)))
    perhaps = d.fresh("perhaps", BOOL)
    some: Mask[Term] = Mask(False, (Mask(True), Mask(perhaps)))
    first: Write = (0, Tree((Cell(True, 5), Cell(perhaps, 6))), some)
    second: Write = (1, Tree((Cell(True, 7), Cell(False, 0))), Mask(False, (Mask(True), None)))
    after = winning(d, unset, [first, second], before)
    assert isinstance(after, Tree)
    both, one = after.parts
    assert isinstance(both, Cell)
    assert isinstance(one, Cell)
    assert both.is_set is True
    assert one.is_set is perhaps
    assert d.known(both.value) is None


def test_what_was_set_stays_set() -> None:
    """[ATOM]"""
    d = Terms()
    old: Storage[Term] = Cell(True, 1)
    after = set_where_written(d, old, Cell(d.fresh("odd", BOOL), 2), [Mask(False)])
    assert after == Cell(True, 2)
