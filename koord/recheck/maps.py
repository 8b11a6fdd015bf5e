"""Maps as SMT arrays from keys to optional values, with the number of keys. [E-MAP]

An array may have infinitely many entries, and a number that does not fit them: there are more maps
to the solver than there are. The order of keys is no part of it, and nothing goes through a map.
"""

from __future__ import annotations

from koord.recheck.sorts import Sorts, Value, entry_sort, part_name
from koord.recheck.terms import BOOL, INT, Term
from koord.syntax.types import MapType


def empty(v: Sorts, type_: MapType) -> Term:
    """A map without entries."""
    array = f"(Array {v.sort(type_.key)} {entry_sort(type_)})"
    nothing = v.t.op(f"(as const {array})", [_none(v, type_)], array)
    return _made(v, type_, nothing, v.t.integer(0))


def count(v: Sorts, value: Term, type_: MapType) -> Term:
    """The number of keys."""
    return v.t.op(part_name(type_, "count"), [value], INT)


def has(v: Sorts, value: Term, key: Value, type_: MapType) -> Term:
    """The condition that a map has a key."""
    return _is_some(v, _found(v, value, key, type_), type_)


def at(v: Sorts, value: Term, key: Value, type_: MapType) -> Value:
    """The value of a key; some value if the key is not there."""
    found = _found(v, value, key, type_)
    held = v.t.op(part_name(type_, "value"), [found], v.sort(type_.value))
    return v.unpack(held, type_.value)


def with_entry(v: Sorts, value: Term, key: Value, new: Value, type_: MapType) -> Term:
    """The map in which a key has a value."""
    entry = v.t.op(part_name(type_, "some"), [v.pack(new, type_.value)], entry_sort(type_))
    more = v.t.plus(count(v, value, type_), v.t.integer(1))
    number = v.t.ite(has(v, value, key, type_), count(v, value, type_), more)
    return _made(v, type_, _stored(v, value, key, entry, type_), number)


def without(v: Sorts, value: Term, key: Value, type_: MapType) -> Term:
    """The map without a key that it has."""
    fewer = v.t.minus(count(v, value, type_), v.t.integer(1))
    return _made(v, type_, _stored(v, value, key, _none(v, type_), type_), fewer)


def overwritten(v: Sorts, old: Term, new: Term, type_: MapType) -> Term:
    """The map with the entries of another, where they count.

    What it has under a key is worked out where that is asked: solvers do without a quantifier. Of
    how many keys it has nothing is known.
    """
    name, sort = part_name(type_, "overwritten"), v.sort(type_)
    v.declare(name, f"(declare-fun {name} ({sort} {sort}) {sort})")
    return v.t.op(name, [old, new], sort)


def bounds(v: Sorts, value: Term, type_: MapType) -> Term:
    """The facts that hold of any map."""
    return v.t.at_most(v.t.integer(0), count(v, value, type_))


def _made(v: Sorts, type_: MapType, entries: Term, number: Term) -> Term:
    return v.t.op(part_name(type_, "make"), [entries, number], v.sort(type_))


def _entries(v: Sorts, value: Term, type_: MapType) -> Term:
    array = f"(Array {v.sort(type_.key)} {entry_sort(type_)})"
    return v.t.op(part_name(type_, "entries"), [value], array)


def _found(v: Sorts, value: Term, key: Value, type_: MapType) -> Term:
    """The optional value under a key."""
    packed = v.pack(key, type_.key)
    known: dict[int, Term] = {}  # of maps, by their ids: both branches of a choice may share most

    def found(one: Term) -> Term:
        if id(one) not in known:
            known[id(one)] = looked_up(one)
        return known[id(one)]

    def looked_up(one: Term) -> Term:
        if one.head == part_name(type_, "overwritten"):
            old, new = map(found, one.args)
            return v.t.ite(_is_some(v, new, type_), new, old)
        if one.head == "ite":
            condition, then, otherwise = one.args
            return v.t.ite(condition, found(then), found(otherwise))
        return v.t.op("select", [_entries(v, one, type_), packed], entry_sort(type_))

    return found(value)


def _is_some(v: Sorts, found: Term, type_: MapType) -> Term:
    return v.t.op(f"(_ is {part_name(type_, 'some')})", [found], BOOL)


def _stored(v: Sorts, value: Term, key: Value, entry: Term, type_: MapType) -> Term:
    entries = _entries(v, value, type_)
    return v.t.op("store", [entries, v.pack(key, type_.key), entry], entries.sort)


def _none(v: Sorts, type_: MapType) -> Term:
    v.sort(type_)
    return v.t.op(part_name(type_, "none"), (), entry_sort(type_))
