"""Machine code of tables of packed states, in which states stand as they were found. [CONFIG]

A table is a block of states, one after the other, and an open hash table of their numbers plus one;
0 is an empty place. It is at most half full, so that there is always an empty place.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec import Struct

from koord.kernels import context as fields
from koord.kernels.assembling import Cells
from koord.kernels.context import Context
from koord.machine.code import BYTES, I32, I64, Code, Ir, constant, word

_FIRST, _SECOND = -7046029254386353131, -4417276706812531889


class TableFields(Struct, frozen=True):
    """The words of a context that a table has."""

    states: int
    count: int
    table: int
    mask: int
    room: int


STATE_TABLE = TableFields(
    fields.STATES, fields.STATE_COUNT, fields.TABLE, fields.TABLE_MASK, fields.STATE_ROOM
)
MIDDLE_TABLE = TableFields(
    fields.MIDDLES,
    fields.MIDDLE_COUNT,
    fields.MIDDLE_TABLE,
    fields.MIDDLE_MASK,
    fields.MIDDLE_ROOM,
)


def hash_code(module: Any, cells: Cells) -> Ir:
    """``hash(state)``: a number that depends on all cells of a state."""
    code = Code(module, "hash", (BYTES,), I64)
    code.inlined()
    b, value = code.b, word(_FIRST)
    for part in code.words(code.arguments[0], cells.state_bytes // 8):
        value = b.mul(b.xor(value, part), word(_SECOND))
        value = b.xor(value, b.lshr(value, word(32)))
    value = b.mul(value, word(_FIRST))
    b.ret(b.xor(value, b.lshr(value, word(29))))
    return code.function


def insert_code(module: Any, cells: Cells, of: TableFields, name: str, hashed: Ir) -> Ir:
    """``insert(context, state)``: the number of a state if it is new, else -1."""
    code = Code(module, name, (BYTES, BYTES), I64)
    context, state = Context(code, code.arguments[0]), code.arguments[1]
    b = code.b
    place = _sought(code, cells, context, of, state, hashed, lambda _: b.ret(word(-1)))
    count = context.get(of.count)
    with b.if_then(b.icmp_signed(">=", count, context.get(of.room))):
        context.leave(fields.LEFT_FULL)
        b.ret(word(-1))
    to = code.at(context.block(of.states), b.mul(count, word(cells.state_bytes)))
    code.copy(to, state, cells.state_bytes)
    after = b.add(count, word(1))
    code.put(context.block(of.table), b.shl(place, word(2)), b.trunc(after, I32))
    context.put(of.count, after)
    b.ret(count)
    return code.function


def lookup_code(module: Any, cells: Cells, of: TableFields, hashed: Ir) -> Ir:
    """``lookup(context, state)``: the number of a state in a table, or -1."""
    code = Code(module, "lookup", (BYTES, BYTES), I64)
    context, state = Context(code, code.arguments[0]), code.arguments[1]
    _sought(code, cells, context, of, state, hashed, code.b.ret)
    code.b.ret(word(-1))
    return code.function


def _sought(
    code: Code,
    cells: Cells,
    context: Context,
    of: TableFields,
    state: Ir,
    hashed: Ir,
    found: Callable[[Ir], object],
) -> Ir:
    """Look for a state; where it is ``found`` ends the function, else its place is given."""
    b, place = code.b, code.slot(I64)
    table, mask, states = context.block(of.table), context.get(of.mask), context.block(of.states)
    words = cells.state_bytes // 8
    b.store(b.and_(b.call(hashed, [state]), mask), place)
    mine = code.words(state, words)

    def entry() -> Ir:
        return code.get(table, b.shl(b.load(place), word(2)), I32)

    with code.while_(lambda: b.icmp_signed("!=", entry(), constant(I32, 0))):
        number = b.sub(b.zext(entry(), I64), word(1))
        theirs = code.words(code.at(states, b.mul(number, word(cells.state_bytes))), words)
        differs = word(0)
        for one, other in zip(mine, theirs, strict=True):
            differs = b.or_(differs, b.xor(one, other))
        with b.if_then(b.icmp_signed("==", differs, word(0))):
            found(number)
        b.store(b.and_(b.add(b.load(place), word(1)), mask), place)
    return b.load(place)


def rehash_code(module: Any, cells: Cells, hashed: Ir) -> Ir:
    """``rehash(states, count, table, mask)``: fill an empty table with states."""
    code = Code(module, "rehash", (BYTES, I64, BYTES, I64), I64)
    states, count, table, mask = code.arguments
    b, place = code.b, code.slot(I64)
    with code.loop(word(0), count) as number:
        state = code.at(states, b.mul(number, word(cells.state_bytes)))
        b.store(b.and_(b.call(hashed, [state]), mask), place)

        def taken() -> Ir:
            entry = code.get(table, b.shl(b.load(place), word(2)), I32)
            return b.icmp_signed("!=", entry, constant(I32, 0))

        with code.while_(taken):
            b.store(b.and_(b.add(b.load(place), word(1)), mask), place)
        entry = b.trunc(b.add(number, word(1)), I32)
        code.put(table, b.shl(b.load(place), word(2)), entry)
    b.ret(word(0))
    return code.function
