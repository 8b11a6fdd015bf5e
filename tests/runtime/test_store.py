"""The store that robots agree on, and values on their way in and out."""

from __future__ import annotations

from hashlib import blake2b
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.proposals import Plain, Write
from koord.runtime.shapes import (
    BOOL,
    FLOAT,
    INT,
    STRING,
    Array,
    Enumeration,
    Mapping,
    PerRobot,
    Record,
    Sequence,
    Shape,
    ShapeError,
    blank,
    from_plain,
    to_plain,
)
from koord.runtime.store import AgreedStore, Layout, Shared

ROBOTS = 3


class Item(NamedTuple):
    owner: int
    done: bool


ITEM = Record(Item, (INT, BOOL))
MODE = Enumeration("Mode", ("idle", "busy"))

LAYOUT = Layout(
    (
        Shared("own", PerRobot(Sequence(INT))),
        Shared("sum", INT),
        Shared("items", Array(ITEM, 2)),
        Shared("queue", Sequence(ITEM)),
        Shared("seen", Mapping(INT, ITEM)),
    )
)


def store() -> AgreedStore:
    made = AgreedStore(LAYOUT, ROBOTS)
    made.declare(
        {
            "own": ((), (1,), (2, 3)),
            "sum": 7,
            "items": (Item(0, False), Item(1, True)),
            "queue": (Item(5, False), Item(6, False)),
            "seen": {4: Item(4, True)},
        }
    )
    return made


# --- writes ---------------------------------------------------------------------------------------


def test_a_write_changes_its_location_alone() -> None:
    it = store()
    changed = it.apply([Write(2, (1, 0), 9), Write(0, (2, 1), 8), Write(1, (), 10)])
    assert changed == {
        "items": (Item(0, False), Item(9, True)),
        "own": ((), (1,), (2, 8)),
        "sum": 10,
    }
    assert isinstance(it.values["items"][1], Item)
    assert it.values["queue"] == (Item(5, False), Item(6, False))


def test_of_two_writes_to_a_location_the_later_one_counts() -> None:
    it = store()
    it.apply([Write(1, (), 1), Write(1, (), 2)])
    assert it.values["sum"] == 2
    it.apply([Write(3, (0, 0), 1), Write(3, (0,), (2, True)), Write(3, (0, 1), False)])
    assert it.values["queue"][0] == Item(2, False)


def test_a_write_to_a_location_that_is_no_more_is_lost() -> None:
    """[LOCATION] (decision record 0007)"""
    it = store()
    it.apply([Write(3, (), ((1, True),)), Write(3, (1, 0), 9), Write(3, (1,), (3, True))])
    assert it.values["queue"] == (Item(1, True),)


def test_a_key_is_added_even_if_another_robot_took_it_out() -> None:
    it = store()
    it.apply([Write(4, (), ()), Write(4, (4,), (2, False)), Write(4, (5,), (3, False))])
    assert list(it.values["seen"].items()) == [(4, Item(2, False)), (5, Item(3, False))]


def test_a_write_to_a_list_that_is_not_set_is_lost() -> None:
    it = AgreedStore(LAYOUT, ROBOTS)
    assert it.apply([Write(3, (0,), (1, True)), Write(4, (1,), (1, True))]) == {"seen": None}
    it.apply([Write(2, (1, 0), 3), Write(0, (1,), (4,))])
    assert it.values["items"][1] == (3, None)
    assert it.values["own"] == (None, (4,), None)


@pytest.mark.parametrize(
    "write",
    [
        Write(5, (), 1),
        Write(-1, (), 1),
        Write(1, (), 1.5),
        Write(1, (), True),
        Write(1, (), None),
        Write(1, (0,), 1),
        Write(2, (0, 2), 1),
        Write(2, (0, -1), 1),
        Write(2, ("x",), 1),
        Write(2, (True,), (1, True)),
        Write(2, (0, 0, 0), 1),
        Write(4, (1, 0), 1),
        Write(4, ("k",), (1, True)),
        Write(0, (0,), ("a",)),
        Write(3, (), 3),
    ],
)
def test_a_write_of_another_program_changes_nothing(write: Write) -> None:
    it = store()
    before = dict(it.values)
    with pytest.raises(ShapeError):
        it.apply([Write(1, (), 99), write])
    assert it.values == before


# --- digests and snapshots ------------------------------------------------------------------------


def _digest(it: AgreedStore) -> bytes:
    """What a digest is: of the whole store, written anew."""
    return blake2b(repr(it.snapshot()).encode(), digest_size=16).digest()


def test_digests_are_of_the_store_as_it_is() -> None:
    it = store()
    assert it.digest() == _digest(it) == it.digest()
    steps: tuple[list[Write], ...] = (
        [Write(1, (), 8)],
        [],
        [Write(1, (), 8)],  # another object, the same value
        [Write(0, (2, 1), 5), Write(3, (), ((1, True),))],
        [Write(4, (4,), (4, False))],
    )
    for writes in steps:
        before, after = it.digest(), it.digest_after(writes)
        assert it.digest() == before
        it.apply(writes)
        assert it.digest() == _digest(it) == after
    it.restore(store().snapshot())
    assert it.digest() == _digest(it) == store().digest()
    for variables in ((), LAYOUT.variables[:1]):
        small = AgreedStore(Layout(variables), ROBOTS)
        assert small.digest() == _digest(small) != b""


def test_stores_agree_if_and_only_if_their_digests_do() -> None:
    one, other = store(), store()
    assert one.digest() == other.digest()
    assert len(one.digest()) == 16
    one.apply([Write(2, (0, 1), True)])
    assert one.digest() != other.digest()
    other.apply([Write(2, (0,), (0, True))])
    assert one.digest() == other.digest()


def test_a_store_comes_back_from_its_snapshot() -> None:
    one, other = store(), AgreedStore(LAYOUT, ROBOTS)
    other.restore(_as_lists(one.snapshot()))
    assert other.values == one.values
    assert type(other.values["items"][0]) is Item
    unset = AgreedStore(LAYOUT, ROBOTS)
    other.restore(unset.snapshot())
    assert other.values == unset.values


def test_a_snapshot_of_another_program_is_refused() -> None:
    it = store()
    before = it.values
    for snapshot in ((), (1, 2, 3, 4, 5), None, it.snapshot()[:-1], "own"):
        with pytest.raises(ShapeError):
            it.restore(snapshot)
    assert it.values is before


# --- values ---------------------------------------------------------------------------------------

SHAPES: dict[str, Shape] = {
    "int": INT,
    "float": FLOAT,
    "bool": BOOL,
    "string": STRING,
    "mode": MODE,
    "item": ITEM,
    "items": Array(ITEM, 2),
    "per robot": PerRobot(FLOAT),
    "list of lists": Sequence(Sequence(MODE)),
    "map": Mapping(MODE, Sequence(ITEM)),
}


def values(shape: Shape) -> st.SearchStrategy[Any]:
    match shape:
        case Record(fields=fields):
            return st.tuples(*map(values, fields)).map(lambda t: Item(*t))
        case Array(element=element, size=size):
            return st.tuples(*[values(element)] * size)
        case PerRobot(element=element):
            return st.tuples(*[values(element)] * ROBOTS)
        case Sequence(element=element):
            return st.lists(values(element), max_size=3).map(tuple)
        case Mapping(key=key, value=value):
            return st.dictionaries(values(key), values(value), max_size=3)
        case Enumeration(members=members):
            return st.integers(0, len(members) - 1)
        case _:
            scalars: dict[Shape, st.SearchStrategy[Any]] = {
                INT: st.integers(),
                FLOAT: st.floats(allow_nan=False),
                BOOL: st.booleans(),
                STRING: st.text(max_size=3),
            }
            return scalars[shape]


def _as_lists(plain: Any) -> Any:
    """As codecs give tuples back."""
    return [_as_lists(part) for part in plain] if isinstance(plain, tuple) else plain


@given(st.sampled_from(sorted(SHAPES)).flatmap(lambda n: st.tuples(st.just(n), values(SHAPES[n]))))
def test_values_come_back_from_what_codecs_carry(named: tuple[str, Any]) -> None:
    shape, value = SHAPES[named[0]], named[1]
    plain = to_plain(shape, value)
    assert from_plain(shape, _as_lists(plain), ROBOTS) == value
    assert from_plain(shape, plain, ROBOTS) == value


_anything: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=2) | st.binary(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.integers(), inner, max_size=2),
    max_leaves=6,
)


@given(st.sampled_from(sorted(SHAPES)), _anything)
def test_whatever_comes_from_outside_is_a_value_or_is_refused(name: str, plain: Any) -> None:
    shape = SHAPES[name]
    try:
        value = from_plain(shape, plain, ROBOTS)
    except ShapeError:
        return
    again: Plain = to_plain(shape, value)
    assert repr(from_plain(shape, again, ROBOTS)) == repr(value)


def test_nothing_is_stored_in_a_blank_variable() -> None:
    assert blank(Array(ITEM, 2), ROBOTS) == (Item(None, None),) * 2  # type: ignore[arg-type]
    assert blank(PerRobot(Sequence(INT)), ROBOTS) == (None,) * ROBOTS
